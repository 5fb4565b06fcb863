"""What each path, vibration or speeds, answers about one rotor, in one form.

A path's `anywhere` is the probability that some rotor is degraded, by its own calibrated threshold: .9 there,
and the odds go with the square of how rare the value is in healthy flight. It is shared among the rotors that
cannot be told apart; those that are told apart from it keep what is left.
"""

import math
from typing import NamedTuple

from gcs_health.estimators.contract import Reason
from gcs_health.estimators.pooled_ar_model import PooledModel
from gcs_health.estimators.pooled_ar_watch import ModelWatch, Verdict
from gcs_health.estimators.speed_deficit import SpeedDeficit, SpeedView

NAN = float("nan")
ODDS = 9.0  # at the threshold: a probability of .9
UNDECIDED = 0.5  # highest probability from a path that may not decide
POWER = 1.64  # a fault is seen in 95 % of windows when it exceeds the threshold by so many sigmas


class Answer(NamedTuple):
    """One path on one rotor.

    source : "vibration", "speed" or "command". k, std : as in an estimate, k not clipped. probability : that this
    rotor has failed. anywhere : that some rotor has. candidates : rotors that it may be. valid : fit to be told.
    """

    source: str
    k: float
    std: float
    probability: float
    anywhere: float
    detectable: float
    candidates: tuple[int, ...]
    reasons: tuple[Reason, ...]
    valid: bool


class ModelAlarm:
    """Keeps a model's alarm for as long as its windows overlap: one event."""

    def __init__(self, hold: float) -> None:
        self.hold = hold
        self._when = -math.inf
        self._k = NAN

    def update(self, watch: ModelWatch) -> None:
        """Take a new verdict."""
        verdict = watch.verdict
        if verdict is None or verdict.blind:
            return
        k = max(view.k_alarm for view in verdict.views.values())
        if k > watch.model.threshold and (verdict.t - self._when > self.hold or k >= self._k):
            self._when, self._k = verdict.t, k

    def largest(self, verdict: Verdict) -> float:
        """Return the k by which the alarm is judged now."""
        now = max(view.k_alarm for view in verdict.views.values())
        return max(now, self._k) if verdict.t - self._when <= self.hold else now


def by_vibration(
    watch: ModelWatch, alarm: ModelAlarm, rotor: int, alike: tuple[tuple[int, ...], ...]
) -> Answer | None:
    """Return what a model says; None where it has no model of the rotor nor of one that looks like it."""
    verdict, model = watch.verdict, watch.model
    trained = [one for one in alike[rotor] if verdict is not None and one in verdict.views]
    if verdict is None or not trained:
        return None
    view = verdict.views[rotor if rotor in trained else trained[0]]
    anywhere = probability(rarity(model, alarm.largest(verdict)) - rarity(model, model.threshold))
    # a rotor whose own model sees nothing is no suspect; among the others the smallest residual names
    suspects = [one for one, other in verdict.views.items() if other.k_alarm > model.threshold]
    separates = verdict.lead >= watch.config.margin and model.names >= watch.config.names
    if separates and (verdict.best in suspects or not suspects):
        suspects = [verdict.best]
    candidates = tuple(dict.fromkeys(one for group in suspects or verdict.views for one in alike[group]))
    reasons = list(verdict.refused)
    if len(candidates) > 1:
        reasons.append(Reason.OPPOSITE_ALIKE)
    seen = model.threshold + POWER * view.std_alarm
    return Answer(
        "vibration",
        view.k,
        view.std,
        shared(anywhere, rotor, candidates),
        anywhere,
        seen if seen <= 1.0 else NAN,
        candidates,
        tuple(reasons),
        not verdict.refused,
    )


def by_speeds(speeds: SpeedDeficit, rotor: int, view: SpeedView) -> Answer:
    """Return what the rotor's speed says."""
    excess = view.k_fast * abs(view.k_fast) - view.threshold**2
    anywhere = probability(
        0.25 * excess / view.std_fast**2
    )  # half of the Gaussian's own log likelihood ratio
    if not view.decides or (view.by_command and rotor != speeds.worst):
        anywhere = min(anywhere, UNDECIDED)
    candidates = (rotor,) if view.by_command else speeds.span.alike[rotor]
    if speeds.named in candidates:
        candidates = (speeds.named,)
    reasons: tuple[Reason, ...] = () if view.settled else (Reason.SHARE_UNKNOWN,)
    if len(candidates) > 1:
        reasons += (Reason.OPPOSITE_ALIKE,)
    seen = view.threshold + POWER * view.std_fast
    return Answer(
        "command" if view.by_command else "speed",
        view.k,
        view.std,
        shared(anywhere, rotor, candidates),
        anywhere,
        seen if view.decides and seen <= 1.0 else NAN,
        candidates,
        reasons,
        view.settled or speeds.trained,
    )


def shared(anywhere: float, rotor: int, candidates: tuple[int, ...]) -> float:
    """Return the rotor's part of a probability that some rotor has failed."""
    if rotor in candidates:
        return anywhere / len(candidates)
    return min(anywhere, 1.0 - anywhere)


def probability(excess: float) -> float:
    """Return 9 exp(2 excess) as a probability; excess = log rarity beyond the threshold's."""
    return 1.0 / (1.0 + math.exp(-min(max(2.0 * excess, -600.0), 600.0)) / ODDS)


def rarity(model: PooledModel, k: float) -> float:
    """Return -log of how often 10 s of healthy flight pass k, by the model's Gumbel law."""
    location, scale = model.tail
    z = (k - location) / scale
    if z > 30.0:
        return z
    return -math.log(-math.expm1(-math.exp(-max(z, -6.0))))
