"""What each source's word is worth: estimates and ESC reports to log likelihood ratios over kinds of fault.

One function a source. A ratio compares how likely what was said would be under a kind with how likely it would be of
a healthy rotor; where the source's own figures give it (an estimate with its spread, a failure probability) it is
worked out from them, else it is one of the constants below.
"""

import math
from collections.abc import Callable
from functools import lru_cache

from gcs_health.estimators.contract import Estimate, Reason, Status
from gcs_health.fusion.kinds import FAILED, FAULTS, Kind
from gcs_health.fusion.verdicts import BOUND, PRIOR_ODDS, Evidence, Odds
from gcs_health.rotor_telemetry import RotorState
from gcs_health.samples import EscInfo, new_tuple

SURE, LIKELY, AGAINST = BOUND, 6.0, -6.0  # nats
HOLDS, HOLDS_SLOW = 1.0, 5.0  # s that an estimate holds without being repeated
LOST_SPREAD, PART_SPREAD = 0.2, 0.05  # of the loss beyond its own standard deviation
PARTIAL = tuple(0.1 + 0.05 * k for k in range(14))  # losses that "partly" covers, equally likely

TURNS = 0.8  # of hover speed: a motor that does cannot have stopped

STUCK_FLAG, HEAT_FLAGS = 32, 4 | 128 | 256 | 512  # ESC_FAILURE_FLAGS, and PX4's beyond the enum
HOT = 110.0  # °C, where ESCs begin to protect themselves
SOON, WARM = 30.0, 70.0  # s within which a rise would reach HOT, and °C from which a rise is followed
APART, VERY_WARM = 10.0, 90.0  # °C above the others; and from which the rise of one that is not is followed
TREND_OVER = 5.0  # s
ERRORS_A_SECOND = 20.0  # more than a noisy wire makes
UNLIKELY = 0.01  # probability of a rise where the value has fallen
VOTE = 6.0  # nats of a source whose false alarms no campaign has bounded: it decides nothing alone


def from_estimate(estimate: Estimate) -> Evidence | None:
    """Return what an estimate says of its rotor; None where it says nothing."""
    function = _OF_ESTIMATOR.get((estimate.estimator, estimate.quantity))
    return function(estimate) if function is not None else None


def effectiveness(estimate: Estimate) -> Evidence | None:
    """Thrust: a named loss by its size, else the slow estimate with its spread."""
    if Reason.MOTOR_STOPPED in estimate.reasons:
        # a blocked motor stands still too: the current tells them apart
        return _evidence(estimate, ((Kind.MOTOR_STOPPED, SURE), (Kind.MOTOR_STUCK, SURE)))
    if estimate.status is not Status.VALID:
        return None
    p = estimate.failure_probability
    named = p == p and p > 0.9
    turns = not named and dict(estimate.evidence).get("speed_over_hover", 1.0) > TURNS  # type: ignore[operator]
    return _evidence(estimate, _of_loss(1.0 - estimate.value, estimate.std, named, turns))


@lru_cache(maxsize=256)  # asked ten times a second of every rotor, of figures that change with lessons alone
def _of_loss(loss: float, spread: float, named: bool, turns: bool) -> Odds:
    """Return what a loss of thrust with its standard deviation speaks for; `turns` = the motor surely does."""
    if named:
        # the rules bound its false alarms: what it names counts in full, its size only among the kinds
        gone, part = _normal(loss, 1.0, math.hypot(spread, LOST_SPREAD)), _partly(loss, spread)
        top = max(gone, part)
        gone, part = SURE + gone - top, SURE + part - top
    else:
        well = _normal(loss, 0.0, max(spread, 0.02))
        gone = _normal(loss, 1.0, math.hypot(spread, LOST_SPREAD)) - well
        # the likeliest size stands for all of them
        nearest = min(max(loss, PARTIAL[0]), PARTIAL[-1])
        part = _normal(loss, nearest, math.hypot(spread, PART_SPREAD)) - well
        most = -math.log(PRIOR_ODDS[Kind.THRUST_LOSS]) - 2.0  # what no rule has named raises nothing
        gone, part = min(gone, most), min(part, most)
    odds: Odds = (
        (Kind.PROPELLER_LOST, gone),
        (Kind.THRUST_LOSS, part),
        (Kind.PROPELLER_SLIPPING, max(gone, part)),
    )
    if named:
        odds += ((Kind.ESC_MISATTRIBUTED, VOTE),)  # another's speed pushes as little
    if turns:
        odds += ((Kind.MOTOR_STOPPED, AGAINST), (Kind.MOTOR_STUCK, AGAINST))
    return odds


def torque(estimate: Estimate) -> Evidence | None:
    """The motor's torque: gone with the propeller, there while a propeller slips."""
    p = estimate.failure_probability
    if p == p and p > 0.9 and Reason.MOTOR_NOT_DRIVEN in estimate.reasons:
        return _evidence(estimate, ((Kind.MOTOR_STOPPED, SURE), (Kind.MOTOR_STUCK, AGAINST)))
    if p != p or estimate.status is not Status.VALID:
        return None
    if p > 0.9:
        odds: Odds = ((Kind.PROPELLER_LOST, _compensated(p, Kind.PROPELLER_LOST)),)
        odds += ((Kind.PROPELLER_SLIPPING, AGAINST), (Kind.MOTOR_STUCK, AGAINST))
    else:
        odds = ((Kind.PROPELLER_LOST, AGAINST), (Kind.THRUST_LOSS, 0.5 * AGAINST))
    return _evidence(estimate, odds)


def drag(estimate: Estimate) -> Evidence | None:
    """The motor's drag against its own: risen where something rubs or a bearing runs dry.

    Fallen, the propeller moves less air, or the motor is not driven: a vote for both, and against one that slips.
    """
    p = estimate.failure_probability
    if p != p or estimate.status is not Status.VALID:
        return None
    fallen = estimate.value < 1.0
    risen = _compensated(min(p, UNLIKELY) if fallen else p, Kind.DRAG_RISEN)
    odds: Odds = ((Kind.DRAG_RISEN, risen),)
    if fallen and p > 0.9:
        odds += ((Kind.THRUST_LOSS, VOTE), (Kind.MOTOR_STOPPED, VOTE), (Kind.PROPELLER_SLIPPING, -VOTE))
    return _evidence(estimate, odds, sees_thrust=False, source="motor_observer drag", lasts=HOLDS_SLOW)


def unbalance(estimate: Estimate) -> Evidence | None:
    """The propeller's unbalance, where it can be told whose it is."""
    p = estimate.failure_probability
    if p != p or estimate.status is not Status.VALID:
        return None
    odds = ((Kind.PROPELLER_UNBALANCED, _compensated(p, Kind.PROPELLER_UNBALANCED)),)
    return _evidence(estimate, odds, sees_thrust=False, lasts=HOLDS_SLOW)


def _compensated(p: float, kind: Kind) -> float:
    """Return the ratio with which a source's own probability comes out as the posterior, if it is alone."""
    p = min(max(p, 1e-6), 1.0 - 1e-6)
    return math.log(p / (1.0 - p)) - math.log(PRIOR_ODDS[kind])


def esc_state(t: float, rotor: int, state: RotorState, others_live: bool, in_flight: bool) -> Evidence | None:
    """Telemetry: an ESC that fell silent in flight while the link and the others go on."""
    if state is RotorState.NOT_REPORTED or not in_flight:
        return None
    if state is RotorState.STALE:
        ratio = SURE if others_live else LIKELY
        return Evidence(t, rotor, "esc", ((Kind.ESC_TELEMETRY_LOST, ratio),))
    return Evidence(t, rotor, "esc", _ESC_SPEAKS)


def degradation(estimate: Estimate) -> Evidence | None:
    """The pooled AR's and the speeds' view of a degraded rotor: a vote."""
    p = estimate.failure_probability
    if p != p or estimate.status is not Status.VALID:
        return None
    # it tells no kind; and a rotor without a propeller keeps its speed: that it sees nothing is no health
    ratio = min(max(_compensated(p, Kind.THRUST_LOSS), 0.0), VOTE)
    odds = _NO_KIND if ratio == 0.0 else tuple([(kind, ratio) for kind, _ in _NO_KIND])
    return _evidence(estimate, odds, sees_thrust=False)


def partial_loss(estimate: Estimate, evidence: Evidence) -> Evidence:
    """Return the evidence of a partial loss that has lasted: it counts in full, by its size among the kinds."""
    loss, spread = 1.0 - estimate.value, estimate.std
    gone, part = _normal(loss, 1.0, math.hypot(spread, LOST_SPREAD)), _partly(loss, spread)
    top = max(gone, part)
    gone, part = SURE + gone - top, SURE + part - top
    odds = ((Kind.PROPELLER_LOST, gone), (Kind.THRUST_LOSS, part), (Kind.PROPELLER_SLIPPING, gone))
    return evidence._replace(odds=(*odds, (Kind.ESC_MISATTRIBUTED, VOTE)))


class EscHeat:
    """Level [°C] and trend [°C/s] of one ESC's temperature, over 5 s."""

    __slots__ = ("level", "since", "t", "trend")

    def __init__(self) -> None:
        self.level = self.t = self.since = math.nan
        self.trend = 0.0

    def feed(self, t: float, degc: float) -> None:
        """Take a temperature; NaN = not known."""
        dt = t - self.t
        if degc != degc:
            return
        if not 0.0 < dt < TREND_OVER:  # the first, or after a gap
            self.level, self.trend, self.t, self.since = degc, 0.0, t, t
            return
        share = dt / TREND_OVER
        before = self.level
        # Holt's: the level follows its own trend, the trend what the level did
        self.level += self.trend * dt + 2.0 * share * (degc - self.level - self.trend * dt)
        self.trend += share * ((self.level - before) / dt - self.trend)
        self.t = t

    def hot_soon(self, others: float = math.nan) -> bool:
        """Whether the rise, if it goes on, ends above `HOT` within `SOON` s.

        `others` [°C]: level of the other ESCs. With them all rise in hard flying, and level off.
        """
        settled = self.t - self.since > 2.0 * TREND_OVER
        warm = VERY_WARM if self.level - others < APART else WARM
        return settled and self.level > warm and self.level + SOON * self.trend > HOT


def esc_info(
    t: float,
    rotor: int,
    slot: int,
    info: EscInfo,
    errors_a_second: float,
    heat: EscHeat | None = None,
    others: float = math.nan,
) -> Evidence:
    """Return what ESC_INFO says in its slot 0 to 3; `others` [°C]: how warm the other ESCs are."""
    flags, degc = info.failure_flags[slot], info.temperature_degc[slot]
    hot = bool(flags & HEAT_FLAGS) or degc > HOT or (heat is not None and heat.hot_soon(others))
    other = flags & ~(HEAT_FLAGS | STUCK_FLAG)
    odds: Odds = (
        (Kind.ESC_OVERHEATING, SURE if hot else AGAINST),
        (Kind.ESC_FAULT_REPORTED, SURE if other or errors_a_second > ERRORS_A_SECOND else AGAINST),
    )
    if flags & STUCK_FLAG:
        odds += ((Kind.MOTOR_STUCK, SURE),)
    figures: tuple[tuple[str, float | str], ...] = (("failure_flags", float(flags)),)
    if degc == degc:
        figures += (("temperature_degc", degc),)
        if heat is not None:
            figures += (("temperature_trend_degc_s", heat.trend),)
    if errors_a_second > 0.0:
        figures += (("errors_a_second", errors_a_second),)
    return Evidence(t, rotor, "esc_info", odds, lasts=3.0, figures=figures)


def _evidence(
    estimate: Estimate, odds: Odds, sees_thrust: bool = True, source: str = "", lasts: float = HOLDS
) -> Evidence:
    source = source or estimate.estimator
    head = estimate.t, estimate.rotor, source
    return new_tuple(Evidence, (*head, odds, sees_thrust, lasts, estimate.evidence))


def _normal(x: float, mean: float, std: float) -> float:
    """Log density of a normal distribution, without its constant."""
    return -0.5 * ((x - mean) / std) ** 2 - math.log(std)


def _partly(loss: float, spread: float) -> float:
    """Log density of the estimated loss when a part of the thrust, any part alike, is gone."""
    std = math.hypot(spread, PART_SPREAD)
    logs = [_normal(loss, size, std) for size in PARTIAL]
    top = max(logs)
    return top + math.log(sum(math.exp(each - top) for each in logs) / len(logs))


_ESC_SPEAKS: Odds = ((Kind.ESC_TELEMETRY_LOST, AGAINST),)
_NO_KIND: Odds = tuple((kind, 0.0) for kind in FAULTS if kind in FAILED)
_OF_ESTIMATOR: dict[tuple[str, str], Callable[[Estimate], Evidence | None]] = {
    ("effectiveness", "effectiveness"): effectiveness,
    ("motor_observer", "effectiveness"): torque,
    ("motor_observer", "drag"): drag,
    ("unbalance", "unbalance"): unbalance,
    ("unbalance", "unbalance_relative"): unbalance,
    ("pooled_ar", "degradation"): degradation,
}
assert set(PRIOR_ODDS) == set(FAULTS)
