"""Multiple-model estimation: one filter per hypothesis, and which of them the residuals believe.

    x+ = x + B diag(u) (1 - gamma_j) dt + K (y - y^),   r_j = y - y^_j,   S = innovation covariance
    p_j+ ~ p_j N(r_j; 0, S),   normalised, none below a floor

Hypothesis 0 is healthy, j = rotor j has lost what `size` says. All share gain and S, since the models
differ in the input alone.  Source: Melczer (2019), 4.3, (4.7-4.9).
"""

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import Judge, Verdict
from gcs_health.estimators.comparison.wrench import CORRELATION, DISTURBANCE, NOISE, Wrench
from gcs_health.samples import Reading

Array = NDArray[np.float64]


def posterior(log_p: Array, r: Array, S: Array, floor: float) -> Array:
    """Return the log probabilities (k,) after residuals r (k, m) of variance S (m,) under each hypothesis.

    `floor` : least log probability; it bounds how long a changed mind takes.
    """
    joint = log_p - 0.5 * np.sum(r * r / S, axis=1)
    joint = joint - joint.max()
    joint = joint - np.log(np.exp(joint).sum())
    floored = np.maximum(joint, floor)
    out: Array = floored - np.log(np.exp(floored).sum())
    return out


class MultipleModel:
    """Scores are the log odds of each rotor's fault against none [-].

    Parameters
    ----------
    size : loss of the faulty hypotheses [-]. floor : least log probability [-].
    """

    def __init__(
        self,
        airframe: Airframe,
        threshold: float = 9.0,
        hold: float = 0.02,
        size: float = 1.0,
        floor: float = -40.0,
    ) -> None:
        self.judge = Judge(threshold, hold)
        self._wrench = Wrench(airframe)
        n = self._wrench.rotors
        self._left = np.vstack([np.ones(n), np.ones((n, n)) - size * np.eye(n)])
        self._R = (NOISE / self._wrench.system.scale) ** 2
        self._P = self._R.copy()
        self._x: Array | None = None
        self._floor = floor
        self.log_p = np.full(n + 1, -np.log(n + 1.0))

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        motion = self._wrench.feed(reading)
        if motion is None:
            return None
        if self._x is None:
            self._x = np.tile(motion.y, (len(self._left), 1))
            return None
        push = self._left @ (self._wrench.system.B * motion.w**2).T
        x = self._x + motion.dt * push
        P = self._P + DISTURBANCE**2 * 2.0 * CORRELATION * motion.dt
        S = P + self._R
        r = motion.y - x
        self._x = x + P / S * r
        self._P = P - P * P / S
        # successive residuals share a disturbance: one vote per correlation time, not one per message
        self.log_p = posterior(self.log_p, r * np.sqrt(min(1.0, motion.dt / CORRELATION)), S, self._floor)
        scores = (self.log_p[1:] - self.log_p[0]).tolist()
        return self.judge.feed(motion.t, scores) if self._wrench.ready(motion.t) else None
