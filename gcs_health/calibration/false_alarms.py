"""Thresholds from a budget of false alarms, from healthy flights; and what so many hours of them can promise.

    x      largest log odds of a fault in each block of 10 s, over all rotors
    u      the 90 % quantile of x;  m of n blocks exceed it, by s on average
    x(r)   = u + s ln(m / T / r)                 the level exceeded r times an hour, exponential tail

The interval is that of s: 2 m s_true / s is chi-squared with 2 m degrees of freedom. Beyond the hours flown the level
is an extrapolation and is called one: k alarms in T hours bound the true rate by chi2(.95, 2 k + 2) / 2 T, which is
3/T where there were none. Source: Coles (2001), An Introduction to Statistical Modeling of Extreme Values, 4.3, with
shape 0; Garwood (1936), Biometrika 28.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

BLOCK = 10.0  # s
QUANTILE = 0.9
LEAST_EXCEEDING = 5  # blocks above u, for a tail
CONFIDENCE = 0.95


class Level(NamedTuple):
    """What healthy flights say of one code.

    Attributes
    ----------
    hours : of healthy flight.
    alarms : raised in them under the rules as they were.
    most : upper 95 % bound of their rate [1/h].
    budget : rate wanted [1/h].
    raise_at, low, high : probability at which that rate is met, its 95 % interval; NaN where there is no tail to fit.
    largest : highest probability that was seen.
    extrapolated : the budget is rarer than anything that the hours flown could show.
    """

    hours: float
    alarms: int
    most: float
    budget: float
    raise_at: float
    low: float
    high: float
    largest: float
    extrapolated: bool

    @property
    def hours_needed(self) -> float:
        """Hours without an alarm that would show the budget to be kept."""
        return most(0, 1.0) / self.budget


def most(alarms: int, hours: float) -> float:
    """Return the upper 95 % bound of a rate [1/h] from a count in so many hours."""
    from scipy.special import chdtri

    return float(chdtri(2 * alarms + 2, 1.0 - CONFIDENCE)) / (2.0 * hours) if hours > 0.0 else math.inf


def level(blocks: Sequence[float], alarms: int, budget: float) -> Level:
    """Fit one code's level.

    Parameters
    ----------
    blocks : (n,) largest log odds of each block of healthy flight [nats].
    alarms : raised meanwhile.
    budget : false alarms an hour that are bearable [1/h].
    """
    hours = len(blocks) * BLOCK / 3600.0
    x = np.asarray(blocks, dtype=np.float64)
    bound = most(alarms, hours)
    largest = _probability(float(x.max())) if len(x) else math.nan
    values = _tail(x, hours, budget)
    return Level(hours, alarms, bound, budget, *values, largest, bound > budget)


def _tail(x: np.ndarray, hours: float, budget: float) -> tuple[float, float, float]:
    if not len(x):
        return math.nan, math.nan, math.nan
    from scipy.special import chdtri

    u = float(np.quantile(x, QUANTILE))
    over = x[x > u] - u
    m = len(over)
    if m < LEAST_EXCEEDING:
        return math.nan, math.nan, math.nan
    scale = float(over.mean())
    rarer = max(math.log(m / hours / budget), 0.0)
    half = (1.0 - CONFIDENCE) / 2.0
    scales = (2 * m * scale / float(chdtri(2 * m, half)), 2 * m * scale / float(chdtri(2 * m, 1.0 - half)))
    at, low, high = (_probability(u + s * rarer) for s in (scale, *scales))
    return at, low, high


def _probability(log_odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-min(max(log_odds, -600.0), 600.0)))
