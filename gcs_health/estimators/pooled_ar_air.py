"""Whether a window was flown in the air that its model was trained in, by how every rotor's model fits it.

The best rotor's residual alone does not tell calm from severe air at a boom's tip: k gives way, and a wrong k
explains what the wrong air does. But then the other rotors' models err in their own way. Three traits of a window,

    z = [log ratio of the best rotor, log ratio of the next one, k of the next one]

(ratio: residual variance over the trained one) are compared with those of flights that fitted nothing, between
the levels by interpolation over the best rotor's k, in Mahalanobis' distance. Goes past sheet 4 section 6.3.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Array = NDArray[np.float64]
FEW = 30  # windows of one level, below which all levels share one covariance
RIDGE = 0.02  # no trait is known better than that
SHARE, ROOM = 0.99, 2.0  # the distance that so many windows keep at home, and what is left beyond it


@dataclass(frozen=True, slots=True, eq=False)
class KnownAir:
    """What windows look like at home.

    levels : (l,) of k, ascending. mean : (l, n) of the traits, covariance : (l, n, n). bound : of the squared
    distance.
    """

    levels: Array
    mean: Array
    covariance: Array
    bound: float

    def distance(self, k: float, z: Array) -> float:
        """Return the squared distance of a window's traits z (n,) from home's, its best rotor being at k."""
        deviation = z - _between(k, self.levels, self.mean)
        inverse = np.linalg.inv(_between(k, self.levels, self.covariance))
        return float(deviation @ inverse @ deviation)

    def holds(self, k: float, z: Array) -> bool:
        """Whether it is home's air."""
        return self.distance(k, z) <= self.bound


def traits(ratio: float, others: Sequence[tuple[float, float]]) -> Array:
    """Return (n,): n = 3, or 1 where no other rotor has a model; others : (ratio, k) by misfit."""
    following = [part for one, k in others[:1] for part in (np.log(one), k)]
    return np.array([np.log(ratio), *following])


def learned(truth: Array, k: Array, z: Array) -> KnownAir:
    """Learn home's air from windows at home: their levels (w,), the best rotor's k (w,) and traits (w, n)."""
    levels = np.unique(truth)
    mean = np.array([z[truth == level].mean(axis=0) for level in levels])
    deviations = z - np.array([_between(one, levels, mean) for one in k])
    pooled = deviations.T @ deviations / len(z)
    covariance = []
    for level in levels:
        own = deviations[truth == level]
        covariance.append(own.T @ own / len(own) if len(own) >= FEW else pooled)
    ridge = RIDGE**2 * np.eye(z.shape[1])
    air = KnownAir(levels, mean, np.array(covariance) + ridge, np.inf)
    distances = [air.distance(one, row) for one, row in zip(k.tolist(), z, strict=True)]
    least = float(chi2.ppf(SHARE, z.shape[1]))
    bound = ROOM * max(float(np.quantile(distances, SHARE)), least)
    return KnownAir(levels, mean, air.covariance, bound)


def _between(k: float, levels: Array, values: Array) -> Array:
    """Interpolate values (l, ...) over the levels; the ends' own beyond them."""
    k = min(max(k, float(levels[0])), float(levels[-1]))
    above = min(int(np.searchsorted(levels, k, side="right")), len(levels) - 1)
    if above == 0:
        return np.asarray(values[0])
    below = above - 1
    share = (k - levels[below]) / (levels[above] - levels[below])
    return np.asarray((1.0 - share) * values[below] + share * values[above])
