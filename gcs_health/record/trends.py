"""Across flights: whether a quantity of a rotor grows, until when it may, and whether a repair helped.

One value a flight, of one rotor, estimator and quantity. Values of different flights are taken as
independent; a line through them is robust against odd flights (Theil-Sen), its interval says what the
flights bear out.
"""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gcs_health.condition.growth import CONFIDENCE, limit_of, line

FLIGHTS_LEAST = 5  # for a trend; below, the interval of Sen (1968) covers all slopes seen, or more
DAY_US = 86_400_000_000
CHANCE = 0.025  # that any of a vehicle's series without growth is told to grow


class Point(NamedTuple):
    """One flight: when [UNIX µs], the value and its standard deviation."""

    at_us: int
    value: float
    std: float


class Trend(NamedTuple):
    """A line through the flights of one baseline.

    Attributes
    ----------
    flights : how many.
    slope, low, high : change a day, and its 95 % interval.
    start, now : the line's value at the first and at the last flight.
    limit : value at which maintenance is due.
    due_us, earliest_us, latest_us : when the line reaches it [UNIX µs], and with the interval's slopes;
        None = never at that slope.
    grows : a maintenance finding: it grows for certain, all series of the vehicle considered, and has gone a
        tenth of its way to the limit.
    """

    flights: int
    slope: float
    low: float
    high: float
    start: float
    now: float
    limit: float
    due_us: int | None
    earliest_us: int | None
    latest_us: int | None
    grows: bool


class Mean(NamedTuple):
    """A mean over flights with its 95 % interval."""

    flights: int
    mean: float
    low: float
    high: float


class Repair(NamedTuple):
    """Before and after a repair.

    Attributes
    ----------
    before, after : the flights of the baselines that it parts.
    low, high : 95 % interval of after - before; NaN with fewer than two flights on a side.
    verdict : "helped", "made it worse", "no change seen" or "too few flights".
    """

    before: Mean
    after: Mean
    low: float
    high: float
    verdict: str


def trend(
    points: Sequence[Point], quantity: str, limit: float | None = None, *, series: int = 1, usual: float = 0.0
) -> Trend | None:
    """Fit the flights of one baseline, oldest first; None if they are fewer than `FLIGHTS_LEAST`.

    `series` : how many of the vehicle are looked at. `usual` : see `condition.growth.limit_of`.
    """
    if len(points) < FLIGHTS_LEAST or points[0].at_us == points[-1].at_us:
        return None
    first = points[0].at_us
    days = [((point.at_us - first) / DAY_US, point.value) for point in points]
    fitted = line(days, CHANCE / series)
    if limit is None:
        limit = limit_of(quantity, fitted.start, usual)
    due, earliest, latest = (
        _reached(limit - fitted.now, s, points[-1].at_us) for s in (fitted.slope, fitted.high, fitted.low)
    )
    return Trend(
        len(points),
        *fitted[:5],  # slope, its interval, start, now
        limit,
        due,
        earliest,
        latest,
        fitted.grows(limit),
    )


def repair(before: Sequence[Point], after: Sequence[Point], *, less_is_better: bool) -> Repair:
    """Compare the means before and after a repair.

    Source: Welch (1947), Biometrika 34: unequal variances, degrees of freedom after Satterthwaite.
    """
    one, two = _mean(before), _mean(after)
    if min(one.flights, two.flights) < 2:
        return Repair(one, two, math.nan, math.nan, "too few flights")
    a = float(np.var([p.value for p in before], ddof=1)) / one.flights
    b = float(np.var([p.value for p in after], ddof=1)) / two.flights
    change = two.mean - one.mean
    freedom = (a + b) ** 2 / (a**2 / (one.flights - 1) + b**2 / (two.flights - 1)) if a + b > 0 else math.inf
    half = _quantile(freedom) * math.sqrt(a + b)
    better, worse = ("helped", "made it worse") if less_is_better else ("made it worse", "helped")
    verdict = better if change + half < 0 else worse if change - half > 0 else "no change seen"
    return Repair(one, two, change - half, change + half, verdict)


def _mean(points: Sequence[Point]) -> Mean:
    n = len(points)
    if not n:
        return Mean(0, math.nan, math.nan, math.nan)
    values = [p.value for p in points]
    mean = float(np.mean(values))
    if n == 1:
        return Mean(1, mean, math.nan, math.nan)
    half = _quantile(n - 1) * float(np.std(values, ddof=1)) / math.sqrt(n)
    return Mean(n, mean, mean - half, mean + half)


def _quantile(freedom: float) -> float:
    """Return Student's two-sided quantile; the normal's in the limit."""
    from scipy.special import ndtri, stdtrit

    p = 0.5 + CONFIDENCE / 2.0
    return float(ndtri(p) if math.isinf(freedom) else stdtrit(freedom, p))


def _reached(missing: float, slope: float, now_us: int) -> int | None:
    """Return when a line that lacks `missing` today gets there; today if it is there."""
    if missing <= 0.0:
        return now_us
    if not slope > 0.0:
        return None
    days = missing / slope
    return now_us + int(days * DAY_US) if days < 36_500 else None
