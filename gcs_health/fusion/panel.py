"""All rotors of one vehicle: evidence in, verdicts and alerts out."""

import math
from collections.abc import Iterable

from gcs_health.airframe import Airframe
from gcs_health.estimators.contract import Estimate, Reason
from gcs_health.fusion.alerts import Alert, AlertDesk
from gcs_health.fusion.autopilot_words import AutopilotWord, Opinion
from gcs_health.fusion.evidence import esc_info, esc_state, from_estimate
from gcs_health.fusion.kinds import FAILED, Kind
from gcs_health.fusion.rules import Rules
from gcs_health.fusion.verdicts import RotorBelief, Verdict
from gcs_health.rotor_telemetry import RotorState, RotorTelemetry
from gcs_health.samples import EscInfo

LIVE = (RotorState.FRESH, RotorState.STOPPED)
AGREE_WITHIN = 10.0  # s between the autopilot's word and ours that are of the same event

# what each of the autopilot's words could be of
MEANS: dict[Opinion, frozenset[Kind]] = {
    Opinion.THRUST_LOSS: FAILED,
    Opinion.MOTOR_FAILURE: FAILED,
    Opinion.MOTOR_STALL: FAILED,
    Opinion.UNDERCURRENT: FAILED,
    Opinion.OVERCURRENT: frozenset({Kind.DRAG_RISEN, Kind.MOTOR_STUCK}),
    Opinion.OVERHEATING: frozenset({Kind.ESC_OVERHEATING}),
    Opinion.ESC_FAILURE: frozenset({Kind.ESC_FAULT_REPORTED}),
    Opinion.ESC_OFFLINE: frozenset({Kind.ESC_TELEMETRY_LOST}),
    Opinion.UNBALANCE: frozenset({Kind.PROPELLER_UNBALANCED}),
    Opinion.YAW_IMBALANCE: FAILED,
    Opinion.CRASH: frozenset(),
}


class RotorPanel:
    """Beliefs and alerts of one vehicle's rotors.

    Parameters
    ----------
    count : alert episodes that went before, under another airframe.
    rules : of the alerts; None = the catalogue's.
    """

    def __init__(self, airframe: Airframe, count: int = 0, rules: Rules | None = None) -> None:
        self._airframe = airframe
        self._beliefs = [RotorBelief(k) for k in range(len(airframe.rotors))]
        self._desk = AlertDesk(airframe, count, rules)
        self._rotor_of_esc = {rotor.esc: k for k, rotor in enumerate(airframe.rotors)}
        self._errors: dict[int, tuple[float, int]] = {}  # time and error count by ESC
        self._judged: list[Verdict] = []
        self._crashed = False

    @property
    def count(self) -> int:
        """Alert episodes so far."""
        return self._desk.count

    @property
    def verdicts(self) -> list[Verdict]:
        """The last verdict of every rotor; empty before the first."""
        return self._judged

    def feed(self, estimates: Iterable[Estimate]) -> list[Alert]:
        """Take estimates; return what follows at once of the rotors whose failure some of them name."""
        told: list[Alert] = []
        for estimate in estimates:
            evidence = from_estimate(estimate)
            if evidence is None:
                continue
            self._beliefs[estimate.rotor].feed(evidence)
            named = estimate.failure_probability > 0.9 or Reason.MOTOR_STOPPED in estimate.reasons
            if named and evidence.sees_thrust:
                told += self._judge(estimate.rotor, estimate.t)
        return told

    def esc_info(self, t: float, info: EscInfo) -> None:
        """Take the ESCs' own reports."""
        for slot in range(4):
            esc = info.index + slot
            rotor = self._rotor_of_esc.get(esc)
            if rotor is None or (info.count and esc >= info.count):
                continue
            before, count = self._errors.get(esc, (t, info.error_count[slot]))
            rate = (info.error_count[slot] - count) / (t - before) if t > before else 0.0
            self._errors[esc] = (t, info.error_count[slot])
            self._beliefs[rotor].feed(esc_info(t, rotor, slot, info, max(rate, 0.0)))

    def routine(self, t: float, telemetry: RotorTelemetry, in_flight: bool) -> list[Alert]:
        """Judge every rotor at vehicle time `t` [s]."""
        states = [telemetry.state(rotor.esc, t) for rotor in self._airframe.rotors]
        for k, state in enumerate(states):
            others = any(other in LIVE for j, other in enumerate(states) if j != k)
            evidence = esc_state(t, k, state, others, in_flight)
            if evidence is not None:
                self._beliefs[k].feed(evidence)
        self._judged = [belief.verdict(t) for belief in self._beliefs]
        told: list[Alert] = []
        for belief, verdict in zip(self._beliefs, self._judged, strict=True):
            if self._desk.concerned(verdict):
                told += self._desk.feed(verdict, belief.figures())
        return told

    def relation(self, word: AutopilotWord) -> str:
        """Say how the autopilot's word stands to our verdicts: "agrees", "alone" or "contradicts"."""
        kinds = MEANS[word.opinion]
        if not kinds or not self._judged:
            return "alone"
        believed = {self._airframe.rotors[v.rotor].motor for v in self._judged if v.of(kinds) > 0.5}
        if not believed:
            return "alone"
        if word.motors and not believed & set(word.motors):
            return "contradicts"
        return "agrees"

    def set_rules(self, rules: Rules) -> None:
        """Go on under these rules of the alerts."""
        self._desk.set_rules(rules)

    def new_flight(self, t: float) -> list[Alert]:
        """Forget what held for the flight before."""
        for belief in self._beliefs:
            belief.new_flight()
        return self._desk.new_flight(t)

    def acknowledge(self, number: int, t: float) -> list[Alert]:
        """Pass on the operator's acknowledgement."""
        return self._desk.acknowledge(number, t)

    def shelve(self, number: int, t: float, until: float = math.inf) -> list[Alert]:
        """Pass on that the operator wants silence on an episode."""
        return self._desk.shelve(number, t, until)

    def _judge(self, rotor: int, t: float) -> list[Alert]:
        belief = self._beliefs[rotor]
        return self._desk.feed(belief.verdict(t), belief.figures())
