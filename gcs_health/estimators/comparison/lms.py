"""The control effectiveness itself, learned by LMS, (4.6).

    G+ = G - mu (G [dw; dw'] - dOmega') [dw; dw']' / (|[dw; dw']|² + eps)

on equally filtered signals; d = change over one step. The step is normalised, else the largest manoeuvre
sets the gain. Needs no current and no mass, but second derivatives of the gyro, and learns only from
what moves. Source: Smeur et al. (2016), in Melczer (2019), 4.2.
"""

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import Judge, Verdict
from gcs_health.estimators.comparison.wrench import DISTURBANCE, Filtered, FilteredWrench
from gcs_health.samples import Reading

Array = NDArray[np.float64]


def lms(G: Array, change: Array, seen: Array, mu: float, eps: float) -> Array:
    """Return the new G (m, k) after inputs changed by `change` (k,) and outputs by `seen` (m,)."""
    error = G @ change - seen
    out: Array = G - mu * np.outer(error, change) / (float(change @ change) + eps)
    return out


class LmsEffectiveness:
    """Scores are the share of each rotor's column that is gone, along its healthy direction [-].

    Parameters
    ----------
    mu : step, 0..2 [-]. eps : squared change of speed/hover below which nothing is learned.
    """

    def __init__(
        self,
        airframe: Airframe,
        threshold: float = 0.5,
        hold: float = 0.02,
        mu: float = 0.05,
        eps: float = 1e-5,
    ) -> None:
        self.judge = Judge(threshold, hold)
        self._signals = FilteredWrench(airframe)
        self._healthy = 2.0 * self._signals.wrench.system.B  # d(w²) = 2 w dw, at hover
        self.G = self._healthy.copy()
        self._mu, self._eps = mu, eps
        self._before: Filtered | None = None

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        now = self._signals.feed(reading)
        if now is None:
            return None
        before, self._before = self._before, now
        if before is None or not self._signals.wrench.ready(now.t):
            return None
        # the known yaw from rotor acceleration is already on the left side (`wrench.py`)
        self.G = lms(self.G, now.w - before.w, now.acceleration - before.acceleration, self._mu, self._eps)
        weight = 1.0 / DISTURBANCE[:, None] ** 2
        left = np.sum(weight * self.G * self._healthy, axis=0)
        whole = np.sum(weight * self._healthy**2, axis=0)
        return self.judge.feed(now.t, (1.0 - left / whole).tolist())
