"""One posterior over kinds of fault for each rotor, from evidence of any subset of sources.

    odds of kind j against healthy = prior_j x product over sources of P(evidence | j) / P(evidence | healthy)

Sources are taken as independent given the kind; each one's ratio is bounded, so that no single source decides
against all others, and what a source said holds until it speaks again or its word has aged away. Where no source
that could see a loss of thrust has spoken lately the state is *unknown*, whatever the posterior: silence is no
health.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple

from gcs_health.fusion.kinds import FAILED, FAULTS, REPORTED, UNKNOWN, Kind
from gcs_health.samples import new_tuple

NAN = float("nan")
NOBODY = -1  # in place of a rotor: one of them, which one cannot be told
WORTH_TELLING = 0.1  # change of probability
SOURCES_ON_GROUND = frozenset({"esc_info"})  # sources that see as well after landing
BOUND = 12.0  # nats that one source may move a kind's odds

# prior odds against healthy, of one rotor at any moment: what maintenance records make plausible, and low enough that
# a single lukewarm source raises nothing
PRIOR_ODDS: dict[Kind, float] = {
    Kind.PROPELLER_LOST: 1e-4,
    Kind.THRUST_LOSS: 1e-4,
    Kind.MOTOR_STOPPED: 1e-4,
    Kind.MOTOR_STUCK: 3e-5,
    Kind.PROPELLER_SLIPPING: 1e-4,
    Kind.PROPELLER_UNBALANCED: 1e-3,
    Kind.DRAG_RISEN: 1e-3,
    Kind.ESC_TELEMETRY_LOST: 1e-3,
    Kind.ESC_FAULT_REPORTED: 1e-4,
    Kind.ESC_OVERHEATING: 1e-4,
    Kind.ESC_MISATTRIBUTED: 1e-4,
    Kind.MOTOR_ORDER_WRONG: 1e-4,
}

_PRIOR: dict[Kind, float] = {Kind.HEALTHY: 1.0, **{kind: PRIOR_ODDS[kind] for kind in FAULTS}}


Odds = tuple[tuple[Kind, float], ...]


class Evidence(NamedTuple):
    """What one source says of one rotor now; it replaces what the source said before.

    Attributes
    ----------
    t : vehicle clock [s]. lasts : for so long it holds [s]; infinite = for the flight.
    source : who says so: an estimator's name, "esc", "command" ...
    odds : log likelihood ratio against healthy by kind [nats]; kinds left out are as likely as healthy.
    sees_thrust : whether this source would have seen a loss of thrust.
    figures : the numbers behind it, for the alert.
    """

    t: float
    rotor: int
    source: str
    odds: Odds
    sees_thrust: bool = False
    lasts: float = 1.0
    figures: tuple[tuple[str, float | str], ...] = ()


class Verdict(NamedTuple):
    """What is believed of one rotor at one time.

    Attributes
    ----------
    kind : the likeliest; HEALTHY too where `known` is False.
    probability : of `kind`.
    weights : of every kind, healthy first: odds against healthy. total : their sum.
    known : whether a source that sees a loss of thrust has spoken lately.
    since : when `kind` became the likeliest [s].
    evidence : what it rests on.
    """

    t: float
    rotor: int
    kind: Kind
    probability: float
    weights: dict[Kind, float]
    total: float
    known: bool
    since: float
    evidence: tuple[Evidence, ...]

    @property
    def state(self) -> str:
        """The kind in words; "unknown" where nothing speaks against health because nothing speaks at all."""
        return UNKNOWN if self.kind is Kind.HEALTHY and not self.known else self.kind.value

    @property
    def posterior(self) -> tuple[tuple[Kind, float], ...]:
        """Probability of every kind, healthy first."""
        return tuple((kind, weight / self.total) for kind, weight in self.weights.items())

    @property
    def healthy(self) -> float:
        """Probability that nothing is wrong."""
        return self.weights[Kind.HEALTHY] / self.total

    @property
    def sources(self) -> tuple[str, ...]:
        """Who moved it, the strongest first."""
        moved = [each for each in self.evidence if each.odds]
        moved.sort(key=lambda each: -max(abs(ratio) for _, ratio in each.odds))
        return tuple(each.source for each in moved)

    def differs(self, before: "Verdict") -> bool:
        """Whether it is worth telling after the one before."""
        if abs(before.probability - self.probability) >= WORTH_TELLING:
            return True
        return (self.kind, self.known) != (before.kind, before.known) and self.state != before.state

    def of(self, kinds: Iterable[Kind]) -> float:
        """Return the probability that the rotor is in any of these states; reports of ESCs stand beside the rest."""
        wanted = frozenset(kinds)
        sought = sum(weight for kind, weight in self.weights.items() if kind in wanted)
        if wanted <= REPORTED:
            return sought / (sought + self.weights[Kind.HEALTHY])
        return sought / (self.total - sum(self.weights[kind] for kind in REPORTED - wanted))

    @property
    def failed(self) -> float:
        """Probability that the rotor no longer gives its thrust."""
        return self.of(FAILED)


class RotorBelief:
    """Evidence of one rotor to its verdict."""

    def __init__(self, rotor: int) -> None:
        self.rotor = rotor
        self._evidence: dict[str, Evidence] = {}
        self._kind = Kind.HEALTHY
        self._since = NAN
        self._odds: list[Odds] = []  # all that was said at the last verdict, and what followed from it
        self._weights, self._total, self._likeliest = _PRIOR, sum(_PRIOR.values()), Kind.HEALTHY

    def feed(self, evidence: Evidence) -> None:
        """Take what a source says now."""
        self._evidence[evidence.source] = evidence

    def figures(self) -> tuple[tuple[str, float | str], ...]:
        """Return the numbers behind what was said, source by source."""
        return tuple(
            (f"{source}.{name}", value)
            for source, evidence in self._evidence.items()
            for name, value in evidence.figures
        )

    def verdict(self, t: float) -> Verdict:
        """Return the posterior at vehicle time `t` [s]."""
        live = tuple([evidence for evidence in self._evidence.values() if t - evidence.t <= evidence.lasts])
        odds = [evidence.odds for evidence in live]
        if odds != self._odds:  # sources mostly repeat themselves
            self._odds = odds
            self._weigh(odds)
        known = any([evidence.sees_thrust for evidence in live])
        weights, total, kind = self._weights, self._total, self._likeliest
        if kind is not self._kind or self._since != self._since:
            self._kind, self._since = kind, t
        head = t, self.rotor, kind, weights[kind] / total
        return new_tuple(Verdict, (*head, weights, total, known, self._since, live))

    def _weigh(self, said: list[Odds]) -> None:
        weights = _PRIOR.copy()
        for odds in said:
            for kind, ratio in odds:
                if ratio:
                    weights[kind] *= math.exp(
                        ratio if -BOUND < ratio < BOUND else math.copysign(BOUND, ratio)
                    )
        self._weights, self._total = weights, sum(weights.values())
        self._likeliest = max(weights, key=weights.__getitem__)

    def land(self, t: float) -> None:
        """Hold what is said at the end of a flight, for and against alike: none of it must lapse before the rest.

        Nothing looks at thrust any more: what was healthy is unknown.
        """
        for source, said in list(self._evidence.items()):
            if source in SOURCES_ON_GROUND:
                continue
            if t - said.t > said.lasts:
                del self._evidence[source]
            else:
                self._evidence[source] = said._replace(lasts=math.inf, sees_thrust=False)

    def take_off(self) -> None:
        """Forget what was held since the landing."""
        self._evidence = {
            source: said for source, said in self._evidence.items() if source in SOURCES_ON_GROUND
        }

    def new_flight(self) -> None:
        """Forget what was held for the flight."""
        self._evidence.clear()
        self._kind, self._since = Kind.HEALTHY, NAN
