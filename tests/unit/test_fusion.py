"""Evidence to posterior: each source's word by itself."""

import math

import pytest

from gcs_health.estimators.contract import Estimate, Quantity, Reason, Status
from gcs_health.fusion.evidence import EscHeat, esc_info, esc_state, from_estimate
from gcs_health.fusion.kinds import FAULTS, Kind
from gcs_health.fusion.verdicts import BOUND, PRIOR_ODDS, Evidence, RotorBelief, Verdict
from gcs_health.rotor_telemetry import RotorState
from gcs_health.samples import EscInfo

NAN = math.nan


def estimate(value: float, std: float, p: float = 0.0, **changes: object) -> Estimate:
    plain = Estimate(1.0, "effectiveness", 0, Quantity.EFFECTIVENESS, value, std, p, Status.VALID)
    return plain._replace(**changes)


def judged(*evidence: Evidence | None, t: float = 1.0) -> Verdict:
    belief = RotorBelief(0)
    for each in evidence:
        assert each is not None
        belief.feed(each)
    return belief.verdict(t)


def test_without_evidence_it_is_unknown_and_the_priors_are_what_is_left() -> None:
    verdict = judged()
    assert verdict.state == "unknown"
    assert verdict.probability == pytest.approx(1.0 / (1.0 + sum(PRIOR_ODDS.values())))
    assert sum(p for _, p in verdict.posterior) == pytest.approx(1.0)


def test_odds_add_up_and_each_source_is_bounded() -> None:
    said = Evidence(1.0, 0, "a", ((Kind.DRAG_RISEN, 3.0),))
    more = Evidence(1.0, 0, "b", ((Kind.DRAG_RISEN, 1e9),))
    odds = PRIOR_ODDS[Kind.DRAG_RISEN] * math.exp(3.0 + BOUND)
    rest = 1.0 + sum(PRIOR_ODDS[kind] for kind in FAULTS if kind is not Kind.DRAG_RISEN)
    assert judged(said, more).of({Kind.DRAG_RISEN}) == pytest.approx(odds / (odds + rest))


def test_what_a_source_said_is_replaced_by_what_it_says_and_ages() -> None:
    lost = Evidence(1.0, 0, "a", ((Kind.PROPELLER_LOST, BOUND),), sees_thrust=True)
    well = lost._replace(t=1.1, odds=((Kind.PROPELLER_LOST, -BOUND),))
    assert judged(lost).kind is Kind.PROPELLER_LOST
    assert judged(lost, well, t=1.2).kind is Kind.HEALTHY
    assert judged(well, t=1.2).state == "healthy"
    assert judged(well, t=5.0).state == "unknown"
    assert judged(lost._replace(lasts=math.inf), t=500.0).kind is Kind.PROPELLER_LOST


def test_a_named_loss_is_a_failure_whose_size_tells_partial_from_total() -> None:
    total = judged(from_estimate(estimate(0.03, 0.05, 0.99)))
    assert total.failed > 0.9
    assert total.of({Kind.PROPELLER_LOST}) > 3.0 * total.of({Kind.THRUST_LOSS})
    partial = judged(from_estimate(estimate(0.6, 0.05, 0.99)))
    assert partial.failed > 0.9
    assert partial.of({Kind.THRUST_LOSS}) > 10.0 * partial.of({Kind.PROPELLER_LOST})


@pytest.mark.parametrize(("value", "std"), [(1.0, 0.05), (0.9, 0.1), (1.1, 0.1), (0.7, 0.3), (0.5, 0.05)])
def test_a_slow_estimate_alone_raises_nothing(value: float, std: float) -> None:
    verdict = judged(from_estimate(estimate(value, std)))
    assert verdict.known
    assert verdict.failed < 0.5


def test_a_good_estimate_speaks_against_a_loss() -> None:
    assert judged(from_estimate(estimate(1.0, 0.05))).failed < judged().failed


def test_a_motor_that_stands_still_is_stopped_or_stuck_and_flags_tell_which() -> None:
    stopped = from_estimate(
        estimate(NAN, NAN, 0.99, status=Status.UNOBSERVABLE, reasons=(Reason.MOTOR_STOPPED,))
    )
    verdict = judged(stopped)
    assert verdict.failed > 0.9
    assert verdict.of({Kind.MOTOR_STOPPED}) < 0.8  # not clear yet
    info = EscInfo(1, 1, 290, 0, 0, 0, 4, 0, 5, 15, (32, 0, 0, 0), (0,) * 4, (40.0,) * 4)
    assert judged(stopped, esc_info(1.0, 0, 0, info, 0.0)).kind is Kind.MOTOR_STUCK


@pytest.mark.parametrize(("value", "risen"), [(1.4, True), (0.6, False)])
def test_drag_that_fell_is_no_drag_that_rose(value: float, risen: bool) -> None:
    said = estimate(value, 0.05, 0.97, estimator="motor_observer", quantity=Quantity.DRAG)
    verdict = judged(from_estimate(said))
    assert (verdict.of({Kind.DRAG_RISEN}) > 0.9) is risen


def test_drag_that_fell_votes_for_a_part_of_the_thrust_lost_and_decides_nothing_alone() -> None:
    fell = from_estimate(estimate(0.6, 0.05, 0.97, estimator="motor_observer", quantity=Quantity.DRAG))
    thrust = from_estimate(estimate(0.6, 0.05))
    assert judged(fell).failed < 0.5
    assert judged(thrust).failed < 0.5
    both = judged(fell, thrust)
    assert both.kind is Kind.THRUST_LOSS
    assert both.probability > 0.9
    as_ever = from_estimate(estimate(0.99, 0.05, 0.01, estimator="motor_observer", quantity=Quantity.DRAG))
    assert judged(as_ever, thrust).failed == pytest.approx(judged(thrust).failed, abs=0.01)


def test_what_cannot_be_estimated_says_nothing() -> None:
    assert from_estimate(estimate(NAN, NAN, NAN, status=Status.UNOBSERVABLE)) is None
    assert from_estimate(estimate(1.0, 0.1, 0.0, estimator="nobody")) is None


def test_a_silent_esc_is_lost_telemetry_only_in_flight_and_while_others_speak() -> None:
    lost = judged(esc_state(1.0, 0, RotorState.STALE, True, True))
    assert lost.kind is Kind.ESC_TELEMETRY_LOST
    assert lost.probability > 0.9
    assert judged(esc_state(1.0, 0, RotorState.STALE, False, True)).probability > 0.5  # all at once: the link
    assert judged(esc_state(1.0, 0, RotorState.STALE, False, True)).kind is Kind.HEALTHY
    assert esc_state(1.0, 0, RotorState.STALE, True, False) is None
    assert esc_state(1.0, 0, RotorState.NOT_REPORTED, True, True) is None


@pytest.mark.parametrize(
    ("flags", "degc", "errors", "kind"),
    [
        (0, 40.0, 0.0, Kind.HEALTHY),
        (4, 40.0, 0.0, Kind.ESC_OVERHEATING),
        (512, NAN, 0.0, Kind.ESC_OVERHEATING),
        (0, 120.0, 0.0, Kind.ESC_OVERHEATING),
        (1, 40.0, 0.0, Kind.ESC_FAULT_REPORTED),
        (64, NAN, 0.0, Kind.ESC_FAULT_REPORTED),
        (0, 40.0, 50.0, Kind.ESC_FAULT_REPORTED),
    ],
)
def test_what_an_esc_reports_of_itself(flags: int, degc: float, errors: float, kind: Kind) -> None:
    info = EscInfo(1, 1, 290, 0, 0, 0, 4, 0, 5, 15, (flags, 0, 0, 0), (0,) * 4, (degc, 0.0, 0.0, 0.0))
    assert judged(esc_info(1.0, 0, 0, info, errors)).kind is kind


def test_a_named_loss_whose_speed_is_anothers_is_no_failure() -> None:
    named = from_estimate(estimate(0.1, 0.05, 0.99))
    exchanged = Evidence(1.0, 0, "attribution", ((Kind.ESC_MISATTRIBUTED, BOUND),))
    assert judged(named).failed > 0.9
    assert judged(named).of({Kind.ESC_MISATTRIBUTED}) < 0.01
    assert judged(named, exchanged).of({Kind.ESC_MISATTRIBUTED}) > 0.99


def test_an_esc_that_what_rubs_has_heated_is_told_beside_it() -> None:
    rubs = Evidence(1.0, 0, "motor_observer drag", ((Kind.DRAG_RISEN, BOUND),))
    info = EscInfo(1, 1, 290, 0, 0, 0, 4, 0, 5, 15, (0,) * 4, (0,) * 4, (125.0, 50.0, 50.0, 50.0))
    hot = esc_info(1.0, 0, 0, info, 0.0)
    both = judged(rubs, hot)
    assert both.of({Kind.DRAG_RISEN}) == pytest.approx(judged(rubs).of({Kind.DRAG_RISEN}), abs=1e-3)
    assert both.of({Kind.ESC_OVERHEATING}) == pytest.approx(judged(hot).of({Kind.ESC_OVERHEATING}), abs=1e-3)
    assert min(both.of({Kind.DRAG_RISEN}), both.of({Kind.ESC_OVERHEATING})) > 0.9


@pytest.mark.parametrize(("others", "soon"), [(math.nan, True), (60.0, True), (78.0, False)])
def test_an_esc_that_grows_warm_with_all_others_is_not_about_to_overheat(others: float, soon: bool) -> None:
    heat = EscHeat()
    for k in range(60):
        heat.feed(k * 0.5, 40.0 + 1.3 * k * 0.5)
    assert 70.0 < heat.level < 90.0
    assert heat.hot_soon(others) is soon
    for k in range(60, 90):
        heat.feed(k * 0.5, 40.0 + 1.3 * k * 0.5)
    assert heat.hot_soon(others)
