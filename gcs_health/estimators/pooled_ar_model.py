"""Functionally pooled AR models: basis, moments, weighted least squares, and the search for k.

    y[t] = sum_i a_i(k) y[t-i] + e[t],     a_i(k) = sum_j theta_ij G_j(k),    i = 1..na, j = 1..p
    v[t] = [y, f_1 .. f_p],                f_j[t] = sum_i theta_ij y[t-i]
    q(k) = [1, -G_1(k) .. -G_p(k)],        e = q'v,   RSS(k) = q' M q,   M = sum_t v v'

M of a window is the sum of its blocks' Grams, and RSS a polynomial of degree 2 (p - 1): no descent is needed.
G_j are shifted Chebyshev polynomials of the first kind; the paper's recurrence spans the same functions.

Source: Dutta et al. (2023), eqs. (9)-(22) and appendices B, C; corrected as in sheet 4 sections 2 and 3.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gcs_health.airframe import AlarmLevel
from gcs_health.estimators.labelled_flights import BOOM
from gcs_health.estimators.pooled_ar_air import KnownAir
from gcs_health.estimators.speed_span import SpeedFacts

Array = NDArray[np.float64]
LOWEST, HIGHEST = -0.4, 1.4  # where k is searched; outside what can be, so that a wrong regime shows
GRID = np.linspace(LOWEST, HIGHEST, 91)
RIDGE = 1e-9  # of the moments' mean diagonal


def basis(k: Array | float, p: int) -> Array:
    """Return (..., p): T*_0 = 1, T*_1 = 2k - 1, T*_n+1 = (4k - 2) T*_n - T*_n-1 (sheet 4, eq. 4)."""
    x = 2.0 * np.asarray(k, dtype=float) - 1.0
    G: Array = np.polynomial.chebyshev.chebvander(x.ravel(), p - 1).astype(np.float64)
    return G.reshape(*x.shape, p)


def basis_slope(k: Array | float, p: int) -> Array:
    """Return (..., p): dG_j / dk."""
    k = np.asarray(k, dtype=float)
    G = basis(k, max(p, 2))
    slope = np.zeros((*k.shape, max(p, 2)))
    slope[..., 1] = 2.0
    for n in range(2, p):
        slope[..., n] = 4.0 * G[..., n - 1] + (4.0 * k - 2.0) * slope[..., n - 1] - slope[..., n - 2]
    out: Array = slope[..., :p]
    return out


class Moments(NamedTuple):
    """Sums over t of one level, enough for every p and every na up to theirs.

    S (na, na) : of phi phi'. c (na,) : of phi y. Y : of y². length : samples.
    """

    S: Array
    c: Array
    Y: float
    length: int

    def __add__(self, other: "Moments") -> "Moments":  # type: ignore[override]
        """Pool two stretches."""
        return Moments(self.S + other.S, self.c + other.c, self.Y + other.Y, self.length + other.length)

    def of_order(self, na: int) -> "Moments":
        """Return those of a lower order."""
        return Moments(self.S[:na, :na], self.c[:na], self.Y, self.length)


def history(y: Array, na: int) -> Array:
    """Return (len(y) - na, na): phi[t] = y[t-1] .. y[t-na] for t = na, na + 1 ..."""
    phi: Array = np.lib.stride_tricks.sliding_window_view(y[:-1], na)[:, ::-1]
    return phi


def moments(y: Array, na: int, piece: int = 20_000) -> Moments:
    """Return the moments of one signal (n,), its constant removed; n > na."""
    S, c = np.zeros((na, na)), np.zeros(na)
    for start in range(na, len(y), piece):
        part = y[start - na : start + piece]
        phi = np.ascontiguousarray(history(part, na))
        S += phi.T @ phi
        c += phi.T @ part[na:]
    return Moments(S, c, float(y[na:] @ y[na:]), len(y) - na)


def fit(by_level: list[Moments], levels: Array, na: int, p: int, weights: Array | None = None) -> Array:
    """Return theta (na, p) by least squares, then once more weighted with 1 / sigma_l² (sheet 4, eq. 3)."""
    G = basis(levels, p)
    if weights is None:
        first = fit(by_level, levels, na, p, np.ones(len(levels)))
        weights = 1.0 / residual_variances(by_level, levels, first)
    A, b = np.zeros((na * p, na * p)), np.zeros(na * p)
    for w, level, g in zip(weights, by_level, G, strict=True):
        part = level.of_order(na)
        A += w * np.kron(part.S, np.outer(g, g))
        b += w * np.kron(part.c, g)
    A[np.diag_indices_from(A)] += RIDGE * np.trace(A) / len(A)
    return np.asarray(np.linalg.solve(A, b)).reshape(na, p)


def residual_variances(by_level: list[Moments], levels: Array, theta: Array) -> Array:
    """Return (levels,): mean squared one-step error at each level."""
    na, p = theta.shape
    out = []
    for level, g in zip(by_level, basis(levels, p), strict=True):
        part, a = level.of_order(na), theta @ g
        out.append((part.Y - 2.0 * a @ part.c + a @ part.S @ a) / part.length)
    return np.asarray(np.maximum(np.array(out, dtype=float), 1e-300), dtype=np.float64)


def bic(by_level: list[Moments], levels: Array, theta: Array) -> float:
    """Return sum_l N ln sigma_l² + na p ln(K1 N); eq. (18) as sheet 4 section 3 mends it."""
    counts = np.array([level.length for level in by_level])
    variances = residual_variances(by_level, levels, theta)
    return float(counts @ np.log(variances) + theta.size * np.log(counts.sum()))


def best_order(level: Moments, orders: tuple[int, ...]) -> int:
    """Return the AR order of the least BIC on one level, as the paper picks it on healthy data."""
    zero = np.zeros(1)
    return min(orders, key=lambda na: bic([level], zero, fit([level], zero, na, 1)))


def grams(y: Array, theta: Array, block: int) -> Array:
    """Return (blocks, p + 1, p + 1): sums of v v' over whole blocks of `block` samples after the first na."""
    na, p = theta.shape
    count = (len(y) - na) // block
    out = np.empty((count, p + 1, p + 1))
    v = np.empty((block, p + 1))
    for k in range(count):
        part = y[k * block : k * block + na + block]
        v[:, 0] = part[na:]
        v[:, 1:] = np.ascontiguousarray(history(part, na)) @ theta  # a view would miss the fast product
        out[k] = v.T @ v
    return out


def direction(k: Array | float, p: int) -> Array:
    """Return q(k), (..., p + 1)."""
    G = basis(k, p)
    return np.concatenate([np.ones((*G.shape[:-1], 1)), -G], axis=-1)


def direction_slope(k: Array | float, p: int) -> Array:
    """Return dq/dk, (..., p + 1)."""
    G = basis_slope(k, p)
    return np.concatenate([np.zeros((*G.shape[:-1], 1)), -G], axis=-1)


def rss(M: Array, k: Array) -> Array:
    """Return the residual sum of squares of windows M (w, p+1, p+1) at k (w,)."""
    q = direction(k, M.shape[-1] - 1)
    return np.asarray(np.einsum("wi,wij,wj->w", q, M, q))


def minimise(M: Array) -> Array:
    """Return (w,): where the RSS of each window M (w, p+1, p+1) is least, between -0.4 and 1.4."""
    p = M.shape[-1] - 1
    if p == 2:
        # G_1 = 1, G_2 = x = 2k - 1: a parabola, x = (M02 - M12) / M22; index 0 is y
        x = (M[:, 0, 2] - M[:, 1, 2]) / np.maximum(M[:, 2, 2], 1e-300)
        return np.clip(0.5 * (x + 1.0), LOWEST, HIGHEST)
    q = direction(GRID, p)
    outer = (q[:, :, None] * q[:, None, :]).reshape(len(GRID), -1)
    values = M.reshape(len(M), -1) @ outer.T
    at = np.clip(values.argmin(axis=1), 1, len(GRID) - 2)
    rows = np.arange(len(M))
    left, middle, right = values[rows, at - 1], values[rows, at], values[rows, at + 1]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / np.where(bend > 0.0, bend, np.inf)
    return np.asarray(GRID[at] + np.clip(shift, -1.0, 1.0) * (GRID[1] - GRID[0])).clip(LOWEST, HIGHEST)


class Spread(NamedTuple):
    """How sure k is by its window. crlb, robust : variances of k; rss : at k."""

    rss: Array
    crlb: Array
    robust: Array


def spread(blocks: Array, k: Array, count: float) -> Spread:
    """Return variances of k (w,) from each window's blocks (w, m, p+1, p+1) of `count` samples in all.

    The bound is eq. (40); the robust one allows for scores that are alike from block to block (sheet 4, eq. 7).
    """
    p = blocks.shape[-1] - 1
    M = blocks.sum(axis=1)
    q, slope = direction(k, p), direction_slope(k, p)
    left = np.maximum(rss(M, k), 1e-300)
    information = np.maximum(np.einsum("wi,wij,wj->w", slope, M, slope), 1e-300)
    crlb = left / count / information
    scores = np.einsum("wi,wmij,wj->wm", slope, blocks, q)
    scores -= scores.mean(axis=1, keepdims=True)
    total = (scores**2).sum(axis=1)
    for lag in (1, 2, 3):
        if scores.shape[1] > lag:
            total += 2.0 * (1.0 - lag / 4.0) * (scores[:, lag:] * scores[:, :-lag]).sum(axis=1)
    return Spread(left, crlb, np.maximum(total / information**2, crlb))


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """The AR model of one rotor's degradation on one signal.

    rotor : index. channel : "az", "p" .., or "boom" for the sensor on the rotor's own boom.
    theta : (na, p). variance : (levels,) of the residual at the trained levels.
    """

    rotor: int
    channel: str
    theta: Array
    variance: Array


@dataclass(frozen=True, slots=True, eq=False)
class PooledModel:
    """All that was learned of one vehicle type in one regime through one sensor chain; see `train`.

    Attributes
    ----------
    vehicle, regime : in words. rate : of the samples [Hz].
    mean_over [s], cutoff [Hz] : what the accelerations had passed on board, NaN = nothing.
    levels : (l,) trained levels. channels, offsets, scales : each signal's name, the constant taken off it, and
        the variance [its unit²] by which its Grams are divided: the same for every rotor.
    parts : one a rotor and channel; of one rotor all have the same p.
    alarm_window, value_window [s]. bias : b, the model's own error of k, of a value window.
    air : what value windows of flights that trained nothing look like, None = not known.
    threshold : of k in an alarm window, passed by a healthy flight once in `alarm_every` [s].
    tail : location and scale of the Gumbel law of 10 s maxima in healthy flight; healthy_time [s] behind it.
    names : share of held-out windows in which the smallest residual was the right rotor's.
    speeds : what the rotor speeds of the same flights taught. facts : further figures of the training.
    """

    vehicle: str
    regime: str
    rate: float
    mean_over: float
    cutoff: float
    levels: Array
    channels: tuple[str, ...]
    offsets: Array
    scales: Array
    parts: tuple[Part, ...]
    alarm_window: float
    value_window: float
    bias: float
    threshold: float
    alarm_every: float
    tail: tuple[float, float]
    healthy_time: float
    names: float
    air: KnownAir | None = None
    speeds: SpeedFacts | None = None
    facts: tuple[tuple[str, float], ...] = ()

    @property
    def rotors(self) -> tuple[int, ...]:
        """The rotors that have a model, in order."""
        return tuple(sorted({part.rotor for part in self.parts}))

    @property
    def takes_imu(self) -> bool:
        """Whether it listens to the IMU; else to the booms."""
        return self.channels != (BOOM,)

    @property
    def block(self) -> int:
        """Samples in a block of 0.1 s."""
        return max(1, round(0.1 * self.rate))

    @property
    def longest(self) -> int:
        """The highest AR order."""
        return max(len(part.theta) for part in self.parts)

    def alarmed(self, level: AlarmLevel) -> "PooledModel":
        """Return it with the alarm where a vehicle's own healthy flights put it."""
        tail = (level.location, level.scale)
        return replace(self, threshold=level.threshold, tail=tail, alarm_every=level.every)

    def of_rotor(self, rotor: int) -> tuple[Part, ...]:
        """Return a rotor's parts."""
        return tuple(part for part in self.parts if part.rotor == rotor)

    def expected(self, rotor: int, k: Array) -> Array:
        """Return the trained residual variance at k (w,), summed over the channels as scaled."""
        at = np.clip(k, self.levels[0], self.levels[-1])
        scale = dict(zip(self.channels, self.scales, strict=True))
        total = np.zeros(len(at))
        for part in self.of_rotor(rotor):
            total += np.exp(np.interp(at, self.levels, np.log(part.variance))) / scale[part.channel]
        return total


def misfit(model: PooledModel, rotor: int, M: Array, k: Array, count: float) -> Array:
    """Return (w,): mean residual at k by which rotors are compared; the smallest names the rotor.

    On the same signals the residuals themselves compare. Each rotor's own boom is another signal: there
    the residual over the trained one stands for it.
    """
    mean = rss(M, k) / count
    if not model.takes_imu:
        return np.asarray(mean / model.expected(rotor, k))
    return mean
