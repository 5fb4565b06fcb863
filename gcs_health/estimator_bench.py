"""The estimators of one vehicle, side by side: who is fed what, and what each has said at its worst."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from gcs_health.airframe import Airframe
from gcs_health.errors import AirframeError
from gcs_health.estimators import load
from gcs_health.estimators.contract import Estimate, Estimator, Status
from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.samples import Reading

Key = tuple[str, str, int]  # estimator, quantity, rotor


class EstimatorBench:
    """Estimators by registry name on one airframe.

    Parameters
    ----------
    names : of the registry.
    mode : "recommended" or "paper".
    settings : further ones of an estimator, by its name.

    Attributes
    ----------
    refused : why an estimator cannot work on this airframe, by its name.
    worst : the estimate nearest to a failure that was seen.
    effectiveness : the effectiveness estimator, if it is among them.

    Raises
    ------
    AirframeError : none of them can work on this airframe.
    """

    def __init__(
        self,
        airframe: Airframe,
        names: tuple[str, ...],
        mode: str,
        settings: Mapping[str, Mapping[str, Any]] | None = None,
    ) -> None:
        self.refused: dict[str, str] = {}
        self.worst: dict[Key, Estimate] = {}
        self._all: list[Estimator] = []
        for name in names:
            try:
                self._all.append(load(name, airframe, mode, **(settings or {}).get(name, {})))
            except AirframeError as error:
                self.refused[name] = str(error)
        if not self._all and self.refused:
            raise AirframeError(next(iter(self.refused.values())))
        found = (each for each in self._all if isinstance(each, EffectivenessEstimator))
        self.effectiveness: EffectivenessEstimator | None = next(found, None)
        self._feeds: dict[type, list[Callable[[Reading], Iterable[Estimate]]]] = {}  # of those who take it

    def feed(self, reading: Reading) -> list[Estimate]:
        """Hand a reading to those who take it; return estimates about whose rotor a decision changed."""
        kind = type(reading)
        feeds = self._feeds.get(kind)
        if feeds is None:
            feeds = self._feeds[kind] = [each.feed for each in self._all if kind in each.takes]
        all_said: list[Estimate] = []
        for feed in feeds:
            said = feed(reading)
            if said:
                all_said += said
        if all_said:
            self._note(all_said)
        return all_said

    def estimates(self, t: float) -> list[Estimate]:
        """Return the present state of every rotor, estimator by estimator, at vehicle time `t` [s]."""
        return [estimate for estimator in self._all for estimate in estimator.estimates(t)]

    def routine(self, t: float) -> list[Estimate]:
        """Do as `estimates`, and keep the worst."""
        said = self.estimates(t)
        self._note(said)
        return said

    def reset(self) -> None:
        """Forget what was learned in flight; what was worst stays."""
        for estimator in self._all:
            estimator.reset()

    def _note(self, estimates: Iterable[Estimate]) -> None:
        for estimate in estimates:
            key = (estimate.estimator, estimate.quantity, estimate.rotor)
            worst = self.worst.get(key)
            if worst is None:
                self.worst[key] = estimate
                continue
            # most are far from the worst, or the same again: a comparison spares them the rest
            p, most = estimate.failure_probability, worst.failure_probability
            if p < most or (p == most and estimate.status is worst.status):
                continue
            if _badness(estimate) > _badness(worst):
                self.worst[key] = estimate


def _badness(estimate: Estimate) -> tuple[float, int]:
    """Order for "worst": the likeliest failure, then the estimate, then anything but unknown."""
    p = estimate.failure_probability
    return (p, estimate.status is Status.VALID) if p == p else (-1.0, 0)
