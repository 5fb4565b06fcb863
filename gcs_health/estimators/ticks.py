"""Readings onto ticks: blocks of IMU messages, and each rotor's speed at any time.

Source: sheet 1 section 7, steps 1 and 2. Rotor speeds are interpolated where an ESC sample lies on
both sides of a tick; beyond the last sample they are held, and the caller must know (`covered`) so
that it can lend such a tick the covariance of its age and compute it again when the sample comes.
"""

import math
from collections.abc import Sequence
from operator import add
from typing import NamedTuple

from gcs_health.samples import ImuReading, RotorReading, new_tuple

MOST = 1e4  # m/s², rad/s: beyond any airframe; larger values are damage
FASTEST = 1e5  # rad/s, likewise


class Tick(NamedTuple):
    """The mean of one block of IMU messages; `t` is the mean of their times [s]."""

    t: float
    ax: float  # specific force [m/s²]
    ay: float
    az: float
    p: float  # body rates [rad/s]
    q: float
    r: float


class UsualStep:
    """The usual time between messages: median of the last nine, so that no gap and no burst moves it."""

    def __init__(self) -> None:
        self.value = math.nan  # [s]
        self._recent: list[float] = []

    def feed(self, dt: float) -> bool:
        """Take one step, > 0 [s]; return whether `value` may have changed."""
        recent = self._recent
        recent.append(dt)
        count = len(recent)
        if count >= 9:
            self.value = sorted(recent)[4]
            recent.clear()
        elif self.value != self.value:
            self.value = dt
        elif count == 3:
            self.value = min(self.value, sorted(recent)[1])  # the very first step may have been a gap
        else:
            return False
        return True


def plausible(reading: ImuReading) -> bool:
    """Whether every value is a number and a flying thing could have made it: no NaN, nothing absurd."""
    _, ax, ay, az, p, q, r = reading
    return (
        -MOST < ax < MOST
        and -MOST < ay < MOST
        and -MOST < az < MOST
        and -MOST < p < MOST
        and -MOST < q < MOST
        and -MOST < r < MOST
    )


class ImuBlocks:
    """Averages a fast IMU to blocks of about `length` s; passes one slower than that on unchanged.

    A block never spans a gap. Readings that are not finite or not newer than the last are dropped and
    counted in `dropped`.

    Attributes
    ----------
    per_block : messages averaged into one tick.
    tick_length : usual time between ticks [s], NaN before the second message.
    """

    def __init__(self, length: float) -> None:
        self.length = length  # [s]
        self.per_block = 1
        self.tick_length = math.nan
        self._step = UsualStep()
        self.last_t = -math.inf
        self.dropped = 0
        self._totals: Sequence[float] = ()  # of the readings of the block
        self._count = 0

    def feed(self, reading: ImuReading) -> Tick | None:
        """Take one message; return the block that it completes, if any."""
        t = reading.t
        if not (t > self.last_t and plausible(reading)):
            self.dropped += 1
            return None
        done = None
        dt = t - self.last_t
        self.last_t = t
        if dt < math.inf:
            if self._step.feed(dt):
                # at 150 Hz and below every message is a tick
                self.per_block = max(1, int(self.length / self._step.value + 0.5))
                self.tick_length = self._step.value * self.per_block
            if self._count and dt > 2.5 * self._step.value and dt > 0.5 * self.length:
                done = self._flush()
        self._totals = list(map(add, self._totals, reading)) if self._count else reading
        self._count += 1
        if done is None and self._count >= self.per_block:
            done = self._flush()
        return done

    @property
    def step(self) -> float:
        """Usual time between messages [s], NaN before the second."""
        return self._step.value

    def _flush(self) -> Tick:
        share = 1.0 / self._count
        self._count = 0
        return new_tuple(Tick, [share * total for total in self._totals])


class RotorTrack:
    """The recent speed samples of each rotor.

    As long as every reading carries every rotor, samples are kept as rows, which is several times faster;
    a reading that does not, as with ESC messages of four, turns them into one list a rotor.

    Attributes
    ----------
    covered : time up to which every rotor's speed is bracketed by samples [s]; -inf while one has none.
    interval : usual time between samples [s], NaN while unknown.
    late : readings or samples dropped because they were not newer than the last.
    """

    KEPT = 48  # samples a rotor; at 500 Hz a tenth of a second, far beyond any tick still open

    def __init__(self, rotors: int) -> None:
        self.rotors = rotors
        self.covered = -math.inf
        self.interval = math.nan
        self.late = 0
        self._step = UsualStep()
        self._row_times: list[float] = []
        self._rows: list[tuple[float, ...]] = []
        self._split = False
        self._run = 0  # complete readings on end while split
        self._times: list[list[float]] = [[] for _ in range(rotors)]
        self._speeds: list[list[float]] = [[] for _ in range(rotors)]

    def feed(self, reading: RotorReading, whole: bool = False) -> bool:
        """Take one reading; return whether `covered` moved. `whole` = known to be complete."""
        t = reading.t
        if t - t != 0.0:
            self.late += 1
            return False
        if self._split:
            self._feed_each(reading)
            covered = min([times[-1] if times else -math.inf for times in self._times])
            self._run = self._run + 1 if complete(reading.speed, self.rotors) else 0
            if self._run > self.KEPT // 2:
                self._turn_to_rows()
            return self._cover(covered)
        if not whole and not complete(reading.speed, self.rotors):
            self._turn_to_lists()
            return self.feed(reading)
        times = self._row_times
        if times and t <= times[-1]:
            self.late += 1
            return False
        times.append(t)
        self._rows.append(reading.speed)
        if len(times) > self.KEPT:
            del times[: self.KEPT // 2]
            del self._rows[: self.KEPT // 2]
        return self._cover(t)

    def at(self, t: float) -> Sequence[float]:
        """Speeds [rad/s] at time t: interpolated, held beyond the last sample. Every rotor has one.

        Held, they are the sample itself, one and the same object every time.
        """
        if self._split:
            return [_between(t, *track) for track in zip(self._times, self._speeds, strict=True)]
        times, rows = self._row_times, self._rows
        j = len(times) - 1
        if t >= times[j]:
            return rows[j]
        while j and times[j - 1] > t:
            j -= 1
        if j == 0:
            return rows[0]
        share = (t - times[j - 1]) / (times[j] - times[j - 1])
        return [low + share * (high - low) for low, high in zip(rows[j - 1], rows[j], strict=True)]

    def last_two(self, rotor: int) -> tuple[float, float]:
        """Return the last two speeds of a rotor [rad/s], NaN where there are not yet two."""
        if self._split:
            speeds: Sequence[float] = self._speeds[rotor][-2:]
        else:
            speeds = [row[rotor] for row in self._rows[-2:]]
        return (speeds[0], speeds[1]) if len(speeds) == 2 else (math.nan, math.nan)

    def around(self, t: float) -> tuple[float, float]:
        """Return the times of the samples on either side of t [s], infinite where none is; whole rows only."""
        times = self._row_times
        after = math.inf
        for time in reversed(times):
            if time <= t:
                return time, after
            after = time
        return -math.inf, after

    def _cover(self, covered: float) -> bool:
        if covered <= self.covered:
            return False
        if self.covered > -math.inf:
            self._step.feed(covered - self.covered)
            self.interval = self._step.value
        self.covered = covered
        return True

    def _feed_each(self, reading: RotorReading) -> None:
        t = reading.t
        for times, speeds, speed in zip(self._times, self._speeds, reading.speed, strict=False):
            if not -FASTEST < speed < FASTEST:
                continue
            if times and t <= times[-1]:
                self.late += 1
                continue
            times.append(t)
            speeds.append(abs(speed))
            if len(times) > self.KEPT:
                del times[: self.KEPT // 2]
                del speeds[: self.KEPT // 2]

    def _turn_to_rows(self) -> None:
        recent = [times[-self.KEPT // 2 :] for times in self._times]
        if any([times != recent[0] for times in recent]):  # late samples were dropped: not yet one row
            return
        self._split = False
        self._row_times = recent[0]
        self._rows = list(zip(*[speeds[-self.KEPT // 2 :] for speeds in self._speeds], strict=True))

    def _turn_to_lists(self) -> None:
        self._split = True
        self._run = 0
        for i in range(self.rotors):
            self._times[i] = list(self._row_times)
            self._speeds[i] = [row[i] for row in self._rows]
        self._row_times.clear()
        self._rows.clear()


def complete(speeds: tuple[float, ...], rotors: int) -> bool:
    """Whether every rotor has a plausible, non-negative speed [rad/s]."""
    if len(speeds) != rotors:
        return False
    total = sum(speeds)  # NaN hides from min and max, not from this
    return total == total and min(speeds) >= 0.0 and max(speeds) < FASTEST


def _between(t: float, times: list[float], speeds: list[float]) -> float:
    """Interpolate one rotor's speed; held beyond either end."""
    j = len(times) - 1
    if t >= times[j]:
        return speeds[j]
    while j and times[j - 1] > t:
        j -= 1
    if j == 0:
        return speeds[0]
    share = (t - times[j - 1]) / (times[j] - times[j - 1])
    return speeds[j - 1] + share * (speeds[j] - speeds[j - 1])
