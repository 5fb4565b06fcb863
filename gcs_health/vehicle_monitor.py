"""Everything about one vehicle: its samples in stream order to estimates, alerts and what is known of it."""

import math
from collections.abc import Callable, Iterable
from typing import Any

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.airframe_choice import AirframeChoice, of_a_vehicle
from gcs_health.clock import Kind, VehicleClock
from gcs_health.errors import AirframeError
from gcs_health.estimator_bench import EstimatorBench
from gcs_health.estimators.contract import Estimate
from gcs_health.estimators.effectiveness_recommended import RecommendedBank
from gcs_health.flight_phase import FlightPhase
from gcs_health.fusion.absorbed import absorbed
from gcs_health.fusion.alerts import Alert
from gcs_health.fusion.autopilot_words import AutopilotWords
from gcs_health.fusion.panel import RotorPanel
from gcs_health.fusion.rules import Rules
from gcs_health.fusion.verdicts import Verdict
from gcs_health.imu_selection import ImuSelection
from gcs_health.monitor_config import MonitorConfig
from gcs_health.needs import Need, Stream, estimator_needs, remedies
from gcs_health.record.condition_log import ConditionLog
from gcs_health.record.describe import describe_airframe, describe_clock, estimate_event, hardware_uid
from gcs_health.record.events import AlertEvent, AutopilotEvent, Event, VehicleEvent
from gcs_health.record.outbox import Outbox
from gcs_health.rotor_telemetry import RotorTelemetry
from gcs_health.samples import (
    Battery,
    BatteryReading,
    EscInfo,
    EscStatus,
    EscTelemetry,
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

AUTOPILOT = 1  # component whose telemetry is a vehicle's even before its HEARTBEAT is heard
NEEDS_AFTER = 4.0  # s until a stream that lacks an input is told what would give it


class VehicleMonitor:
    """One (system, component): clock → airframe → telemetry truth → estimator → alerts → events.

    Parameters
    ----------
    vehicle : "sysid.compid".
    config : what the user chose; may be replaced, which estimators go on with their part of it.
    """

    def __init__(self, vehicle: str, config: MonitorConfig) -> None:
        self.vehicle = vehicle
        self.config = config
        self.autopilot: int | None = None
        self.is_vehicle = False
        self.uid: str | None = None
        self.geometry = AirframeChoice()
        self.phase = FlightPhase()
        self.custom_mode: int | None = None  # as the last HEARTBEAT said
        self.first_t = self.last_t = math.nan
        self.last_us = 0
        self.gaps: list[tuple[float, float]] = []
        self.latest: list[Estimate] = []  # of the last round of estimates
        self.clock = VehicleClock()
        self.imu = ImuSelection()
        self.rotors = RotorTelemetry()
        self.condition = ConditionLog(vehicle)
        self._due = -math.inf
        self._bench: EstimatorBench | None = None
        self._panel: RotorPanel | None = None
        self._words = AutopilotWords()
        self._needs_said = False
        self._outbox = Outbox(vehicle)
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
        if config.airframe is not None:
            self._adopt(config.airframe)

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
        if not self._outbox.pending:
            return []
        events = self._outbox.release(sample.receive_us, self.last_t, self.clock.settled)
        return events if self.is_vehicle else []

    def poll(self, receive_us: int) -> list[Event]:
        """Say what silence causes: a vehicle that has gone quiet still gets its needs told."""
        if not self.is_vehicle or self.last_t != self.last_t:
            return []
        silent = max(receive_us - self.last_us, 0) * 1e-6
        self._tell_needs(self.last_t + silent)
        return self._outbox.take()

    def finish(self) -> list[Event]:
        """End of input: say what a flight that had no end yet has shown of its condition."""
        return [*self.condition.end(self.last_t, self.last_us)]

    @property
    def airframe(self) -> Airframe | None:
        """Its geometry; None while unknown."""
        return self.geometry.chosen

    @property
    def vehicle_type(self) -> int | None:
        """MAV_TYPE; None if unheard."""
        return self.geometry.vehicle_type

    @property
    def alerts(self) -> list[AlertEvent]:
        """Every step of every alert so far."""
        return self._outbox.alerts

    @property
    def bank(self) -> RecommendedBank | None:
        """What the recommended mode has learned; None in paper mode and without an airframe."""
        estimator = self._bench.effectiveness if self._bench is not None else None
        return estimator.bank if estimator is not None else None

    @property
    def verdicts(self) -> list[Verdict]:
        """The last verdict of every rotor; empty before the first."""
        return self._panel.verdicts if self._panel is not None else []

    @property
    def absorbed(self) -> tuple[str, ...]:
        """What all rotors do alike and is no rotor's fault, in words."""
        if self.airframe is None:
            return ()
        return absorbed(self.bank, self.airframe, self._panel.sag if self._panel else math.nan).words()

    @property
    def refused(self) -> dict[str, str]:
        """Why an estimator cannot work on this airframe, by its name."""
        return self._bench.refused if self._bench is not None else {}

    def acknowledge(self, number: int) -> list[Event]:
        """Take that the operator has seen an alert episode; return what that causes."""
        told = self._panel.acknowledge(number, self.last_t) if self._panel is not None else []
        return [*self._outbox.alert(told, self.last_us)]

    def shelve(self, number: int, seconds: float) -> list[Event]:
        """Take that the operator wants silence on an episode for so long [s]; 0 ends it."""
        until = self.last_t + seconds
        told = self._panel.shelve(number, self.last_t, until) if self._panel is not None else []
        return [*self._outbox.alert(told, self.last_us)]

    @property
    def rules(self) -> Rules:
        """The alert rules that hold for it."""
        return self.config.rules.rules(self.airframe.name if self.airframe else None, self.vehicle, self.uid)

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
        rotor = self.rotors.fastest()
        stream = Stream(
            self.imu.rate(),
            rotor,
            rotor if self.rotors.gives_current else 0.0,
            self.phase.landed_heard / span if span > 0 else 0.0,
            self.airframe is not None and self.airframe.source is not AirframeSource.ASSUMED,
            self.autopilot,
        )
        return {name: estimator_needs(name, stream) for name in self.config.estimators}

    # -- samples ------------------------------------------------------------------------------------

    def _on_heartbeat(self, t: float, sample: Heartbeat) -> None:
        if not of_a_vehicle(sample):
            return
        changed = (sample.autopilot, sample.vehicle_type) != (self.autopilot, self.vehicle_type)
        self.autopilot, self.geometry.vehicle_type = sample.autopilot, sample.vehicle_type
        self.custom_mode = sample.custom_mode
        if not self.is_vehicle:
            self._now_a_vehicle()
        elif changed:
            self._say("identity", "the autopilot or vehicle type was heard")
        was = self.phase.armed
        if sample.armed is not was:
            news = sample.armed or was is not None
            if sample.armed and was is False:
                self.condition.new_flight()
                if self._panel is not None:
                    self._alerts(self._panel.new_flight(t))
            elif was and not sample.armed:
                self._outbox.pending += self.condition.end(t, self.last_us)
            self.phase.armed = sample.armed
            self._tell_flight(t)
            if news:
                self._say("flight", "armed" if sample.armed else "disarmed")

    def _on_landed_state(self, t: float, sample: LandedState) -> None:
        if self.phase.land(sample):
            self._tell_flight(t)

    def _on_imu(self, t: float, sample: Imu) -> None:
        if not self.is_vehicle and sample.component == AUTOPILOT:
            self._now_a_vehicle()
        reading = self.imu.feed(t, sample)
        if reading is not None:
            if self.imu.news:
                self._read(self.imu.filtering(t, self.autopilot))
            self._read(reading)

    def _on_rotors(self, t: float, sample: EscStatus | EscTelemetry | EscInfo | Outputs) -> None:
        if not self.is_vehicle and sample.component == AUTOPILOT:
            self._now_a_vehicle()
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
            self._outbox.pending.append(
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
        if not self.geometry.parameter(sample):
            return
        self.rotors.set_output_channels(self.geometry.output_channels)
        airframe = self.geometry.from_parameters()
        if airframe is not None:
            self._adopt(airframe)

    # -- time ---------------------------------------------------------------------------------------

    def _note_time(self, t: float) -> None:
        """Take what happened to the vehicle's clock."""
        for notice in self.clock.notices():
            if notice.kind is Kind.AXIS:  # all before was receive time: another origin
                self.first_t = self.last_t = t
                self._due = -math.inf
                self.condition.new_flight()
                if self._bench is not None:
                    self._bench.reset()
                    self._tell_all_known(t)
                continue
            if notice.kind is Kind.GAP:
                self.gaps.append((notice.t, notice.size))
            if self.is_vehicle:
                self._say("clock", describe_clock(notice))

    # -- what follows -------------------------------------------------------------------------------

    def _read(self, reading: Reading) -> None:
        if self.config.tap is not None:
            self.config.tap(self.vehicle, reading)
        if self._bench is not None:
            self.condition.read(reading)
            said = self._bench.feed(reading)
            if said:
                self._judge(said)
            if self._panel is not None:
                told = self._panel.read(reading, self._surely_flies)
                if told:
                    self._alerts(told)

    def _surely_flies(self) -> bool:
        bank = self.bank
        return self.phase.surely_flies(bank is not None and bank.gate.open)

    def _tell_flight(self, t: float) -> None:
        reading = self.phase.reading(t)
        if reading is not None:
            self._read(reading)

    def _tell_all_known(self, t: float) -> None:
        """Tell new or reset estimators what is said only when it changes."""
        self._tell_flight(t)
        if self.imu.rate():
            self._read(self.imu.filtering(t, self.autopilot))

    def _routine(self, t: float) -> None:
        """Do what falls due with time: assume an airframe, say what is missing, estimate regularly."""
        if self.airframe is None:
            assumed = self.geometry.assumed(t - self.first_t, self.rotors.esc_count())
            if assumed is not None:
                self._adopt(assumed)
        self._tell_needs(t)
        if self._bench is not None:
            self.latest = estimates = self._bench.routine(t)
            assert self.airframe is not None
            head = (self.airframe, self.last_us, self.vehicle)
            self._outbox.pending += [estimate_event(estimate, *head) for estimate in estimates]
            self._judge(estimates)
            if self._panel is not None:
                self.condition.routine(t, estimates, self.phase.flies and self._panel.failed is None)
                self._alerts(self._panel.routine(t, self.rotors, self.phase.flies))
                self._outbox.tell(self._panel.verdicts, self.airframe, self.last_us)
                if self.config.verdict_tap is not None:
                    self.config.verdict_tap(self.vehicle, self._panel.verdicts, self.phase.flies)
        rate = self.config.estimate_rate
        self._due = (math.floor(t * rate) + 1) / rate

    def _judge(self, estimates: Iterable[Estimate]) -> None:
        if self._panel is not None:
            self._alerts(self._panel.feed(estimates))

    def _adopt(self, airframe: Airframe) -> None:
        """Take an airframe; the estimator starts anew, what went before was under another geometry."""
        try:
            bench = EstimatorBench(airframe, self.config.estimators, self.config.mode, self.config.settings)
        except AirframeError as error:
            self.geometry.refused = str(error)
            if airframe.source is AirframeSource.FILE:
                raise
            return
        self._bench = bench
        self.latest = []
        self.geometry.chosen, self.geometry.refused = airframe, ""
        self.rotors.set_airframe(airframe)
        count = self._panel.count if self._panel is not None else 0
        self._panel = RotorPanel(airframe, count, self.rules)
        self.condition.adopt(airframe)
        self._outbox.forget_verdicts()
        self._tell_all_known(self.last_t)
        self._say("airframe", f"airframe {airframe.name} from {airframe.source.value}")

    def _tell_needs(self, t: float) -> None:
        if self._needs_said or not t - self.first_t >= NEEDS_AFTER:
            return
        self._needs_said = True
        if self.geometry.unusable():
            self._say("notice", self.geometry.unusable())
            return
        for text in remedies(self.needs().values()):
            self._say("notice", text)

    # -- events -------------------------------------------------------------------------------------

    def _now_a_vehicle(self) -> None:
        self.is_vehicle = True
        self._say("seen", f"vehicle {self.vehicle} seen")

    def _say(self, change: str, text: str) -> None:
        if not self.is_vehicle:  # "seen" will tell all that is known by then
            return
        self._outbox.pending.append(
            VehicleEvent(
                self.last_t,
                self.last_us,
                self.vehicle,
                change,
                text,
                self.autopilot,
                self.vehicle_type,
                None if self.airframe is None else describe_airframe(self.airframe),
                self.phase.armed,
                self.uid,
            )
        )

    def _alerts(self, alerts: Iterable[Alert]) -> None:
        self._outbox.pending += self._outbox.alert(alerts, self.last_us)
