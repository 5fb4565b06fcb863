"""The common part of the baselines: as large as it was put in, and shown."""

import math
from dataclasses import replace

import pytest
from synthetic_flight import HOVER, Scenario, airframe, fly

from gcs_health.airframe import Airframe, Rotor
from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.fusion.absorbed import Absorbed, absorbed
from gcs_health.fusion.commanded import Commanded
from gcs_health.samples import CommandReading, RotorReading

NAN = math.nan
KNOWN = airframe(4)


def flown(truth: Airframe, seconds: float = 20.0) -> Absorbed:
    """Fly the true craft; the estimator has `KNOWN`."""
    estimator = EffectivenessEstimator(KNOWN)
    for reading in fly(Scenario(duration=seconds, craft=truth)):
        estimator.feed(reading)
    assert estimator.bank is not None
    assert estimator.bank.failed is None
    return absorbed(estimator.bank, KNOWN, NAN)


def test_a_payload_is_the_common_effectiveness() -> None:
    gains = KNOWN.effectiveness
    assert gains.thrust is not None
    heavy = replace(KNOWN, effectiveness=replace(gains, thrust=0.95 * gains.thrust))
    found = flown(heavy)
    assert found.effectiveness == pytest.approx(0.95, abs=0.01)
    assert "common effectiveness 0.95, absorbed" in found.words()[0]
    assert flown(KNOWN).effectiveness == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("x", "y"), [(0.012, 0.0), (0.0, -0.012), (-0.006, 0.006)])
def test_a_shifted_weight_is_where_it_was_put(x: float, y: float) -> None:
    def beside(rotor: Rotor) -> Rotor:
        return replace(rotor, position=(rotor.position[0] - x, rotor.position[1] - y, 0.0))

    rotors = tuple(beside(rotor) for rotor in KNOWN.rotors)
    gains = KNOWN.effectiveness
    assert gains.roll is not None
    assert gains.pitch is not None
    reach = [[max(abs(r.position[axis]) for r in rows) for axis in (0, 1)] for rows in (rotors, KNOWN.rotors)]
    # the same torques: a gain is that of the largest arm, and the arms have grown
    gains = replace(
        gains, roll=gains.roll * reach[0][1] / reach[1][1], pitch=gains.pitch * reach[0][0] / reach[1][0]
    )
    found = flown(replace(KNOWN, rotors=rotors, effectiveness=gains))
    assert (found.forward, found.right) == (pytest.approx(x, abs=0.002), pytest.approx(y, abs=0.002))
    assert found.words()[1].startswith("weight (or wind) ")


def test_a_sagging_battery_is_less_speed_for_the_same_command() -> None:
    commanded = Commanded(4)
    for k in range(1200):
        t = 0.05 * k
        sag = 1.0 - 0.002 * max(t - 10.0, 0.0)
        commanded.command(CommandReading(t, (0.5,) * 4))
        commanded.rotors(RotorReading(t, (HOVER * sag,) * 4, (NAN,) * 4, (NAN,) * 4), True)
        if k == 100:
            assert math.isnan(commanded.sag())  # too early to compare
    assert commanded.sag() == pytest.approx(0.91, abs=0.01)
    (said,) = absorbed(None, KNOWN, commanded.sag()).words()
    assert said == "rotor speed for the same command 0.91 of early in the flight, absorbed: battery or load"


def test_what_is_not_known_is_not_said() -> None:
    assert absorbed(None, KNOWN, NAN).words() == ()
    assert Absorbed(NAN, -0.02, 0.01, False, NAN).words() == (
        "weight (or wind) 2 % of the arm back, 1 % of the arm right of the rotors' centre, absorbed",
    )
