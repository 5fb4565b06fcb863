"""A line through values in time that odd ones do not bend, and whether it grows for certain and to any purpose.

    slope = median over pairs (y_j - y_i) / (t_j - t_i)             Theil-Sen
    its interval: the pairs' slopes of ranks (N -+ z sqrt(n (n-1) (2n+5) / 18)) / 2, N their number

Many series of one vehicle are looked at: a finding in any of them by chance is to be as rare as said, so that each is
asked for more (Bonferroni). And a growth that is certain but tiny is nothing to act on: the line must have gone a
part of its way to the limit.

Source: Sen (1968), JASA 63, section 5; the ranks as scipy.stats.theilslopes has them, which takes a second to load.
"""

import math
from collections.abc import Sequence
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

CONFIDENCE = 0.95  # of the interval that is shown
# Quantities that grow with wear, and the value at which a finding projects its date where the user
# gives none: a multiple of the baseline's first value. A convention, not a measured limit of any part.
GROWING = {"unbalance": 2.0, "unbalance_relative": 2.0, "drag": 1.5}
MATERIAL = 0.1  # of the way from start to limit


class Line(NamedTuple):
    """A robust line; `start`, `now` : its values at the first and last time; `sure` : lower bound of its slope."""

    slope: float
    low: float
    high: float
    start: float
    now: float
    sure: float

    def grows(self, limit: float) -> bool:
        """Whether it surely grows, and has gone a part of its way to the limit."""
        return self.sure > 0.0 and self.now - self.start >= MATERIAL * (limit - self.start)


def limit_of(quantity: str, start: float, usual: float) -> float:
    """Return where maintenance is due if nobody says otherwise.

    `usual` : what the vehicle's rotors start from, their median: a rotor that starts from nearly nothing is
    not worn when it has twice as much.
    """
    return GROWING[quantity] * max(start, usual)


def line(points: Sequence[tuple[float, float]], chance: float) -> Line:
    """Fit (time, value), oldest first, at two different times at least.

    `chance` : that `sure` of a series without growth lies above zero.

    Examples
    --------
    >>> line([(0.0, 1.0), (1.0, 2.0), (2.0, 9.0), (3.0, 4.0)], 0.05).slope
    1.0
    """
    t, y = np.array(points, dtype=float).T
    i, j = np.triu_indices(len(t), 1)
    apart = t[j] > t[i]
    i, j = i[apart], j[apart]
    slopes = np.sort((y[j] - y[i]) / (t[j] - t[i]))
    slope = float(np.median(slopes))
    intercept = float(np.median(y - slope * (t - t[0])))  # scipy's own leans to an odd value's side
    low, high = _bounds(slopes, len(t), 0.5 * (1.0 - CONFIDENCE))
    sure, _ = _bounds(slopes, len(t), chance)
    return Line(slope, low, high, intercept, intercept + slope * float(t[-1] - t[0]), sure)


def _bounds(slopes: NDArray[np.float64], n: int, chance: float) -> tuple[float, float]:
    """Return the slopes that the true one is below, and above, by that chance each."""
    spread = math.sqrt(n * (n - 1) * (2 * n + 5) / 18.0)
    below = NormalDist().inv_cdf(1.0 - chance) * spread
    count = len(slopes)
    upper, lower = round(0.5 * (count + below)), round(0.5 * (count - below)) - 1
    return (
        float(slopes[lower]) if lower >= 0 else -math.inf,
        float(slopes[upper]) if upper < count else math.inf,
    )
