"""Rotors whose lines are one peak are not told apart, however sure the fit is."""

import numpy as np

from gcs_health.estimators.order_tracking import Stretch
from gcs_health.estimators.unbalance_recommended import abreast

NEAR = (1.0, 4.4)  # rad/s
SPINS = np.array([1, 1, -1])


def stretches(speeds: np.ndarray) -> list[Stretch]:
    return [Stretch(float(k), speed, float(speed.min()), np.ones(3), ()) for k, speed in enumerate(speeds)]


def test_rotors_that_turn_alike_and_may_both_be_the_largest_are_one_group() -> None:
    hover = stretches(np.tile([500.0, 502.6, 520.0], (20, 1)))
    assert abreast(0, SPINS, (0, 1), hover, NEAR) == (0, 1)
    assert abreast(0, SPINS, (0, 2), hover, NEAR) == ()  # the mate turns 20 rad/s faster
    assert abreast(0, SPINS, (0,), hover, NEAR) == ()  # the one abreast cannot be the largest
    assert abreast(-1, SPINS, (0, 1), hover, NEAR) == ()  # nobody was named


def test_alike_in_the_mean_is_not_alike() -> None:
    swing = 20.0 * np.sin(np.arange(20.0))
    moving = stretches(np.stack([500.0 + swing, 500.0 - swing, 520.0 + swing], axis=1))
    assert abreast(0, SPINS, (0, 1), moving, NEAR) == ()


def test_one_spin_within_half_a_hertz_is_one_peak_whatever_the_fit_says() -> None:
    hover = stretches(np.tile([500.0, 503.0, 502.0], (20, 1)))
    near = (3.2, 4.4)
    assert abreast(0, SPINS, (0,), hover, near) == (0, 1)  # the third turns the other way
    assert abreast(2, SPINS, (2,), hover, near) == ()
