"""Two-stage Kalman filter for losses of effectiveness, (5.36-5.37).

    x+ = A x + B u - B diag(u) gamma + w_x,   gamma+ = gamma + w_g,   y = C x + v

Stage 1 filters x as if there were no loss; stage 2 takes its innovation r = S gamma + noise and filters
gamma; the coupling x = x~ + V gamma joins them. With W = A V - B diag(u):

    U = W Pg Pg-^-1,   Pg- = Pg + Qg,   x~- = A x~ + B u + (W - U) gamma
    Px- = A Px A' + Qx + W Pg W' - U Pg- U'
    S = C U,   V = U - K_x S,   K_g = Pg- S' (C Px- C' + R + S Pg- S')^-1

which is the joint filter of [x; gamma] exactly (the test holds them equal), at the cost of two small ones.

Source: Keller and Darouach (1997) and Hsieh and Chen (1999) as used in Melczer (2019), 5.4.
"""

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import Judge, Verdict
from gcs_health.estimators.comparison.wrench import CORRELATION, DISTURBANCE, NOISE, Wrench
from gcs_health.samples import Reading

Array = NDArray[np.float64]


class TwoStage:
    """The filter itself, of any shape.

    Attributes
    ----------
    x : (m,) state of stage 1; Px (m, m). gamma : (n,) losses [-]; Pg (n, n). V : (m, n) coupling.
    """

    def __init__(self, x: Array, Px: Array, gamma: Array, Pg: Array) -> None:
        self.x, self.Px = x, Px
        self.gamma, self.Pg = gamma, Pg
        self.V = np.zeros((len(x), len(gamma)))

    @property
    def state(self) -> Array:
        """The state with the losses taken into account (m,)."""
        joint: Array = self.x + self.V @ self.gamma
        return joint

    def step(self, A: Array, Bu: Array, y: Array, C: Array, Qx: Array, Qg: Array, R: Array) -> None:
        """Advance by one step and one measurement; `Bu` (m, n) = B diag(u), covariances per step."""
        W = A @ self.V - Bu
        Pg = self.Pg + Qg
        U = np.linalg.solve(Pg, self.Pg @ W.T).T
        x = A @ self.x + Bu.sum(axis=1) + (W - U) @ self.gamma
        Px = A @ self.Px @ A.T + Qx + W @ self.Pg @ W.T - U @ Pg @ U.T
        S = C @ U
        own = C @ Px @ C.T + R
        K = np.linalg.solve(own, C @ Px).T
        r = y - C @ x
        self.x = x + K @ r
        Px = Px - K @ C @ Px
        self.Px = 0.5 * (Px + Px.T)
        G = np.linalg.solve(own + S @ Pg @ S.T, S @ Pg).T
        self.gamma = self.gamma + G @ (r - S @ self.gamma)
        Pg = Pg - G @ S @ Pg
        self.Pg = 0.5 * (Pg + Pg.T)
        self.V = U - K @ S


class TwoStageKalman:
    """Scores are the losses gamma [-].

    Parameters
    ----------
    wander : standard deviation of the losses' random walk in a second [-]; large = quick and scattered.
    """

    def __init__(
        self, airframe: Airframe, threshold: float = 0.5, hold: float = 0.02, wander: float = 0.5
    ) -> None:
        self.judge = Judge(threshold, hold)
        self._wrench = Wrench(airframe)
        self._wander = wander
        self._filter: TwoStage | None = None
        self._R = np.diag((NOISE / self._wrench.system.scale) ** 2)

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        motion = self._wrench.feed(reading)
        if motion is None:
            return None
        n = self._wrench.rotors
        if self._filter is None:
            self._filter = TwoStage(motion.y, self._R, np.zeros(n), 0.1 * np.eye(n))
        Qx = np.diag(DISTURBANCE**2 * 2.0 * CORRELATION * motion.dt)
        Qg = self._wander**2 * motion.dt * np.eye(n)
        Bu = self._wrench.system.B * motion.w**2 * motion.dt
        self._filter.step(np.eye(4), Bu, motion.y, np.eye(4), Qx, Qg, self._R)
        # four rows see four directions: what they do not see must not grow without bound
        self._filter.Pg *= min(1.0, n / max(float(np.trace(self._filter.Pg)), 1e-12))
        return (
            self.judge.feed(motion.t, self._filter.gamma.tolist()) if self._wrench.ready(motion.t) else None
        )
