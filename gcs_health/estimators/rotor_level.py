"""How fast the rotors turn in flight, and whether this is flight, from their speeds and the autopilot's word.

An idle on the ground looks like a slow flight until the rotors speed up to fly. So whatever was learned is
forgotten when the level rises by a third: that was the take-off. This project.
"""

import math
from dataclasses import dataclass

from gcs_health.samples import FlightReading


@dataclass(frozen=True, slots=True)
class LevelConfig:
    """Rules of the level."""

    follow: float = 1.0  # s, mean speed of all rotors
    fade: float = 90.0  # s in which the level would fall
    take_off: float = 1.3  # rise of the level that makes a new beginning
    lift_off: float = 1.7  # mean speed over the level that makes it a take-off whatever is said of the ground
    idle: float = 1.0  # s, the shortest stay at a level that counts as an idle before it
    turning: float = 0.4  # of the level; a rotor below tells nothing of its propeller (sheet 3, step 3)
    accept: float = 4.0  # s in which a level that rose by less is taken as it is
    settle: float = 0.5  # s after a beginning until a verdict
    least: float = 20.0  # rad/s; below, nothing turns
    stopped_for: float = 2.0  # s of still rotors that end a flight


class RotorLevel:
    """Fed the latest speeds with every rotor reading.

    Attributes
    ----------
    value : the level [rad/s], 0 before anything turned.
    began : when the present level began [s]. airborne : whether this is taken for flight.
    """

    def __init__(self, config: LevelConfig) -> None:
        self.config = config
        self.armed: bool | None = None
        self.landed: bool | None = None
        self.restart()

    def restart(self) -> None:
        """Begin as for a new flight."""
        self.value = self._mean = self._anchor = 0.0
        self.began = self._t = float("-inf")
        self.took_off = False
        self._still_since = float("nan")

    def flight(self, reading: FlightReading) -> bool:
        """Take the autopilot's word; return whether a flight ended with it."""
        ended = self.armed is True and reading.armed is False
        if reading.landed is False and self.landed is True:
            self.took_off = True
        self.armed, self.landed = reading.armed, reading.landed
        if ended:
            self.restart()
        return ended

    def speeds(self, t: float, mean: float) -> bool:
        """Take the mean speed of all rotors [rad/s] at t [s]; return whether a new beginning was made."""
        c = self.config
        dt = t - self._t
        self._t = t
        if mean < c.least:
            if self._still_since != self._still_since:
                self._still_since = t
            elif t - self._still_since > c.stopped_for and self.value:
                self.restart()
                return True
            return False
        self._still_since = float("nan")
        dt = dt if dt < 0.5 else 0.5
        share = dt / c.follow
        self._mean += (share if share < 1.0 else 1.0) * (mean - self._mean)
        value = self.value * (1.0 - dt / c.fade)
        self.value = value if value > self._mean else self._mean
        if self.value <= c.take_off * self._anchor:
            if self.value > self._anchor:  # what is left of a take-off's rise is no second one
                self._anchor += dt / c.accept * (self.value - self._anchor)
            return False
        self.took_off |= t - self.began > c.idle and mean > c.lift_off * self._anchor > 0.0
        self._anchor = self.value
        self.began = t
        return True

    @property
    def airborne(self) -> bool:
        """Whether the rotors carry the vehicle, as far as can be told."""
        return self.armed is not False and self.value > 0.0 and (self.landed is not True or self.took_off)

    def judged(self, t: float) -> bool:
        """Whether verdicts may be given at t [s]."""
        return self.airborne and t - self.began > self.config.settle


def mean_of_known(values: list[float]) -> float:
    """Return the mean of what is not NaN; NaN if all is."""
    known = [value for value in values if value == value]
    return sum(known) / len(known) if known else math.nan
