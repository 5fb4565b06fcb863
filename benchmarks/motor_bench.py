"""A bench of rotors alone: ESC loops, motors, propellers and their telemetry, many flights as columns.

Four rotors of the thesis's motor (sheet 3: Tables 1-2, KV 920, R .19 Ohm, 12.4 V, true torque coefficient
2.85e-7); every rotor of every flight differs: J by 5 %, kappa_tau 3, friction 20, R 5 %. Half of the flights have
ESCs that govern speed, half are driven by duty. Wind turns up as a wandering kappa_tau, flying as thrust demands
that pulse by -55..+70 %. Take-off at 4 s after an idle of 3 s, landing and disarming in the last 3 s.

What telemetry adds: jitter of 20 % of the period, 1 % of messages lost, .2 A of noise, a gain error of 3 % and an
offset of .05 A for each ESC; the current as a snapshot, as a mean since the last message, or behind a lag, on the
motor's or the battery's side.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe, AirframeSource, Motor, Rotor
from gcs_health.samples import FlightReading, Reading, RotorReading

Array = NDArray[np.float64]

ROTORS = 4
TORQUE_CONSTANT, RESISTANCE, VOLTS = 0.01038, 0.19, 12.4
TORQUE, FRICTION, INERTIA = 2.85e-7, 9.4782e-6, 3.9876e-5
HOVER, IDLE = 550.0, 150.0  # rad/s
MOST_CURRENT, BRAKE = 30.0, 10.0  # A
BARE_INERTIA = 0.3  # of a rotor without its propeller
DT = 0.001  # s
GRID = 10  # steps between two values of demand and wind
ARMED_AT, TAKE_OFF, LANDING, CUT = 1.0, 4.0, 3.0, 1.0  # s; the last two before the end


@dataclass(frozen=True)
class Telemetry:
    """What the ESC's telemetry is like.

    rate [Hz]; current : "snapshot" or "mean"; lag of the current [s]; side : "motor" or "battery"; rpm_step
    [rpm] and current_step [A]; gain : spread of the current's gain.
    """

    rate: float = 50.0
    current: str = "snapshot"
    lag: float = 0.0
    side: str = "motor"
    rpm_step: float = 1.0
    current_step: float = 0.01
    gain: float = 0.03
    offset: float = 0.05
    noise: float = 0.2
    speed_noise: float = 0.5  # rad/s


@dataclass(frozen=True)
class Trouble:
    """What breaks: kind "none", "ejected", "partial", "friction", "undriven"; size what is left, or a factor."""

    kind: str = "none"
    size: float = math.nan
    ramp: float = 0.0  # s


@dataclass
class Bench:
    """Flights flown together; (k, B, n) histories every `DT`."""

    seeds: list[int]
    duration: float
    at: Array  # (B,) s
    rotor: NDArray[np.int64]  # (B,)
    speed: Array
    current: Array
    lagged: Array
    volts: Array
    truth: dict[str, Array] = field(default_factory=dict)  # (B, n) of each constant

    def readings(self, flight: int, telemetry: Telemetry) -> Iterator[Reading]:
        """Yield what the ground station would be told of one flight."""
        rng = np.random.default_rng((self.seeds[flight], 7))
        count = int(self.duration * telemetry.rate)
        period = 1.0 / telemetry.rate
        t = period * (np.arange(1, count) + rng.uniform(-0.2, 0.2, count - 1))
        t = t[rng.random(len(t)) > 0.01]
        t = t[t < self.duration - 2 * DT]
        grid = DT * np.arange(self.speed.shape[0])
        columns = []
        for r in range(ROTORS):
            w = np.interp(t, grid, self.speed[:, flight, r]) + rng.normal(0.0, telemetry.speed_noise, len(t))
            step = telemetry.rpm_step * math.pi / 30.0
            i = self._current(flight, r, t, grid, telemetry)
            i = i * (1.0 + telemetry.gain * rng.standard_normal()) + telemetry.offset * rng.standard_normal()
            i = i + rng.normal(0.0, telemetry.noise, len(t))
            columns.append((np.maximum(np.round(w / step) * step, 0.0), i, telemetry.current_step))
        speed = np.stack([w for w, _, _ in columns], axis=1).tolist()
        current = np.stack([np.round(i / s) * s for _, i, s in columns], axis=1).tolist()
        volts = np.interp(t, grid, self.volts[:, flight]).tolist()
        armed = [(ARMED_AT, True, True), (TAKE_OFF + 0.5, True, False), (self.duration - CUT, False, True)]
        for now, w, i, u in zip(t.tolist(), speed, current, volts, strict=True):
            while armed and armed[0][0] <= now:
                yield FlightReading(*armed.pop(0))
            yield RotorReading(now, tuple(w), tuple(i), (u,) * ROTORS)

    def _current(self, flight: int, r: int, t: Array, grid: Array, telemetry: Telemetry) -> Array:
        raw = (self.lagged if telemetry.lag else self.current)[:, flight, r]
        if telemetry.side == "battery":
            resistance = self.truth["resistance"][flight, r]
            drop = resistance * self.current[:, flight, r] + TORQUE_CONSTANT * self.speed[:, flight, r]
            raw = raw * drop / self.volts[:, flight]
        if telemetry.current == "mean":
            total = np.interp(t, grid, np.cumsum(raw) * DT)
            first = np.interp(t[0] - 1.0 / telemetry.rate, grid, np.cumsum(raw) * DT)
            return np.diff(total, prepend=first) / np.diff(t, prepend=t[0] - 1.0 / telemetry.rate)
        return np.interp(t, grid, raw)

    def airframe(self, flight: int, inertia: float = 1.0, **known: object) -> Airframe:
        """Return the craft as its vehicle file would have it: kappa_tau known to 2.5 %, J times `inertia`."""
        rng = np.random.default_rng((self.seeds[flight], 8))
        values = {
            "torque_constant": TORQUE_CONSTANT,
            "torque": TORQUE * (1.0 + 0.025 * rng.standard_normal()),
            "friction": FRICTION,
            "inertia": INERTIA * inertia,
            "resistance": RESISTANCE,
            "current_side": "motor",
        }
        return airframe(Motor(**{**values, **known}))  # type: ignore[arg-type]


def airframe(motor: Motor) -> Airframe:
    """Return a quadrotor of these motors."""
    arms = ((1.0, 1.0, 1), (-1.0, -1.0, 1), (1.0, -1.0, -1), (-1.0, 1.0, -1))
    rotors = tuple(Rotor(k + 1, k, (0.2 * x, 0.2 * y, 0.0), s, 0.14) for k, (x, y, s) in enumerate(arms))
    return Airframe("bench", rotors, AirframeSource.FILE, motor=motor)


def fly(
    seeds: list[int],
    duration: float = 60.0,
    trouble: Trouble | list[Trouble] | None = None,
    lag: float = 0.0,
    at: float | None = None,
) -> Bench:
    """Fly one flight a seed; a flight depends on its own seed and trouble alone.

    `trouble` : of all or of each. `at` [s] : when, else drawn by the seed.
    """
    each = trouble if isinstance(trouble, list) else [trouble or Trouble()] * len(seeds)
    rngs = [np.random.default_rng((seed, 1)) for seed in seeds]
    count = len(seeds)
    spread = np.stack([rng.standard_normal((4, ROTORS)) for rng in rngs])  # (B, 4, n)
    inertia = INERTIA * (1.0 + 0.05 * spread[:, 0])
    torque = TORQUE * (1.0 + 0.03 * spread[:, 1])
    friction = FRICTION * np.clip(1.0 + 0.20 * spread[:, 2], 0.4, 1.6)
    resistance = RESISTANCE * (1.0 + 0.05 * spread[:, 3])
    governed = np.array([[seed % 2 == 0] for seed in seeds])
    drawn = np.array([rng.uniform(0.35, 0.85) for rng in rngs]) * (duration - 7.0) + 3.0
    when = drawn if at is None else np.full(count, at)
    rotor = np.array([int(rng.integers(ROTORS)) for rng in rngs])
    struck = np.arange(ROTORS)[None, :] == rotor[:, None]
    opposite = np.arange(ROTORS)[None, :] == (rotor ^ 1)[:, None]
    wanted, wind = _demands(rngs, duration)
    is_kind = {
        kind: np.array([[one.kind == kind] for one in each])
        for kind in ("ejected", "partial", "friction", "undriven")
    }
    size = np.array([[1.0 if math.isnan(one.size) else one.size] for one in each])
    ramp = np.array([[one.ramp] for one in each])
    first = float(when.min()) if any([one.kind != "none" for one in each]) else math.inf
    steps = int(duration / DT)
    shape = (steps, count, ROTORS)
    out_w, out_i, out_lag = (np.empty(shape, dtype=np.float32) for _ in range(3))
    out_u = np.empty((steps, count), dtype=np.float32)
    w = np.zeros((count, ROTORS))
    integral, lagged, i = np.zeros_like(w), np.zeros_like(w), np.zeros_like(w)
    gain = INERTIA * 30.0 / TORQUE_CONSTANT
    bus = np.full((count, 1), VOLTS)
    spin = steps - round(CUT / DT)
    for k in range(steps):
        t = k * DT
        now = struck & (t >= when[:, None])
        if k % GRID == 0:
            eta, goal = wind[k // GRID], wanted[k // GRID]
            rub, moment = friction, inertia
            if t >= first:
                grown = np.clip((t - when[:, None]) / np.maximum(ramp, DT), 0.0, 1.0)
                since = np.clip((t - when[:, None]) / 0.2, 0.0, 1.0)
                gone = now & is_kind["ejected"]
                eta = np.where(gone, 0.0, eta)
                moment = np.where(gone, BARE_INERTIA * inertia, inertia)
                ask = np.where(struck, 1.0 + 0.25 * since, np.where(opposite, 1.0 - 0.25 * since, 1.0))
                goal = np.where(is_kind["ejected"], goal * ask, goal)
                chipped = now & is_kind["partial"]
                eta = np.where(chipped, eta * (1.0 - grown * (1.0 - size)), eta)
                goal = np.where(chipped, goal * (1.0 + since * (size**-0.5 - 1.0)), goal)
                rub = np.where(now & is_kind["friction"], friction * (1.0 + grown * (size - 1.0)), friction)
        error = goal - w
        integral = np.clip(integral + DT * 8.0 * gain * error, 0.0, MOST_CURRENT)
        by_speed = gain * error + integral
        steady = (TORQUE * goal * goal + FRICTION * goal) / TORQUE_CONSTANT
        by_duty = (TORQUE_CONSTANT * (goal - w) + RESISTANCE * steady) / resistance
        i = np.where(governed, by_speed, by_duty)
        if k >= spin:
            i = np.where(governed, 0.0, i)
        most = np.minimum((bus - TORQUE_CONSTANT * w) / resistance, MOST_CURRENT)
        i = np.maximum(np.minimum(i, most), -BRAKE)
        i = np.where(w > 1.0, i, np.maximum(i, 0.0))
        if t >= first:
            i = np.where(now & is_kind["undriven"], 0.0, i)
        rise = (TORQUE_CONSTANT * i - torque * eta * w * w - rub * w) / moment
        w = np.maximum(w + DT * rise, 0.0)
        lagged = lagged + (DT / lag if lag else 1.0) * (i - lagged)
        drawn = (i * (resistance * i + TORQUE_CONSTANT * w)).sum(axis=1, keepdims=True) / bus
        bus = VOLTS - 0.01 * drawn
        out_w[k], out_i[k], out_lag[k], out_u[k] = w, i, lagged, bus[:, 0]
    aloft = slice(round((TAKE_OFF + 1.0) / (GRID * DT)), round((duration - LANDING) / (GRID * DT)))
    flown = torque * wind[aloft].mean(axis=0)  # the drag that there was, this flight's wind included
    truth = {"inertia": inertia, "torque": flown, "friction": friction, "resistance": resistance}
    return Bench(seeds, duration, when, rotor, out_w, out_i, out_lag, out_u, truth)


def _demands(rngs: list[np.random.Generator], duration: float) -> tuple[Array, Array]:
    """Return wanted speeds [rad/s] and what the wind makes of kappa_tau [-], both (k, B, n) on the grid."""
    step = GRID * DT
    count = round(duration / step) + 1
    t = step * np.arange(count)
    wanted, wind = [], []
    for rng in rngs:
        trim = 1.0 + 0.08 * rng.uniform(-1.0, 1.0, ROTORS)
        thrust = np.ones((count, ROTORS)) * trim
        thrust += _wandering(rng, count, ROTORS, 0.2, 0.04, step)
        at = TAKE_OFF + 2.0
        while at < duration - LANDING - 1.0:
            width = rng.uniform(0.2, 0.6)
            size = rng.uniform(-0.55, 0.70) * (np.ones(ROTORS) if rng.random() < 0.5 else _tilt(rng))
            thrust[(t >= at) & (t < at + width)] += size
            at += width + rng.exponential(2.0)
        speed = HOVER * np.sqrt(np.maximum(thrust, 0.08))
        climb = np.clip((t - TAKE_OFF) / 1.0, 0.0, 1.0)[:, None]
        descend = np.clip((t - (duration - LANDING)) / 1.0, 0.0, 1.0)[:, None]
        aloft = climb * (1.0 - descend)
        speed = IDLE + aloft * (speed - IDLE)
        speed[(t < ARMED_AT) | (t >= duration - CUT)] = 0.0
        wanted.append(speed)
        gusts = (
            1.0 + _wandering(rng, count, 1, 3.0, 0.03, step) + _wandering(rng, count, ROTORS, 1.0, 0.03, step)
        )
        wind.append(1.0 + aloft * (gusts - 1.0))
    return np.stack(wanted, axis=1), np.stack(wind, axis=1)


def _tilt(rng: np.random.Generator) -> Array:
    """A demand that rolls or pitches: two rotors up, two down, by half of a pulse."""
    signs = ((1, -1, -1, 1), (1, -1, 1, -1))[int(rng.integers(2))]
    return 0.5 * np.array(signs, dtype=float)


def _wandering(
    rng: np.random.Generator, count: int, width: int, tau: float, sigma: float, step: float
) -> Array:
    """An Ornstein-Uhlenbeck walk, (count, width)."""
    keep = math.exp(-step / tau)
    drive = rng.standard_normal((count, width)) * sigma * math.sqrt(1.0 - keep * keep)
    out = np.empty((count, width))
    now = sigma * rng.standard_normal(width)
    for k in range(count):
        now = keep * now + drive[k]
        out[k] = now
    return out
