"""A propeller's balance in a workshop's words, against the arithmetic of ISO 21940-11, and where it is told."""

from itertools import pairwise
from pathlib import Path

import pytest
from synthetic_flight import airframe

from gcs_health.balance import GRADES, amount, figures, grade, words
from gcs_health.cli.history_text import vehicle_text
from gcs_health.cli.text import summary_text
from gcs_health.estimators.contract import Estimate, Quantity, Status
from gcs_health.fusion.alerts import AlertDesk
from gcs_health.fusion.evidence import from_estimate
from gcs_health.fusion.verdicts import RotorBelief
from gcs_health.record.describe import describe_state, estimate_event
from gcs_health.record.events import EstimateEvent, SummaryEvent, VehicleEvent
from gcs_health.record.flight_results import FlightCollector
from gcs_health.record.history import History
from gcs_health.record.vehicle_history import VehicleHistory
from gcs_health.report.flight_page import _rotor

U, RADIUS, MASS, SPEED = 2e-6, 0.12, 0.01, 600.0  # kg m, m, kg, rad/s


def test_it_is_the_standards_arithmetic() -> None:
    known = dict(figures(U, RADIUS, MASS, SPEED))
    assert known["unbalance_g_mm"] == pytest.approx(2.0)
    assert known["tip_mass_mg"] == pytest.approx(1e6 * U / RADIUS)
    assert known["balance_quality_mm_s"] == pytest.approx(
        1e3 * U / MASS * SPEED
    )  # e 0.2 mm, 600 rad/s: 120 mm/s
    assert known["balance_grade"] == "G 250"
    assert "balance_grade_lacks" not in known


@pytest.mark.parametrize(
    ("quality", "said"), [(0.0, "G 0.4"), (6.3, "G 6.3"), (6.4, "G 16"), (5e3, "beyond G 4000")]
)
def test_a_grade_is_the_least_whose_limit_holds(quality: float, said: str) -> None:
    assert grade(quality) == said
    assert all(2.3 < b / a < 2.7 for a, b in pairwise(GRADES))  # the standard's factor


def test_what_is_missing_is_said() -> None:
    assert words(figures(U)) == "2 g mm, no grade without the propeller's mass and a usual speed"
    assert words(figures(U, mass=MASS)) == "2 g mm, no grade without a usual speed"
    assert words(figures(U, RADIUS, MASS, SPEED)) == "2 g mm (16.7 mg at the tip), G 250 at 5730 rpm"
    assert words((("level_m_s2", 1.0),)) == amount(()) == ""


def shaken(evidence: tuple[tuple[str, float | str], ...], p: float = 0.99) -> Estimate:
    plain = Estimate(1.0, "unbalance", 0, Quantity.UNBALANCE, U, 1e-7, p, Status.VALID)
    return plain._replace(evidence=evidence)


def test_the_alert_says_how_large_it_is_and_carries_the_grade() -> None:
    belief, desk = RotorBelief(0), AlertDesk(airframe(4))
    said = from_estimate(shaken(figures(U, RADIUS, MASS, SPEED)))
    assert said is not None
    belief.feed(said)
    (alert,) = desk.feed(belief.verdict(1.0), belief.figures())
    assert "propeller unbalanced, 2 g mm, 9" in alert.text
    assert dict(alert.evidence)["unbalance.balance_grade"] == "G 250"


def test_a_relative_unbalance_has_no_such_words() -> None:
    relative = shaken(())._replace(quantity=Quantity.UNBALANCE_RELATIVE)
    assert describe_state(relative)["balance"] == ""
    event = estimate_event(relative, airframe(4), 0, "1.1")
    assert event.balance_quality != event.balance_quality


def test_summary_and_report_have_it() -> None:
    state = describe_state(shaken(figures(U, RADIUS, MASS, SPEED), 0.1))
    told = {"estimator": "unbalance", "quantity": "unbalance", "final": state, "worst": state}
    rotor = {
        "motor": 1,
        "seat": "right",
        "telemetry": "fresh",
        "final": state,
        "worst": state,
        "estimates": (told,),
    }
    assert _rotor(rotor, {1: "healthy"})["balance"] == "2 g mm (16.7 mg at the tip), G 250 at 5730 rpm"
    gaps = {"count": 0, "longest": 0.0, "total": 0.0}
    summary = SummaryEvent(1.0, 0, "1.1", 1.0, {}, gaps, {"bytes": 1}, (), (rotor,), ())  # type: ignore[arg-type]
    assert "2.0 ± 0.1 G250" in summary_text(summary)


def test_the_history_keeps_the_flights_mean_grade(tmp_path: Path) -> None:
    graded = estimate_event(
        shaken(figures(U, RADIUS, MASS, SPEED)), airframe(4), 1_780_000_000_000_000, "1.1"
    )
    lacking: EstimateEvent = graded._replace(t=2.0, balance_quality=float("nan"))
    said = [VehicleEvent(0.0, 5, "1.1", "flight", "armed", armed=True), graded, lacking]
    said.append(VehicleEvent(3.0, 6, "1.1", "flight", "disarmed", armed=False))  # type: ignore[arg-type]
    (record,) = FlightCollector().feed(said)
    store = History(str(tmp_path / "h.sqlite"))
    store.store(record)
    told = VehicleHistory.of(store, store.vehicles()[0], None, {})
    assert told.results[0].balance_quality == pytest.approx(120.0)
    assert "unbalance 2 ± 0.1 g mm (G 250), 1 flight" in vehicle_text(told, brief=False)
    store.close()
