"""Sliding-mode observer: the injection that holds it on the surface is the fault, (5.14-5.22).

    x^' = B u + K e + nu,   e = y - x^,   nu = rho e / (|e| + eps)   per axis

On the surface nu, low-passed, equals what the model lacks (equivalent injection); its direction names
the rotor. sgn(e) chatters at the rates of telemetry, so the boundary layer eps is part of the method.

Source: Utkin; Edwards and Spurgeon; Melczer (2019), 5.2; sheet 3.
"""

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import Judge, Verdict
from gcs_health.estimators.comparison.wrench import Wrench, signature
from gcs_health.samples import Reading

Array = NDArray[np.float64]


def injection(e: Array, rho: float, eps: float) -> Array:
    """Return nu (m,) of the errors e (m,)."""
    out: Array = rho * e / (np.abs(e) + eps)
    return out


class SlidingMode:
    """Scores are the loss that the equivalent injection looks like [-].

    Parameters
    ----------
    K : [1/s]. rho : bound of the disturbance it can hold [rotors' worth]. eps : boundary layer in y
        [rotors' worth times s]. filter_time : of nu [s].
    """

    def __init__(
        self,
        airframe: Airframe,
        threshold: float = 0.5,
        hold: float = 0.02,
        K: float = 10.0,
        rho: float = 3.0,
        eps: float = 0.05,
        filter_time: float = 0.03,
    ) -> None:
        self.judge = Judge(threshold, hold)
        self._wrench = Wrench(airframe)
        self._K, self._rho, self._eps, self._filter_time = K, rho, eps, filter_time
        self._x: Array | None = None
        self.lack = np.zeros(4)

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        motion = self._wrench.feed(reading)
        if motion is None:
            return None
        if self._x is None:
            self._x = motion.y
        s, u = self._wrench.system, motion.w**2
        x = self._x + motion.dt * (s.B @ u)
        e = motion.y - x
        # slope of the injection at e, held over the step: stays stable where rho dt / eps is above 1
        slope = self._K + self._rho / (np.abs(e) + self._eps)
        moved = (1.0 - np.exp(-slope * motion.dt)) * e
        self._x = x + moved
        keep = np.exp(-motion.dt / self._filter_time)
        self.lack = keep * self.lack + (1.0 - keep) * moved / motion.dt
        if not self._wrench.ready(motion.t):
            return None
        return self.judge.feed(motion.t, signature(self.lack, s.B, u).tolist())
