"""Gains of the adaptive observer that are proven stable, and the proof, without a solver.

The LMI (17), P > 0 and [[A'P + PA - C'L' - LC + alpha I, sqrt(alpha) P], [sqrt(alpha) P, -I]] < 0, is by Schur's
complement M = (A - KC)'P + P(A - KC) + alpha (PP + I) < 0. For one rotor, A = -kappa_f/J and C = 1:

    K > alpha (P + 1/P)/2 - kappa_f/J,      least at P = 1:  K > alpha - kappa_f/J

and the same for the coupled system with P = I and K = k I, whose slowest pole takes the place of -kappa_f/J.
`CERTIFIED` is what the solver found, by `python -m gcs_health.estimators.observer_synthesis`; the
tests certify it again by eigenvalues. M mixes units: it is sufficient for stability, no rule for tuning.

Source: Melczer (2019), eqs. (14), (16), (17); sheet 3, "Scalar LMI by hand".
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating[Any]]


class ObserverProblem(NamedTuple):
    """What the LMI is about; C = I.

    name : of the system. poles : the diagonal of A [1/s]. alpha : gamma_Phi + gamma_eta gamma_phi |D| [1/s].
    """

    name: str
    poles: tuple[float, ...]
    alpha: float


class CertifiedGain(NamedTuple):
    """A solution of (17) with P and K diagonal, and the least K = k I for which the solver found any."""

    problem: ObserverProblem
    P: tuple[float, ...]
    K: tuple[float, ...]
    least: float


def least_gain(alpha: float, damping: float, P: float = 1.0) -> float:
    """Return the bound that K must exceed [1/s]; `damping` is kappa_f/J."""
    return 0.5 * alpha * (P + 1.0 / P) - damping


def lyapunov(problem: ObserverProblem, P: Array, K: Array) -> Array:
    """Return M, which must be negative definite; P and K are (n, n)."""
    A = np.diag(problem.poles)
    closed = A - K
    M: Array = closed.T @ P + P @ closed + problem.alpha * (P @ P + np.eye(len(A)))
    return M


def certifies(problem: ObserverProblem, P: Array, K: Array) -> bool:
    """Whether P and K prove the observer stable."""
    symmetric = 0.5 * (P + P.T)
    M = lyapunov(problem, symmetric, K)
    return bool(np.linalg.eigvalsh(symmetric)[0] > 0.0 and np.linalg.eigvalsh(0.5 * (M + M.T))[-1] < 0.0)


CERTIFIED: tuple[CertifiedGain, ...] = (
    CertifiedGain(
        ObserverProblem("one rotor of Melczer (2019)", (-0.237692,), 8.00883),
        (0.77538,),
        (8.54839,),
        7.77126,
    ),
    CertifiedGain(
        ObserverProblem(
            "hexacopter of Melczer (2019), coupled",
            (
                -0.237692,
                -0.237692,
                -0.237692,
                -0.237692,
                -0.237692,
                -0.237692,
                -0.1,
                -0.1,
                -0.1,
            ),
            31.6175,
        ),
        (
            0.759209,
            0.834363,
            0.834363,
            0.834363,
            0.834363,
            0.834363,
            0.8476,
            0.8476,
            0.77509,
        ),
        (
            34.671,
            34.671,
            34.671,
            34.671,
            34.671,
            34.671,
            34.671,
            34.671,
            34.671,
        ),
        31.5191,
    ),
)
