"""Thresholds that follow the residual, (5.8), and the plainest signal they can be laid on.

    rho± = mean(r) ± [(k1 - 1) |mean(r)| + k2 std(r) + k3]        over [t - T, t - guard]

(the paper's two k1, one above and one below 1, written as one). (5.8) integrates over the future and takes
signed deviations, which sum to 0; the causal form with the standard deviation is meant. The guard keeps a
beginning fault out of its own threshold, and under suspicion the window stands still: else a slow fault
teaches the threshold.

Source: Freddi et al. (2012) in Melczer (2019), 3.2 and 5.1; sheet 3.
"""

import math
from collections import deque

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import Judge, Verdict, towards
from gcs_health.samples import FlightReading, Reading, RotorReading

LOW_PASS = 0.3  # s, longer than a rotor takes to change its speed


class AdaptiveThreshold:
    """One residual's own bounds.

    Parameters
    ----------
    window T, guard : [s]. k1, k2 : [-]. k3 : [unit of r]; floor of the band.
    """

    def __init__(
        self, window: float = 5.0, guard: float = 0.2, k1: float = 1.0, k2: float = 1.0, k3: float = 0.0
    ) -> None:
        self.window, self.guard = window, guard
        self.k1, self.k2, self.k3 = k1, k2, k3
        self._waiting: deque[tuple[float, float]] = deque()
        self._inside: deque[tuple[float, float]] = deque()
        self._sum = self._squares = 0.0

    @property
    def ready(self) -> bool:
        """Whether half a window has been seen."""
        return bool(self._inside) and self._inside[-1][0] - self._inside[0][0] > 0.5 * self.window

    def bounds(self) -> tuple[float, float]:
        """Return (mean, half width) of the window; NaN before anything is in it."""
        n = len(self._inside)
        if not n:
            return math.nan, math.nan
        mean = self._sum / n
        std = math.sqrt(max(self._squares / n - mean * mean, 0.0))
        return mean, (self.k1 - 1.0) * abs(mean) + self.k2 * std + self.k3

    def feed(self, t: float, r: float, frozen: bool = False) -> float:
        """Take a residual; return how many half widths it lies from the mean (0 before `ready`)."""
        middle, width = self.bounds()
        excess = (r - middle) / width if self.ready and width > 0.0 else 0.0
        if frozen:
            return excess
        self._waiting.append((t, r))
        while self._waiting and self._waiting[0][0] <= t - self.guard:
            self._take(self._waiting.popleft(), 1.0)
        while self._inside and self._inside[0][0] < t - self.window:
            self._take(self._inside.popleft(), -1.0)
        return excess

    def _take(self, item: tuple[float, float], sign: float) -> None:
        if sign > 0.0:
            self._inside.append(item)
        self._sum += sign * item[1]
        self._squares += sign * item[1] * item[1]


class CurrentThreshold:
    """Current over squared speed of each motor under its own adaptive threshold; no model at all.

    Both are low-passed alike first: what accelerates the rotor is current too.

    Scores are half widths below the mean [-]: a load that is gone. Six tenths of the threshold are suspicious
    and freeze the window.
    """

    def __init__(self, airframe: Airframe, threshold: float = 3.0, hold: float = 0.1) -> None:
        self.judge = Judge(threshold, hold)
        self._suspect = 0.6 * threshold
        self._bounds = [AdaptiveThreshold(k1=1.1) for _ in airframe.rotors]
        self._excess = [0.0] * len(airframe.rotors)
        self._current = [math.nan] * len(airframe.rotors)
        self._square = [math.nan] * len(airframe.rotors)
        self._t = math.nan
        self._flying_since = math.inf

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        if isinstance(reading, FlightReading):
            flies = reading.landed is False
            self._flying_since = min(self._flying_since, reading.t) if flies else math.inf
        if not isinstance(reading, RotorReading) or not reading.t - self._flying_since > 1.0:
            return None
        dt, self._t = reading.t - self._t, reading.t
        share = 1.0 - math.exp(-dt / LOW_PASS) if dt == dt else 1.0
        for i, (speed, current) in enumerate(zip(reading.speed, reading.current, strict=True)):
            if speed == speed and current == current and speed > 1.0:
                self._current[i] = towards(self._current[i], current, share)
                self._square[i] = towards(self._square[i], speed * speed, share)
                frozen = -self._excess[i] > self._suspect
                ratio = self._current[i] / self._square[i]
                self._excess[i] = self._bounds[i].feed(reading.t, ratio, frozen)
        return self.judge.feed(reading.t, [-excess for excess in self._excess])
