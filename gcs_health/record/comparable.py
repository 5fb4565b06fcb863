"""Flights made comparable: one regime of all that were flown, and the payload taken out.

    unbalance  U = U_hat L / L_0       L: load, mean square speed in the regime; L_0: its median over the flights

The estimator takes the vehicle file's mass for the vehicle's, U_hat = U m_file / m, and a heavier vehicle needs the
more speed: m / m_file = L / L_0 in the same air. Thinner air moves L too: a tenth less density passes for a tenth
more mass. Drag is against the other rotors of the same flight: nothing is left to take out.
"""

from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from gcs_health.condition.regime import Regime, best
from gcs_health.record.history import ConditionRow
from gcs_health.record.trends import Point

SECONDS_LEAST = 15.0  # of a flight in the regime
FLIGHTS_LEAST = 2
ESTIMATOR = {
    "unbalance": "unbalance",
    "unbalance_relative": "unbalance",
    "drag": "motor_observer",
}  # by quantity


class Comparable(NamedTuple):
    """One quantity of one rotor, flights alike; `seconds` flown so in all of them. Empty where they are too few."""

    regime: str
    seconds: float
    points: tuple[Point, ...]


NOTHING = Comparable("", 0.0, ())


def comparable(rows: Sequence[ConditionRow]) -> Comparable:
    """Return what can be compared of one quantity of one rotor, oldest first."""
    known = [row for row in rows if row.started_us and row.seconds >= SECONDS_LEAST]
    flights = {regime: sum(row.regime == regime.value for row in known) for regime in Regime}
    regime = best(flights)
    if regime is None or flights[regime] < FLIGHTS_LEAST:
        return NOTHING
    alike = [row for row in known if row.regime == regime.value]
    usual = median(row.load for row in alike)
    points = tuple(
        Point(
            row.started_us,
            row.value if row.quantity == "drag" else row.value * row.load / usual,
            row.spread,
        )
        for row in alike
    )
    return Comparable(regime.value, sum(row.seconds for row in alike), points)
