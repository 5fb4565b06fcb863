"""Readings onto ticks: blocks of IMU messages, and each rotor's speed at any time.

Source: sheet 1 section 7, steps 1 and 2. Rotor speeds are interpolated where an ESC sample lies on
both sides of a tick; beyond the last sample they are held, and the caller must know (`covered`) so
that it can lend such a tick the covariance of its age and compute it again when the sample comes.
"""

import math
from typing import NamedTuple

from gcs_health.samples import ImuReading, RotorReading

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

    def feed(self, dt: float) -> None:
        """Take one step [s]."""
        recent = self._recent
        recent.append(dt)
        if self.value != self.value or len(recent) >= 9:
            ordered = sorted(recent)
            self.value = ordered[len(ordered) // 2]
            if len(recent) >= 9:
                recent.clear()
        elif len(recent) == 3:
            self.value = min(self.value, sorted(recent)[1])  # the very first step may have been a gap


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
    """

    def __init__(self, length: float) -> None:
        self.length = length  # [s]
        self._step = UsualStep()
        self.last_t = -math.inf
        self.dropped = 0
        self._count = 0
        self._sums = [0.0] * 7

    def feed(self, reading: ImuReading) -> Tick | None:
        """Take one message; return the block that it completes, if any."""
        t, ax, ay, az, p, q, r = reading
        if not (t > self.last_t and plausible(reading)):
            self.dropped += 1
            return None
        done = None
        dt = t - self.last_t
        self.last_t = t
        if dt < math.inf:
            self._step.feed(dt)
            if self._count and dt > 2.5 * self.step and dt > 0.5 * self.length:
                done = self._flush()
        sums = self._sums
        sums[0] += t
        sums[1] += ax
        sums[2] += ay
        sums[3] += az
        sums[4] += p
        sums[5] += q
        sums[6] += r
        self._count += 1
        if done is None and self._count >= self.per_block:
            done = self._flush()
        return done

    @property
    def step(self) -> float:
        """Usual time between messages [s], NaN before the second."""
        return self._step.value

    @property
    def per_block(self) -> int:
        """Messages averaged into one tick."""
        step = self._step.value
        # .25: at 100 Hz and below every message is a tick, at 125 Hz too
        return max(1, int(self.length / step + 0.25)) if step > 0.0 else 1

    def _flush(self) -> Tick:
        share = 1.0 / self._count
        tick = Tick(*[value * share for value in self._sums])
        self._sums = [0.0] * 7
        self._count = 0
        return tick


class RotorTrack:
    """The recent speed samples of each rotor.

    Attributes
    ----------
    covered : time up to which every rotor's speed is bracketed by samples [s]; -inf while one has none.
    late : samples dropped because they were not newer than the last of their rotor.
    """

    KEPT = 48  # samples a rotor; at 500 Hz a tenth of a second, far beyond any tick still open

    def __init__(self, rotors: int) -> None:
        self.times: list[list[float]] = [[] for _ in range(rotors)]
        self.speeds: list[list[float]] = [[] for _ in range(rotors)]
        self.covered = -math.inf
        self.late = 0
        self._step = UsualStep()

    def feed(self, reading: RotorReading) -> bool:
        """Take one reading; return whether `covered` moved."""
        t = reading.t
        if t - t != 0.0:
            self.late += 1
            return False
        for times, speeds, speed in zip(self.times, self.speeds, reading.speed, strict=False):
            if not -FASTEST < speed < FASTEST:
                continue
            if times and t <= times[-1]:
                self.late += 1
                continue
            times.append(t)
            speeds.append(speed if speed >= 0.0 else -speed)
            if len(times) > self.KEPT:
                del times[: self.KEPT // 2]
                del speeds[: self.KEPT // 2]
        return self._cover()

    def _cover(self) -> bool:
        covered = math.inf
        for times in self.times:
            if not times:
                return False
            if times[-1] < covered:
                covered = times[-1]
        if covered <= self.covered:
            return False
        if self.covered > -math.inf:
            self._step.feed(covered - self.covered)
        self.covered = covered
        return True

    @property
    def interval(self) -> float:
        """Usual time between samples [s], NaN while unknown."""
        return self._step.value

    def at(self, t: float) -> list[float]:
        """Speeds [rad/s] at time t: interpolated, held beyond the last sample. Every rotor has one."""
        out = []
        after = before = math.nan  # bracket of the rotor before: most share one ESC message
        share = 0.0
        for times, speeds in zip(self.times, self.speeds, strict=True):
            j = len(times) - 1
            if t >= times[j]:
                out.append(speeds[j])
                continue
            while j and times[j - 1] > t:
                j -= 1
            if j == 0:
                out.append(speeds[0])
                continue
            if times[j] != after or times[j - 1] != before:
                after = times[j]
                before = times[j - 1]
                share = (t - before) / (after - before)
            low = speeds[j - 1]
            out.append(low + share * (speeds[j] - low))
        return out
