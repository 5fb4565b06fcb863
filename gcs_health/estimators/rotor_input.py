"""What one rotor's telemetry gave last, and how often it comes."""

import math

FASTEST = 1e5  # rad/s: beyond any rotor; larger values are damage
MOST_CURRENT = 2000.0  # A, likewise
NAN = math.nan


class RotorInput:
    """What one rotor's telemetry gave last, and how often it comes.

    Attributes
    ----------
    t : of the last speed with a current [s]. speed [rad/s], current [A], volts [V].
    interval : usual time between such readings [s], NaN before the second. currents : how many so far.
    """

    __slots__ = ("current", "currents", "interval", "speed", "t", "volts")

    def __init__(self) -> None:
        self.t = -math.inf
        self.speed = self.current = self.volts = NAN
        self.interval = NAN
        self.currents = 0

    def take(self, t: float, w: float, i: float, u: float) -> float:
        """Take a reading; return the time since the last one [s], infinite at first; <= 0: not taken."""
        if i == 0.0 and not self.currents:  # exactly 0 from the start: an ESC that gives volts but no amperes
            return 0.0
        dt = t - self.t
        if not dt > 0.0:
            if dt < -1.0:  # another axis of time and not a late sample
                self.t, self.interval = t, NAN
            return 0.0
        if dt < math.inf:
            usual = self.interval
            # a clipped mean: gaps do not slow it, a change of rate is followed
            self.interval = dt if usual != usual else usual + 0.05 * (min(dt, 3.0 * usual) - usual)
        self.t, self.speed, self.current, self.volts = t, w, i, u
        self.currents += 1
        return dt
