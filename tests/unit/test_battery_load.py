"""The battery's current after a rotor was named: a lost propeller no longer draws, and nothing else is said."""

import math

import pytest
from synthetic_flight import airframe

from gcs_health.estimators.contract import Estimate, Quantity, Status
from gcs_health.fusion.battery import MOST, BatteryLoad
from gcs_health.fusion.kinds import Kind
from gcs_health.fusion.panel import RotorPanel
from gcs_health.fusion.verdicts import Evidence
from gcs_health.samples import BatteryReading, FlightReading, RotorReading

NAN = math.nan
UNKNOWN = (NAN,) * 4
HOVER, AMPERES = 600.0, 5.0  # rad/s, A of one rotor


def speeds(t: float, *w: float, currents: tuple[float, ...] = UNKNOWN) -> RotorReading:
    return RotorReading(t, w or (HOVER,) * 4, currents, UNKNOWN)


def battery(t: float, amperes: float) -> BatteryReading:
    return BatteryReading(t, 16.0, amperes)


def learned() -> BatteryLoad:
    load = BatteryLoad(4)
    for k in range(30):
        t = 0.2 * k
        load.rotors(speeds(t))
        load.learn(battery(t, 4 * AMPERES * (1.0 + 0.002 * k)))  # the battery sags: ever more current
    return load


def after(
    load: BatteryLoad, share: float, *w: float, currents: tuple[float, ...] = UNKNOWN
) -> Evidence | None:
    """Rotor 2 is named at 6 s and draws so much of what it did."""
    load.rotors(speeds(6.1, *w, currents=currents))
    return load.follow(battery(6.1, AMPERES * 1.058 * (3.0 + share)), 2)


def test_a_rotor_that_draws_nothing_has_no_propeller() -> None:
    said = after(learned(), 0.0)
    assert said is not None
    assert dict(said.odds)[Kind.PROPELLER_LOST] == pytest.approx(MOST)
    assert dict(said.figures)["load"] == pytest.approx(
        0.0, abs=0.15
    )  # the slow baseline took most of the sag


@pytest.mark.parametrize("share", [0.6, 1.0, 1.4])
def test_a_current_that_did_not_fall_says_nothing_for_a_sensor_may_lag(share: float) -> None:
    said = after(learned(), share)
    assert said is None or set(dict(said.odds).values()) == {0.0}


def test_it_is_silent_where_it_cannot_know() -> None:
    assert after(learned(), 0.0, HOVER, HOVER, 0.3 * HOVER, HOVER) is None  # switched off since
    assert after(learned(), 0.0, HOVER, NAN, HOVER, HOVER) is not None  # heard of a moment before
    assert after(learned(), 0.0, currents=(AMPERES,) * 4) is None  # the ESC's own current tells more
    assert after(BatteryLoad(4), 0.0) is None  # nothing learned
    load = learned()
    assert load.follow(battery(9.0, 15.0), 2) is None  # speeds too old


def test_where_the_current_scatters_it_weighs_little() -> None:
    load = BatteryLoad(4)
    for k in range(60):  # two batteries, heard in turns
        load.rotors(speeds(0.1 * k))
        load.learn(battery(0.1 * k, AMPERES * (4.0 if k % 2 else 0.4)))
    said = after(load, 0.0)
    assert said is not None
    assert dict(said.odds)[Kind.PROPELLER_LOST] < 0.5


def codes(amperes: float) -> list[str]:
    """A rotor is named by its thrust while the battery tells its current."""
    panel = RotorPanel(airframe(4))
    told = panel.read(FlightReading(0.0, True, False), lambda: True)
    for k in range(120):
        t = 0.05 * k
        for reading in (speeds(t), battery(t, 4 * AMPERES)):
            told += panel.read(reading, lambda: True)
    named = Estimate(6.0, "effectiveness", 2, Quantity.EFFECTIVENESS, 0.02, 0.05, 0.99, Status.VALID)
    told += panel.feed([named])
    for k in range(1, 6):
        for reading in (speeds(6.0 + 0.1 * k), battery(6.0 + 0.1 * k, amperes)):
            told += panel.read(reading, lambda: True)
    return [alert.kind.code for alert in told]


def test_without_esc_currents_a_lost_propeller_is_told_as_one() -> None:
    assert codes(3 * AMPERES) == ["ROTOR_FAILED", "PROPELLER_LOST"]
    assert codes(4 * AMPERES) == ["ROTOR_FAILED"]
