"""What a flight says for and against two rotors sitting in each other's seats."""

import math

import numpy as np
import pytest

from gcs_health.calibration.control_effectiveness import MomentRegression
from gcs_health.calibration.geometry_check import exchange_cost

APART = 0.1  # s
DT = 0.01
PAIRS = list(zip(*np.triu_indices(6, 1), strict=True))


def gains(scale: float = 1.0) -> tuple[list[float], list[float]]:
    """Return roll and pitch gains of six rotors around a circle."""
    seats = [math.pi * (k + 0.5) / 3.0 for k in range(6)]
    return [-scale * math.sin(a) for a in seats], [scale * math.cos(a) for a in seats]


def flown(seats: tuple[int, ...], strength: float) -> MomentRegression:
    """Return what 10 s of manoeuvres teach, the rotor told as k sitting in `seats[k]`."""
    rng = np.random.default_rng(3)
    regression = MomentRegression(6)
    rows = np.array(gains())[:, list(seats)]
    for _ in range(50):
        squares = strength * rng.standard_normal((20, 6))
        measured = squares @ rows.T + rng.standard_normal((20, 2))
        regression.feed(np.full(20, DT), squares, measured)
    return regression


@pytest.mark.parametrize("scale", [1.0, 0.4], ids=["gains known", "gains far off"])
def test_a_flight_with_the_right_seats_speaks_against_every_exchange(scale: float) -> None:
    cost = exchange_cost(flown((0, 1, 2, 3, 4, 5), 1.0), gains(scale), APART)
    assert cost.shape == (15,)
    assert cost.min() > 10.0


def test_a_flight_with_two_exchanged_speaks_for_that_exchange() -> None:
    cost = exchange_cost(flown((3, 1, 2, 0, 4, 5), 1.0), gains(), APART)
    assert PAIRS[int(cost.argmin())] == (0, 3)
    assert cost.min() < -10.0


def test_hover_says_little() -> None:
    cost = exchange_cost(flown((0, 1, 2, 3, 4, 5), 0.05), gains(), APART)
    assert np.abs(cost).max() < 3.0
    np.testing.assert_array_equal(exchange_cost(MomentRegression(6), gains(), APART), np.zeros(15))
