"""Lines through the flights of one baseline, their intervals, and what a repair changed."""

import math
import random

import pytest

from gcs_health.record.trends import DAY_US, Point, repair, trend

BEGAN = 1_780_000_000_000_000  # 2026-05-28


def points(values: list[float], every: float = 7.0) -> list[Point]:
    return [Point(BEGAN + int(k * every * DAY_US), value, 0.1) for k, value in enumerate(values)]


def test_a_line_through_the_flights_is_found_and_projected() -> None:
    noise = random.Random(3)
    values = [1.0 + 0.1 * k + noise.gauss(0.0, 0.02) for k in range(12)]
    values[5] = 9.0  # one odd flight
    found = trend(points(values), "unbalance", limit=2.5)
    assert found is not None
    assert found.grows
    assert found.slope == pytest.approx(0.1 / 7.0, rel=0.15)
    assert found.low < 0.1 / 7.0 < found.high
    due = BEGAN + 15 * 7 * DAY_US
    assert found.due_us == pytest.approx(due, abs=7 * DAY_US)
    assert found.earliest_us is not None
    assert found.latest_us is not None
    assert found.earliest_us <= found.due_us <= found.latest_us
    by_default = trend(points(values), "unbalance")
    assert by_default is not None
    assert by_default.limit == 2.0 * by_default.start


def test_the_interval_of_the_slope_covers_the_truth_as_often_as_it_says() -> None:
    """400 series of ten flights without growth: the 95 % interval misses zero in one of twenty."""
    noise = random.Random(1)
    missed = 0
    for _ in range(400):
        found = trend(points([noise.gauss(1.0, 0.2) for _ in range(10)]), "unbalance")
        assert found is not None
        missed += not found.low <= 0.0 <= found.high
    assert missed / 400 < 0.05 + 3 * math.sqrt(0.05 * 0.95 / 400)


def test_no_trend_of_few_flights_and_no_date_without_growth() -> None:
    assert trend(points([1.0, 2.0, 3.0, 4.0]), "unbalance") is None
    falling = trend(points([5.0, 4.0, 3.0, 2.0, 1.0, 0.5]), "unbalance", limit=6.0)
    assert falling is not None
    assert (falling.grows, falling.due_us) == (False, None)


@pytest.mark.parametrize(
    ("before", "after", "less_is_better", "verdict"),
    [
        ([4.0, 4.2, 3.9], [1.0, 1.2, 1.1], True, "helped"),
        ([1.0, 1.2, 1.1], [4.0, 4.2, 3.9], True, "made it worse"),
        ([0.6, 0.62, 0.61], [0.98, 1.0, 0.99], False, "helped"),
        ([1.0, 1.4, 0.7], [1.1, 1.2, 0.8], True, "no change seen"),
        ([1.0], [4.0, 4.2], True, "too few flights"),
    ],
)
def test_a_repair_is_judged_by_the_interval_of_the_change(
    before: list[float], after: list[float], less_is_better: bool, verdict: str
) -> None:
    assert repair(points(before), points(after), less_is_better=less_is_better).verdict == verdict


def test_welch_s_interval_is_scipy_s() -> None:
    from scipy.stats import ttest_ind

    before, after = [4.0, 4.2, 3.9, 4.6], [1.0, 1.2, 1.1]
    interval = ttest_ind(after, before, equal_var=False).confidence_interval(0.95)
    told = repair(points(before), points(after), less_is_better=True)
    assert (told.low, told.high) == pytest.approx((interval.low, interval.high))
