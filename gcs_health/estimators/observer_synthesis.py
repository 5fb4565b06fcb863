"""Observer gains by convex optimisation, at design time: `python -m gcs_health.estimators.observer_synthesis`.

Prints the rows of `observer_gains.CERTIFIED`. Needs the extra `design` (cvxpy). For a fixed gain K = k I the
LMI (17) is linear in P alone; the least k is found by bisection, and the printed solution has a tenth more.
(Minimising |L| instead is a trap: P runs to its bound and K with it.)

Source: Melczer (2019), eqs. (10), (13), (17); constants from its Table 2, the hexacopter's from
`simulate/vehicles/melczer_hexa.toml`, since the thesis does not print them.
"""

import sys
from typing import Any

import numpy as np

from gcs_health.estimators.observer_gains import CertifiedGain, ObserverProblem, certifies

FRICTION, INERTIA, TORQUE = 9.4782e-6, 3.9876e-5, 1.9960e-7  # Table 2, weighted
TOP_SPEED, ROTORS = 800.0, 6
BODY_DAMPING, TOP_RATE = 0.1, 6.0  # 1/s, rad/s: not in the thesis


def decentralised() -> ObserverProblem:
    """Return one rotor of the thesis."""
    return ObserverProblem(
        "one rotor of Melczer (2019)", (-FRICTION / INERTIA,), 2.0 * TOP_SPEED * TORQUE / INERTIA
    )


def coupled() -> ObserverProblem:
    """Return its hexacopter with rotors and body rates together."""
    poles = (-FRICTION / INERTIA,) * ROTORS + (-BODY_DAMPING,) * 3
    # |eta| <= sqrt(6); the moments add next to nothing to |D| = kappa_tau/J
    alpha = 2.0 * TOP_SPEED * ROTORS**0.5 * TORQUE / INERTIA + 2.0 * TOP_RATE
    return ObserverProblem("hexacopter of Melczer (2019), coupled", poles, alpha)


def solve(problem: ObserverProblem, gain: float, margin: float = 1e-7) -> "np.ndarray[Any, Any] | None":
    """Return a diagonal P for K = gain I that satisfies (17) strictly; None if there is none.

    Raises
    ------
    ImportError : cvxpy is not installed.
    """
    import cvxpy

    n = len(problem.poles)
    A = np.diag(problem.poles)
    p = cvxpy.Variable(n)
    P = cvxpy.diag(p)
    root = problem.alpha**0.5
    closed = (A - gain * np.eye(n)) @ P
    corner = closed + closed.T + problem.alpha * np.eye(n)
    lmi = cvxpy.bmat([[corner, root * P], [root * P, -np.eye(n)]])
    task = cvxpy.Problem(cvxpy.Minimize(0), [p >= margin, lmi << -margin * np.eye(2 * n)])
    task.solve(solver=cvxpy.CLARABEL)
    if p.value is None or not certifies(problem, np.diag(p.value), gain * np.eye(n)):
        return None
    return np.asarray(p.value)


def synthesise(problem: ObserverProblem) -> CertifiedGain:
    """Return gains a tenth above the least for which the LMI has a solution."""
    low, high = 0.0, 4.0 * problem.alpha
    while high - low > 1e-4 * problem.alpha:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if solve(problem, middle) is not None else (middle, high)
    gain = 1.1 * high
    P = solve(problem, gain)
    assert P is not None
    return CertifiedGain(problem, tuple(P.tolist()), (gain,) * len(problem.poles), high)


def main() -> None:
    """Print the table."""
    for problem in (decentralised(), coupled()):
        found = synthesise(problem)
        numbers = [
            f"({', '.join(f'{value:.6g}' for value in row)},)" for row in (problem.poles, found.P, found.K)
        ]
        sys.stdout.write(
            "    CertifiedGain(\n"
            f'        ObserverProblem("{problem.name}", {numbers[0]}, {problem.alpha:.6g}),\n'
            f"        {numbers[1]},\n        {numbers[2]},\n        {found.least:.6g},\n    ),\n"
        )


if __name__ == "__main__":
    main()
