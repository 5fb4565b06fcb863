"""ESC telemetry that repeats itself, told from coarse and from calm telemetry."""

import math

import numpy as np
import pytest

from gcs_health.fusion.frozen import Frozen
from gcs_health.samples import RotorReading

NAN = (math.nan,) * 4


def told(
    frozen: Frozen, seconds: float, step: float, stuck_from: float, seed: int = 1, rate: float = 50.0
) -> list[bool]:
    """Feed a hover whose speeds are rounded to `step` [rad/s]; rotor 2 repeats itself from a time on."""
    rng = np.random.default_rng(seed)
    out, last = [], 0.0
    for k in range(round(seconds * rate)):
        t = k / rate
        speed = [step * round((500.0 + rng.normal(0.0, 2.0)) / step) for _ in range(4)]
        if t >= stuck_from:
            speed[2] = last
        last = speed[2]
        frozen.rotors(RotorReading(t, tuple(speed), NAN, NAN))
        out.append([frozen.holds(i, t) for i in range(4)] == [False, False, True, False])
    return out


def test_telemetry_that_repeats_itself_is_told_after_three_seconds() -> None:
    said = told(Frozen(4), 15.0, 0.1, stuck_from=8.0)
    assert not any(said[: round(10.9 * 50)])
    assert all(said[round(11.2 * 50) :])


@pytest.mark.parametrize("seed", range(5))
def test_coarse_steps_in_a_calm_hover_are_no_fault(seed: int) -> None:
    frozen = Frozen(4)
    told(
        frozen, 60.0, 10.5, stuck_from=math.inf, seed=seed
    )  # steps of 100 rpm: a value stands for many samples
    assert not any(frozen.holds(i, 60.0) for i in range(4))


def test_where_all_stand_still_it_is_the_link_and_no_rotor() -> None:
    frozen = Frozen(4)
    for k in range(500):
        speed = tuple(500.0 + (k if k < 100 else 100) for _ in range(4))
        frozen.rotors(RotorReading(k / 50.0, speed, NAN, NAN))
    assert not any(frozen.holds(i, 10.0) for i in range(4))


def test_a_rotor_that_is_not_in_a_reading_is_no_repetition() -> None:
    frozen = Frozen(4)
    for k in range(600):
        speed = [500.0 + k % 7] * 4
        speed[k % 2] = math.nan
        frozen.rotors(RotorReading(k / 50.0, tuple(speed), NAN, NAN))
    assert not any(frozen.holds(i, 12.0) for i in range(4))


def test_a_doubt_comes_sooner_and_goes_with_the_first_change() -> None:
    frozen = Frozen(4)
    told(frozen, 8.42, 0.1, stuck_from=8.0)
    assert frozen.doubtful(8.5)
    assert not any(frozen.holds(i, 8.5) for i in range(4))
    told(frozen, 9.0, 0.1, stuck_from=math.inf)
    assert not frozen.doubtful(9.0)
