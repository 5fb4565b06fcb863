"""The effectiveness estimator's decisions in the words of the contract."""

import math
from statistics import NormalDist

from gcs_health.estimators.contract import Estimate, Quantity, Reason, Status
from gcs_health.estimators.effectiveness_paper import PaperFilter
from gcs_health.estimators.effectiveness_recommended import RecommendedBank
from gcs_health.samples import new_tuple

NAN = math.nan
STANDARD = NormalDist()
DAMAGED = 0.75  # k below which a rotor counts as damaged where no rule has spoken
UNDECIDED = 0.89  # highest failure probability while the rules are not satisfied

Evidence = tuple[tuple[str, float | str], ...]


def estimate(
    t: float,
    rotor: int,
    value: float,
    std: float,
    p: float,
    status: Status,
    reasons: list[Reason],
    detectable: float = NAN,
    evidence: Evidence = (),
) -> Estimate:
    """Return an estimate of effectiveness."""
    what = "effectiveness", rotor, Quantity.EFFECTIVENESS
    return new_tuple(Estimate, (t, *what, value, std, p, status, tuple(reasons), detectable, evidence))


def missing(t: float, rotor: int, reasons: list[Reason], warming: bool) -> Estimate:
    """Say what keeps a rotor from being judged; `warming` = it may still come."""
    return estimate(t, rotor, NAN, NAN, NAN, Status.CONVERGING if warming else Status.UNOBSERVABLE, reasons)


def probabilities(core: RecommendedBank, likelihoods: list[float]) -> list[float]:
    """Posterior of each single fault: the threshold LLR alone gives .9, less never more than .89."""
    threshold = core.config.bank.llr - math.log(9.0)
    weights = [math.exp(min(llr - threshold, 700.0)) for llr in likelihoods]
    total = 1.0 + sum(weights)
    return [min(weight / total, UNDECIDED) for weight in weights]


def healthy(
    core: RecommendedBank,
    t: float,
    rotor: int,
    reasons: list[Reason],
    probability: float,
    information: float,
    speed: float,
    warming: bool,
) -> Estimate:
    """Say how a rotor is while none has failed; `information` is D of the longest window."""
    if core.contradicted:
        return estimate(t, rotor, NAN, NAN, NAN, Status.DIVERGED, [Reason.GEOMETRY_CONTRADICTED, *reasons])
    if not reasons and core.gate.reason is not None:
        reasons = [Reason(core.gate.reason.value)]
    if reasons and reasons != [Reason.SETTLING]:
        return missing(t, rotor, reasons, warming)
    detectable = core.bank.detectable(information) if core.gate.verdicts else NAN
    value, std = core.slow.effectiveness(rotor), core.slow.std(rotor)
    evidence: Evidence = (("speed_over_hover", speed / core.hover), ("since_open_s", core.gate.since_open))
    partial = core.partial
    if partial.rotor is not None:  # one rotor explains what is seen: the others are as they were
        value, std = 1.0, partial.config.spread
        if rotor == partial.rotor:
            value, std = min(max(1.0 - partial.theta, 0.0), 1.5), partial.std
            damaged = STANDARD.cdf((DAMAGED - value) / std)
            probability = max(probability, min(damaged, UNDECIDED))
            evidence += (("rule", "partial_loss"), ("llr", partial.llr), ("theta", partial.theta))
    status = Status.CONVERGING if reasons else Status.VALID
    return estimate(t, rotor, value, std, probability, status, reasons, detectable, evidence)


def stopped(t: float, rotor: int, ratio: float) -> Estimate:
    """Say that a motor stopped, at this share of hover speed."""
    evidence: Evidence = (("rule", "motor_stopped"), ("speed_over_hover", ratio))
    return estimate(t, rotor, NAN, NAN, 0.99, Status.UNOBSERVABLE, [Reason.MOTOR_STOPPED], NAN, evidence)


def lost(core: RecommendedBank, t: float, rotor: int) -> Estimate:
    """Say that the bank names this rotor, and why."""
    verdict = core.verdict
    # odds of this fault against none (the threshold LLR alone gives .9) and against the next rotor's
    none = math.exp(min(core.config.bank.llr - math.log(9.0) - verdict.llr, 0.0))
    rival = math.exp(-max(verdict.lead, 0.0))
    evidence: Evidence = (
        ("rule", "single_fault_bank"),
        ("llr", verdict.llr),
        ("lead", verdict.lead),
        ("theta", verdict.theta),
        ("explained", verdict.share),
        ("chi2", verdict.chi2),
        ("window_s", verdict.ticks * core.tick_length),
        ("imu_step_s", core.blocks.step),
        ("rotor_speed_step_s", core.track.interval),
    )
    p = max(1.0 / (1.0 + none + rival), 0.9001)
    partial = core.partial
    # 1 / sqrt(D) knows noise alone, not what the model is wrong by
    theta, std = verdict.theta, math.hypot(verdict.std, partial.config.spread)
    if partial.rotor == rotor and theta + 2.0 * std < 1.0:  # not all is lost: a second tells better how much
        theta, std = partial.theta, partial.std
    value = min(max(1.0 - theta, 0.0), 1.5)
    return estimate(t, rotor, value, std, p, Status.VALID, [], NAN, evidence)


def of_paper(core: PaperFilter, t: float, rotor: int) -> Estimate:
    """Say what the paper's filter says."""
    std = core.std(rotor)
    if not core.armed:
        return estimate(t, rotor, core.x[rotor], std, NAN, Status.CONVERGING, [Reason.ON_GROUND])
    # P(k < k_thr) = p_threshold needs k = k_thr - 1.2816 sigma at .9
    needed = 1.0 - core.config.k_threshold + 1.2816 * std
    return estimate(
        t,
        rotor,
        core.x[rotor],
        std,
        core.failure_probability(rotor),
        Status.VALID,
        [],
        needed if needed <= 1.0 else NAN,
        (("rule", "paper"), ("sigma", std)),
    )
