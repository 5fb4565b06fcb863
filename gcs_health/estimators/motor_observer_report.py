"""What the motor observer says of one rotor: value, trust, reasons, and the smallest fault it would see."""

import math
from typing import NamedTuple

from gcs_health.estimators.contract import Quantity, Reason, Status
from gcs_health.estimators.motor_observer_paper import PaperObserver
from gcs_health.estimators.motor_observer_recommended import RecommendedObserver

NAN = math.nan
Evidence = tuple[tuple[str, float | str], ...]
UNDECIDED = 0.89  # highest failure probability while the rules are not satisfied
DECIDED = 0.9001  # lowest once they are
NOT_DRIVEN = 0.99
NINE_TO_ONE = math.log(9.0)  # odds of .9
NINE_IN_TEN = 1.2816  # standard deviations
SLOW_NOISE = 0.05  # of a ratio of means over a minute: sheet 5, section 6


class Report(NamedTuple):
    """An estimate without its time and address."""

    value: float
    std: float
    probability: float
    status: Status
    reasons: tuple[Reason, ...]
    detectable: float = NAN
    evidence: Evidence = ()


def nothing(reasons: list[Reason], probability: float = NAN) -> Report:
    """Return what is said of a rotor that cannot be seen."""
    return Report(NAN, NAN, probability, Status.UNOBSERVABLE, tuple(reasons))


def normal_cdf(z: float) -> float:
    """Return P(x < z) of a standard normal x."""
    return 0.5 * math.erfc(-z / math.sqrt(2.0))


# -- paper ------------------------------------------------------------------------------------------


def report_paper(core: PaperObserver, rotor: int, quantity: Quantity, reasons: list[Reason]) -> Report:
    """Report one rotor in paper mode: eta^, of which drag is the same figure. `reasons` = what is missing."""
    if not reasons and core.model is None:
        reasons = [Reason.MOTOR_CONSTANTS_UNKNOWN]
    if reasons:
        return nothing(reasons)
    eta, spread = core.value(rotor)
    t = core.inputs[rotor].t
    if not core.level.airborne or core.inputs[rotor].speed < core.level.config.turning * core.level.value:
        reason = Reason.ROTORS_BELOW_HOVER if core.level.airborne else Reason.ON_GROUND
        return nothing([reason], 0.95 if core.lost[rotor] and quantity is Quantity.EFFECTIVENESS else NAN)
    settled = core.level.judged(t)
    status = Status.VALID if settled else Status.CONVERGING
    why = () if settled else (Reason.SETTLING,)
    evidence = (("rule", "paper"), ("spread", spread))
    if quantity is Quantity.DRAG:  # the thesis makes no verdict of it
        return Report(eta, spread, NAN, status, why, NAN, evidence)
    probability = min(normal_cdf((core.config.lost - eta) / max(spread, 1e-3)), UNDECIDED)
    if core.lost[rotor]:
        probability = 0.95
    needed = 1.0 - core.config.lost
    return Report(eta, spread, probability, status, why, needed, evidence)


# -- recommended ------------------------------------------------------------------------------------


def report_recommended(
    core: RecommendedObserver,
    t: float,
    rotor: int,
    quantity: Quantity,
    reasons: list[Reason],
    currents: Evidence,
) -> Report:
    """Report one rotor at t [s]. `reasons` = which of its inputs are missing; `currents` = what is known of them."""
    if reasons:
        return nothing(reasons)
    if core.undriven.undriven[rotor]:
        probability = NOT_DRIVEN if quantity is Quantity.EFFECTIVENESS else NAN
        given = core.inputs[rotor]
        evidence: Evidence = (
            ("rule", "motor_not_driven"),
            ("speed_over_level", given.speed / core.level.value if core.level.value else NAN),
            ("current", given.current),
        )
        reason = (Reason.MOTOR_NOT_DRIVEN,)
        return Report(NAN, NAN, probability, Status.UNOBSERVABLE, reason, NAN, evidence)
    if not core.level.airborne:
        return nothing([Reason.ON_GROUND])
    if quantity is Quantity.EFFECTIVENESS:
        return _effectiveness(core, t, rotor, currents)
    return _drag(core, rotor, currents)


def refused(core: RecommendedObserver, rotor: int) -> list[Reason]:
    """Return what keeps the balance of a rotor from being made: its current, its rate."""
    reasons = []
    if core.measured_on is None:
        reasons.append(Reason.CURRENT_SIDE_UNKNOWN)
    elif core.contradicted:
        reasons.append(Reason.CURRENT_SIDE_CONTRADICTED)
    elif core.measured_on == "battery" and not core.convertible:
        reasons.append(Reason.CURRENT_OF_BATTERY)
    if core.inputs[rotor].interval > core.config.slowest:
        reasons.append(Reason.RATE_TOO_LOW)
    return reasons


def currents_evidence(core: RecommendedObserver) -> Evidence:
    """Return what is known of the currents."""
    timing = core.timing.decided
    found: list[tuple[str, float | str]] = [("current_side", core.measured_on or "unknown")]
    if core.side.exponent == core.side.exponent:
        found += [("exponent", core.side.exponent), ("exponent_std", core.side.error)]
    if core.witness:
        found.append(("battery_sensor_says", core.witness))
    if timing is not None:
        kind = "mean" if timing.mean else "lag" if timing.lag else "moment"
        found += [("current_timing", kind), ("current_lag_s", timing.lag)]
    return tuple(found)


def _effectiveness(core: RecommendedObserver, t: float, rotor: int, evidence: Evidence) -> Report:
    balance = core.balances[rotor]
    reasons = refused(core, rotor)
    if reasons:
        return nothing(reasons)._replace(evidence=evidence)
    given = core.inputs[rotor]
    evidence = (
        ("rule", "lost_propeller"),
        ("llr", balance.llr),
        ("threshold", balance.threshold),
        ("baseline", balance.baseline),
        ("noise_scale", balance.scale),
        *evidence,
    )
    probability = 1.0 / (1.0 + math.exp(min(balance.threshold - balance.llr - NINE_TO_ONE, 700.0)))
    probability = max(probability, DECIDED) if balance.lost else min(probability, UNDECIDED)
    if given.speed < core.level.config.turning * core.level.value:
        slow = nothing([Reason.ROTORS_BELOW_HOVER], probability if balance.lost else NAN)
        return slow._replace(evidence=evidence)
    if balance.constants.a != balance.constants.a:
        return nothing([Reason.MOTOR_CONSTANTS_UNKNOWN])._replace(status=Status.CONVERGING, evidence=evidence)
    reference = balance.reference if balance.reference == balance.reference else balance.baseline
    value, std = balance.eta / reference, math.sqrt(balance.variance) / reference
    settled = balance.reference == balance.reference and core.level.judged(t)
    return Report(
        value,
        std,
        probability,
        Status.VALID if settled else Status.CONVERGING,
        () if settled else (Reason.SETTLING,),
        balance.detectable(given.interval),
        evidence,
    )


def _drag(core: RecommendedObserver, rotor: int, evidence: Evidence) -> Report:
    by_minutes = core.by_minutes
    if not by_minutes:
        reasons = refused(core, rotor)
        if reasons:
            return nothing(reasons)._replace(evidence=evidence)
    c = core.ratio.config
    rho = core.ratio.ratio[rotor]
    if rho != rho:
        waiting = Report(NAN, NAN, NAN, Status.CONVERGING, (Reason.SETTLING,), NAN, evidence)
        return waiting._replace(reasons=(Reason.RATE_TOO_LOW,)) if by_minutes else waiting
    loss, rise = (c.slow_loss, c.slow_rise) if by_minutes else (c.loss, c.rise)
    balance = core.balances[rotor]
    std = SLOW_NOISE if by_minutes else math.sqrt(balance.slow_variance) / max(balance.reference, 0.1)
    verdict = core.ratio.verdict[rotor]
    outside = normal_cdf((loss - rho) / std) + normal_cdf((rho - rise) / std)
    probability = max(min(outside, 1.0), DECIDED) if verdict else min(outside, UNDECIDED)
    evidence = (("rule", verdict or "drag_ratio"), ("ratio", rho), *evidence)
    # the rise of this rotor's drag that would be found in nine cases of ten
    needed = max((rise + NINE_IN_TEN * std) / rho - 1.0, 0.0) if rho > 0.0 else NAN
    return Report(rho, std, probability, Status.VALID, (), needed, evidence)
