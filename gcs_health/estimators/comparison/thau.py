"""Thau's observer, as residual generator and with a fault term, (5.1-5.11).

    x^' = A x^ + B u + f(x^, u) + E eta^ + K (y - C x^),   K = P^-1 C',   A'P + P A - C'C + theta P = 0
    eta^' = W G' (y - C x^) - sigma W eta^,   G = C P E

Here A = 0, C = I, f the gyroscopic coupling -J^-1 (Omega x J Omega) of the body where its inertia is
known (evaluated at the measured rates, as 5.1.2 asks), E = -B diag(u), eta the losses. The leak sigma
biases a steady fault low; a large theta is quick and lets the residual wash out.

Source: Thau (1973), Freddi et al. (2012), in Melczer (2019), 5.1; sheet 3 corrects (5.11), (5.13).
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_lyapunov

from gcs_health.airframe import Airframe
from gcs_health.estimators.comparison import Judge, Verdict
from gcs_health.estimators.comparison.adaptive_threshold import AdaptiveThreshold
from gcs_health.estimators.comparison.wrench import DISTURBANCE, Motion, Wrench, signature
from gcs_health.samples import Reading

Array = NDArray[np.float64]


def gain(A: Array, C: Array, theta: float) -> tuple[Array, Array]:
    """Return (P, K) of A'P + P A - C'C + theta P = 0 and K = P^-1 C'.

    Parameters
    ----------
    A : (n, n). C : (m, n), observable with A. theta : [1/s], large enough for P to be positive definite.
    """
    shifted = A + 0.5 * theta * np.eye(len(A))
    P = np.asarray(solve_continuous_lyapunov(shifted.T, C.T @ C), dtype=np.float64)
    P = 0.5 * (P + P.T)
    return P, np.asarray(np.linalg.solve(P, C.T), dtype=np.float64)


class _Observer:
    """State and prediction that both uses share."""

    def __init__(self, airframe: Airframe, theta: float) -> None:
        self.wrench = Wrench(airframe)
        self.P, self.K = gain(np.zeros((4, 4)), np.eye(4), theta)
        self.x: Array | None = None
        self._inertia = np.array(airframe.inertia) if airframe.inertia is not None else None

    def coupling(self, motion: Motion) -> Array:
        """Return f (4,): what turning about two axes does to the third."""
        f = np.zeros(4)
        if self._inertia is not None:
            s = self.wrench.system
            rates = motion.y[:3] * s.scale[:3]
            f[:3] = -np.cross(rates, self._inertia * rates) / self._inertia / s.scale[:3]
        return f

    def step(self, motion: Motion, fault: Array) -> Array:
        """Advance to the motion's time under the losses `fault` (n,); return y - C x^ before the correction."""
        if self.x is None:
            self.x = motion.y
        push = self.wrench.system.B @ (motion.w**2 * (1.0 - fault)) + self.coupling(motion)
        x = self.x + motion.dt * push
        error = motion.y - x
        # exact over the step for a held error: Euler would ring where K dt is not small
        self.x = x + (1.0 - np.exp(-np.diag(self.K) * motion.dt)) * error
        return np.asarray(error)


class ThauResidual:
    """Detection by adaptive thresholds on the four residuals, isolation by their direction.

    Scores are the residual's half widths [-], given to the rotor whose loss it looks like.
    """

    def __init__(
        self, airframe: Airframe, threshold: float = 5.0, hold: float = 0.02, theta: float = 20.0
    ) -> None:
        self.judge = Judge(threshold, hold)
        self._observer = _Observer(airframe, theta)
        self._healthy = np.zeros(self._observer.wrench.rotors)
        self._bounds = [AdaptiveThreshold(k3=0.1 * float(d)) for d in DISTURBANCE]
        self._suspect = 0.6 * threshold
        self._frozen = False

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        motion = self._observer.wrench.feed(reading)
        if motion is None:
            return None
        error = self._observer.step(motion, self._healthy)
        # x^ was corrected before: what is left settles at lack / K; times K it is the lack itself
        lack = error * (1.0 - np.exp(-np.diag(self._observer.K) * motion.dt)) / motion.dt
        rows = zip(self._bounds, lack.tolist(), strict=True)
        excess = [bound.feed(motion.t, value, self._frozen) for bound, value in rows]
        worst = max(abs(value) for value in excess)
        if not self._observer.wrench.ready(motion.t):
            return None
        self._frozen = worst > self._suspect
        away = np.array([value - bound.bounds()[0] for value, bound in zip(lack, self._bounds, strict=True)])
        s = self._observer.wrench.system
        scores = np.where(signature(away, s.B, motion.w**2) > 0.0, worst, 0.0)
        return self.judge.feed(motion.t, scores.tolist())


class ThauFault:
    """The adaptive form; scores are the losses eta^ [-].

    Parameters
    ----------
    theta : of the observer [1/s]. speed : bandwidth of eta^ in hover [1/s]; sets W = w I. sigma_w : sigma W
        [1/s], the leak.
    """

    def __init__(
        self,
        airframe: Airframe,
        threshold: float = 0.5,
        hold: float = 0.02,
        theta: float = 40.0,
        speed: float = 20.0,
        sigma_w: float = 1.0,
    ) -> None:
        self.judge = Judge(threshold, hold)
        self._observer = _Observer(airframe, theta)
        # G = C P E and P = I / theta: eta^' = W E' e / theta; with e = E eta / theta a rotor's own rate
        # is w |E_i|² / theta², and |E_i|² = 4 for a quadrotor in hover
        self._W = speed * theta**2 / 4.0
        self._leak = sigma_w
        self.eta = np.zeros(self._observer.wrench.rotors)

    def feed(self, reading: Reading) -> Verdict | None:
        """Take one reading."""
        motion = self._observer.wrench.feed(reading)
        if motion is None:
            return None
        error = self._observer.step(motion, self.eta)
        mean = error * (1.0 - np.exp(-np.diag(self._observer.K) * motion.dt)) / np.diag(self._observer.K)
        E = -self._observer.wrench.system.B * motion.w**2
        G = self._observer.P @ E
        rise = self._W * (G.T @ (mean / motion.dt)) - self._leak * self.eta
        self.eta = np.clip(self.eta + motion.dt * rise, -0.5, 1.5)
        return self.judge.feed(motion.t, self.eta.tolist()) if self._observer.wrench.ready(motion.t) else None
