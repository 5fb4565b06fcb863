"""How hard each motor has to turn its propeller: current over squared speed, against what it was in this flight.

    r_i = (I_i / W_i²) / (its value learned with a memory of 5 s)

A rotor without its propeller draws next to nothing, one whose propeller slips or misses the air as much as before, a
cut blade in between; one that stands under current is blocked, one without current is not driven. Relative, so that
neither the motor's constants nor the side on which the ESC measures must be known. Asked only of a rotor whose thrust
is missing: it tells kinds apart, and finds nothing itself.
"""

import math
from collections import deque

from gcs_health.fusion.kinds import Kind
from gcs_health.fusion.verdicts import BOUND, Evidence
from gcs_health.samples import RotorReading

MEMORY, EVERY, LEARN = 5.0, 0.1, 2.0  # s: of the usual load; from lesson to lesson; until it is believed
OVER, FROM = 0.4, 0.1  # s: it is measured over so long, at least
NONE, SPREAD = 0.1, 0.15  # load without a propeller; standard deviation, of one flight's manoeuvres
PART = (0.3, 0.7)  # loads of what is partly there
STANDS, TELLS = 0.05, 0.2  # of its usual speed; between them a current says nothing
UNDER_CURRENT, NO_CURRENT = 0.5, 0.15  # of the usual current


class Load:
    """Fed speeds and currents; `of` says what the load of a rotor speaks for."""

    def __init__(self, rotors: int) -> None:
        self._n = rotors
        self.new_flight()

    def new_flight(self) -> None:
        """Forget the flight before."""
        self._usual = [math.nan] * self._n
        self._speed, self._current = [math.nan] * self._n, [math.nan] * self._n  # the usual ones
        self._learned = [0.0] * self._n
        self._at = -math.inf
        self._recent: deque[tuple[float, RotorReading]] = deque(maxlen=64)

    def learn(self, reading: RotorReading) -> None:
        """Take a reading of a vehicle that flies, none of whose rotors has failed."""
        if 0.0 <= reading.t - self._at < EVERY:
            return
        self._at = reading.t
        for k, (speed, current) in enumerate(zip(reading.speed, reading.current, strict=True)):
            load = current / (speed * speed) if speed > 0.0 else math.nan
            if load == load:
                self._learned[k] += EVERY
                share = EVERY / min(self._learned[k], MEMORY)
                self._usual[k] = _towards(self._usual[k], load, share)
                self._speed[k] = _towards(self._speed[k], speed, share)
                self._current[k] = _towards(self._current[k], current, share)

    def follow(self, reading: RotorReading, rotor: int) -> Evidence | None:
        """Take a reading just after a rotor has failed; return what its load says of the kind."""
        recent = self._recent
        recent.append((reading.t, reading))
        while reading.t - recent[0][0] > OVER:
            recent.popleft()
        usual = self._usual[rotor]
        if self._learned[rotor] < LEARN or not usual > 0.0:
            return None
        if reading.speed[rotor] < STANDS * self._speed[rotor]:
            return self._standing(reading.t, rotor, reading.current[rotor] / self._current[rotor])
        known = [
            (each.speed[rotor], each.current[rotor])
            for _, each in recent
            if each.speed[rotor] > TELLS * self._speed[rotor] and each.current[rotor] == each.current[rotor]
        ]
        if len(known) < 2 or recent[-1][0] - recent[0][0] < FROM:
            return None
        ratio = sum(i for _, i in known) / sum(w * w for w, _ in known) / usual
        return self._said(reading.t, rotor, ratio)

    def _standing(self, t: float, rotor: int, ratio: float) -> Evidence | None:
        if not (ratio > UNDER_CURRENT or ratio < NO_CURRENT):  # NaN is neither
            return None
        blocked = 0.5 * BOUND if ratio > UNDER_CURRENT else -0.5 * BOUND
        odds = ((Kind.MOTOR_STUCK, blocked), (Kind.MOTOR_STOPPED, -blocked))
        return Evidence(t, rotor, "load", odds, lasts=math.inf, figures=(("current_over_usual", ratio),))

    def _said(self, t: float, rotor: int, ratio: float) -> Evidence:
        well = _normal(min(ratio, 1.0), 1.0)
        part = _normal(ratio, min(max(ratio, PART[0]), PART[1])) - well - 0.7
        unloaded = _bounded(_normal(max(ratio, NONE), NONE) - well)
        odds = (
            (Kind.PROPELLER_LOST, unloaded),
            (Kind.MOTOR_STOPPED, unloaded),  # not driven, it draws nothing either
            (Kind.THRUST_LOSS, _bounded(part)),
            (Kind.PROPELLER_SLIPPING, 0.0),
        )
        return Evidence(t, rotor, "load", odds, lasts=math.inf, figures=(("load_over_usual", ratio),))


def _towards(value: float, new: float, share: float) -> float:
    return new if value != value else value + share * (new - value)


def _normal(x: float, mean: float) -> float:
    return -0.5 * ((x - mean) / SPREAD) ** 2


def _bounded(odds: float) -> float:
    return min(max(odds, -0.5 * BOUND), 0.5 * BOUND)
