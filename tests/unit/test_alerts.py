"""The alert machine and its catalogue: each rule by itself, and the panel that feeds it."""

import math
from pathlib import Path

import pytest
from synthetic_flight import airframe

from gcs_health.estimators.contract import Estimate, Quantity, Reason, Status
from gcs_health.fusion.alert_table import CATALOGUE, OF_KIND
from gcs_health.fusion.alerts import Alert, AlertDesk
from gcs_health.fusion.kinds import FAILED, FAULTS, Kind
from gcs_health.fusion.panel import RotorPanel
from gcs_health.fusion.shared import SharedUnbalance
from gcs_health.fusion.verdicts import Verdict
from gcs_health.rotor_telemetry import RotorTelemetry
from gcs_health.samples import EscInfo, FlightReading

NAN = math.nan


def verdict(t: float, kind: Kind, p: float, rotor: int = 0, **others: float) -> Verdict:
    """A posterior with `p` on one kind, `others` on further ones by name, the rest healthy."""
    share = {kind: p, **{Kind[name]: value for name, value in others.items()}}
    rest = 1.0 - sum(share.values())
    weights = {Kind.HEALTHY: rest, **{k: share.get(k, 0.0) for k in FAULTS}}
    return Verdict(t, rotor, kind, p, weights, 1.0, True, t, ())


def steps(alerts: list[Alert]) -> list[tuple[str, str, int]]:
    return [(alert.state, alert.kind.code, alert.number) for alert in alerts]


def test_raised_once_escalated_when_clear_and_never_twice() -> None:
    desk = AlertDesk(airframe(4))
    told = desk.feed(verdict(1.0, Kind.PROPELLER_LOST, 0.55, THRUST_LOSS=0.4))
    assert steps(told) == [("raised", "ROTOR_FAILED", 1)]
    assert desk.feed(verdict(1.1, Kind.PROPELLER_LOST, 0.55, THRUST_LOSS=0.4)) == []
    assert steps(desk.feed(verdict(1.2, Kind.PROPELLER_LOST, 0.95))) == [("escalated", "PROPELLER_LOST", 1)]
    assert desk.feed(verdict(1.3, Kind.PROPELLER_LOST, 0.95)) == []
    # what was clear does not become unclear again
    assert desk.feed(verdict(1.4, Kind.PROPELLER_LOST, 0.5, THRUST_LOSS=0.45)) == []


def test_a_kind_that_is_clear_at_once_is_raised_as_such() -> None:
    told = AlertDesk(airframe(4)).feed(verdict(1.0, Kind.MOTOR_STOPPED, 0.95))
    assert steps(told) == [("raised", "MOTOR_STOPPED", 1)]


def test_cleared_only_after_it_was_calm_for_long_enough() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.PROPELLER_LOST, 0.95))
    assert desk.feed(verdict(2.0, Kind.HEALTHY, 0.0)) == []
    assert desk.feed(verdict(3.0, Kind.PROPELLER_LOST, 0.95)) == []  # back: no second alarm
    assert desk.feed(verdict(4.0, Kind.HEALTHY, 0.0)) == []
    assert steps(desk.feed(verdict(6.1, Kind.HEALTHY, 0.0))) == [("cleared", "PROPELLER_LOST", 1)]
    assert steps(desk.feed(verdict(7.0, Kind.PROPELLER_LOST, 0.95))) == [("raised", "PROPELLER_LOST", 2)]


def test_unknown_clears_nothing() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.PROPELLER_LOST, 0.95))
    for t in (2.0, 5.0, 9.0):
        assert desk.feed(verdict(t, Kind.HEALTHY, 0.0)._replace(known=False)) == []


def test_one_alarm_a_cause_others_of_a_failed_vehicle_are_explained() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.PROPELLER_LOST, 0.95, rotor=2))
    assert desk.feed(verdict(1.5, Kind.MOTOR_STOPPED, 0.99, rotor=0)) == []
    assert desk.feed(verdict(1.5, Kind.PROPELLER_UNBALANCED, 0.99, rotor=0)) == []


def test_a_hold_must_be_over_before_it_is_raised() -> None:
    desk = AlertDesk(airframe(4))
    assert desk.feed(verdict(1.0, Kind.ESC_TELEMETRY_LOST, 0.99)) == []
    assert desk.feed(verdict(1.5, Kind.HEALTHY, 0.0)) == []
    assert desk.feed(verdict(1.6, Kind.ESC_TELEMETRY_LOST, 0.99)) == []
    assert steps(desk.feed(verdict(2.6, Kind.ESC_TELEMETRY_LOST, 0.99))) == [
        ("raised", "ESC_TELEMETRY_LOST", 1)
    ]


def test_acknowledged_once_and_shelved_until_it_gets_graver() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.PROPELLER_LOST, 0.55, THRUST_LOSS=0.4))
    assert steps(desk.acknowledge(1, 1.1)) == [("acknowledged", "ROTOR_FAILED", 1)]
    assert desk.acknowledge(1, 1.2) == []
    assert desk.acknowledge(7, 1.2) == []
    assert steps(desk.shelve(1, 1.3, 100.0)) == [("shelved", "ROTOR_FAILED", 1)]
    assert steps(desk.feed(verdict(9.0, Kind.PROPELLER_LOST, 0.95))) == [("escalated", "PROPELLER_LOST", 1)]


def test_kinds_as_grave_do_not_take_turns_and_a_graver_one_does_not_wait() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.MOTOR_STOPPED, 0.95))
    for k in range(1, 9):
        kind = Kind.MOTOR_STUCK if k % 2 else Kind.MOTOR_STOPPED
        assert desk.feed(verdict(1.0 + 0.1 * k, kind, 0.95)) == []
    assert desk.feed(verdict(2.0, Kind.MOTOR_STUCK, 0.95)) == []
    assert steps(desk.feed(verdict(2.4, Kind.MOTOR_STUCK, 0.95))) == [("escalated", "MOTOR_STUCK", 1)]
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.PROPELLER_SLIPPING, 0.95))
    assert steps(desk.feed(verdict(1.1, Kind.PROPELLER_LOST, 0.95))) == [("escalated", "PROPELLER_LOST", 1)]


def test_a_rotor_that_seemed_to_fail_and_has_anothers_telemetry_is_one_episode() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.PROPELLER_SLIPPING, 0.95))
    told = desk.feed(verdict(1.5, Kind.ESC_MISATTRIBUTED, 0.95))  # two sources say so: no hold
    assert steps(told) == [("escalated", "ESC_MISATTRIBUTED", 1)]
    assert desk.failed is None
    assert desk.feed(verdict(1.6, Kind.ESC_MISATTRIBUTED, 0.95, rotor=2)) == []  # the other of the two


def test_a_rotor_that_its_own_current_proves_to_have_failed_is_not_taken_for_exchanged() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.PROPELLER_LOST, 0.95))
    assert desk.proven
    for k in range(15):
        for rotor in (0, 2):
            assert desk.feed(verdict(1.1 + 0.1 * k, Kind.ESC_MISATTRIBUTED, 0.95, rotor=rotor)) == []
    assert desk.failed == 0


def test_a_new_flight_clears_what_is_open() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(verdict(1.0, Kind.PROPELLER_LOST, 0.95))
    assert steps(desk.new_flight(9.0)) == [("cleared", "PROPELLER_LOST", 1)]


def test_every_kind_has_its_code_and_every_text_fits_a_line() -> None:
    assert set(OF_KIND) == set(FAULTS)
    assert len(CATALOGUE) == len(FAULTS) + 1
    for row in CATALOGUE.values():
        text = row.text.format(motor=12, seat="front right bottom, CCW", percent=99, amount=", 12345 g mm")
        assert max(len(text), len(row.unnamed.format(percent=99))) <= 80, text
        assert 0 <= row.severity <= 7
        assert row.advice.endswith(".")
        assert row.clear_at < row.raise_at
    assert set(FAILED) < set(FAULTS)


def shared(t: float, p: float) -> Verdict:
    """One of four rotors, each as likely."""
    belief = SharedUnbalance([1, 2, 3, 4])
    belief.feed([unbalanced(t, k, p / 4.0, Reason.NOT_IDENTIFIABLE) for k in range(4)])
    found = belief.verdict(t)
    assert found is not None
    return found


def unbalanced(t: float, rotor: int, p: float, *reasons: Reason) -> Estimate:
    plain = Estimate(t, "unbalance", rotor, Quantity.UNBALANCE, NAN, NAN, p, Status.UNOBSERVABLE, reasons)
    return plain if reasons else plain._replace(status=Status.VALID)


def test_the_sum_over_the_suspects_counts_and_no_rotor_is_named() -> None:
    (alert,) = AlertDesk(airframe(4)).feed(shared(1.0, 0.96))
    assert (alert.kind.code, alert.rotor) == ("PROPELLER_UNBALANCED", None)
    assert alert.text == "a propeller is unbalanced, which one cannot be told, 96 % sure"
    belief = SharedUnbalance([5, 6, 7, 8])
    belief.feed(
        [unbalanced(1.0, k, 0.48 if k in (1, 3) else 0.003, Reason.NOT_IDENTIFIABLE) for k in range(4)]
    )
    assert belief.probability(1.0) == pytest.approx(0.96)
    assert ("unbalance.one_of_motors", "6 8") in belief.figures()
    assert math.isnan(belief.probability(9.0))  # nothing said of it for long


def test_what_is_not_known_or_a_rotors_own_is_nobodys() -> None:
    belief = SharedUnbalance([1, 2, 3, 4])
    belief.feed([unbalanced(1.0, k, NAN, Reason.NO_BASELINE) for k in range(4)])
    assert belief.verdict(1.0) is None
    belief.feed([unbalanced(1.0, k, 0.95 if k == 2 else 0.003) for k in range(4)])
    assert belief.probability(1.0) == 0.0
    assert AlertDesk(airframe(4)).feed(shared(1.0, 0.8)) == []


def test_once_a_rotor_is_named_the_same_episode_is_its() -> None:
    desk = AlertDesk(airframe(4))
    assert steps(desk.feed(shared(1.0, 0.95))) == [("raised", "PROPELLER_UNBALANCED", 1)]
    (named,) = desk.feed(verdict(2.0, Kind.PROPELLER_UNBALANCED, 0.95, rotor=2))
    assert (named.state, named.number, named.rotor) == ("escalated", 1, airframe(4).rotors[2])
    assert desk.feed(shared(3.0, 0.95)) == []  # explained by the named one
    (over,) = desk.feed(verdict(20.0, Kind.HEALTHY, 0.0, rotor=2)) or desk.feed(
        verdict(81.0, Kind.HEALTHY, 0.0, rotor=2)
    )
    assert over.state == "cleared"


def test_an_alert_of_no_rotor_clears_and_a_failed_rotor_explains_it() -> None:
    desk = AlertDesk(airframe(4))
    desk.feed(shared(1.0, 0.95))
    assert desk.feed(shared(2.0, 0.02)) == []
    (over,) = desk.feed(shared(62.5, 0.02))
    assert (over.state, over.text) == ("cleared", "PROPELLER_UNBALANCED is over")
    desk.feed(verdict(63.0, Kind.PROPELLER_LOST, 0.95, rotor=1))
    assert desk.feed(shared(64.0, 0.99)) == []


PART = Estimate(1.0, "effectiveness", 0, Quantity.EFFECTIVENESS, 0.6, 0.05, 0.5, Status.VALID)._replace(
    evidence=(("rule", "partial_loss"),)
)  # as effectiveness says it for 2 s


AGAINST = Estimate(1.0, "motor_observer", 0, Quantity.EFFECTIVENESS, 1.0, 0.05, 1e-3, Status.VALID)


def contradicted() -> RotorPanel:
    """In flight, effectiveness names a rotor, and the motor observer says that its propeller is there."""
    panel = RotorPanel(airframe(4))
    assert panel.read(FlightReading(0.0, True, False), lambda: True) == []
    for k in range(30):
        t = 1.0 + 0.1 * k
        assert panel.feed([PART._replace(t=t), AGAINST._replace(t=t)]) == []
        assert panel.routine(t, RotorTelemetry(), True) == []
    assert panel.verdicts[0].failed > 0.1  # all but told
    return panel


def judged_on(panel: RotorPanel, begin: float, flies: bool, *said: Estimate) -> list[tuple[str, str, int]]:
    told = []
    for k in range(40):
        t = begin + 0.1 * k
        told += panel.feed([each._replace(t=t) for each in said]) + panel.routine(t, RotorTelemetry(), flies)
    return steps(told)


def test_in_flight_the_lapse_of_what_spoke_against_it_lets_a_fault_be_told() -> None:
    assert judged_on(contradicted(), 4.0, True, PART) == [("raised", "THRUST_LOSS", 1)]


@pytest.mark.parametrize("over", [FlightReading(4.0, False, False), FlightReading(4.0, True, True)])
def test_after_the_flight_nothing_is_raised_by_the_lapse_of_what_spoke_against_it(
    over: FlightReading,
) -> None:
    panel = contradicted()
    panel.read(over, lambda: False)
    assert judged_on(panel, 4.0, False, PART) == []
    assert panel.verdicts[1].state == "unknown"  # nobody looks any more
    info = EscInfo(1, 1, 290, 0, 0, 0, 4, 0, 5, 15, (0, 4, 0, 0), (0,) * 4, (0.0, 120.0, 0.0, 0.0))
    panel.esc_info(8.0, info)  # what an ESC reports now is no estimate of the flight
    assert steps(panel.routine(8.0, RotorTelemetry(), False)) == [("raised", "ESC_OVERHEATING", 1)]


def test_what_was_told_in_flight_stays_after_landing_and_the_next_flight_is_judged_anew() -> None:
    panel = contradicted()
    assert judged_on(panel, 4.0, True, PART) == [("raised", "THRUST_LOSS", 1)]
    panel.read(FlightReading(8.0, False, True), lambda: False)
    assert judged_on(panel, 8.0, False) == []
    assert panel.verdicts[0].kind is Kind.THRUST_LOSS
    assert steps(panel.new_flight(20.0)) == [("cleared", "THRUST_LOSS", 1)]
    panel.read(FlightReading(20.1, True, True), lambda: False)
    panel.read(FlightReading(21.0, True, False), lambda: True)
    assert judged_on(panel, 22.0, True, PART) == [("raised", "THRUST_LOSS", 2)]


def test_the_documented_table_is_the_catalogue() -> None:
    page = (Path(__file__).parents[2] / "docs" / "reference" / "alerts.md").read_text("utf-8")
    for row in CATALOGUE.values():
        assert f"| `{row.code}` |" in page
        assert row.advice in page
