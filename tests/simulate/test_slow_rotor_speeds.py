"""Orders shorter than the time between two rotor speeds, which no commands tell: turned sharply, nothing was lost."""

from dataclasses import replace

import numpy as np

from gcs_health.airframe import Airframe, Effectiveness
from gcs_health.estimators.effectiveness import EffectivenessConfig, EffectivenessEstimator
from gcs_health.estimators.short_order import ShortOrderConfig
from gcs_health.simulate.batch import Flights, fly_many
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.telemetry import BOOTED

LOST_AT = 12.0
SEEDS = (1001, 1006, 1008)  # of those that showed the rule's need
RULE = EffectivenessConfig()
NO_RULE = replace(RULE, recommended=replace(RULE.recommended, short_order=ShortOrderConfig(freed=0.0)))


def hexacopter() -> tuple[Flights, Airframe]:
    """Setpoint steps at 50 Hz of accelerations and 10 Hz of rotor speeds; motor 2's propeller goes at the end."""
    changes = ["vehicle=ghalamchi_large", "trajectory.kind=random", "trajectory.duration=13"]
    plan = load_scenario(
        "healthy_quad", [*changes, "trajectory.height=12", "trajectory.lands=false", "wind.speed=4"]
    )
    at = np.full(len(SEEDS), LOST_AT)
    flights = fly_many(
        plan, list(SEEDS), 50.0, 10.0, (Fault("propeller_lost", np.ones(len(SEEDS), int), at),)
    )
    return flights, replace(plan.vehicle.airframe(), effectiveness=Effectiveness())


def named(
    flights: Flights, flight: int, airframe: Airframe, config: EffectivenessConfig
) -> tuple[float, int] | None:
    """Return time since the loss [s] and rotor of the first failure named."""
    estimator = EffectivenessEstimator(airframe, config)
    for reading in flights.readings(flight, False):
        for estimate in estimator.feed(reading):
            if estimate.failure_probability > 0.9:
                return estimate.t - BOOTED - LOST_AT, estimate.rotor
    return None


def test_a_short_order_between_two_rotor_speeds_is_no_lost_rotor() -> None:
    flights, airframe = hexacopter()
    without = [named(flights, k, airframe, NO_RULE) for k in range(len(SEEDS))]
    assert any(found is not None and found[0] < 0.0 for found in without)  # else these flights show nothing
    for k in range(len(SEEDS)):
        found = named(flights, k, airframe, RULE)
        assert found is not None
        assert 0.0 < found[0] < 0.2
        assert found[1] == 1
