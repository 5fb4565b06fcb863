"""Which rotor is damaged, whether any is, or that this cannot be told: decided by refits under bounds.

    all s <= thr costs < 16       ok, if holding any one rotor at damage costs > 16; else unknown
    else damage is present        rotor b (the largest), if holding b alone <= thr costs > 16 and > .07 of that;
                                  else present, rotor not identifiable

Probabilities are logistic in the cost: the threshold alone gives 0.9, nothing in its favour 0.003.

What thr is: a quarter of a known damage; twice the rotor's own baseline; else, with neither, that of an
*outlier among its fellows*. If healthy unbalances were Rayleigh distributed (two normal components), the
chance that the largest of n exceeds the next by more than sqrt(c) in amplitude would be

    P = prod_{j=2..n} j / (j + c - 1)

(spacings of exponential order statistics). c is what makes P = 0.002, and at least 25; 9 for a rotor whose
amplitude has grown fourfold since the flight's first seconds. A rotor that cannot be told from another might share
its power equally, so it is no outlier. No absolute threshold carries over from
craft to craft: a healthy Bebop 2 shakes more than a damaged 690 g quadrotor.

Source: sheet 2 section 5; sheet 5 section 5 on thresholds.
"""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gcs_health.estimators.amplitude_model import Array
from gcs_health.estimators.bounded_fit import Fit


class Finding(StrEnum):
    """The verdict on the vehicle."""

    OK = "ok"
    UNKNOWN = "unknown"
    ROTOR = "rotor"
    PRESENT = "present"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the bounded fits say.

    Attributes
    ----------
    rotor : the damaged one; -1 where none is named.
    probability : (n,) that each is damaged; NaN where it cannot be told.
    present : cost of "no rotor is damaged" [-]. alone : cost of "rotor b is not damaged" [-].
    """

    finding: Finding
    rotor: int
    probability: tuple[float, ...]
    present: float
    alone: float


def logistic(odds: float) -> float:
    """Return the probability of log odds."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -40.0), 40.0)))


def chance_of_outlier(n: int, c: float) -> float:
    """Return the chance that the largest of n healthy powers exceeds c times the next."""
    return math.prod(j / (j + c - 1.0) for j in range(2, n + 1))


def outlier_ratio(n: int, chance: float, least: float) -> float:
    """Return the power ratio c >= least² at which the chance is no more than asked."""
    low, high = least * least, 1e6
    if chance_of_outlier(n, low) <= chance:
        return low
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if chance_of_outlier(n, middle) > chance else (low, middle)
    return high


def judge(
    fit: Fit,
    ok_below: Array,
    damaged_above: Array,
    threshold: float,
    certain: float = 1.0,
    own_error: float = 0.0,
) -> Verdict:
    """Return the verdict on one window.

    Parameters
    ----------
    ok_below, damaged_above : (n,) bounds on s.
    threshold : cost above which a hypothesis is given up.
    certain : at most so probable, whatever the cost.
    own_error : share of the cost of "none is damaged" that may be the model's own error.
    """
    n = len(fit.s)
    nothing, free = np.zeros(n), np.full(n, np.inf)
    b = int(np.argmax(fit.s / ok_below))
    present = fit.cost(nothing, ok_below)

    def odds(cost: float) -> float:
        return math.log(9.0) + 0.5 * (cost - threshold)

    def at_most(rotor: int) -> Array:
        bound = free.copy()
        bound[rotor] = ok_below[rotor]
        return bound

    def at_least(rotor: int) -> Array:
        bound = nothing.copy()
        bound[rotor] = damaged_above[rotor]
        return bound

    if present <= threshold:
        hidden = [fit.cost(at_least(i), free) for i in range(n)]
        held = min(logistic(odds(present)), 0.89)
        if min(hidden) > threshold:
            return Verdict(Finding.OK, -1, tuple(held if i == b else 0.003 for i in range(n)), present, 0.0)
        known = tuple(0.003 if cost > threshold else math.nan for cost in hidden)
        return Verdict(Finding.UNKNOWN, -1, known, present, 0.0)
    alone = fit.cost(nothing, at_most(b))
    threshold = max(threshold, own_error * present)
    if alone > threshold:
        p = [min(logistic(odds(fit.cost(nothing, at_most(i)))), certain) for i in range(n)]
        return Verdict(Finding.ROTOR, b, tuple(p), present, alone)
    suspects = [i for i in range(n) if fit.cost(at_least(i), free) <= threshold]
    share = min(logistic(odds(present)), certain) / max(len(suspects), 1)
    p = [share if i in suspects else 0.003 for i in range(n)]
    return Verdict(Finding.PRESENT, -1, tuple(p), present, alone)
