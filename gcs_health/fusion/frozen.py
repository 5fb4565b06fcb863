"""Telemetry that repeats itself: an ESC whose speed, current and voltage all stand still in flight.

    frozen: nothing has changed for 3 s, nor for 20 times what it usually takes, while half of the others' change
    doubtful: the same after 0.4 s and 8 times: too early to tell of, late enough to rest no other verdict on it

A live ESC's figures move with every sample but for their rounding; how often they usually do is learned of each, so
that coarse steps in a calm hover are no fault.
"""

import math

from gcs_health.samples import RotorReading

LEAST, TIMES = 3.0, 20.0  # s, and usual times between changes, without one
DOUBT, DOUBT_TIMES = 0.4, 8.0  # likewise
LIVELY = 1.0  # s within which the others must have changed
SHARE = 0.1  # of a new time between changes in the usual one


class Frozen:
    """Fed readings of a vehicle that flies; `holds` says whose telemetry repeats itself."""

    def __init__(self, rotors: int) -> None:
        self._n = rotors
        self.new_flight()

    def new_flight(self) -> None:
        """Forget the flight before."""
        self._last: list[tuple[float, float, float] | None] = [None] * self._n
        self._changed = [math.nan] * self._n  # when [s]
        self._usual = [math.nan] * self._n  # between changes [s]

    def rotors(self, reading: RotorReading) -> None:
        """Take what the ESCs tell; a speed that is not known is no news."""
        t = reading.t
        lasts, changed, usuals = self._last, self._changed, self._usual
        told = zip(reading.speed, reading.current, reading.voltage, strict=True)
        for k, (speed, current, voltage) in enumerate(told):
            if speed != speed:
                continue
            last = lasts[k]
            if last is not None and speed == last[0] and _same(current, last[1]) and _same(voltage, last[2]):
                continue
            step, usual = t - changed[k], usuals[k]
            if step > 0.0:
                usuals[k] = step if usual != usual else usual + SHARE * (step - usual)
            lasts[k], changed[k] = (speed, current, voltage), t

    def holds(self, rotor: int, t: float) -> bool:
        """Whether the telemetry of a rotor repeats itself at t [s]."""
        return self._still(rotor, t, LEAST, TIMES)

    def doubtful(self, t: float) -> bool:
        """Whether the telemetry of any rotor may repeat itself at t [s]."""
        return any(self._still(rotor, t, DOUBT, DOUBT_TIMES) for rotor in range(self._n))

    def _still(self, rotor: int, t: float, least: float, times: float) -> bool:
        last = self._last[rotor]
        if last is None or not last[0] > 0.0:
            return False
        still = t - self._changed[rotor]
        if not still >= max(least, times * self._usual[rotor]):
            return False
        lively = sum(t - at < LIVELY for k, at in enumerate(self._changed) if k != rotor)
        return 2 * lively >= self._n - 1


def _same(a: float, b: float) -> bool:
    """Whether both are equal, or both not known."""
    return a == b or (a != a and b != b)
