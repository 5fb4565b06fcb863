"""Everything about one vehicle: its samples in stream order to estimates, alerts and what is known of it."""

import math
from collections.abc import Callable, Iterable
from typing import Any

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.airframe_parameters import AirframeParameters
from gcs_health.airframe_tables import assume_airframe
from gcs_health.clock import Kind, VehicleClock
from gcs_health.errors import AirframeError
from gcs_health.estimator_bench import EstimatorBench
from gcs_health.estimators.contract import Estimate
from gcs_health.estimators.effectiveness_recommended import RecommendedBank
from gcs_health.fusion.alerts import Alert
from gcs_health.fusion.autopilot_words import AutopilotWords
from gcs_health.fusion.panel import RotorPanel
from gcs_health.fusion.rules import RuleBook, Rules
from gcs_health.fusion.verdicts import Verdict
from gcs_health.imu_selection import ImuSelection
from gcs_health.needs import Input, Need, Stream, estimator_needs
from gcs_health.record.describe import (
    alert_event,
    describe_airframe,
    estimate_event,
    hardware_uid,
    verdict_event,
)
from gcs_health.record.events import (
    AlertEvent,
    AutopilotEvent,
    Event,
    VehicleEvent,
)
from gcs_health.rotor_telemetry import RotorTelemetry
from gcs_health.samples import (
    Battery,
    BatteryReading,
    EscInfo,
    EscStatus,
    EscTelemetry,
    FlightReading,
    Heartbeat,
    Imu,
    LandedState,
    Other,
    Outputs,
    Parameter,
    Reading,
    Sample,
    StatusText,
    Vibration,
    VibrationReading,
)

NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: ground stations, companions, gimbals
NOT_VEHICLES = frozenset({5, 6, 18, 26, 27, 30, 31, 34})  # MAV_TYPE: ground stations, companions ...
MULTIROTORS = frozenset({0, 2, 3, 4, 13, 14, 15, 29, 35, 43})  # 0 generic; 4: some quads say helicopter
ASSUME_AFTER = 3.0  # s of vehicle time in which parameters may still tell the geometry
NEEDS_AFTER = 4.0  # s until a stream that lacks an input is told what would give it
CLOCK_WAIT_US = 2_000_000  # events wait so long for a first stamped message
ON_GROUND = 1  # MAV_LANDED_STATE
UNKNOWN_LANDED = 0
BETTER = (AirframeSource.FILE, AirframeSource.PARAMETERS, AirframeSource.ASSUMED)

Tap = Callable[[str, Reading], None]
VerdictTap = Callable[[str, list[Verdict], bool], None]

CLOCK_TEXT = {
    Kind.GAP: "nothing came for {:.1f} s",
    Kind.REBOOT: "the vehicle rebooted: its clock went back by {:.1f} s",
    Kind.VEHICLE_STEP: "the vehicle's clock was set by {:.1f} s",
    Kind.RECEIVE_STEP: "the ground station's clock was set by {:.1f} s",
}


class VehicleMonitor:
    """One (system, component): clock → airframe → telemetry truth → estimator → alerts → events.

    Parameters
    ----------
    vehicle : "sysid.compid".
    airframe : the user's vehicle file; None = from the stream.
    estimators : by registry name. mode : "recommended" or "paper".
    estimate_rate : at most so many estimates a second and rotor [Hz].
    tap : called with (vehicle, reading) before every reading reaches the estimator.
    book : the user's alert rules.
    verdict_tap : called with (vehicle, verdicts of all rotors, whether it flies) at every look at them.
    """

    def __init__(
        self,
        vehicle: str,
        airframe: Airframe | None,
        estimators: tuple[str, ...],
        mode: str,
        estimate_rate: float,
        tap: "Tap | None" = None,
        book: RuleBook | None = None,
        verdict_tap: "VerdictTap | None" = None,
    ) -> None:
        self.vehicle = vehicle
        self._book = book or RuleBook()
        self._verdict_tap = verdict_tap
        self.autopilot: int | None = None
        self.vehicle_type: int | None = None
        self.is_vehicle = False
        self.uid: str | None = None
        self.airframe: Airframe | None = None
        self.custom_mode: int | None = None  # as the last HEARTBEAT said
        self.first_t = self.last_t = math.nan
        self.last_us = 0
        self.gaps: list[tuple[float, float]] = []
        self.alerts: list[AlertEvent] = []
        self.latest: list[Estimate] = []  # of the last round of estimates
        self.clock = VehicleClock()
        self.imu = ImuSelection()
        self.rotors = RotorTelemetry()
        self._names = estimators
        self._mode = mode
        self._tap = tap
        self._rate = estimate_rate
        self._due = -math.inf
        self._parameters = AirframeParameters()
        self._bench: EstimatorBench | None = None
        self._panel: RotorPanel | None = None
        self._words = AutopilotWords()
        self._told: dict[int, Verdict] = {}
        self._armed: bool | None = None
        self._landed: bool | None = None
        self._landed_heard = 0
        self._needs_said = False
        self._unusable = ""
        self._pending: list[Event] = []
        self._timed = False
        self._first_us: int | None = None
        self._handlers: dict[type, Callable[[float, Any], None]] = {
            Heartbeat: self._on_heartbeat,
            LandedState: self._on_landed_state,
            Imu: self._on_imu,
            EscStatus: self._on_rotors,
            EscTelemetry: self._on_rotors,
            EscInfo: self._on_esc_info,
            StatusText: self._on_words,
            Other: self._on_other,
            Outputs: self._on_rotors,
            Parameter: self._on_parameter,
            Battery: self._on_battery,
            Vibration: self._on_vibration,
        }
        if airframe is not None:
            self._adopt(airframe)

    def feed(self, sample: Sample) -> list[Event]:
        """Take one sample; return what it causes."""
        t = self.clock.time_of(sample)
        self.last_us = sample.receive_us
        if self.clock.news:
            self._note_time(t)
        if not t <= self.last_t:
            if self.last_t != self.last_t:
                self.first_t = t
            self.last_t = t
        handler = self._handlers.get(type(sample))
        if handler is not None:
            handler(t, sample)
        if t >= self._due and self.is_vehicle:
            self._routine(t)
        return self._release(sample) if self._pending else []

    def poll(self, receive_us: int) -> list[Event]:
        """Say what silence causes: a vehicle that has gone quiet still gets its needs told."""
        if not self.is_vehicle or self.last_t != self.last_t:
            return []
        silent = max(receive_us - self.last_us, 0) * 1e-6
        self._tell_needs(self.last_t + silent)
        events, self._pending = self._pending, []
        return events

    @property
    def bank(self) -> RecommendedBank | None:
        """What the recommended mode has learned; None in paper mode and without an airframe."""
        estimator = self._bench.effectiveness if self._bench is not None else None
        return estimator.bank if estimator is not None else None

    def set_tap(self, tap: "Tap | None") -> None:
        """Let another hear the readings from now on."""
        self._tap = tap

    @property
    def armed(self) -> bool | None:
        """As the last HEARTBEAT said; None if unheard."""
        return self._armed

    @property
    def landed(self) -> bool | None:
        """As the autopilot said last; None if it has not."""
        return self._landed

    @property
    def verdicts(self) -> list[Verdict]:
        """The last verdict of every rotor; empty before the first."""
        return self._panel.verdicts if self._panel is not None else []

    @property
    def refused(self) -> dict[str, str]:
        """Why an estimator cannot work on this airframe, by its name."""
        return self._bench.refused if self._bench is not None else {}

    def acknowledge(self, number: int) -> list[Event]:
        """Take that the operator has seen an alert episode; return what that causes."""
        return self._operator(self._panel.acknowledge(number, self.last_t) if self._panel else [])

    def shelve(self, number: int, seconds: float) -> list[Event]:
        """Take that the operator wants silence on an episode for so long [s]; 0 ends it."""
        until = self.last_t + seconds
        return self._operator(self._panel.shelve(number, self.last_t, until) if self._panel else [])

    def _operator(self, alerts: list[Alert]) -> list[Event]:
        before = len(self._pending)
        self._alerts(alerts)
        told, self._pending = self._pending[before:], self._pending[:before]
        return told

    @property
    def rules(self) -> Rules:
        """The alert rules that hold for it."""
        return self._book.rules(self.airframe.name if self.airframe else None, self.vehicle, self.uid)

    def estimates(self) -> list[Estimate]:
        """Return the present state of every rotor, estimator by estimator."""
        return self._bench.estimates(self.last_t) if self._bench is not None else []

    def worst(self, estimate: Estimate) -> Estimate:
        """Return the estimate nearest to a failure of the same quantity and rotor that was seen."""
        key = (estimate.estimator, estimate.quantity, estimate.rotor)
        return self._bench.worst.get(key, estimate) if self._bench is not None else estimate

    def needs(self) -> dict[str, tuple[Need, ...]]:
        """List what each estimator needs against what the stream has, by its name."""
        span = self.last_t - self.first_t
        rotor = self._rotor_rate()
        stream = Stream(
            self.imu.rate(),
            rotor,
            rotor if self.rotors.gives_current else 0.0,
            self._landed_heard / span if span > 0 else 0.0,
            self.airframe is not None and self.airframe.source is not AirframeSource.ASSUMED,
            self.autopilot,
        )
        return {name: estimator_needs(name, stream) for name in self._names}

    def missing_parameters(self) -> str:
        """Say which parameters a geometry begun still lacks; empty if none."""
        return self._parameters.missing() if self._source_is_worse_than(AirframeSource.PARAMETERS) else ""

    def unusable(self) -> str:
        """Say why nothing can be estimated here at all; empty if something can."""
        if self.vehicle_type is not None and self.vehicle_type not in MULTIROTORS:
            return f"MAV_TYPE {self.vehicle_type} is not a multirotor: no rotors to watch"
        return self._unusable

    # -- samples ------------------------------------------------------------------------------------

    def _on_heartbeat(self, t: float, sample: Heartbeat) -> None:
        if sample.autopilot == NO_AUTOPILOT or sample.vehicle_type in NOT_VEHICLES:
            return
        changed = (sample.autopilot, sample.vehicle_type) != (self.autopilot, self.vehicle_type)
        self.autopilot, self.vehicle_type = sample.autopilot, sample.vehicle_type
        self.custom_mode = sample.custom_mode
        if not self.is_vehicle:
            self._now_a_vehicle()
        elif changed:
            self._say("identity", "the autopilot or vehicle type was heard")
        if sample.armed is not self._armed:
            news = sample.armed or self._armed is not None
            if sample.armed and self._armed is False and self._panel is not None:
                self._alerts(self._panel.new_flight(t))
            self._armed = sample.armed
            self._tell_flight(t)
            if news:
                self._say("flight", "armed" if sample.armed else "disarmed")

    def _on_landed_state(self, t: float, sample: LandedState) -> None:
        self._landed_heard += 1
        landed = None if sample.landed_state == UNKNOWN_LANDED else sample.landed_state == ON_GROUND
        if landed is not self._landed:
            self._landed = landed
            self._tell_flight(t)

    def _on_imu(self, t: float, sample: Imu) -> None:
        self._is_autopilot(sample)
        reading = self.imu.feed(t, sample)
        if reading is not None:
            if self.imu.news:
                self._read(self.imu.filtering(t, self.autopilot))
            self._read(reading)

    def _on_rotors(self, t: float, sample: EscStatus | EscTelemetry | EscInfo | Outputs) -> None:
        self._is_autopilot(sample)
        reading = self.rotors.feed(t, sample)
        if reading is not None:
            self._read(reading)

    def _on_esc_info(self, t: float, sample: EscInfo) -> None:
        self._on_rotors(t, sample)
        if self._panel is not None:
            self._panel.esc_info(t, sample)

    def _on_words(self, t: float, sample: StatusText | Other) -> None:
        word = self._words.feed(sample)
        if word is not None and not word.before_arming:
            relation = self._panel.relation(word) if self._panel is not None else "alone"
            self._pending.append(
                AutopilotEvent(t, self.last_us, self.vehicle, word.opinion, word.motors, word.text, relation)
            )

    def _on_battery(self, t: float, sample: Battery) -> None:
        self._read(BatteryReading(t, sample.voltage, sample.current))

    def _on_vibration(self, t: float, sample: Vibration) -> None:
        self._read(VibrationReading(t, sample.x, sample.y, sample.z))

    def _on_other(self, t: float, sample: Other) -> None:
        if sample.name != "AUTOPILOT_VERSION":
            self._on_words(t, sample)
            return
        uid = hardware_uid(sample.fields)
        if uid is not None and uid != self.uid:
            self.uid = uid
            if self._panel is not None:
                self._panel.set_rules(self.rules)
            self._say("identity", f"the autopilot's hardware is {uid}")

    def _on_parameter(self, t: float, sample: Parameter) -> None:
        self.imu.set_parameter(sample.name, sample.number)
        if not self._parameters.feed(sample):
            return
        self.rotors.set_output_channels(self._parameters.output_channels())
        if self._source_is_worse_than(AirframeSource.FILE):
            airframe = self._parameters.airframe(self.vehicle_type)
            if airframe is not None and airframe != self.airframe:
                self._adopt(airframe)

    def _is_autopilot(self, sample: Sample) -> None:
        """Telemetry of component 1 is an autopilot's even before its HEARTBEAT is heard."""
        if not self.is_vehicle and sample.component == 1:
            self._now_a_vehicle()

    # -- time ---------------------------------------------------------------------------------------

    def _note_time(self, t: float) -> None:
        """Take what happened to the vehicle's clock."""
        for notice in self.clock.notices():
            if notice.kind is Kind.AXIS:  # all before was receive time: another origin
                self.first_t = self.last_t = t
                self._due = -math.inf
                if self._bench is not None:
                    self._bench.reset()
                    self._tell_all_known(t)
                continue
            if notice.kind is Kind.GAP:
                self.gaps.append((notice.t, notice.size))
            if self.is_vehicle:
                self._say("clock", CLOCK_TEXT[notice.kind].format(abs(notice.size)))

    def _release(self, sample: Sample) -> list[Event]:
        """Let events out, once the vehicle's clock is known or will not be: their times are on one axis."""
        if not self._timed:
            if self._first_us is None:
                self._first_us = sample.receive_us
            self._timed = self.clock.settled or sample.receive_us - self._first_us > CLOCK_WAIT_US
            if not self._timed:
                return []
            self._pending = [event._replace(t=self.last_t) for event in self._pending]
        events, self._pending = self._pending, []
        return events if self.is_vehicle else []

    # -- what follows -------------------------------------------------------------------------------

    def _read(self, reading: Reading) -> None:
        if self._tap is not None:
            self._tap(self.vehicle, reading)
        if self._bench is not None:
            said = self._bench.feed(reading)
            if said:
                self._judge(said)
            if self._panel is not None:
                told = self._panel.read(reading, self._surely_flies())
                if told:
                    self._alerts(told)

    def _surely_flies(self) -> bool:
        """Whether it flies, by the autopilot's word, or, where it does not say, by the flight gate.

        Thrown or held in a hand, its rotors do as they are told one by one: no speed is to be judged by the others'.
        """
        if self._landed is None:
            return self._armed is not False and self.bank is not None and self.bank.gate.open
        return self._flies()

    def _tell_flight(self, t: float) -> None:
        if self._armed is not None or self._landed is not None:
            self._read(FlightReading(t, self._armed, self._landed))

    def _tell_all_known(self, t: float) -> None:
        """Tell new or reset estimators what is said only when it changes."""
        self._tell_flight(t)
        if self.imu.rate():
            self._read(self.imu.filtering(t, self.autopilot))

    def _routine(self, t: float) -> None:
        """Do what falls due with time: assume an airframe, say what is missing, estimate regularly."""
        if t - self.first_t >= ASSUME_AFTER and self.airframe is None and not self.unusable():
            assumed = assume_airframe(self.rotors.esc_count(), self.vehicle_type)
            if assumed is not None:
                self._adopt(assumed)
        self._tell_needs(t)
        if self._bench is not None:
            self.latest = estimates = self._bench.routine(t)
            assert self.airframe is not None
            head = (self.airframe, self.last_us, self.vehicle)
            self._pending += [estimate_event(estimate, *head) for estimate in estimates]
            self._judge(estimates)
            if self._panel is not None:
                self._alerts(self._panel.routine(t, self.rotors, self._flies()))
                self._tell_verdicts(self._panel.verdicts)
                if self._verdict_tap is not None:
                    self._verdict_tap(self.vehicle, self._panel.verdicts, self._flies())
        self._due = (math.floor(t * self._rate) + 1) / self._rate

    def _judge(self, estimates: Iterable[Estimate]) -> None:
        if self._panel is not None:
            self._alerts(self._panel.feed(estimates))

    def _flies(self) -> bool:
        """Whether the vehicle flies, as far as the autopilot says."""
        return self._armed is not False and self._landed is not True

    def _tell_verdicts(self, verdicts: list[Verdict]) -> None:
        """Say what changed in what is believed of the rotors."""
        assert self.airframe is not None
        for verdict in verdicts:
            before = self._told.get(verdict.rotor)
            if before is not None and not verdict.differs(before):
                continue
            self._told[verdict.rotor] = verdict
            self._pending.append(verdict_event(verdict, self.airframe, self.last_us, self.vehicle))

    def _adopt(self, airframe: Airframe) -> None:
        """Take an airframe; the estimator starts anew, what went before was under another geometry."""
        try:
            bench = EstimatorBench(airframe, self._names, self._mode)
        except AirframeError as error:
            self._unusable = str(error)
            if airframe.source is AirframeSource.FILE:
                raise
            return
        self._unusable = ""
        self._bench = bench
        self.latest = []
        self.airframe = airframe
        self.rotors.set_airframe(airframe)
        count = self._panel.count if self._panel is not None else 0
        self._panel = RotorPanel(airframe, count, self.rules)
        self._told.clear()
        self._tell_all_known(self.last_t)
        self._say("airframe", f"airframe {airframe.name} from {airframe.source.value}")

    def _source_is_worse_than(self, source: AirframeSource) -> bool:
        return self.airframe is None or BETTER.index(self.airframe.source) > BETTER.index(source)

    def _tell_needs(self, t: float) -> None:
        if self._needs_said or not t - self.first_t >= NEEDS_AFTER:
            return
        self._needs_said = True
        if self.unusable():
            self._say("notice", self.unusable())
            return
        told: set[Input] = set()  # several estimators lack the same
        for need in (need for needs in self.needs().values() for need in needs):
            if need.met or need.input in told or not need.wanted > 1.0:
                continue
            if need.input is Input.CURRENT and Input.ROTOR_SPEED in told:
                continue  # what gives the one gives the other
            told.add(need.input)
            have = f"only {need.rate:.1f} Hz of" if need.rate else "no"
            self._say("notice", f"{have} {need.input.value} in the stream: {need.remedy}")

    def _rotor_rate(self) -> float:
        if self.airframe is None:
            escs: Iterable[int] = self.rotors.escs
        else:
            escs = [rotor.esc for rotor in self.airframe.rotors]
        return max((self.rotors.rate(esc) for esc in escs), default=0.0)

    # -- events -------------------------------------------------------------------------------------

    def _now_a_vehicle(self) -> None:
        self.is_vehicle = True
        self._say("seen", f"vehicle {self.vehicle} seen")

    def _say(self, change: str, text: str) -> None:
        if not self.is_vehicle:  # "seen" will tell all that is known by then
            return
        self._pending.append(
            VehicleEvent(
                self.last_t,
                self.last_us,
                self.vehicle,
                change,
                text,
                self.autopilot,
                self.vehicle_type,
                None if self.airframe is None else describe_airframe(self.airframe),
                self._armed,
                self.uid,
            )
        )

    def _alerts(self, alerts: Iterable[Alert]) -> None:
        for alert in alerts:
            event = alert_event(alert, self.last_us, self.vehicle)
            self.alerts.append(event)
            self._pending.append(event)
