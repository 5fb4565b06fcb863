"""Unbalances from block powers: non-negative weighted least squares, its covariance, bounded refits.

    min sum_r (p_r - sum_l M_rl s_l - nu c_r)² / V_r     s_l, nu >= 0
    V = nu'² + 2 nu' S + S² - sum_l S_l² + (0.1 S)² + (0.05 nu')²      S_l = M_rl s_l, nu' = nu c_r

three reweightings. The covariance is the unconstrained solution's sandwich G^-1 (sum_c g_c g_c') G^-1 over
clusters c of about a second, times c / (c - n - 1): blocks close in time share a beat, and a chi-square from
independent rows would be far too sure. `kappa` = trace sandwich / trace G^-1 >= 1 is that excess; whatever
a refit under bounds costs is divided by it.

Source: sheet 2 section 5.
"""

from dataclasses import dataclass

import numpy as np

from gcs_health.estimators.amplitude_model import Array

REWEIGHTINGS = 3
MODEL_ERROR, NOISE_ERROR = 0.1, 0.05  # floors of the model error, shares of S and nu'
RIDGE = 1e-9  # relative, so that coinciding rotors have a Cholesky factor
BOUND_WEIGHT = 1e4  # of the rows that hold an upper bound, over the largest of the problem


@dataclass(frozen=True, slots=True)
class Fit:
    """Solution in the caller's units of s.

    Attributes
    ----------
    s : (n,) non-negative. nu : noise.
    covariance : (n, n) of s, sandwich.
    inseparable : smallest eigenvalue of the normalised Gram matrix [-], and
    tangle : (n,) its eigenvector's entries of the rotors.
    """

    s: Array
    nu: float
    covariance: Array
    inseparable: float
    tangle: Array
    _triangle: Array  # of the scaled, weighted problem
    _target: Array
    _scale: Array
    _kappa: float
    _cost: float

    def std(self) -> Array:
        """Return the standard deviation of each s."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def cost(self, low: Array, high: Array) -> float:
        """Return what it costs to hold every s within [low, high]: a chi-square difference.

        Parameters
        ----------
        low, high : (n,) bounds in the units of s; 0 and infinity bind nothing.
        """
        scale = self._scale
        low = np.append(low, 0.0) / scale
        high = np.append(high, np.inf) / scale
        target = self._target - self._triangle @ low
        matrix, right = self._triangle, target
        bound = np.flatnonzero(np.isfinite(high))
        if len(bound):  # y + slack = high - low, held by weight: a bound for non-negative least squares
            weight = BOUND_WEIGHT * float(np.abs(self._triangle).max())
            n = len(low)
            rows = np.zeros((len(bound), n + len(bound)))
            rows[np.arange(len(bound)), bound] = weight
            rows[np.arange(len(bound)), n + np.arange(len(bound))] = weight
            matrix = np.vstack((np.hstack((matrix, np.zeros((n, len(bound))))), rows))
            right = np.concatenate((target, weight * (high - low)[bound]))
        _, residual = _nnls(matrix, right)
        return max(residual * residual - self._cost, 0.0) / self._kappa


def fit(power: Array, mix: Array, noise: Array, cluster: Array) -> Fit | None:
    """Solve for s and nu; None where the rows are too few, or not numbers.

    Parameters
    ----------
    power : (m,) |Y|². mix : (m, n). noise : (m,) sum of squared weights.
    cluster : (m,) ascending number of the second that each row belongs to.
    """
    n = mix.shape[1]
    starts = np.flatnonzero(np.diff(cluster, prepend=-1))
    clusters = len(starts)
    if clusters < n + 2 or not (np.isfinite(power).all() and np.isfinite(mix).all()):
        return None
    matrix = np.column_stack((mix, noise))
    scale = 1.0 / np.maximum(np.sqrt(np.mean(matrix * matrix, axis=0)), 1e-300)
    matrix = matrix * scale
    unit = float(np.mean(power))
    if not unit > 0.0:
        return None
    power = power / unit
    variance = np.full(len(power), 1.0)
    x = np.zeros(n + 1)
    for _ in range(REWEIGHTINGS + 1):
        weighted = matrix / variance[:, None]
        gram, right = matrix.T @ weighted, weighted.T @ power
        own = np.diag(gram).copy()
        gram.flat[:: n + 2] += np.where(own > 0.0, RIDGE * own, 1.0)  # a blind rotor has an empty column
        try:
            triangle = np.linalg.cholesky(gram).T
        except np.linalg.LinAlgError:  # absurd numbers
            return None
        target = np.linalg.solve(triangle.T, right)
        x, residual = _nnls(triangle, target)
        variance = _variance(matrix, x)
    inverse = np.linalg.inv(gram)
    scores = weighted * (power - matrix @ (inverse @ right))[:, None]
    clustered = np.add.reduceat(scores, starts, axis=0)
    meat = clustered.T @ clustered * (clusters / (clusters - n - 1))
    sandwich = inverse @ meat @ inverse
    kappa = max(1.0, float(np.trace(sandwich) / np.trace(inverse)))
    norm = 1.0 / np.maximum(np.sqrt(np.diag(gram)), 1e-300)
    values, vectors = np.linalg.eigh(gram * norm * norm[:, None])
    back = unit * scale
    return Fit(
        (x * back)[:n],
        float(x[n] * back[n]),
        (sandwich * back * back[:, None])[:n, :n],
        float(values[0]),
        np.abs(vectors[:n, 0]),
        triangle,
        target,
        back,
        kappa,
        residual * residual,
    )


def _variance(matrix: Array, x: Array) -> Array:
    """Return V of each row, in the scaled units."""
    parts = matrix[:, :-1] * x[:-1]
    total = parts.sum(axis=1)
    noise = matrix[:, -1] * x[-1]
    v = noise * noise * (1.0 + NOISE_ERROR**2) + 2.0 * noise * total
    v += total * total * (1.0 + MODEL_ERROR**2) - (parts * parts).sum(axis=1)
    floor = 1e-6 * float(np.mean(v)) + 1e-30
    out: Array = np.maximum(v, floor)
    return out


def _nnls(matrix: Array, right: Array) -> tuple[Array, float]:
    from scipy.optimize import nnls  # only where used: half a second to import

    solution, residual = nnls(matrix, right, maxiter=50 * matrix.shape[1])
    return solution, float(residual)
