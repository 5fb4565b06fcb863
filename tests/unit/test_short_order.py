"""What tells a lost rotor from an order that came and went between two slow speeds."""

import math

import pytest

from gcs_health.estimators.fault_bank import NOTHING
from gcs_health.estimators.short_order import ShortOrderConfig, may_be_order

TICK, LONGEST, INTERVAL = 0.02, 0.13, 0.1  # s
FREED, KEPT = (600.0, 680.0), (600.0, 600.0)  # rad/s


@pytest.mark.parametrize(
    ("share", "chi2", "theta", "ticks", "speeds", "order"),
    [
        (0.9, 1.0, 0.7, 4, FREED, False),
        (0.9, 1.0, 0.7, 4, KEPT, True),
        (0.9, 1.0, 0.7, 4, (600.0, math.nan), False),  # nobody knows: the other signs must do
        (0.7, 2.0, 1.0, 8, FREED, True),  # several rotors were ordered
        (0.7, 1.0, 0.6, 8, FREED, True),
        (0.7, 1.0, 1.0, 8, FREED, False),  # speeds held too long blur what is left
        (0.9, 1.0, 1.0, 8, KEPT, False),  # too long and too much for an order
        (0.9, 1.0, 0.6, 8, KEPT, True),
    ],
)
def test_an_order_leaves_its_rotor_slower_and_ends(
    share: float, chi2: float, theta: float, ticks: int, speeds: tuple[float, float], order: bool
) -> None:
    loss = NOTHING._replace(rotor=0, share=share, chi2=chi2, theta=theta, ticks=ticks)
    assert may_be_order(ShortOrderConfig(), loss, TICK, LONGEST, INTERVAL, speeds) is order
