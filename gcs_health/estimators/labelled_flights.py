"""Flights whose truth is known: what a pooled model is trained on."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gcs_health.errors import ConfigError
from gcs_health.samples import BoomReading, FlightReading, ImuFilterReading, ImuReading, Reading, RotorReading

Array = NDArray[np.float64]
BOOM = "boom"  # the channel that is each rotor's own boom sensor
IMU = ("ax", "ay", "az", "p", "q", "r")
GAP = 1.6  # sample steps beyond which a stretch ends
SHORTEST = 100  # samples that make a stretch
SPEED_STEP = 0.1  # s between rotor speeds
TURNS = 0.5  # of the usual speed: the slowest rotor of a vehicle in the air


@dataclass(frozen=True, slots=True)
class LabelledFlight:
    """A steady, gapless stretch of one flight.

    vehicle : which one of the kind. rotor : index, of no matter when k = 0. k : degradation.
    signals : of each IMU channel (n,) at the model's rate. booms : (n, rotors), NaN where there is no sensor.
    speeds : (m, rotors) rotor speeds [rad/s], if known.
    """

    vehicle: str
    rotor: int
    k: float
    signals: Mapping[str, NDArray[np.floating]]
    booms: NDArray[np.floating] | None = None
    speeds: NDArray[np.floating] | None = None

    def signal(self, channel: str, rotor: int) -> Array:
        """Return (n,): the channel as the model of `rotor` sees it."""
        if channel == BOOM:
            if self.booms is None:
                raise ConfigError(f"vehicle {self.vehicle!r}: a labelled flight without boom sensors")
            return np.asarray(self.booms[:, rotor], dtype=float)
        if channel not in self.signals:
            raise ConfigError(f"vehicle {self.vehicle!r}: a labelled flight without the channel {channel!r}")
        return np.asarray(self.signals[channel], dtype=float)

    @property
    def length(self) -> int:
        """Samples."""
        return len(self.booms) if self.booms is not None else len(next(iter(self.signals.values())))


def labelled(
    readings: Iterable[Reading], vehicle: str, rotor: int, k: float, rate: float, start: float, stop: float
) -> list[LabelledFlight]:
    """Cut a flight's readings between two times [s] into gapless stretches of one label.

    Stretches of the IMU and of the boom sensors are flights of their own. Rotor speeds are not taken: give
    them yourself where they are evenly sampled.
    """
    imu: list[list[float]] = []
    booms: list[list[float]] = []
    out: list[LabelledFlight] = []
    last = {ImuReading: math.nan, BoomReading: math.nan}

    def close(rows: list[list[float]], kind: type) -> None:
        if len(rows) >= SHORTEST:
            columns = np.array(rows)
            if kind is BoomReading:
                out.append(LabelledFlight(vehicle, rotor, k, {}, columns))
            else:
                out.append(LabelledFlight(vehicle, rotor, k, dict(zip(IMU, columns.T, strict=True))))
        rows.clear()

    for reading in readings:
        if not start <= reading.t <= stop or not isinstance(reading, ImuReading | BoomReading):
            continue
        kind = type(reading)
        rows = imu if kind is ImuReading else booms
        if not reading.t - last[kind] <= GAP / rate:
            close(rows, kind)
        rows.append(list(reading[1:]) if isinstance(reading, ImuReading) else list(reading.az))
        last[kind] = reading.t
    close(imu, ImuReading)
    close(booms, BoomReading)
    return out


@dataclass(frozen=True, slots=True)
class Label:
    """What is true of a whole flight: `rotor` (index) runs at 1 - k of its command from `since` [s] on.

    Healthy before; healthy throughout where k = 0.
    """

    rotor: int
    k: float
    since: float = math.inf


def flown(
    readings: Sequence[Reading], vehicle: str, label: Label, rate: float, settle: float = 6.0
) -> list[LabelledFlight]:
    """Cut what a labelled flight teaches out of its readings: in the air, `settle` s after take-off and onset.

    With the rotor speeds of those times at 10 Hz, in the order of the rotors, where all of them are told.
    """
    start, stop = _in_the_air(readings)
    start += settle
    if label.k > 0.0:
        start = max(start, label.since + settle)
    speeds = _even_speeds(readings, start, stop)
    cut = labelled(readings, vehicle, label.rotor, label.k, rate, start, stop)
    return [replace(flight, speeds=speeds) if flight.booms is None else flight for flight in cut]


def imu_rate(readings: Sequence[Reading]) -> float:
    """Return the usual rate of accelerations and rates [Hz]; NaN without any."""
    times = np.array([reading.t for reading in readings if isinstance(reading, ImuReading)])
    return 1.0 / float(np.median(np.diff(times))) if len(times) > 1 else math.nan


def imu_filters(readings: Sequence[Reading]) -> tuple[float, float]:
    """Return the mean [s] and cut-off [Hz] that the accelerations have passed, as last said; NaN = nothing."""
    last = next((r for r in reversed(readings) if isinstance(r, ImuFilterReading)), None)
    return (math.nan, math.nan) if last is None else (last.mean_over, last.cutoff)


def _in_the_air(readings: Sequence[Reading]) -> tuple[float, float]:
    """Return between which times [s] it flew: as the autopilot says, else as long as its rotors turned."""
    told = [r for r in readings if isinstance(r, FlightReading) and r.landed is not None]
    up = next((r.t for r in told if r.landed is False), None)
    if up is not None:
        return up, next((r.t for r in told if r.t > up and r.landed), math.inf)
    slowest = [(r.t, min(r.speed)) for r in readings if isinstance(r, RotorReading) and min(r.speed) > 0.0]
    if not slowest:
        return -math.inf, math.inf
    usual = float(np.median([speed for _, speed in slowest]))
    turning = [t for t, speed in slowest if speed > TURNS * usual]
    return turning[0], turning[-1]


def _even_speeds(readings: Sequence[Reading], start: float, stop: float) -> Array | None:
    """Return (m, rotors) speeds every 0.1 s [rad/s]; None where some rotor's are never told."""
    told = [(r.t, *r.speed) for r in readings if isinstance(r, RotorReading) and start <= r.t <= stop]
    rows = np.array(told)
    if len(rows) < 2 or not np.isfinite(rows).any(axis=0).all():
        return None
    t = np.arange(rows[0, 0], rows[-1, 0], SPEED_STEP)
    known = [np.isfinite(column) for column in rows.T[1:]]
    return np.stack(
        [np.interp(t, rows[k, 0], column[k]) for k, column in zip(known, rows.T[1:], strict=True)], axis=1
    )


Split = tuple[list[LabelledFlight], list[LabelledFlight], list[LabelledFlight]]


def split(flights: Sequence[tuple[Label, Sequence[LabelledFlight]]]) -> Split:
    """Share out whole flights: to fit, held out, and healthy ones for the threshold.

    Of the levels every other one is held out, never the first or the last; of healthy flights the first of four is
    fitted, the second held out, the others set the threshold.

    Raises
    ------
    ConfigError : too few healthy flights or levels.
    """
    healthy = [cut for label, cut in flights if label.k == 0.0]
    if len(healthy) < 3:
        raise ConfigError(f"training: expected three healthy flights at least, got {len(healthy)}")
    levels = sorted({label.k for label, _ in flights if label.k > 0.0})
    if len(levels) < 3:
        got = ", ".join(f"{k:g}" for k in levels) or "none"
        raise ConfigError(f"training: expected three levels of degradation at least, got {got}")
    held_levels = set(levels[1:-1:2])
    fitted = [one for label, cut in flights if label.k > 0.0 and label.k not in held_levels for one in cut]
    held_out = [one for label, cut in flights if label.k in held_levels for one in cut]
    fitted += [one for cut in healthy[0::4] for one in cut]
    held_out += [one for cut in healthy[1::4] for one in cut]
    return fitted, held_out, [one for cut in (*healthy[2::4], *healthy[3::4]) for one in cut]
