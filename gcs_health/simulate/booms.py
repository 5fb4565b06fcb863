"""Booms that bend: the first two out-of-plane modes of each, so that a boom-tip accelerometer exists.

Ritz functions l² to l⁷ on a clamped beam with a tip mass:
    M_ij = int rho phi_i phi_j dl + m phi_i(L) phi_j(L),   K_ij = EI int phi_i'' phi_j'' dl
and each mode a damped oscillator driven by the rotor's force at the tip. Two terms alone would put the
second mode 37 % too high, four 0.2 %. Source: sheet 4 section 3 "Boom" (148.0 and 1187 Hz for the paper's).
"""

import numpy as np
from numpy.typing import NDArray

from gcs_health.simulate.vehicle import Boom

Array = NDArray[np.float64]
POWERS = (2, 3, 4, 5, 6, 7)
MODES = 2


def modes(boom: Boom) -> tuple[Array, Array]:
    """Return frequencies [rad/s] and tip deflections [1/sqrt(kg)] of the first modes, mass-normalised."""
    from scipy.linalg import eigh

    length = boom.length
    M, K = np.zeros((2, len(POWERS), len(POWERS)))
    for i, a in enumerate(POWERS):
        for j, b in enumerate(POWERS):
            # in l / L, so that the matrices stay well conditioned
            M[i, j] = boom.line_mass * length / (a + b + 1) + boom.tip_mass
            K[i, j] = boom.stiffness / length**3 * a * (a - 1) * b * (b - 1) / (a + b - 3)
    values, vectors = eigh(K, M)
    tip = vectors.sum(axis=0)
    return np.sqrt(values[:MODES]), np.abs(tip[:MODES])


class Booms:
    """The tips of all booms of one flight; `step` takes the force of each rotor on its tip."""

    def __init__(self, boom: Boom, count: int, dt: float) -> None:
        from scipy.linalg import expm

        frequencies, self._tip = modes(boom)
        self._steps = []
        for w in frequencies:
            A = np.array([[0.0, 1.0], [-w * w, -2.0 * boom.damping * w]])
            F = expm(A * dt)  # exact for a force held over the step, whatever the frequency
            self._steps.append((F, np.linalg.solve(A, (F - np.eye(2)) @ np.array([0.0, 1.0])), w))
        self._damping = boom.damping
        self._state: Array = np.zeros((MODES, 2, count))
        self._mean: Array | None = None

    def step(self, lift: Array) -> Array:
        """Return the tip accelerations [m/s²], out of plane, upward, by the upward forces `lift` [N]."""
        if self._mean is None:
            self._mean = np.array(lift)
        acceleration = np.zeros(len(lift))
        for k, (F, G, w) in enumerate(self._steps):
            drive = self._tip[k] * lift
            state = F @ self._state[k] + np.outer(G, drive)
            self._state[k] = state
            acceleration += self._tip[k] * (drive - w * w * state[0] - 2.0 * self._damping * w * state[1])
        return acceleration
