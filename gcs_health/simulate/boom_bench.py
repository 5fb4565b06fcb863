"""A hexacopter on bending booms in gusts, many flights at once, finely enough for a sensor at a boom's tip.

The vehicle of Dutta et al. (2023): rotor 1 in front, 2 right of it, and so on around; 5 m/s ahead. What the
flight simulator steps at 1 kHz is here linear, and exact in its modes, at the paper's 10 kHz or, by default, at
the third of it that the sensors have:

    M q'' + C q' + K q = P f       q = heave, roll, pitch and two bending modes of each boom
    f_i = kappa_T W_i² (1 + a_i sin(th_i + ..) + b_i sin(2 th_i + ..)) - D W_i (tip's velocity + gust)
    W_i' = ((1 - k_i) W_i,cmd - W_i) / tau,      th_i' = W_i
    W_cmd = W_h (1 + u_0 - sin(psi) u_R + cos(psi) u_P + s u_Y)      the paper's four controls, eq. (2)

so that a slowed rotor, the controller's answer to it, the rotors' lines and the booms' damping by their rotors
are there. Speed deficits to the mean in steady flight at k = .2, .4, .6, .8: 7.7, 18, 33, 57 %, as in sheet 4.
Gusts are Dryden's with the paper's length; line strengths and gains are assumptions (sheet 4 section 5).
"""

import math

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe, AirframeSource, Rotor
from gcs_health.gate import GRAVITY
from gcs_health.simulate.boom_flights import IMU_MEAN, ROTORS, SPEED_STEP, Bench, BenchFlights, Plan
from gcs_health.simulate.booms import MODES, modes, participation
from gcs_health.simulate.vehicle import load_sim_vehicle

__all__ = ["ROTORS", "SPEED_STEP", "Bench", "BenchFlights", "Plan", "airframe", "fly_bench"]

Array = NDArray[np.float64]
AHEAD = 5.0  # m/s, airspeed
GUST_LENGTH = 0.6096  # m, hub to hub
LAG = 0.033  # s, of a rotor's speed
ONE_REV, BLADE_PASS = 0.01, 0.03  # of thrust
TRIM_MOMENT = 0.03  # nose-up, of weight times arm: what 5 m/s ask of the pitch control
CONTROL_STEP = 0.002  # s
RPM_NOISE = 15.0 * math.pi / 30.0  # rad/s
DRAG = 0.35  # 1/s, of the body in plane
INFLOW = 4.6  # thrust lost per advance ratio, by blade elements; speeds then swing by 3 % per m/s of gusts


def airframe() -> Airframe:
    """Return the geometry: rotor 1 in front, clockwise seen from above."""
    vehicle = load_sim_vehicle("dutta_hexa")
    rotors = tuple(
        Rotor(i + 1, i, (float(x), float(y), 0.0), 1 if i % 2 else -1, vehicle.rotors[0].radius)
        for i, (x, y) in enumerate(_seats(_arm()))
    )
    return Airframe("Hexacopter of Dutta", rotors, AirframeSource.FILE, mass=vehicle.mass)


def fly_bench(plans: list[Plan], bench: Bench) -> BenchFlights:
    """Fly them all, side by side."""
    flight = _Flight(plans, bench)
    return flight.fly()


def _arm() -> float:
    return math.hypot(*load_sim_vehicle("dutta_hexa").rotors[0].position[:2])


def _seats(arm: float) -> Array:
    psi = np.arange(ROTORS) * math.pi / 3.0
    return arm * np.stack([np.cos(psi), np.sin(psi)], axis=1)


class _Structure:
    """Heave (up), roll, pitch and the modes of all booms, in exact steps of `dt`."""

    def __init__(self, dt: float) -> None:
        from scipy.linalg import expm

        vehicle = load_sim_vehicle("dutta_hexa")
        boom = vehicle.boom
        assert boom is not None
        frequencies, tip = modes(boom)
        shear, bending = participation(boom)
        arm = _arm()
        seats = _seats(arm)
        n = 3 + MODES * ROTORS
        M, K, C = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
        M[:3, :3] = np.diag([vehicle.mass, *vehicle.inertia[:2]])
        tips = np.zeros((ROTORS, n))  # upward displacement of each tip
        tips[:, 0], tips[:, 1], tips[:, 2] = 1.0, -seats[:, 1], seats[:, 0]
        root = arm - boom.length
        for i in range(ROTORS):
            ahead, right = seats[i] / arm
            for k in range(MODES):
                j = 3 + MODES * i + k
                M[j, j] = 1.0
                M[0, j] = M[j, 0] = shear[k]
                lever = root * shear[k] + bending[k]
                M[1, j] = M[j, 1] = -right * lever
                M[2, j] = M[j, 2] = ahead * lever
                K[j, j] = frequencies[k] ** 2
                C[j, j] = 2.0 * boom.damping * frequencies[k]
                tips[i, j] = tip[k]
        inverse = np.linalg.inv(M)
        zero, one = np.zeros((n, n)), np.eye(n)
        A = np.block([[zero, one], [-inverse @ K, -inverse @ C]])
        push = np.concatenate([tips.T, np.eye(n)[:, :3]], axis=1)  # six forces at the tips, three on the body
        B = np.concatenate([np.zeros((n, ROTORS + 3)), inverse @ push])
        size = 2 * n
        whole = expm(np.block([[A, B], [np.zeros((ROTORS + 3, size + ROTORS + 3))]]) * dt)
        self.step = np.ascontiguousarray(whole[:size])
        self.tips = np.concatenate([np.zeros((ROTORS, n)), tips], axis=1)  # their velocity
        rows = np.concatenate([np.eye(n)[:3], tips])
        self.out = rows @ np.concatenate([A, B], axis=1)[n:]  # accelerations: heave, roll, pitch, six tips
        self.n = n


class _Gusts:
    """Dryden's filters on columns: along, across, down, and the vertical gust's slope ahead and right."""

    def __init__(self, rngs: list[np.random.Generator], dt: float, sigma: float) -> None:
        from scipy.signal import bilinear

        self._rngs = rngs
        time = GUST_LENGTH / AHEAD
        keep = math.exp(-dt / time)
        self._first = (np.array([sigma * math.sqrt(1.0 - keep * keep)]), np.array([1.0, -keep]))
        b, a = bilinear([math.sqrt(3.0) * time, 1.0], [time * time, 2.0 * time, 1.0], 1.0 / dt)
        impulse = _impulse(b, a, round(12.0 * time / dt))
        self._second = (b * sigma / math.sqrt(float(impulse @ impulse)), a)
        self._state = [np.zeros((len(self._filter(row)[1]) - 1, len(rngs))) for row in range(5)]
        self.block(round(8.0 * time / dt))  # until the filters have forgotten their start

    def block(self, count: int) -> Array:
        """Return (count, 5, flights)."""
        from scipy.signal import lfilter

        noise = np.stack([rng.standard_normal((count, 5)) for rng in self._rngs], axis=2)
        for row in range(5):
            b, a = self._filter(row)
            noise[:, row], self._state[row] = lfilter(b, a, noise[:, row], axis=0, zi=self._state[row])
        noise[:, 3:] *= 0.5 / _arm()  # half the gust's strength at a rotor's seat
        return noise

    def _filter(self, row: int) -> tuple[Array, Array]:
        return self._second if row else self._first


def _impulse(b: Array, a: Array, count: int) -> Array:
    from scipy.signal import lfilter

    start = np.zeros(count)
    start[0] = 1.0
    return np.asarray(lfilter(b, a, start))


class _Flight:
    """All flights: state and step."""

    def __init__(self, plans: list[Plan], bench: Bench) -> None:
        vehicle = load_sim_vehicle("dutta_hexa")
        self.plans, self.bench = plans, bench
        count = self.count = len(plans)
        self.dt = 3e-4 / bench.oversample
        motor = vehicle.motor
        self.structure = _Structure(self.dt)
        rngs = [np.random.default_rng(np.random.SeedSequence((p.vehicle, p.seed, 1))) for p in plans]
        self.gusts = _Gusts(rngs, self.dt, bench.gusts)
        self.noise = np.random.default_rng(np.random.SeedSequence([p.seed for p in plans]))
        own = [np.random.default_rng(np.random.SeedSequence((p.vehicle, 77))) for p in plans]
        draws = np.stack([rng.standard_normal((5, ROTORS)) for rng in own], axis=2)
        phases = np.stack([rng.uniform(0.0, 2.0 * math.pi, (ROTORS,)) for rng in rngs], axis=1)
        self.one = ONE_REV * np.exp(0.3 * draws[0])
        self.blade = BLADE_PASS * np.exp(0.2 * draws[1])
        self.one_at, self.blade_at = draws[2] * math.pi, draws[3] * math.pi
        self.kappa = motor.thrust * (1.0 + 0.01 * draws[4])
        self.hover = vehicle.hover
        self.speed = np.full((ROTORS, count), self.hover)
        self.phase = phases
        self.damping = motor.thrust * INFLOW / (vehicle.rotors[0].radius or 0.1)
        self.mass, self.inertia = vehicle.mass, vehicle.inertia
        self.torque = motor.torque
        self.left = np.ones((ROTORS, count))
        arm = _arm()
        self.x, self.y = (column[:, None] for column in _seats(arm).T)
        self.spin = np.array([rotor.spin for rotor in airframe().rotors], dtype=float)[:, None]
        self.state = np.zeros((2 * self.structure.n + ROTORS + 3, count))
        self.level = np.zeros((8, count))  # u, v, r, psi and the integrals of heave, roll, pitch, yaw
        self.drift = np.zeros((2, count))
        self.command = np.full((ROTORS, count), self.hover)
        self.mix = np.concatenate([np.ones((ROTORS, 1)), -self.y / arm, self.x / arm, self.spin], axis=1)
        each = vehicle.mass * GRAVITY / ROTORS
        # what one unit of each control does: lift, moments [1/s²]
        self.authority = np.array(
            [
                2.0 * GRAVITY,
                6.0 * each * arm / vehicle.inertia[0],
                6.0 * each * arm / vehicle.inertia[1],
                12.0 * motor.torque * self.hover**2 / vehicle.inertia[2],
            ]
        )[:, None]
        self.gyro = np.zeros((3, count))

    def fly(self) -> BenchFlights:
        """Step through the whole flight, recording as the sensors do."""
        b, n = self.bench, self.structure.n
        over = b.oversample
        total = round(b.duration / self.dt) // over * over
        samples, count = total // over, self.count
        acceleration = np.empty((samples, 9, count), dtype=np.float32)  # heave, rolling, pitching, tips
        motion = np.empty((samples, 5, count), dtype=np.float32)  # ax, ay, p, q, r
        keep = round(b.speed_step / 3e-4) * over
        speeds, commands = [], []
        control = max(1, round(CONTROL_STEP / self.dt))
        gusts = np.empty((0, 5, count))
        filtered = _Decimation(over, 9 * count)
        for k in range(total):
            at = k % 2048
            if at == 0:
                gusts = self.gusts.block(2048)
            if k * self.dt >= b.onset and k % control == 0:
                for flight, plan in enumerate(self.plans):
                    self.left[plan.rotor, flight] = 1.0 - plan.k
            if k % control == 0:
                self._control(control * self.dt)
            gust = gusts[at]
            self._step(gust)
            raw = self.structure.out @ self.state
            if over > 1:
                filtered.push(raw)
            if (k + 1) % over == 0:
                sample = k // over
                acceleration[sample] = filtered.value().reshape(9, count) if over > 1 else raw
                level = self.level
                motion[sample, 0] = DRAG * (gust[0] - level[0])
                motion[sample, 1] = DRAG * (gust[1] - level[1])
                motion[sample, 2:4] = self.state[n + 1 : n + 3]
                motion[sample, 4] = level[2]
            if (k + 1) % keep == 0:
                speeds.append(np.abs(self.speed + self.noise.normal(0.0, RPM_NOISE, self.speed.shape)))
                commands.append(self.command.copy())
        return self._recorded(acceleration, motion, np.array(speeds), np.array(commands))

    def _recorded(
        self, acceleration: NDArray[np.float32], motion: NDArray[np.float32], speed: Array, command: Array
    ) -> BenchFlights:
        """Add noise, turn up into down, and average as PX4 does."""
        b, samples, count = self.bench, len(acceleration), self.count
        force = acceleration[:, [0, 3, 4, 5, 6, 7, 8]]
        force = -force - np.float32(GRAVITY)
        force += self.noise.standard_normal(force.shape, dtype=np.float32) * np.float32(b.noise)
        motion[:, :2] += self.noise.standard_normal((samples, 2, count), dtype=np.float32) * np.float32(
            b.noise
        )
        motion[:, 2:] += self.noise.standard_normal((samples, 3, count), dtype=np.float32) * np.float32(
            b.gyro_noise
        )
        rate = 1.0 / (b.oversample * self.dt)
        # 5 ms are 16 2/3 samples: means between the nearest ones
        edges = np.round(np.arange(0.0, samples / rate, IMU_MEAN) * rate).astype(int)
        six = np.concatenate([motion[:, :2], force[:, :1], motion[:, 2:]], axis=1)
        whole = edges[edges < samples]
        lengths = np.diff(np.append(whole, samples))[:, None, None]
        imu = np.asarray(np.add.reduceat(six, whole, axis=0) / lengths, dtype=np.float32)
        hub = np.concatenate([force[:, :1], motion[:, 2:4]], axis=1)
        narrow = np.float32
        return BenchFlights(
            tuple(self.plans), b, rate, hub, force[:, 1:], imu, speed.astype(narrow), command.astype(narrow)
        )

    def _step(self, gust: Array) -> None:
        dt, n = self.dt, self.structure.n
        state, level = self.state, self.level
        self.speed += (self.left * self.command - self.speed) * (dt / LAG)
        w = self.speed
        self.phase += dt * w
        sink = self.structure.tips @ state[: 2 * n]  # the tip's velocity, upward
        sink += gust[2] + gust[3] * self.x + gust[4] * self.y
        lines = 1.0 + self.one * np.sin(self.phase + self.one_at)
        lines += self.blade * np.sin(2.0 * self.phase + self.blade_at)
        force = w * (self.kappa * w * lines - self.damping * sink)
        state[2 * n : 2 * n + ROTORS] = force
        state[2 * n + ROTORS] = -self.mass * GRAVITY
        state[2 * n + ROTORS + 2] = TRIM_MOMENT * self.mass * GRAVITY * self.x[0]
        state[: 2 * n] = self.structure.step @ state
        yaw = (self.spin * (self.torque * w * w)).sum(axis=0) / self.inertia[2]
        u, v, r, psi = level[:4]
        roll, pitch = state[1], state[2]
        level[0] = u + dt * (-GRAVITY * pitch + DRAG * (gust[0] - u))
        level[1] = v + dt * (GRAVITY * roll + DRAG * (gust[1] - v))
        level[2] = r + dt * (yaw - 0.5 * r)
        level[3] = psi + dt * r

    def _control(self, dt: float) -> None:
        """Velocity, attitude, rate; heave and heading: gains as in `controller.py`, softened for the booms."""
        n, state, level = self.structure.n, self.state, self.level
        measured = np.stack([state[n + 1], state[n + 2], level[2]])
        measured = measured + self.noise.normal(0.0, 0.02, measured.shape)
        self.gyro += (measured - self.gyro) * min(1.0, 250.0 * dt)
        p, q, r = self.gyro
        self.drift += dt * 0.05 * level[:2]
        roll = np.clip(-0.10 * level[1] - self.drift[1], -0.3, 0.3)
        pitch = np.clip(0.10 * level[0] + self.drift[0], -0.3, 0.3)
        wanted = np.stack(
            [
                3.0 * (-1.2 * state[0] - state[n]),
                12.0 * (5.0 * (roll - state[1]) - p),
                12.0 * (5.0 * (pitch - state[2]) - q),
                3.0 * (-1.0 * level[3] - r),
            ]
        )
        error = wanted / np.array([3.0, 12.0, 12.0, 3.0])[:, None]
        level[4:8] += dt * np.array([1.5, 20.0, 20.0, 1.0])[:, None] * error
        self.command = self.hover * (1.0 + self.mix @ ((wanted + level[4:8]) / self.authority))
        np.clip(self.command, 0.0, 2.0 * self.hover, out=self.command)


class _Decimation:
    """Low pass at 1600 Hz before a third of the samples is kept (Dutta et al., "Non-Parametric Analysis")."""

    def __init__(self, over: int, width: int) -> None:
        from scipy.signal import firwin

        self._taps = firwin(31, 1600.0, fs=over / 3e-4) if over > 1 else np.ones(1)
        self._ring = np.zeros((len(self._taps), width))
        self._at = 0

    def push(self, raw: Array) -> None:
        """Take one physics step's values."""
        self._ring[self._at] = raw.ravel()
        self._at = (self._at + 1) % len(self._ring)

    def value(self) -> Array:
        """Return the filtered values now."""
        return np.asarray(np.roll(self._taps, self._at) @ self._ring)
