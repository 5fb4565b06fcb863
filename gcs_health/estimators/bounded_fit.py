"""Unbalances from block powers: non-negative weighted least squares, its covariance, bounded refits.

    min sum_r (p_r - sum_l M_rl s_l - nu c_r)² / V_r     s_l, nu >= 0
    V = nu'² + 2 nu' S + S² - sum_l S_l² + (0.1 S)² + (0.05 nu')²      S_l = M_rl s_l, nu' = nu c_r

three reweightings. The covariance is the unconstrained solution's sandwich G^-1 (sum_c g_c g_c') G^-1 over
clusters c of about a second, times c / (c - n - 1): blocks close in time share a beat, and a chi-square from
independent rows would be far too sure. `kappa` = trace sandwich / trace G^-1 >= 1 is that excess; whatever
a refit under bounds costs is divided by it.

Source: sheet 2 section 5.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_health.estimators.amplitude_model import Array

REWEIGHTINGS = 3
MODEL_ERROR, NOISE_ERROR = 0.1, 0.05  # floors of the model error, shares of S and nu'
RIDGE = 1e-9  # relative, so that coinciding rotors have a Cholesky factor
ROUNDING = 1e-12  # relative, within which a value lies on its bound
TRIES = 3  # exchanges of all offenders that need not help
LOW, FREE, HIGH = -1, 0, 1


@dataclass(frozen=True, slots=True)
class Fit:
    """Solution in the caller's units of s.

    Attributes
    ----------
    s : (n,) non-negative. nu : noise.
    covariance : (n, n) of s, sandwich.
    """

    s: Array
    nu: float
    covariance: Array
    _gram: Array  # of the scaled, weighted problem, (n + 1, n + 1)
    _right: Array
    _x: Array  # its solution
    _slope: Array  # of half the sum of squares, at the solution
    _held: list[int]
    _scale: Array
    _kappa: float

    def std(self) -> Array:
        """Return the standard deviation of each s."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def tangle(self) -> tuple[float, Array]:
        """Return the smallest eigenvalue of the normalised Gram matrix [-], its eigenvector's (n,) entries."""
        norm = 1.0 / np.maximum(np.sqrt(self._gram.diagonal()), 1e-300)
        values, vectors = np.linalg.eigh(self._gram * norm * norm[:, None])
        return float(values[0]), np.abs(vectors[:-1, 0])

    def cost(self, low: Array, high: Array) -> float:
        """Return what it costs to hold every s within [low, high]: a chi-square difference.

        Parameters
        ----------
        low, high : (n,) bounds in the units of s; 0 and infinity bind nothing.
        """
        scale = self._scale[:-1]
        bounds = [*(low / scale).tolist(), 0.0], [*(high / scale).tolist(), np.inf]
        x, _ = solve_within(self._gram, self._right, *bounds, self._held)
        off = x - self._x
        return max(float(off @ (self._gram @ off + 2.0 * self._slope)), 0.0) / self._kappa


def fit(power: Array, mix: Array, noise: Array, starts: Array) -> Fit | None:
    """Solve for s and nu; None where the rows are too few, or not numbers.

    Parameters
    ----------
    power : (m,) |Y|². mix : (m, n). noise : (m,) sum of squared weights.
    starts : first row of each second, ascending.
    """
    n, clusters = mix.shape[1], len(starts)
    if clusters < n + 2:
        return None
    table = np.concatenate((mix.T, noise[None], power[None]))  # (n + 2, m): sums run along the rows
    unit = float(power.mean())
    squares = table * table
    size = squares[: n + 1].mean(axis=1)
    if not (unit > 0.0 and np.isfinite(size.sum() + unit)):
        return None
    scale = 1.0 / np.maximum(np.sqrt(size), 1e-300)
    table *= np.append(scale, 1.0 / unit)[:, None]
    squares = table[:n] * table[:n]
    matrix, seen = table[: n + 1], table[n + 1]
    free = [0.0] * (n + 1), [np.inf] * (n + 1)
    held = [FREE] * (n + 1)
    weighted = table
    for again in range(REWEIGHTINGS + 1):
        if again:
            weighted = table / _variance(matrix, squares, x)
        products = weighted @ matrix.T
        gram, right = products[:-1], products[-1]
        own = gram.diagonal()
        gram.flat[:: n + 2] += np.where(own > 0.0, RIDGE * own, 1.0)  # a blind rotor has an empty column
        try:
            x, held = solve_within(gram, right, *free, held)
        except np.linalg.LinAlgError:  # absurd numbers
            return None
    inverse = np.linalg.inv(gram)
    scores = weighted[:-1] * (seen - (inverse @ right) @ matrix)
    clustered = np.add.reduceat(scores, starts, axis=1)
    meat = clustered @ clustered.T * (clusters / (clusters - n - 1))
    sandwich = inverse @ meat @ inverse
    kappa = max(1.0, float(sandwich.trace() / inverse.trace()))
    back = unit * scale
    return Fit(
        (x * back)[:n],
        float(x[n] * back[n]),
        (sandwich * back * back[:, None])[:n, :n],
        gram,
        right,
        x,
        gram @ x - right,
        held,
        back,
        kappa,
    )


def _variance(matrix: Array, squares: Array, x: Array) -> Array:
    """Return V of each row, in the scaled units; `squares` of the matrix without its noise."""
    s = x[:-1]
    total, noise = s @ matrix[:-1], x[-1] * matrix[-1]
    v = (noise * (1.0 + NOISE_ERROR**2) + 2.0 * total) * noise
    v += total * total * (1.0 + MODEL_ERROR**2) - (s * s) @ squares
    out: Array = np.maximum(v, 1e-6 * float(v.mean()) + 1e-30)
    return out


def solve_within(
    gram: Array, right: Array, low: Sequence[float], high: Sequence[float], held: Sequence[int]
) -> tuple[Array, list[int]]:
    """Return the x within [low, high] of the least x'Gx - 2 b'x, and which bound holds each entry.

    All that offend are freed or held at once, as long as that helps; then one at a time, which always ends.

    Parameters
    ----------
    gram : (n, n) positive definite. right : (n,) b.
    held : LOW, FREE or HIGH of each entry, to begin with; near the solution saves exchanges.

    Raises
    ------
    LinAlgError : the matrix is singular or not of numbers.

    Source: Judice and Pires, "A block principal pivoting algorithm ...", Computers & Op. Res. 21(5), 1994.
    """
    n = len(right)
    held = [state if state != HIGH or top < np.inf else FREE for state, top in zip(held, high, strict=True)]
    fewest, tries = n + 1, TRIES
    for _ in range(20 * n):
        x = np.array([(low[i], 0.0, high[i])[state + 1] for i, state in enumerate(held)])
        free = [i for i, state in enumerate(held) if state == FREE]
        if len(free) == n:
            x = np.linalg.solve(gram, right)
        elif free:
            x[free] = np.linalg.solve(gram[free][:, free], (right - gram @ x)[free])
        values, slope = x.tolist(), (gram @ x - right).tolist()
        if not sum(values) - sum(values) == 0.0:
            raise np.linalg.LinAlgError("not of numbers")
        near = ROUNDING * max(map(abs, values))
        flat = ROUNDING * max(map(abs, right.tolist()))
        offend = []
        for i, state in enumerate(held):
            if state == FREE:
                if values[i] < low[i] - near:
                    offend.append((i, LOW))
                elif values[i] > high[i] + near:
                    offend.append((i, HIGH))
            elif slope[i] * state > flat:
                offend.append((i, FREE))
        if not offend:
            break
        if len(offend) < fewest:
            fewest, tries = len(offend), TRIES
        elif tries:
            tries -= 1
        else:
            offend = offend[-1:]
        for i, state in offend:
            held[i] = state
    return np.minimum(np.maximum(x, low), high), held
