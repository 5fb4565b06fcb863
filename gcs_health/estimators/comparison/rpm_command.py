"""Measured rotor speed against what was commanded: what one would write first.

    score_i = |w_i - g_i c_i| / (g_i c_i),   both low-passed; g_i = rad/s per command, learned over 10 s

Sees a motor that does not obey. With a governed ESC it cannot see a propeller that is gone.
"""

import math

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import Judge, Verdict, towards
from gcs_health.samples import CommandReading, FlightReading, Reading, RotorReading

LOW_PASS, LEARN = 0.1, 10.0  # s


class RpmAgainstCommand:
    """Scores are the relative difference [-]."""

    def __init__(self, airframe: Airframe, threshold: float = 0.3, hold: float = 0.05) -> None:
        n = len(airframe.rotors)
        self.judge = Judge(threshold, hold)
        self._command = [math.nan] * n
        self._w, self._c = [math.nan] * n, [math.nan] * n
        self.gain = [math.nan] * n
        self._t = math.nan
        self._flying_since = math.inf

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        if isinstance(reading, CommandReading):
            self._command = list(reading.command)
        elif isinstance(reading, FlightReading):
            flies = reading.landed is False
            self._flying_since = min(self._flying_since, reading.t) if flies else math.inf
        elif isinstance(reading, RotorReading) and reading.t > self._flying_since:
            return self._compare(reading)
        return None

    def _compare(self, reading: RotorReading) -> Verdict | None:
        dt = reading.t - self._t
        self._t = reading.t
        follow = 1.0 - math.exp(-dt / LOW_PASS) if dt == dt else 1.0
        scores = []
        for i, (speed, command) in enumerate(zip(reading.speed, self._command, strict=True)):
            score = 0.0
            if speed == speed and command == command and command > 0.05:
                self._w[i] = towards(self._w[i], speed, follow)
                self._c[i] = towards(self._c[i], command, follow)
                learn = 1.0 - math.exp(-dt / LEARN) if dt == dt else 1.0
                usual = self.gain[i] * self._c[i]
                score = abs(self._w[i] - usual) / usual if usual == usual else 0.0
                if not score > 0.5 * self.judge.threshold:  # a fault must not become the usual
                    self.gain[i] = towards(self.gain[i], self._w[i] / self._c[i], learn)
            scores.append(score)
        return self.judge.feed(reading.t, scores) if reading.t - self._flying_since > 3.0 else None
