"""Alerts: verdicts in, one episode per rotor and cause out; raised once, escalated, cleared when the reason is gone.

    raised      the probability of a fault has been at or above the code's `raise_at` for its `hold`
    escalated   the kind has become clear, or a graver one: the same episode under another code
    updated     the kind is the same, but how sure has changed much
    acknowledged, shelved      by the operator; a shelved one is silent until its time is over or it is escalated
    cleared     below `clear_at` for `clear_after`; a latched code only with the next flight

One alarm a cause: after a rotor has failed, what follows in the others (idling partners, contact, the crash) is not
told as faults of their own; two exchanged rotors are one alarm; telemetry that all rotors lose at once is one
link's fault, told once. A fault of one of the rotors, none of which can be named, is one episode of no rotor; once
one is named, the episode is that rotor's. After the flight nothing new is told but what ESCs report.
"""

import math
from dataclasses import dataclass

from gcs_health.airframe import Airframe, Rotor
from gcs_health.balance import amount
from gcs_health.fusion.alert_table import ROTOR_FAILED, AlertKind
from gcs_health.fusion.kinds import FAILED, FAULTS, Kind
from gcs_health.fusion.rules import Rules
from gcs_health.fusion.verdicts import NOBODY, Verdict

CLEAR_KIND = 0.8  # share of the failed kinds' probability at which one of them is clear
MUCH = 0.2  # change of probability worth an update
UPDATE_EVERY = 5.0  # s, at most so often
KIND_HOLDS = 0.3  # s that a kind must be clear before it replaces one as grave that was told


@dataclass(frozen=True, slots=True)
class Alert:
    """One step of an episode.

    Attributes
    ----------
    t : vehicle clock [s] of the datum that caused it.
    number : the episode's number within its vehicle, from 1; all its steps share it.
    state : "raised", "escalated", "updated", "acknowledged", "shelved" or "cleared".
    rotor : the rotor concerned; None = one of them, which one cannot be told.
    probability : of the fault, 0..1.
    """

    t: float
    number: int
    state: str
    kind: AlertKind
    rotor: Rotor | None
    probability: float
    text: str
    evidence: tuple[tuple[str, float | str], ...]


@dataclass(slots=True)
class _Episode:
    number: int
    rotor: int
    family: frozenset[Kind]  # the kinds that it may turn out to be
    row: AlertKind
    told: float  # probability last told
    told_t: float
    worst: float
    raised: float  # when [s]
    calm_since: float | None = None
    turns_to: AlertKind | None = None  # another kind that has become clear
    turns_since: float = math.nan  # [s]
    acknowledged: bool = False
    shelved_until: float = float("-inf")


class AlertDesk:
    """The alert machine of one vehicle."""

    def __init__(self, airframe: Airframe, count: int = 0, rules: Rules | None = None) -> None:
        """`count` episodes went before, under another airframe."""
        self._airframe = airframe
        self.set_rules(rules or Rules())
        self._open: dict[tuple[int, frozenset[Kind]], _Episode] = {}
        self._waiting: dict[int, dict[Kind, float]] = {}  # since when, by rotor and family
        self.landed = False  # a flight is over: what is told of it was told in it
        self.count = count

    @property
    def failed(self) -> int | None:
        """The rotor that was told first to have failed, None where none has."""
        for each in self._open.values():  # asked with every rotor reading, and mostly none is open
            if each.family is FAILED_FAMILY:
                return each.rotor
        return None

    @property
    def failed_at(self) -> float:
        """When that was [s]; NaN where none has."""
        return next((each.raised for each in self._open.values() if each.family is FAILED_FAMILY), math.nan)

    @property
    def proven(self) -> bool:
        """Whether the current or speed of a rotor proves that it failed."""
        return any(each.row.proven for each in self._open.values())

    def set_rules(self, rules: Rules) -> None:
        """Go on under these rules; what is open stays so until they clear it."""
        self._rules = rules
        self._surely_well = 1.0 - rules.least  # no code's `raise_at` can be reached beside so much health

    def concerned(self, verdict: Verdict) -> bool:
        """Whether a verdict could change anything: mostly the rotor is healthy, and nothing is open or waiting."""
        return (
            verdict.healthy <= self._surely_well or bool(self._open) or bool(self._waiting.get(verdict.rotor))
        )

    def feed(self, verdict: Verdict, evidence: tuple[tuple[str, float | str], ...] = ()) -> list[Alert]:
        """Take one rotor's verdict; return what the operator must be told because of it."""
        told = []
        for family in FAMILIES_ON_GROUND if self.landed else FAMILIES:
            probability = verdict.of(family)
            episode = self._open.get((verdict.rotor, family))
            if episode is None:
                alert = self._raise(verdict, family, probability, evidence)
            else:
                alert = self._go_on(verdict, episode, probability, evidence)
            if alert is not None:
                told.append(alert)
        return told

    def acknowledge(self, number: int, t: float) -> list[Alert]:
        """The operator has seen the episode of this number."""
        told = []
        for episode in self._numbered(number):
            if not episode.acknowledged:
                episode.acknowledged = True
                told.append(self._step(t, episode, "acknowledged", episode.told, ()))
        return told

    def shelve(self, number: int, t: float, until: float) -> list[Alert]:
        """The operator does not want to hear of this episode until then, unless it gets graver."""
        told = []
        for episode in self._numbered(number):
            episode.shelved_until = until
            told.append(self._step(t, episode, "shelved", episode.told, ()))
        return told

    def new_flight(self, t: float) -> list[Alert]:
        """Clear what was latched for the flight before."""
        told = [self._step(t, episode, "cleared", 0.0, ()) for episode in self._open.values()]
        self._open.clear()
        self._waiting.clear()
        self.landed = False
        return told

    def _numbered(self, number: int) -> list[_Episode]:
        return [episode for episode in self._open.values() if episode.number == number]

    def _raise(
        self,
        verdict: Verdict,
        family: frozenset[Kind],
        probability: float,
        evidence: tuple[tuple[str, float | str], ...],
    ) -> Alert | None:
        row = self._row(verdict, family)
        if row is None:
            return None
        waiting = self._waiting.setdefault(verdict.rotor, {})
        key = min(family)
        if probability < row.raise_at or self._explained(verdict.rotor, family):
            waiting.pop(key, None)
            if not waiting:
                self._waiting.pop(verdict.rotor, None)
            return None
        before = self._mistaken(verdict.rotor, family)
        if before is None and verdict.t - waiting.setdefault(key, verdict.t) < row.hold:
            return None
        waiting.pop(key, None)
        if not waiting:
            del self._waiting[verdict.rotor]
        if before is not None:
            before.rotor, before.family, before.row = verdict.rotor, family, row
            before.calm_since, before.shelved_until = None, float("-inf")
            self._open[verdict.rotor, family] = before
            return self._tell(verdict.t, before, "escalated", probability, evidence)
        self.count += 1
        episode = _Episode(
            self.count, verdict.rotor, family, row, probability, verdict.t, probability, verdict.t
        )
        self._open[verdict.rotor, family] = episode
        return self._step(verdict.t, episode, "raised", probability, evidence)

    def _mistaken(self, rotor: int, family: frozenset[Kind]) -> _Episode | None:
        """Take out the open episode that this one turns out to be: of no rotor, or of one that seemed to fail."""
        unnamed = self._open.pop((NOBODY, family), None)
        failed = self._open.get((rotor, FAILED_FAMILY))
        if unnamed is None and family in _EXCHANGED and failed is not None and not failed.row.proven:
            return self._open.pop((rotor, FAILED_FAMILY))
        return unnamed

    def _row(self, verdict: Verdict, family: frozenset[Kind]) -> AlertKind | None:
        """Return the code of the family's likeliest kind, or "failed" while unclear; None = not told."""
        if len(family) == 1:
            return self._rules.row(next(iter(family)))
        kind = max((kind for kind in verdict.weights if kind in family), key=verdict.weights.__getitem__)
        clear = verdict.weights[kind] >= CLEAR_KIND * verdict.total * verdict.of(family)
        return self._rules.row(kind) if clear else self._rules.failed

    def _explained(self, rotor: int, family: frozenset[Kind]) -> bool:
        """Whether another rotor's failure is cause enough for what this one shows."""
        if rotor == NOBODY and any(each.family == family for each in self._open.values()):
            return True
        if (
            family in _EXCHANGED
        ):  # two rotors, one cause: whichever is seen first; or a rotor that has failed indeed
            return self.proven or any(
                each.rotor != rotor and each.family == family for each in self._open.values()
            )
        return family != TELEMETRY and any(
            each.rotor != rotor and each.family is FAILED_FAMILY for each in self._open.values()
        )

    def _go_on(
        self,
        verdict: Verdict,
        episode: _Episode,
        probability: float,
        evidence: tuple[tuple[str, float | str], ...],
    ) -> Alert | None:
        t = verdict.t
        episode.worst = max(episode.worst, probability)
        if probability <= episode.row.clear_at and verdict.known:
            return self._calm(t, episode, probability, evidence)
        episode.calm_since = None
        if probability < episode.row.raise_at:
            return None
        if self._turned(verdict, episode):
            episode.shelved_until = float("-inf")
            return self._tell(t, episode, "escalated", probability, evidence)
        if t < episode.shelved_until or t - episode.told_t < UPDATE_EVERY:
            return None
        if abs(probability - episode.told) >= MUCH:
            return self._tell(t, episode, "updated", probability, evidence)
        return None

    def _turned(self, verdict: Verdict, episode: _Episode) -> bool:
        """Whether the episode's kind has become clear, or another one: then it has its row now."""
        row = self._row(verdict, episode.family)
        if row is None or row.code in (episode.row.code, ROTOR_FAILED.code):
            episode.turns_to = None
            return False
        if row is not episode.turns_to:
            episode.turns_to, episode.turns_since = row, verdict.t
        graver = episode.row.code == ROTOR_FAILED.code or row.severity < episode.row.severity
        if not graver and verdict.t - episode.turns_since < KIND_HOLDS:
            return False  # kinds do not take turns
        episode.row, episode.turns_to = row, None
        return True

    def _calm(
        self, t: float, episode: _Episode, probability: float, evidence: tuple[tuple[str, float | str], ...]
    ) -> Alert | None:
        if episode.row.latched:
            return None
        if episode.calm_since is None:
            episode.calm_since = t
        if t - episode.calm_since < episode.row.clear_after:
            return None
        del self._open[episode.rotor, episode.family]
        return self._step(t, episode, "cleared", probability, evidence)

    def _tell(
        self,
        t: float,
        episode: _Episode,
        state: str,
        probability: float,
        evidence: tuple[tuple[str, float | str], ...],
    ) -> Alert:
        episode.told, episode.told_t = probability, t
        return self._step(t, episode, state, probability, evidence)

    def _step(
        self,
        t: float,
        episode: _Episode,
        state: str,
        probability: float,
        evidence: tuple[tuple[str, float | str], ...],
    ) -> Alert:
        row, named = episode.row, episode.rotor != NOBODY
        rotor = self._airframe.rotors[episode.rotor] if named else None
        seat = self._airframe.seat(episode.rotor) if named else ""
        belief = episode.told if state == "cleared" else probability
        size = amount(evidence, "unbalance.")
        text = (row.text if named else row.unnamed).format(
            motor=rotor.motor if rotor is not None else "",
            seat=seat,
            percent=min(99, int(100 * belief)),
            amount=f", {size}" if size else "",
        )
        if state == "cleared":
            text = f"motor {rotor.motor} ({seat}): {row.code} is over" if rotor else f"{row.code} is over"
        return Alert(t, episode.number, state, row, rotor, probability, text, evidence)


FAILED_FAMILY = FAILED
TELEMETRY = frozenset({Kind.ESC_TELEMETRY_LOST})
_EXCHANGED = (frozenset({Kind.ESC_MISATTRIBUTED}), frozenset({Kind.MOTOR_ORDER_WRONG}))
FAMILIES = (FAILED_FAMILY, *(frozenset({kind}) for kind in FAULTS if kind not in FAILED))
FAMILIES_ON_GROUND = (
    frozenset({Kind.ESC_FAULT_REPORTED}),
    frozenset({Kind.ESC_OVERHEATING}),
)  # seen as well after landing
