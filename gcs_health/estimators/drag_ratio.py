"""Slow damage: each propeller's drag against its own healthy level and against its neighbours'.

    rho_r = (eta_r / eta_r0) / median over the rotors

Wind, battery and air density move all rotors alike and drop out. Below: a part of the propeller is
missing. Above: drag has risen, or friction (a bearing), or the winding makes less torque of a current.

Where telemetry is too slow for a balance over intervals, or the current cannot be converted, a mean over a minute
of steady readings does the same, coarser.

Source: sheet 3, recommended mode, step 8; sheet 5 section 6 for the slow rates.
"""

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RatioConfig:
    """Thresholds; sheet 3, step 8 and sheet 5, section 6, unless said otherwise."""

    loss: float = 0.88
    rise: float = 1.10
    hold: float = 0.5  # s below `loss`
    hold_rise: float = 1.5  # s above `rise`; this project
    back: float = 0.04  # inside the threshold by that much for `clear` until it is taken back; this project
    clear: float = 2.0  # s; this project
    every: float = 0.05  # s between two looks
    full: float = 0.6  # of the level; an interval at less speed is friction and offset; this project
    least_rotors: int = 3  # for a median
    slow_time: float = 60.0  # s over which slow telemetry is averaged
    slow_loss: float = 0.75
    slow_rise: float = 1.33  # this project


class DragRatio:
    """The ratios of all rotors and what is concluded from them.

    Attributes
    ----------
    ratio : (n,) rho, NaN where not known.
    verdict : (n,) "" while nothing is wrong, else "partial_loss" or "drag_rise".
    """

    def __init__(self, rotors: int, config: RatioConfig) -> None:
        self.config = config
        self.ratio = [math.nan] * rotors
        self.verdict = [""] * rotors
        self._since = [math.nan] * rotors
        self._due = -math.inf

    def due(self, t: float) -> bool:
        """Whether it is time to look again."""
        return t >= self._due or self._due - t > 1.0

    def feed(self, t: float, levels: list[float], slow: bool = False) -> bool:
        """Take eta over eta_0 of every rotor, NaN = unknown, at t [s]; return whether a verdict changed."""
        c = self.config
        self._due = t + c.every
        known = sorted([level for level in levels if level == level])
        if len(known) < c.least_rotors:
            self.ratio = [math.nan] * len(levels)
            self._since = [math.nan] * len(levels)
            return False
        half = len(known) // 2
        median = known[half] if len(known) % 2 else 0.5 * (known[half - 1] + known[half])
        if not median > 0.0:
            return False
        loss, rise = (c.slow_loss, c.slow_rise) if slow else (c.loss, c.rise)
        changed = False
        for k, level in enumerate(levels):
            self.ratio[k] = rho = level / median
            seen = "partial_loss" if rho < loss else "drag_rise" if rho > rise else ""
            if self.verdict[k]:
                inside = loss + c.back < rho < rise - c.back
                changed |= self._after(k, t, inside, c.clear, "")
            else:
                hold = c.hold if seen == "partial_loss" else c.hold_rise
                changed |= self._after(k, t, bool(seen), hold, seen)
        return changed

    def _after(self, k: int, t: float, holds: bool, hold: float, verdict: str) -> bool:
        """Change a verdict once its condition has held long enough."""
        if not holds:
            self._since[k] = math.nan
            return False
        if self._since[k] != self._since[k]:
            self._since[k] = t
        if t - self._since[k] < hold:
            return False
        self.verdict[k] = verdict
        self._since[k] = math.nan
        return True


class SlowMean:
    """Drag of one rotor from single steady readings, forgetting over `memory` s: sum(drive w²)/sum(w^4)."""

    def __init__(self, memory: float) -> None:
        self.memory = memory
        self.time = 0.0
        self._top = self._bottom = 0.0

    def note(self, dt: float, w: float, drive: float) -> None:
        """Take a reading: time since the last [s], speed [rad/s], what drives the drag [any unit]."""
        dt = min(dt, 1.0)
        keep = 1.0 - dt / self.memory
        squares = w * w
        self._top = keep * self._top + dt * drive * squares
        self._bottom = keep * self._bottom + dt * squares * squares
        self.time += dt

    @property
    def value(self) -> float:
        """The mean drag; NaN before `memory` s were seen."""
        return self._top / self._bottom if self.time >= self.memory and self._bottom > 0.0 else math.nan
