"""Condition for maintenance: regimes, indicators by regime, growth within a flight, and flights made comparable."""

import math
import random
from collections.abc import Iterable

import numpy as np
import pytest
from recorded import FLIGHT, feed, two_flights
from synthetic_flight import airframe

from gcs_health.cli.text import maintenance, summary_text
from gcs_health.condition.growth import line
from gcs_health.condition.indicators import KEPT, STRETCH, Indicator, Indicators
from gcs_health.condition.regime import Regime, Stretch, best, regimes
from gcs_health.estimators.contract import Estimate, Quantity, Status
from gcs_health.pipeline import MonitorConfig
from gcs_health.record.comparable import NOTHING, comparable
from gcs_health.record.events import AlertEvent, ConditionEvent, Event, SummaryEvent
from gcs_health.record.flight_results import FlightCollector
from gcs_health.record.history import ConditionRow
from gcs_health.record.trends import DAY_US
from gcs_health.samples import BatteryReading, ImuReading, RotorReading

NAN = math.nan
HOVER, AMPERES = 600.0, 5.0  # rad/s, A of one rotor
BEGAN = 1_780_000_000_000_000


class Flown:
    """A synthetic flight at 20 Hz, told piece by piece."""

    def __init__(self, seed: int = 1) -> None:
        self.indicators = Indicators(airframe(4))
        self.t = 10.0
        self._noise = random.Random(seed)

    def fly(
        self,
        seconds: float,
        *,
        speed: float = HOVER,
        gusts: float = 0.003,
        lean: float = 0.0,
        drags: tuple[float, ...] = (1.0,) * 4,
        unbalance: tuple[float, ...] = (1e-6,) * 4,
        rise: float = 0.0,
        sound: bool = True,
    ) -> "Flown":
        """Fly on; drag of rotor 0 and unbalance of rotor 2 rise by `rise` an hour, as shares."""
        noise, began = self._noise, self.t
        while self.t < began + seconds:
            self.t += 0.05
            worn = 1.0 + rise * (self.t - began) / 3600.0
            w = tuple(speed * (1.0 + noise.gauss(0.0, gusts)) for _ in range(4))
            i = tuple(
                AMPERES * d * (worn if k == 0 else 1.0) * (w[k] / HOVER) ** 2 + noise.gauss(0.0, 0.1)
                for k, d in enumerate(drags)
            )
            g = 9.81
            self.indicators.read(RotorReading(self.t, w, i, (NAN,) * 4))
            self.indicators.read(
                ImuReading(self.t, g * math.sin(lean), 0.0, -g * math.cos(lean), 0.0, 0.0, 0.0)
            )
            self.indicators.read(BatteryReading(self.t, 15.5, NAN))
            if self.indicators.due(self.t):
                said = [
                    u * (worn if k == 2 else 1.0) + noise.gauss(0.0, 2e-8) for k, u in enumerate(unbalance)
                ]
                self.indicators.estimates(self.t, map(self._unbalance, range(4), said), sound)
        return self

    def _unbalance(self, rotor: int, value: float) -> Estimate:
        quantity = self.indicators._quantity
        return Estimate(self.t, "unbalance", rotor, quantity, value, 1e-8, 0.0, Status.VALID)

    def found(self, quantity: str, regime: str) -> dict[int, Indicator]:
        """Return by rotor."""
        rows = self.indicators.of_flight()
        return {row.rotor: row for row in rows if (row.quantity, row.regime) == (quantity, regime)}


# -- regimes ---------------------------------------------------------------------------------------------


def test_the_flight_s_own_usual_load_tells_a_climb_and_idling_is_no_flight() -> None:
    calm = Stretch(0.01, 4e5, 0.02)
    told = regimes(
        [
            calm._replace(load=2e4),
            *[calm] * 4,
            calm._replace(load=4.4e5),
            calm._replace(load=3.7e5),
            calm._replace(unsteady=0.1),
            calm._replace(lean=0.3),
            calm._replace(unsteady=0.3, load=5e5),
            calm._replace(lean=NAN),
        ]
    )
    assert [regime.value for regime in told] == [
        "ground", "hover", "hover", "hover", "hover", "climb", "descent", "wind", "wind", "manoeuvre", "hover",
    ]  # fmt: skip
    assert regimes([]) == []


def test_the_steadier_regime_is_compared_in_unless_little_was_flown_in_it() -> None:
    assert best({}) is None
    assert best({Regime.WIND: 3}) is Regime.WIND
    assert best({Regime.HOVER: 4, Regime.WIND: 9}) is Regime.WIND
    assert best({Regime.HOVER: 5, Regime.WIND: 9}) is Regime.HOVER


# -- indicators of one flight ----------------------------------------------------------------------------


def test_indicators_are_those_of_their_regime_and_drag_is_against_the_other_rotors() -> None:
    flight = Flown().fly(61.0, drags=(1.1, 1.0, 1.0, 0.95))
    flight.fly(40.0, gusts=0.1, drags=(1.3, 1.0, 1.0, 0.95), unbalance=(3e-6,) * 4)
    hover, wind = flight.found("drag", "hover"), flight.found("drag", "wind")
    assert hover[0].value == pytest.approx(1.1, abs=0.01)
    assert hover[3].value == pytest.approx(0.95, abs=0.01)
    assert wind[0].value == pytest.approx(1.3, abs=0.01)
    assert hover[0].seconds == pytest.approx(60.0, abs=STRETCH)
    assert hover[0].load == pytest.approx(HOVER**2, rel=0.01)
    assert hover[0].voltage == 15.5
    assert hover[0].motor == airframe(4).rotors[0].motor
    quantity = flight.indicators._quantity.value
    calm, gusty = flight.found(quantity, "hover"), flight.found(quantity, "wind")
    assert calm[1].value == pytest.approx(1e-6, rel=0.05)
    # the first three stretches of each regime look back on what was before
    assert calm[1].seconds == hover[0].seconds - 3 * STRETCH
    assert gusty[1].value == pytest.approx(3e-6, rel=0.05)


def test_what_is_flown_with_a_failed_rotor_is_left_out_and_memory_is_bounded() -> None:
    flight = Flown().fly(30.0).fly(30.0, drags=(2.0, 1.0, 1.0, 1.0), sound=False)
    assert flight.found("drag", "hover")[0].value == pytest.approx(1.0, abs=0.01)
    assert flight.indicators._rows.maxlen == KEPT
    flight.indicators.new_flight()
    assert flight.indicators.of_flight() == ()


def test_without_currents_there_is_no_drag_and_without_speeds_nothing() -> None:
    indicators = Indicators(airframe(4))
    for k in range(400):
        t = 0.05 * k
        indicators.read(ImuReading(t, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0))
        if k > 200:
            indicators.read(RotorReading(t, (HOVER,) * 4, (NAN,) * 4, (NAN,) * 4))
        if indicators.due(t):
            indicators.estimates(t, [], True)
    assert indicators.of_flight() == ()
    assert len(indicators._rows) > 0


# -- growth within a flight ------------------------------------------------------------------------------


def test_growth_within_a_flight_is_found_with_its_slope_and_when_it_is_due() -> None:
    flight = Flown().fly(400.0, rise=2.0)  # of its value an hour: 22 % in this flight
    quantity = flight.indicators._quantity.value
    drag, unbalance = flight.found("drag", "hover"), flight.found(quantity, "hover")
    assert [k for k, row in drag.items() if row.grows] == [0]
    assert [k for k, row in unbalance.items() if row.grows] == [2]
    assert unbalance[2].slope == pytest.approx(2e-6, rel=0.2)
    assert unbalance[2].low < 2e-6 < unbalance[2].high
    # doubles half an hour after its beginning
    assert unbalance[2].due == pytest.approx(0.5 - 400.0 / 3600.0, abs=0.08)
    assert "grew within the flight by" in maintenance(unbalance[2]._asdict())


def test_a_growth_too_small_to_act_on_and_a_short_flight_are_no_finding() -> None:
    assert not any(row.grows for row in Flown().fly(400.0, rise=0.3).indicators.of_flight())
    brief = Flown().fly(120.0, rise=10.0)
    assert not any(row.grows or row.slope == row.slope for row in brief.indicators.of_flight())


def test_a_line_through_noise_is_sure_to_grow_as_seldom_as_said() -> None:
    """1000 series of twelve without growth, at a chance of 2 %."""
    noise = np.random.default_rng(5)
    sure = sum(line(list(enumerate(noise.normal(1.0, 0.1, 12))), 0.02).sure > 0.0 for _ in range(1000))
    assert 0 < sure < 1000 * (0.02 + 3 * math.sqrt(0.02 * 0.98 / 1000))


def test_the_interval_is_scipy_s() -> None:
    from scipy.stats import theilslopes

    noise = np.random.default_rng(2)
    times = np.sort(noise.uniform(0.0, 50.0, 17))
    values = 0.1 * times + noise.normal(0.0, 1.0, 17)
    ours = line(list(zip(times, values, strict=True)), 0.025)
    slope, _, low, high = theilslopes(values, times, 0.95)
    assert (ours.slope, ours.low, ours.high, ours.sure) == pytest.approx((slope, low, high, low))


# -- flights made comparable -----------------------------------------------------------------------------


def row(week: int, regime: str, value: float, load: float = 4e5, quantity: str = "unbalance") -> ConditionRow:
    return ConditionRow(
        f"f{week}", BEGAN + 7 * week * DAY_US, 3, quantity, regime, value, 1e-8, 60.0, load,
        15.0, NAN, NAN, NAN, 0, NAN, "",
    )  # fmt: skip


def test_flights_are_compared_in_one_regime_with_the_payload_taken_out() -> None:
    rows = [row(k, "hover", 1e-6 / (1.3 if k == 2 else 1.0), 5.2e5 if k == 2 else 4e5) for k in range(5)]
    rows += [row(k, "wind", 2e-6) for k in range(6)]
    alike = comparable(rows)
    assert (alike.regime, alike.seconds) == ("hover", 300.0)
    assert [point.value for point in alike.points] == pytest.approx([1e-6] * 5)
    drag = comparable([each._replace(quantity="drag") for each in rows])
    assert drag.points[2].value == rows[2].value  # already against the others


def test_too_few_flights_or_too_little_of_the_regime_compare_with_nothing() -> None:
    assert comparable([row(0, "hover", 1e-6)]) == NOTHING
    assert comparable([row(k, "hover", 1e-6)._replace(seconds=5.0) for k in range(9)]) == NOTHING
    assert comparable([row(k, "hover", 1e-6)._replace(started_us=0) for k in range(9)]) == NOTHING


# -- through the monitor ---------------------------------------------------------------------------------


def conditions(events: Iterable[Event]) -> list[ConditionEvent]:
    return [event for event in events if isinstance(event, ConditionEvent)]


def test_every_flight_of_a_session_tells_its_condition_once_when_it_ends() -> None:
    events = feed(two_flights(), MonitorConfig())
    one, two = conditions(events)
    after = events.index(one)
    assert not any(isinstance(event, ConditionEvent) for event in events[:after])
    assert one.indicators
    assert {each["regime"] for each in one.indicators} <= {regime.value for regime in Regime}  # type: ignore[index, call-overload]
    records = {}
    collector = FlightCollector()
    for record in collector.feed(events):
        records[record.identity] = record
    first, second = records.values()
    assert [each._asdict() for each in first.condition] == list(one.indicators)
    assert [each._asdict() for each in second.condition] == list(two.indicators)


def test_a_flight_that_never_disarms_tells_its_condition_before_the_summary_and_raises_nothing() -> None:
    from gcs_health.flight import replay

    flight = replay(FLIGHT, readings=False)
    kinds = [type(event) for event in flight.events]
    assert kinds.count(ConditionEvent) == 1
    assert kinds.index(ConditionEvent) < kinds.index(SummaryEvent)
    # what was flown after a rotor had failed is in none of it
    (alert,) = {event.id for event in flight.events if isinstance(event, AlertEvent)}
    assert alert
    (told,) = conditions(flight.events)
    assert all(each["value"] < 1.1 for each in told.indicators if each["quantity"] == "drag")  # type: ignore[index, call-overload, operator]
    (summary,) = flight.summaries
    assert summary.maintenance == ()


def test_the_summary_s_text_tells_what_grew_and_calls_it_maintenance() -> None:
    grew = Indicator(
        2, 3, Quantity.UNBALANCE.value, "hover", 2e-6, 1e-7, 400.0, 4e5, 15.0, 2e-6, 1e-6, 3e-6, True, 0.4
    )
    gaps = {"count": 0, "longest": 0.0, "total": 0.0}
    told = ({"t": 430.0, **grew._asdict()},)
    text = summary_text(SummaryEvent(430.0, 0, "1.1", 430.0, {}, gaps, {"bytes": 1}, (), (), (), told))  # type: ignore[arg-type]
    said = " ".join(text.split())
    assert (
        "07:10.000 maintenance: motor 3: unbalance 2 g mm grew within the flight by 2 (1 to 3) g mm an hour"
        in said
    )
    assert "no alert" in said
