"""Flights of the paper's three vehicles with a truth in unbalance, for the campaign and the reproduction.

The project's simulator flies them without unbalance and without noise, since neither moves the vehicle; what
shakes the IMU is added afterwards from the flown rotor phases: the damage, residual unbalance of the healthy
propellers (0 to 10 % of the damage), speed ripple, noise, the filters on board, telemetry at any rate with
jitter, loss, stamps that are late, speeds that are wrong. So one flight serves every rate, healthy and damaged.
Each flight depends on its own seed alone.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.samples import (
    CommandReading,
    FlightReading,
    ImuFilterReading,
    ImuReading,
    Reading,
    RotorReading,
)
from gcs_health.simulate.scenario import Scenario, load_scenario
from gcs_health.simulate.world import World

NAN = math.nan
VEHICLES = {"small": "ghalamchi_small", "medium": "ghalamchi_medium", "large": "ghalamchi_large"}
DAMAGE_MG = {"small": 5.0, "medium": 40.0, "large": 40.0}  # at the tip: the paper's cut propellers
NOISE = {"small": 2.4, "medium": 0.8, "large": 0.8}  # m/s² an axis, in 0-200 Hz
RIPPLE = {"small": 0.005, "medium": 0.003, "large": 0.003}  # standard deviation of the speed, share
RIPPLE_TIME = 0.02  # s
BAND = 200.0  # Hz, that `NOISE` is spread over
LEAST_HEIGHT = 3.5  # m


@dataclass(frozen=True)
class Telemetry:
    """What arrives of a flight. Rates in Hz; `mean` [s] and `cutoff` [Hz] filter the accelerations on board."""

    imu: float = 100.0
    esc: float = 50.0
    mean: float = 0.0
    cutoff: float = 0.0
    rpm_error: float = 0.002  # standard deviation, of each rotor's scale
    rpm_step: float = 10.0
    latency: float = 0.004  # s, of the rotor speeds' stamps
    jitter: float = 0.2  # share of the IMU's step
    loss: float = 0.02
    unequal: float = 0.0  # the frame passes y with 1 - this
    speeds: bool = True
    commands: bool = False


@dataclass(frozen=True)
class Flown:
    """Flights side by side, one row a physics step.

    Attributes
    ----------
    clean : (k, 6, flights) what an IMU without noise measures [m/s², rad/s].
    phase, speed, command : (k, n, flights) [rad], [rad/s], [-]; ripple included.
    rotor : (flights,) the rotor that the damage is for. residual : (n, flights) of the healthy ones [kg m].
    mass : (flights,) [kg].
    """

    vehicle: str
    airframe: Airframe
    dt: float
    clean: np.ndarray
    phase: np.ndarray
    speed: np.ndarray
    command: np.ndarray
    rotor: np.ndarray
    residual: np.ndarray
    mass: np.ndarray
    seeds: list[int]

    def unbalance(self, flight: int, share: float = 1.0) -> np.ndarray:
        """Return (n,) m_u r_u [kg m] with `share` of the vehicle's damage; 0 = healthy."""
        out = self.residual[:, flight].copy()
        if share:
            out[self.rotor[flight]] = share * damage(self.vehicle)
        return out

    def readings(
        self, flight: int, telemetry: Telemetry, share: float = 1.0, at: float = 0.0, seed: int = 7
    ) -> Iterator[Reading]:
        """Yield one flight's readings in order of time; the damage appears at `at` [s]."""
        c = telemetry
        rng = np.random.default_rng(np.random.SeedSequence(self.seeds[flight], spawn_key=(seed,)))
        n = len(self.airframe.rotors)
        t = np.arange(len(self.clean)) * self.dt
        imu = self._shaken(flight, share, at, t)
        imu[:, 1] *= 1.0 - c.unequal
        imu[:, :2] += self._noise(c, rng, imu[:, :2].shape)
        imu[:, :2] = _on_board(imu[:, :2], c, self.dt)
        yield FlightReading(0.0, True, False)
        yield ImuFilterReading(0.0, c.mean or NAN, c.cutoff or NAN, "the benchmark")
        sent = _due(len(t), self.dt, c.imu, c.jitter, rng)
        sent = sent[rng.random(len(sent)) >= c.loss]
        esc = _due(len(t), self.dt, c.esc, 0.0, rng)
        esc = esc[rng.random(len(esc)) >= c.loss]
        step = c.rpm_step * math.pi / 30.0
        off = 1.0 + c.rpm_error * rng.standard_normal(n)
        told = (np.rint(self.speed[esc, :, flight] * off / step) * step).tolist()
        command = self.command[esc, :, flight].tolist()
        stamps = (t[esc] + c.latency).tolist()
        absent = (NAN,) * n
        j = 0
        for when, values in zip(t[sent].tolist(), imu[sent].tolist(), strict=True):
            while j < len(stamps) and stamps[j] <= when:
                if c.commands:
                    yield CommandReading(stamps[j], tuple(command[j]))
                if c.speeds:
                    yield RotorReading(stamps[j], tuple(told[j]), absent, absent)
                j += 1
            yield ImuReading(when, *values)

    def _shaken(self, flight: int, share: float, at: float, t: np.ndarray) -> np.ndarray:
        """Return (k, 6) with the vibration: (m_u r_u w² / m) (cos, s sin) of each rotor."""
        out = self.clean[:, :, flight].copy()
        before, after = self.unbalance(flight, 0.0), self.unbalance(flight, share)
        for i, rotor in enumerate(self.airframe.rotors):
            size = np.where(t < at, before[i], after[i]) / self.mass[flight] * self.speed[:, i, flight] ** 2
            out[:, 0] += size * np.cos(self.phase[:, i, flight])
            # counter-clockwise from above is about -z: from x towards -y
            out[:, 1] -= rotor.spin * size * np.sin(self.phase[:, i, flight])
        return out

    def _noise(self, c: Telemetry, rng: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
        sigma = NOISE[self.vehicle]
        if c.mean or c.cutoff:  # of the same density; else all of it arrives, whatever the rate
            sigma *= math.sqrt(0.5 / self.dt / BAND)
        return sigma * rng.standard_normal(shape)


def damage(vehicle: str) -> float:
    """Return m_u r_u of the vehicle's damage [kg m]."""
    return DAMAGE_MG[vehicle] * 1e-6 * (0.032 if vehicle == "small" else 0.1)


def scenario(vehicle: str, kind: str, seconds: float, **more: object) -> Scenario:
    """Return the scenario of a flight; `more` are changes, dots written as two underscores."""
    changes = [
        f"vehicle={VEHICLES[vehicle]}",
        f"trajectory.kind={kind}",
        f"trajectory.duration={seconds + 10.0}",
        f"trajectory.height={LEAST_HEIGHT}",
        "trajectory.lands=false",
        "wind.speed=2.0",
        "sensors.imu_integration_rate=1000.0",
        "sensors.accelerometer_noise=0.0",
        "sensors.residual_unbalance=0.0",
        *[f"{key.replace('__', '.')}={value}" for key, value in more.items()],
    ]
    return load_scenario("healthy_quad", changes)


def fly(
    vehicle: str,
    kind: str,
    seeds: list[int],
    seconds: float = 22.0,
    ripple: float = 1.0,
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0),
    **more: object,
) -> Flown:
    """Fly once for each seed; the record begins when the height is reached."""
    plan = scenario(vehicle, kind, seconds, **more)
    plan = replace(plan, vehicle=replace(plan.vehicle, lever=lever))
    world = World(plan, seeds)
    plant, dt, count = world.plant, world.dt, len(seeds)
    n = len(plant.rotors)
    rngs = [np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(6,))) for seed in seeds]
    residual = damage(vehicle) * np.stack([rng.uniform(0.0, 0.1, n) for rng in rngs], axis=1)
    rotor = np.array([int(rng.integers(n)) for rng in rngs])
    turned = np.stack([rng.uniform(0.0, 2.0 * math.pi, n) for rng in rngs], axis=1)
    first = round((plan.trajectory.flying_from + 0.5) / dt)
    steps = round(seconds / dt)
    decay = math.exp(-dt / RIPPLE_TIME)
    kick = RIPPLE[vehicle] * ripple * math.sqrt(1.0 - decay * decay)
    uneven = np.zeros((n, count))
    clean = np.zeros((steps, 6, count), dtype=np.float32)
    phase, speed, command = (np.zeros((steps, n, count)) for _ in range(3))
    for k in range(first + steps):
        world.step()
        if k < first:
            continue
        if (k - first) % 512 == 0:
            drawn = np.stack([rng.standard_normal((512, n)) for rng in rngs], axis=2)
        uneven = decay * uneven + kick * drawn[(k - first) % 512]
        w = np.array([np.broadcast_to(state.w, count) for state in plant.rotors]) * (1.0 + uneven)
        turned = turned + dt * w
        at = k - first
        clean[at] = [np.broadcast_to(value, count) for value in world.imu.latest.values]
        phase[at], speed[at] = turned, w
        command[at] = [np.broadcast_to(value, count) for value in world.controller.wanted]
    command /= plan.vehicle.motor.top
    airframe = plan.vehicle.airframe()
    mass = np.broadcast_to(plant.mass, count).copy()
    return Flown(vehicle, airframe, dt, clean, phase, speed, command, rotor, residual, mass, seeds)


def _due(count: int, dt: float, rate: float, jitter: float, rng: np.random.Generator) -> np.ndarray:
    """Return the ascending rows at which a message of that rate [Hz] is sent."""
    every = max(1, round(1.0 / (rate * dt)))
    rows = np.arange(every, count, every)
    reach = round(jitter * every / 2.0)
    if reach:
        rows = np.clip(rows + rng.integers(-reach, reach + 1, len(rows)), 0, count - 1)
    return np.unique(rows)


def _on_board(a: np.ndarray, c: Telemetry, dt: float) -> np.ndarray:
    """Low-pass with two poles, then take the running mean, as asked."""
    from scipy.signal import butter, lfilter

    if c.cutoff:
        a = lfilter(*butter(2, c.cutoff, fs=1.0 / dt), a, axis=0)
    if c.mean:
        taps = round(c.mean / dt)
        a = lfilter(np.full(taps, 1.0 / taps), 1.0, a, axis=0)
    return a
