"""Unbalances from block powers: non-negative weighted least squares, its covariance, bounded refits.

    min sum_r (p_r - sum_l M_rl s_l - nu c_r)² / V_r     s_l, nu >= 0
    V = nu'² + 2 nu' S + S² - sum_l S_l² + (0.1 S)² + (0.05 nu')²      S_l = M_rl s_l, nu' = nu c_r

three reweightings. The covariance is the unconstrained solution's sandwich G^-1 (sum_c g_c g_c') G^-1 over
clusters c of about a second, times c / (c - n - 1): blocks close in time share a beat, and a chi-square from
independent rows would be far too sure. `kappa` = trace sandwich / trace G^-1 >= 1 is that excess; whatever
a refit under bounds costs is divided by it.

Of so few unknowns the exchanges of `settle` on a plain table cost less than a general solver's call, and bounds hold
exactly rather than by a weight. Source: sheet 2 section 5.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gcs_health.estimators.amplitude_model import Array

REWEIGHTINGS = 3
MODEL_ERROR, NOISE_ERROR = 0.1, 0.05  # floors of the model error, shares of S and nu'
RIDGE = 1e-9  # relative, so that coinciding rotors have a Cholesky factor
ROUNDING = 1e-10  # relative, within which a value lies on its bound
TRIES = 3  # exchanges of all offenders that need not help
LOW, FREE, HIGH = -1, 0, 1
Table = list[
    list[float]
]  # (n, n + 1), of G x + slope = b: each free x or held one's slope by the others and b


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
    _table: Table
    _flat: float
    _x: Array  # its solution
    _slope: Array  # of half the sum of squares, at the solution
    _held: list[int]
    _scale: Array
    _kappa: float

    def std(self) -> Array:
        """Return the standard deviation of each s."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    def tangle(self, below: float) -> Array:
        """Return (n, n) how much of each rotor lies in what cannot be solved for, and which other may have it.

        That is the projection onto all directions of the normalised Gram matrix with an eigenvalue `below`: of one
        such direction alone any vector of their span might be shown, and where all rotors turn at one speed the
        pair of the other spin.
        """
        norm = 1.0 / np.maximum(np.sqrt(self._gram.diagonal()), 1e-300)
        values, vectors = np.linalg.eigh(self._gram * norm * norm[:, None])
        lost = vectors[:-1, values < below]
        out: Array = np.abs(lost @ lost.T)
        return out

    def cost(self, low: Array, high: Array) -> float:
        """Return what it costs to hold every s within [low, high]: a chi-square difference.

        Parameters
        ----------
        low, high : (n,) bounds in the units of s; 0 and infinity bind nothing.
        """
        scale = self._scale[:-1]
        bounds = [*(low / scale).tolist(), 0.0], [*(high / scale).tolist(), math.inf]
        x = settle(self._table[:], self._held[:], *bounds, self._flat)
        off = x - self._x
        return max(float(off @ (self._gram @ off + 2.0 * self._slope)), 0.0) / self._kappa


def fit(power: Array, mix: Array, noise: Array, starts: list[int]) -> Fit | None:
    """Solve for s and nu; None where the rows are too few, or not numbers.

    Parameters
    ----------
    power : (m,) |Y|². mix : (m, n). noise : (m,) sum of squared weights.
    starts : first row of each second, ascending.
    """
    n, clusters = mix.shape[1], len(starts)
    if clusters < n + 2:
        return None
    rows = np.concatenate((mix.T, noise[None], power[None]))  # (n + 2, m): sums run along the rows
    unit = float(power.sum()) / len(power)
    size = (rows[:-1] * rows[:-1]).sum(axis=1) / len(power)
    if not (unit > 0.0 and math.isfinite(unit + float(size.sum()))):
        return None
    scale = 1.0 / np.maximum(np.sqrt(size), 1e-300)
    rows *= np.append(scale, 1.0 / unit)[:, None]
    matrix, squares, weighted = rows[:-1], rows[:n] * rows[:n], rows
    blind = np.where(size > 0.0, 0.0, 1.0)  # such a rotor has an empty column
    free = [0.0] * (n + 1), [math.inf] * (n + 1)
    for left in range(REWEIGHTINGS, -1, -1):
        products = weighted @ matrix.T
        gram, right = products[:-1], products[-1]
        own = gram.reshape(-1)[:: n + 2]
        own += RIDGE * own + blind
        try:
            inverse = np.linalg.inv(gram)
        except np.linalg.LinAlgError:  # absurd numbers
            return None
        x, held = inverse @ right, [FREE] * (n + 1)
        if not left or not min(x.tolist()) >= 0.0:
            table = np.concatenate((inverse, x[:, None]), axis=1).tolist()
            flat = ROUNDING * float(np.abs(right).max())
            x = settle(table, held, *free, flat)
        if left:
            weighted = rows / _variance(matrix, squares, x)
    if not math.isfinite(float(x.sum())):
        return None
    scores = weighted[:-1] * (rows[-1] - (inverse @ right) @ matrix)
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
        table,
        flat,
        x,
        gram @ x - right,
        held,
        back,
        kappa,
    )


def _variance(matrix: Array, squares: Array, x: Array) -> Array:
    """Return V of each row, in the scaled units; `squares` of the matrix without its noise."""
    s, nu = x[:-1], x[-1]
    total, noise = s @ matrix[:-1], nu * matrix[-1]
    v = total * (2.0 * noise + (1.0 + MODEL_ERROR**2) * total)
    v += (1.0 + NOISE_ERROR**2) * noise * noise
    v -= (s * s) @ squares
    out: Array = np.maximum(v, 1e-6 / len(v) * float(v.sum()) + 1e-30)
    return out


def settle(table: Table, held: list[int], low: Sequence[float], high: Sequence[float], flat: float) -> Array:
    """Return the x within [low, high] of the least x'Gx - 2 b'x.

    All that offend are freed or held at once, as long as that helps; then one at a time, which always ends.

    Parameters
    ----------
    table, held : where to begin, LOW, FREE or HIGH of each entry (HIGH only at a finite bound); brought to the
        solution. Near it there is little to do.
    flat : slope that counts for none.

    Source: Judice and Pires, "A block principal pivoting algorithm for large-scale strictly monotone linear
    complementarity problems", 1994.
    """
    n = len(table)
    fewest, tries = n + 1, TRIES
    values: list[float] = []
    for _ in range(20 * n):
        values = _values(table, held, low, high)
        offend = _offending(table, held, values, low, high, flat)
        if not offend:
            break
        if len(offend) < fewest:
            fewest, tries = len(offend), TRIES
        elif tries:
            tries -= 1
        else:
            offend = offend[-1:]
        for i, state in offend:
            if not _exchange(table, i):
                break  # absurd numbers
            held[i] = state
    return np.array(
        [
            min(max(x, b), c) if state == FREE else b if state == LOW else c
            for state, x, b, c in zip(held, values, low, high, strict=True)
        ]
    )


def _values(table: Table, held: list[int], low: Sequence[float], high: Sequence[float]) -> list[float]:
    """Return x of each entry that is free, minus the slope of each that is held."""
    values = [row[-1] for row in table]
    for j, state in enumerate(held):
        if state != FREE:
            bound = low[j] if state == LOW else high[j]
            if bound:
                values = [value - row[j] * bound for value, row in zip(values, table, strict=True)]
    return values


def _offending(
    table: Table,
    held: list[int],
    values: list[float],
    low: Sequence[float],
    high: Sequence[float],
    flat: float,
) -> list[tuple[int, int]]:
    """Return which entries are free beyond a bound or held though they would leave it, and what they should be."""
    sizes = [abs(row[-1]) for row, state in zip(table, held, strict=True) if state == FREE]
    near = ROUNDING * max(sizes, default=0.0)
    offend = []
    for i, (state, value) in enumerate(zip(held, values, strict=True)):
        if state != FREE:
            if value * state < -flat:
                offend.append((i, FREE))
        elif value < low[i] - near:
            offend.append((i, LOW))
        elif value > high[i] + near:
            offend.append((i, HIGH))
    return offend


def _exchange(table: Table, k: int) -> bool:
    """Free an entry that is held, or hold one that is free; return whether it could be done."""
    pivot = table[k][k]
    if not pivot > 0.0:
        return False
    row = [value / pivot for value in table[k]]
    row[k] = 1.0 / pivot
    for i, other in enumerate(table):
        if i != k:
            share = other[k]
            table[i] = made = [value - share * part for value, part in zip(other, row, strict=True)]
            made[k] = -share / pivot
    table[k] = row
    return True
