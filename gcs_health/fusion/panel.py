"""All rotors of one vehicle: evidence in, verdicts and alerts out."""

import math
from collections.abc import Callable, Iterable

from gcs_health.airframe import Airframe
from gcs_health.estimators.contract import Estimate, Reason
from gcs_health.fusion.alerts import Alert, AlertDesk
from gcs_health.fusion.attribution import Attribution
from gcs_health.fusion.autopilot_words import AutopilotWord, Opinion
from gcs_health.fusion.battery import BatteryLoad
from gcs_health.fusion.commanded import Commanded
from gcs_health.fusion.evidence import EscHeat, esc_info, esc_state, from_estimate, partial_loss
from gcs_health.fusion.frozen import Frozen
from gcs_health.fusion.kinds import FAILED, Kind
from gcs_health.fusion.load import Load
from gcs_health.fusion.rules import Rules
from gcs_health.fusion.shared import SharedUnbalance
from gcs_health.fusion.verdicts import BOUND, Evidence, RotorBelief, Verdict
from gcs_health.rotor_telemetry import RotorState, RotorTelemetry
from gcs_health.samples import (
    BatteryReading,
    CommandReading,
    EscInfo,
    FlightReading,
    ImuReading,
    Reading,
    RotorReading,
)

LIVE = (RotorState.FRESH, RotorState.STOPPED)
DECIDES = 0.6  # s after a failure in which load and command tell its kind: then a quadrotor cuts its motors
PART_MISSES = 0.2  # s: so long times the part that is missing, a tenth for 2 s; benchmarks/partial_losses.md

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
        self._attribution = Attribution(airframe)
        self._commanded = Commanded(len(airframe.rotors))
        self._load = Load(len(airframe.rotors))
        self._battery = BatteryLoad(len(airframe.rotors))
        self._frozen = Frozen(len(airframe.rotors))
        self._shared = SharedUnbalance([rotor.motor for rotor in airframe.rotors])
        self._heat: dict[int, EscHeat] = {}  # by ESC
        self._flew = False
        self._part_since: dict[int, float] = {}  # since when a part of a rotor's thrust is missing

    @property
    def count(self) -> int:
        """Alert episodes so far."""
        return self._desk.count

    @property
    def verdicts(self) -> list[Verdict]:
        """The last verdict of every rotor; empty before the first."""
        return self._judged

    @property
    def sag(self) -> float:
        """Rotor speed for the same command, against early in the flight [-]; NaN = not known, or a rotor failed."""
        return self._commanded.sag() if self.failed is None else math.nan

    def read(self, reading: Reading, flies: Callable[[], bool]) -> list[Alert]:
        """Take what estimators take, for what is seen in the telemetry itself; return what follows at once.

        `flies` is asked only where it matters: whether the vehicle surely flies.
        """
        kind = type(reading)
        if kind is ImuReading:
            self._attribution.latest = reading  # type: ignore[assignment]
        elif kind is CommandReading:
            self._attribution.command(reading)  # type: ignore[arg-type]
            self._commanded.command(reading)  # type: ignore[arg-type]
        elif kind is RotorReading:
            self._battery.rotors(reading)  # type: ignore[arg-type]
            return self._rotors(reading, flies())  # type: ignore[arg-type]
        elif kind is BatteryReading:
            return self._of_battery(reading, flies)  # type: ignore[arg-type]
        elif kind is FlightReading:
            self._flight(reading)  # type: ignore[arg-type]
        return []

    def _flight(self, reading: FlightReading) -> None:
        """After a flight nothing new is raised from what was seen in it, however evidence lapses."""
        flies = reading.flies
        if flies is not self._desk.landed:
            self._flew = self._flew or flies
            return
        if not (flies or self._flew):  # it has not been in the air
            return
        self._desk.landed = not flies
        for belief in self._beliefs:
            if flies:
                belief.take_off()
            else:
                belief.land(reading.t)

    def _of_battery(self, reading: BatteryReading, flies: Callable[[], bool]) -> list[Alert]:
        failed = self.failed
        if failed is None:
            if flies():
                self._battery.learn(reading)
        elif not self._desk.landed and reading.t - self._desk.failed_at <= DECIDES:
            said = self._battery.follow(reading, failed)
            if said is not None:
                self._beliefs[failed].feed(said)
                return self._judge(failed, reading.t)
        return []

    def _rotors(self, reading: RotorReading, flies: bool) -> list[Alert]:
        if self._desk.landed:
            return []
        failed = self.failed
        said: list[Evidence] = self._commanded.rotors(reading, flies)
        for evidence in self._attribution.rotors(reading, flies and not self._desk.proven):
            self._beliefs[evidence.rotor].feed(evidence)
        if failed is None:
            if flies:
                self._load.learn(reading)
                self._frozen.rotors(reading)
        elif not reading.t - self._desk.failed_at <= DECIDES:
            return []
        else:
            load = self._load.follow(reading, failed)
            said = [each for each in said if each.rotor == failed] + ([load] if load is not None else [])
        told: list[Alert] = []
        for evidence in said:
            self._beliefs[evidence.rotor].feed(evidence)
            told += self._judge(evidence.rotor, evidence.t)
        return told

    @property
    def failed(self) -> int | None:
        """The rotor that was told to have failed, if any: what follows in the others is explained by it."""
        return self._desk.failed

    def feed(self, estimates: Iterable[Estimate]) -> list[Alert]:
        """Take estimates; return what follows at once of the rotors whose failure some of them name."""
        if self._desk.landed:
            return []
        told: list[Alert] = []
        unbalances: list[Estimate] = []
        for estimate in estimates:
            evidence = from_estimate(estimate)
            if estimate.estimator == "effectiveness":
                evidence = self._lasting(estimate, evidence)
            elif estimate.estimator == "unbalance":
                unbalances.append(estimate)
            if evidence is None:
                continue
            named = estimate.failure_probability > 0.9 or Reason.MOTOR_STOPPED in estimate.reasons
            if (named or self._part_since) and self._frozen.doubtful(estimate.t):
                continue  # one rotor's figures are old: the vehicle's turning accuses whichever fits
            self._beliefs[estimate.rotor].feed(evidence)
            if named and evidence.sees_thrust:
                told += self._judge(estimate.rotor, estimate.t)
        if unbalances:
            self._shared.feed(unbalances)
        return told

    def _lasting(self, estimate: Estimate, evidence: Evidence | None) -> Evidence | None:
        """A part of the thrust that has been missing for long is a fault, though no rule of total loss named it."""
        rotor = estimate.rotor
        if ("rule", "partial_loss") not in estimate.evidence or evidence is None:
            self._part_since.pop(rotor, None)
            return evidence
        missing = estimate.t - self._part_since.setdefault(rotor, estimate.t)
        lasts = missing * (1.0 - estimate.value) >= PART_MISSES
        return partial_loss(estimate, evidence) if lasts else evidence

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
            heat = self._heat.setdefault(esc, EscHeat())
            heat.feed(t, info.temperature_degc[slot])
            others = [each.level for k, each in self._heat.items() if k != esc]
            warm = sum(others) / len(others) if others else math.nan
            self._beliefs[rotor].feed(esc_info(t, rotor, slot, info, max(rate, 0.0), heat, warm))

    def routine(self, t: float, telemetry: RotorTelemetry, in_flight: bool) -> list[Alert]:
        """Judge every rotor at vehicle time `t` [s]."""
        states = [telemetry.state(rotor.esc, t) for rotor in self._airframe.rotors]
        alive = [state in LIVE for state in states]
        live = sum(alive)
        for k, state in enumerate(states):
            if in_flight and state is RotorState.FRESH and self._frozen.holds(k, t):
                state = RotorState.STALE  # what it repeats is old
            evidence = esc_state(t, k, state, live > alive[k], in_flight)
            if evidence is not None:
                self._beliefs[k].feed(evidence)
        if self.failed is not None:
            self._excuse(t)
        self._judged = [belief.verdict(t) for belief in self._beliefs]
        told: list[Alert] = []
        for belief, verdict in zip(self._beliefs, self._judged, strict=True):
            if self._desk.concerned(verdict):
                told += self._desk.feed(verdict, belief.figures())
        shared = self._shared.verdict(t)
        if shared is not None and self._desk.concerned(shared):
            told += self._desk.feed(shared, self._shared.figures())
        return told

    def _excuse(self, t: float) -> None:
        """A rotor that the controller switched off once another had failed stands still by order."""
        for k, belief in enumerate(self._beliefs):
            if k != self.failed and self._commanded.switched_off(k):
                odds = tuple((kind, -BOUND) for kind in FAILED)
                belief.feed(Evidence(t, k, "switched_off", odds))

    def relation(self, word: AutopilotWord) -> str:
        """Say how the autopilot's word stands to our verdicts: "agrees", "alone" or "contradicts"."""
        kinds = MEANS[word.opinion]
        if not kinds or not self._judged:
            return "alone"
        believed = {self._airframe.rotors[v.rotor].motor for v in self._judged if v.of(kinds) > 0.5}
        if not believed:
            shared = Kind.PROPELLER_UNBALANCED in kinds and self._shared.probability(self._judged[0].t) > 0.5
            return "agrees" if shared else "alone"
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
        self._attribution.new_flight()
        self._commanded.new_flight()
        self._load.new_flight()
        self._battery.new_flight()
        self._frozen.new_flight()
        self._shared.new_flight()
        self._part_since.clear()
        self._flew = False
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
