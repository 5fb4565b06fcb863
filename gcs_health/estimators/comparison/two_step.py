"""Two-step inversion: the wrench from the IMU, then each rotor's loss from it, (4.3-4.5).

    y' = B diag(u) (1 - gamma)     =>     gamma = 1 - diag(u)^-1 B^-1 y'

Four rotors only: with six the matrix has no inverse. Source: Lu and van Kampen (2015) in Melczer (2019), 4.2.
"""

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.errors import AirframeError
from gcs_health.estimators.comparison import Judge, Verdict
from gcs_health.estimators.comparison.wrench import FilteredWrench
from gcs_health.samples import Reading

Array = NDArray[np.float64]
SLOWEST = 0.1  # of hover's squared speed; below, a rotor's share is not seen


def losses(B: Array, u: Array, acceleration: Array) -> Array:
    """Return gamma (4,) from y' (4,) of u (4,); 0 where a rotor hardly turns."""
    thrusts = np.linalg.solve(B, acceleration)
    return np.where(u > SLOWEST, 1.0 - thrusts / np.maximum(u, SLOWEST), 0.0)


class TwoStepInversion:
    """Scores are the losses gamma [-].

    Raises
    ------
    AirframeError : not four rotors, or they cannot be told apart.
    """

    def __init__(self, airframe: Airframe, threshold: float = 0.5, hold: float = 0.02) -> None:
        self.judge = Judge(threshold, hold)
        self._signals = FilteredWrench(airframe)
        B = self._signals.wrench.system.B
        if B.shape[1] != 4 or np.linalg.matrix_rank(B) < 4:
            raise AirframeError(f"{airframe.name}: two-step inversion needs four rotors that differ")

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        now = self._signals.feed(reading)
        if now is None or not self._signals.wrench.ready(now.t):
            return None
        gamma = losses(self._signals.wrench.system.B, now.w**2, now.acceleration)
        return self.judge.feed(now.t, gamma.tolist())
