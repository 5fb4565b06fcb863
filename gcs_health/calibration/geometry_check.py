"""Whether the rotors answer where the geometry puts them.

    g      coefficient of each rotor's squared speed in roll (or pitch) acceleration, all free
    cos    cosine of g with the coefficients that the geometry predicts: 1 right, 0 renumbered, -1 mirrored
           with more than four rotors, whose speeds a mixer moves in four directions only, the coefficients
           are not determined: then the cosine of what both predict, which is
    F      how much better g explains than nothing, in units of noise

Hover excites too little to tell, then the answer is None. A lost rotor makes one coefficient vanish,
which leaves cos above .7; a mirrored or renumbered file brings at least one axis to 0 or below.

Source: this project; thresholds chosen on `bebop2_prop_eject`, `indiflight_*` and `nanodrone_*` at five
rates: with the right file cos stays above .4 wherever F > 4.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gcs_health.calibration.control_effectiveness import MomentRegression

Array = NDArray[np.float64]
DETERMINED = 4  # rotors whose coefficients flight determines: roll, pitch, yaw and thrust


@dataclass(frozen=True, slots=True)
class GeometryConfig:
    """When a geometry is called contradicted."""

    delay: float = 0.2  # s by which the data lag
    least_time: float = 0.4  # s of data before any verdict
    strong_time: float = 2.0  # s of data before flight alone contradicts a geometry
    strong_f: float = 20.0
    strong_samples: float = 80.0
    strong_share: float = 0.3  # R² of the free fit
    strong_cos: float = 0.25
    strong_part: float = 0.35  # of the free fit's R² that the geometry may explain at most
    weak_f: float = 10.0
    doubt_f: float = 3.0  # a verdict asks for more than flight does: a wrong name is worse than none
    doubt_cos: float = 0.3
    doubt_left: float = (
        1.2  # what the geometry leaves unexplained, over what the free fit leaves: less is borne out
    )
    doubt_samples: float = 100.0  # with fewer, and a time shift not yet found, right files look wrong too
    agree_cos: float = 0.7


@dataclass(frozen=True, slots=True)
class AxisFit:
    """One axis: R² free and as the geometry says, cosine between both fits, F of the free one."""

    free: float
    assumed: float
    cos: float
    f: float
    samples: float  # independent ones


def fit_axis(regression: MomentRegression, row: int, gains: list[float], block: float) -> AxisFit | None:
    """Compare the free fit of one axis (0 roll, 1 pitch) with the geometry's; None where undetermined.

    `gains` (n,) are the predicted coefficients [(rad/s²)/(rad/s)²], `block` the time that one
    independent sample spans [s].
    """
    n = regression.rotors
    samples = regression.time / block
    moments = regression.moments
    total = float(moments[n + row, n + row])
    h = np.array(gains)
    if samples < 3.0 * n or total <= 0.0 or not h.any():
        return None
    A = moments[:n, :n]
    c = moments[:n, n + row]
    ridge = 1e-3 * float(np.trace(A)) / n
    spread = float(h @ A @ h)
    if ridge <= 0.0 or spread <= 0.0:
        return None
    g = np.linalg.solve(A + ridge * np.eye(n), c)
    free = min(max(float(c @ g) / total, 0.0), 1.0 - 1e-9)
    along = max(float(h @ c), 0.0)
    if n > DETERMINED:
        size, agreement = math.sqrt(max(spread * float(c @ g), 0.0)), float(h @ c)
    else:
        size, agreement = float(np.linalg.norm(g) * np.linalg.norm(h)), float(g @ h)
    if size <= 0.0:
        return None
    return AxisFit(
        free=free,
        assumed=along * along / spread / total,
        cos=min(agreement / size, 1.0),
        f=free / (1.0 - free) * (samples - n) / n,
        samples=samples,
    )


def exchange_cost(regression: MomentRegression, rows: tuple[list[float], list[float]], apart: float) -> Array:
    """Return (n (n - 1) / 2,): log likelihood ratio of the geometry over it with each pair of seats exchanged.

    Negative where the exchange explains the flight better. `rows` : roll and pitch gains (n,) as the geometry has
    them, each fitted with a scale of its own. `apart` : time between independent samples [s].
    """
    n = regression.rotors
    one, other = np.triu_indices(n, 1)
    moments = regression.moments
    A = moments[:n, :n]
    cost = np.zeros(len(one))
    for row, gains in enumerate(rows):
        total = float(moments[n + row, n + row])
        h = np.tile(gains, (len(one) + 1, 1))  # the last is the geometry itself
        pairs = np.arange(len(one))
        h[pairs, one], h[pairs, other] = h[pairs, other], h[pairs, one]
        along, spread = np.maximum(h @ moments[:n, n + row], 0.0), np.einsum("pi,ij,pj->p", h, A, h)
        if total > 0.0 and spread.min() > 0.0:
            left = np.log(np.maximum(1.0 - along * along / spread / total, 1e-3))
            cost += 0.5 * regression.time / apart * (left[:-1] - left[-1])
    return cost


def contradicted(fits: list[AxisFit], config: GeometryConfig) -> bool:
    """Whether flight alone shows the geometry to be wrong on any axis."""
    return any(
        fit.f > config.strong_f
        and fit.samples > config.strong_samples
        and fit.free > config.strong_share
        and fit.cos < config.strong_cos
        and fit.assumed < config.strong_part * fit.free
        for fit in fits
    )


def doubtful(fits: list[AxisFit], config: GeometryConfig) -> bool:
    """Whether a verdict must not be given on this geometry: weaker evidence than `contradicted`.

    In a single brisk manoeuvre the squared speeds move along one direction: the free coefficients are then anything
    that agrees with it, and their cosine alone means nothing. What the geometry leaves unexplained is asked too: with
    cosines below .4 the right file left 1.11 times as much as the free fit at most, a wrong one 1.36 (two simulated
    flights, `demo` from seeds 4 and 12).
    """
    return any(
        fit.f > (config.doubt_f if fit.samples > config.doubt_samples else config.weak_f)
        and fit.cos < config.doubt_cos
        and 1.0 - fit.assumed > config.doubt_left * (1.0 - fit.free)
        for fit in fits
    )


def supports(fits: list[AxisFit], config: GeometryConfig) -> bool:
    """Whether the data bear out a geometry that was only assumed: one axis clearly, none against."""
    clear = any(fit.f > config.weak_f and fit.cos > config.agree_cos for fit in fits)
    return clear and all(fit.cos > 0.5 for fit in fits if fit.f > config.doubt_f)


def agrees(fits: list[AxisFit], config: GeometryConfig) -> bool:
    """Whether both axes clearly answer as the geometry says."""
    return len(fits) == 2 and all(fit.f > config.weak_f and fit.cos > config.agree_cos for fit in fits)
