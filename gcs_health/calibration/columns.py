"""One flight's readings as columns, and when in it the vehicle flew: what calibration works on.

Flying is told from the rotors alone (their squared speeds, or squared commands where no speeds come): above
half of their usual level, less a second at either end. *Hover* is the part of it that turns slowly and
carries its weight.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from gcs_health.gate import GRAVITY
from gcs_health.samples import (
    CommandReading,
    FlightReading,
    ImuReading,
    Reading,
    RotorReading,
    VibrationReading,
)

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

EDGE = 1.0  # s left out at either end of a flight
SMOOTH = 0.5  # s over which hover must hold
HOVER_RATE, HOVER_EXCESS = 0.6, 1.5  # rad/s, m/s²
LONGEST_GAP = 0.3  # s between rotor speeds that are joined by a line


@dataclass(frozen=True)
class FlightColumns:
    """Readings of one flight, each kind in order of time.

    Attributes
    ----------
    name : of the log.
    imu_t (k,) [s], imu (k, 6): ax, ay, az [m/s²], p, q, r [rad/s].
    rotor_t (m,) [s], speed (m, n) [rad/s], current (m, n) [A], voltage (m, n) [V]; NaN = nothing new.
    command_t (c,) [s], command (c, n) [-].
    vibration_t (v,) [s], vibration (v, 3) [m/s²].
    landed (l, 2): time [s], and 1 where the autopilot says that it stands on the ground.
    """

    name: str
    imu_t: Array
    imu: Array
    rotor_t: Array
    speed: Array
    current: Array
    voltage: Array
    command_t: Array
    command: Array
    vibration_t: Array
    vibration: Array
    landed: Array

    @property
    def rotors(self) -> int:
        """Number of rotors."""
        return int(self.speed.shape[1])

    @cached_property
    def has_speeds(self) -> bool:
        """Whether every rotor told its speed."""
        return bool(len(self.speed)) and bool((np.isfinite(self.speed).sum(axis=0) > 10).all())

    def squares_at(self, t: Array) -> Array:
        """Squared speeds (len(t), n) [(rad/s)²] at times t, NaN beyond the data or in a gap."""
        out = np.full((len(t), self.rotors), np.nan)
        for i in range(self.rotors):
            known = np.isfinite(self.speed[:, i])
            times = self.rotor_t[known]
            if len(times) < 2:
                continue
            out[:, i] = np.interp(t, times, self.speed[known, i], np.nan, np.nan) ** 2
            after = np.clip(np.searchsorted(times, t), 1, len(times) - 1)
            out[times[after] - times[after - 1] > LONGEST_GAP, i] = np.nan
        return out

    def flying(self, t: Array) -> Flags:
        """Whether the vehicle flew at times t."""
        load_t, load = self._load
        if len(load) < 2:
            return np.zeros(len(t), dtype=bool)
        usual = float(np.median(load[load > 0.25 * load.max()]))
        up = np.interp(t, load_t, (_smooth(load_t, load, SMOOTH) > 0.5 * usual).astype(float), 0.0, 0.0) > 0.5
        if len(self.landed) and not self.landed[:, 1].all():  # else it never heard of the take-off
            said = np.searchsorted(self.landed[:, 0], t, side="right") - 1
            up &= ~((said >= 0) & (self.landed[said, 1] > 0.5))
        return _shrunk(t, up, EDGE)

    def hovering(self, t: Array) -> Flags:
        """Whether the vehicle flew and neither turned nor climbed hard at times t."""
        rates = np.abs(self.imu[:, 3:5]).max(axis=1) if len(self.imu) else np.zeros(0)
        lift = np.abs(self.imu[:, 2] + GRAVITY) if len(self.imu) else np.zeros(0)
        if not len(rates):
            return self.flying(t)
        calm_rates = np.interp(t, self.imu_t, _smooth(self.imu_t, rates, SMOOTH)) < HOVER_RATE
        level = np.abs(self.imu[:, 2] + GRAVITY)
        known = np.isfinite(level)
        if not known.any():
            return self.flying(t) & calm_rates
        smooth = _smooth(self.imu_t[known], self.imu[known, 2], SMOOTH)
        calm_lift = np.abs(np.interp(t, self.imu_t[known], smooth) + GRAVITY) < HOVER_EXCESS
        return self.flying(t) & calm_rates & calm_lift if lift.size else self.flying(t)

    @cached_property
    def _load(self) -> tuple[Array, Array]:
        """Times and mean squared speeds, or mean squared commands."""
        if self.has_speeds:
            squares = self.squares_at(self.rotor_t)
            known = np.isfinite(squares).all(axis=1)
            return self.rotor_t[known], squares[known].mean(axis=1)
        known = np.isfinite(self.command).all(axis=1) if len(self.command) else np.zeros(0, dtype=bool)
        return self.command_t[known], (self.command[known] ** 2).mean(axis=1)


def columns(name: str, readings: Iterable[Reading], rotors: int) -> FlightColumns:
    """Gather a flight's readings; what is not newer than the last of its kind is left out."""
    rows: dict[type, list[tuple[float, ...]]] = {}
    last: dict[type, float] = {}
    for reading in readings:
        kind = type(reading)
        if not reading.t > last.get(kind, -np.inf):
            continue
        last[kind] = reading.t
        if isinstance(reading, RotorReading):
            row: tuple[float, ...] = (reading.t, *reading.speed, *reading.current, *reading.voltage)
        elif isinstance(reading, CommandReading):
            row = (reading.t, *reading.command)
        elif isinstance(reading, FlightReading):
            row = (reading.t, float(bool(reading.landed)))
        elif isinstance(reading, ImuReading | VibrationReading):
            row = tuple(reading)
        else:
            continue
        rows.setdefault(kind, []).append(row)

    def table(kind: type, width: int) -> Array:
        return np.array(rows.get(kind, []), dtype=float).reshape(-1, width)

    imu, rotor = table(ImuReading, 7), table(RotorReading, 1 + 3 * rotors)
    command, vibration = table(CommandReading, 1 + rotors), table(VibrationReading, 4)
    return FlightColumns(
        name,
        imu[:, 0],
        imu[:, 1:],
        rotor[:, 0],
        rotor[:, 1 : 1 + rotors],
        rotor[:, 1 + rotors : 1 + 2 * rotors],
        rotor[:, 1 + 2 * rotors :],
        command[:, 0],
        command[:, 1:],
        vibration[:, 0],
        vibration[:, 1:],
        table(FlightReading, 2),
    )


def _smooth(t: Array, values: Array, width: float) -> Array:
    """Return the running mean over `width` [s] about each time."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    first = np.searchsorted(t, t - width / 2)
    last = np.searchsorted(t, t + width / 2, side="right")
    return np.asarray((total[last] - total[first]) / (last - first))


def _shrunk(t: Array, up: Flags, edge: float) -> Flags:
    """Return `up` without `edge` seconds at either end of each of its spans."""
    change = np.flatnonzero(np.diff(np.concatenate([[False], up, [False]]).astype(int)))
    out = np.zeros(len(t), dtype=bool)
    for first, last in zip(change[::2], change[1::2] - 1, strict=True):
        out |= (t >= t[first] + edge) & (t <= t[last] - edge)
    return out
