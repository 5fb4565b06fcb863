"""What would be found in flights like these: faults grafted at many times, each watched by a monitor of its own.

A flight is read once up to each start, where the monitor is set aside; every fault goes on from a copy of it,
so all faults and motors are judged at the same moments, and no healthy second is read twice.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.simulate.graft import Graft
from gcs_health.simulate.graft_fault import TELEMETRY, GraftFault
from gcs_health.simulate.recording import Flown, Recorded, first_pass, with_times

Array = NDArray[np.float64]
LADDER = (0.8, 0.7, 0.6, 0.5, 0.4)  # what is left of the rotor
SHAKES = (0.5, 1.0, 2.0, 4.0)  # m/s² at the flight's usual speed, whatever the vehicle weighs
DRAGS = (1.1, 1.2, 1.4, 2.0)  # factors on the current
WINDOW = 2.0  # s after the fault in which an alert counts
SLOW = ("unbalance", "drag")  # what is judged by means over many seconds
SLOW_WINDOW = 20.0  # s, for those
SLOW_SHARE = 4  # of the moments one in so many is for slow faults: each takes as much longer
ROOM, HOLE = 0.6, 0.1  # s behind a start for which verdicts may be given, but for such holes
SAID_BEFORE = 3000  # frames in which an ESC has surely spoken
Z = 1.959964  # 95 %


@dataclass(frozen=True, slots=True)
class Trial:
    """One graft: the fault's motor, the motor named first (0 = none) and how long after the fault [s]."""

    motor: int
    named: int
    delay: float

    @property
    def found(self) -> bool:
        """Whether the right motor was named."""
        return self.named == self.motor


class Rung(NamedTuple):
    """One row of the ladder: its name, effect, size (NaN = none) and what that is, and a fault for each motor."""

    name: str
    effect: str
    size: float
    size_is: str
    faults: list[GraftFault]


class Course:
    """One healthy flight, ready for faults at `starts` and slow ones at `slow_starts` [s, vehicle clock].

    Raises
    ------
    LogError : as `first_pass`.
    """

    def __init__(self, name: str, frames: list[tuple[int, bytes]], airframe: Airframe | None) -> None:
        self.name = name
        self.flown: Flown = first_pass(name, frames, airframe)
        self.starts: list[float] = []
        self.slow_starts: list[float] = []
        self._records = list(with_times(frames, default_dialect()))
        self._monitor = Monitor(MonitorConfig(airframe=airframe))
        self._waiting: dict[float, tuple[int, Monitor]] = {}

    @property
    def open_time(self) -> float:
        """How long verdicts could be given [s]."""
        steps = np.diff(self.flown.opened)
        return float(steps[steps < HOLE].sum())

    def choose(self, count: int, rng: np.random.Generator) -> int:
        """Draw up to `count` starts, some for slow faults, and fly to each; return how many there are."""
        possible = moments(self.flown.opened)
        self.starts = _drawn(possible, count, rng)
        long = [at for at in possible.tolist() if self._open_after(at) > 0.9 * SLOW_WINDOW]
        self.slow_starts = _drawn(np.array(long), math.ceil(count / SLOW_SHARE), rng)
        self._waiting = dict(self._fly_to(sorted({*self.starts, *self.slow_starts})))
        return len(self.starts)

    def _open_after(self, at: float) -> float:
        """Return for how much of the slow window behind a moment verdicts could be given [s]."""
        opened = self.flown.opened
        steps = np.diff(opened[(opened >= at) & (opened <= at + SLOW_WINDOW)])
        return float(steps[steps < HOLE].sum())

    def starts_for(self, effect: str) -> list[float]:
        """Return the moments at which faults of a kind begin."""
        return self.slow_starts if effect in SLOW else self.starts

    def _fly_to(self, starts: list[float]) -> Iterator[tuple[float, tuple[int, Monitor]]]:
        due = list(starts)
        for k, record in enumerate(self._records):
            while due and record.sender == self.flown.vehicle and record.t >= due[0]:
                yield due.pop(0), (k, self._monitor.copy())
            if not due:
                return
            self._monitor.feed(record.raw, record.stamp)

    def trial(self, start: int, fault: GraftFault) -> Trial:
        """Return what becomes of a fault at start number `start` of its kind; its own `at` is not used."""
        at = self.starts_for(fault.effect)[start]
        for event in self.alerts(at, fault, SLOW_WINDOW if fault.effect in SLOW else WINDOW):
            if event.state == "raised":
                return Trial(fault.motor, event.motor or 0, event.t - at)
        return Trial(fault.motor, 0, math.nan)

    def alerts(self, at: float, fault: GraftFault, window: float) -> Iterator[AlertEvent]:
        """Yield every step of an alert in the `window` [s] after a fault at `at`, one of the starts."""
        end = at + window
        begin, waiting = self._waiting[at]
        monitor = waiting.copy()
        records = self._until(begin, end)
        flown = replace(_weighed(self.flown), last_t=min(self.flown.last_t, end + 0.1))
        graft = Graft(flown, replace(fault, at=at - flown.first_t))
        if fault.effect == "telemetry":
            graft.edit(self._records[max(begin - SAID_BEFORE, 0) : begin])
        for stamp, raw in graft.edit(records):
            for event in monitor.feed(raw, stamp):
                if isinstance(event, AlertEvent):
                    yield event

    def _until(self, begin: int, end: float) -> list[Recorded]:
        out = []
        for record in self._records[begin:]:
            if record.sender == self.flown.vehicle and record.t > end:
                break
            out.append(record)
        return out


def moments(opened: Array) -> Array:
    """Return the times of `opened` (k,) after which verdicts may be given for `ROOM` s without a hole."""
    if len(opened) < 2:
        return opened[:0]
    holes = np.concatenate([[0], np.cumsum(np.diff(opened) > HOLE)])
    last = np.searchsorted(opened, opened + ROOM, side="right") - 1
    good = (opened[last] > opened + ROOM - HOLE) & (holes[last] == holes)
    out: Array = np.unique(opened[good])
    return out


def _drawn(possible: Array, count: int, rng: np.random.Generator) -> list[float]:
    if not len(possible):
        return []
    drawn = rng.choice(possible, size=min(count, len(possible)), replace=False)
    return sorted(float(at) for at in drawn)


def _weighed(flown: Flown) -> Flown:
    """Return the flight with a mass: unbalance sized by its acceleration cancels it, so any will do."""
    return flown if flown.airframe.mass else replace(flown, airframe=replace(flown.airframe, mass=1.0))


def faults(flown: Flown) -> list[Rung]:
    """Return the ladder: losses, unbalance, drag where currents are told, and telemetry faults."""
    motors = [rotor.motor for rotor in flown.airframe.rotors]
    rungs = [
        Rung(
            f"{left:g} left",
            "effectiveness",
            left,
            "left of the rotor",
            [GraftFault(motor, "effectiveness", 0.0, left) for motor in motors],
        )
        for left in LADDER
    ]
    usual = float(np.median(np.interp(flown.opened, flown.rotor_t, flown.speed.mean(axis=1))))
    mass = _weighed(flown).airframe.mass or 1.0
    for shake in SHAKES:
        many = [GraftFault(motor, "unbalance", 0.0, shake * mass / usual**2) for motor in motors]
        rungs.append(Rung(f"shakes {shake:g} m/s²", "unbalance", shake, "m/s² at the usual speed", many))
    powered = [rotor.motor for k, rotor in enumerate(flown.airframe.rotors) if k in flown.powered]
    for factor in DRAGS if powered else ():
        many = [GraftFault(motor, "drag", 0.0, factor) for motor in powered]
        rungs.append(Rung(f"drag x {factor:g}", "drag", factor, "factor on the current", many))
    after = dict(zip(motors, [*motors[1:], motors[0]], strict=True))
    for how in TELEMETRY:
        swapped = how == "swapped"
        many = [GraftFault(m, "telemetry", 0.0, how=how, other=after[m] if swapped else 0) for m in motors]
        rungs.append(Rung(f"telemetry {how}", f"telemetry {how}", math.nan, "", many))
    return rungs


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % Wilson interval of a share."""
    if not count:
        return 0.0, 1.0
    share = hits / count
    middle = (share + Z * Z / (2 * count)) / (1 + Z * Z / count)
    half = Z / (1 + Z * Z / count) * math.sqrt(share * (1 - share) / count + Z * Z / (4 * count * count))
    return max(middle - half, 0.0), min(middle + half, 1.0)


def median_interval(values: list[float]) -> tuple[float, float]:
    """Return the 95 % interval of a median, by order statistics; NaN for fewer than 6 values."""
    n, below, k = len(values), 0.0, 0
    while k < n // 2 and (below := below + math.comb(n, k) / 2**n) <= 0.025:
        k += 1
    if not k:
        return math.nan, math.nan
    ordered = sorted(values)
    return ordered[k - 1], ordered[n - k]
