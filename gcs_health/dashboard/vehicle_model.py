"""One vehicle's last minute, and its picture."""

import copy
import math
from collections import deque

from gcs_health.airframe import Airframe
from gcs_health.dashboard.snapshot import NAN, TRAIL, Figure, Level, RotorShot, Row, VehicleShot
from gcs_health.dashboard.words import AUTOPILOT, mode_name
from gcs_health.estimators.amplitude_model import ImuFilter, highpass_gain
from gcs_health.estimators.contract import REASON_TEXT, Reason
from gcs_health.estimators.unbalance_config import RecommendedConfig
from gcs_health.fusion.kinds import FAILED, UNKNOWN, Kind
from gcs_health.fusion.verdicts import Verdict
from gcs_health.gate import GRAVITY
from gcs_health.record.events import EstimateEvent
from gcs_health.rotor_telemetry import RotorState
from gcs_health.samples import ImuFilterReading, ImuReading, Reading, RotorReading
from gcs_health.vehicle_monitor import VehicleMonitor

ROW_EVERY = 0.1  # s
ROWS = 600
BLIND_POINTS = 96  # of the blind-band map
LONGEST_NAME = 18
FASTER = 1.3  # times the fastest rotor: how far the map reaches
VEHICLE_TYPE = {2: "quadrotor", 13: "hexarotor", 14: "octorotor", 15: "tricopter", 29: "dodecarotor"}


class VehicleModel:
    """Heard: readings and estimates; kept: the newest of each, rows of the last minute."""

    def __init__(self) -> None:
        self.rows: deque[Row] = deque(maxlen=ROWS)
        self._trail: deque[tuple[int, tuple[float, ...]]] = deque(maxlen=TRAIL)
        self._figures: dict[tuple[int, str, str], EstimateEvent] = {}  # by ESC index
        self._trends: dict[tuple[int, str], deque[tuple[float, float]]] = {}
        self._speed: list[float] = []
        self._current: list[float] = []
        self._voltage: list[float] = []
        self._lift, self._lifts = 0.0, 0
        self._due = -math.inf
        self._filter = ImuFilter()
        self._blind: tuple[tuple[float, float], ...] = ()
        self._blind_due = -math.inf
        self._since = NAN

    def copy(self) -> "VehicleModel":
        """Return one that goes on by itself."""
        other = copy.copy(self)
        other.rows = self.rows.copy()
        other._trail = self._trail.copy()
        other._figures = dict(self._figures)
        other._trends = {key: trend.copy() for key, trend in self._trends.items()}
        other._speed, other._current = self._speed[:], self._current[:]
        other._voltage = self._voltage[:]
        return other

    def read(self, reading: Reading) -> bool:
        """Hear a reading; return whether a row is due."""
        if isinstance(reading, ImuReading):
            if reading.az == reading.az:
                self._lift -= reading.az
                self._lifts += 1
        elif isinstance(reading, RotorReading):
            for kept, news in (
                (self._speed, reading.speed),
                (self._current, reading.current),
                (self._voltage, reading.voltage),
            ):
                if len(kept) != len(news):
                    kept[:] = [NAN] * len(news)
                for k, value in enumerate(news):
                    if value == value:
                        kept[k] = value
        elif isinstance(reading, ImuFilterReading):
            self._filter = ImuFilter.told(reading)
            self._blind_due = -math.inf
        return not self._due - 5.0 * ROW_EVERY <= reading.t < self._due  # clocks may go back, too

    def estimate(self, event: EstimateEvent) -> None:
        """Hear an estimate."""
        self._figures[event.rotor, event.estimator, event.quantity] = event
        if event.quantity.startswith("unbalance") and event.value == event.value:
            trend = self._trends.setdefault((event.rotor, event.quantity), deque(maxlen=TRAIL))
            if not trend or not 0.0 <= event.t - trend[-1][0] < 1.0:
                trend.append((event.t, event.value))

    def keep_row(self, watched: VehicleMonitor) -> None:
        """Keep what is known now."""
        t, n = watched.last_t, len(watched.airframe.rotors) if watched.airframe is not None else 0
        self._due = (math.floor(t / ROW_EVERY) + 1) * ROW_EVERY
        lift = self._lift / self._lifts if self._lifts else NAN
        self._lift, self._lifts = 0.0, 0
        if not n:
            return
        assert watched.airframe is not None
        verdicts = watched.verdicts
        failed = tuple(v.failed if v.known or v.failed > 0.5 else NAN for v in verdicts) or (NAN,) * n
        effectiveness = tuple(self._value(rotor.esc, "effectiveness") for rotor in watched.airframe.rotors)
        speed = tuple(self._speed) if len(self._speed) == n else (NAN,) * n
        current = tuple(self._current) if len(self._current) == n else (NAN,) * n
        expected = NAN
        hover = watched.bank.hover if watched.bank is not None else math.inf
        if math.isfinite(hover) and hover > 0.0:
            expected = GRAVITY * sum(w * w for w in speed) / (n * hover * hover)
        self.rows.append(Row(t, failed, effectiveness, speed, current, lift, expected))
        second = math.floor(t)
        if self._trail and self._trail[-1][0] == second:
            before = self._trail.pop()[1]
            # NaN where nothing is known: the known one of the two
            failed = tuple(
                max(a, b) if a == a and b == b else a if a == a else b
                for a, b in zip(before, failed, strict=True)
            )
        elif self._trail and not 0 < second - self._trail[-1][0] < TRAIL:
            self._trail.clear()
        self._trail.append((second, failed))

    def shot(self, watched: VehicleMonitor, silent: float, alarmed: dict[int, str]) -> VehicleShot:
        """Return the picture; `alarmed` names what open alerts say of motors."""
        frame = watched.airframe
        flies = watched.landed is False or (watched.landed is None and watched.armed is True)
        if not flies:
            self._since = NAN
        elif self._since != self._since:
            self._since = watched.last_t
        rotors: tuple[RotorShot, ...] = ()
        if frame is not None:
            rotors = tuple(self._rotor(watched, frame, k, silent, alarmed) for k in range(len(frame.rotors)))
        return VehicleShot(
            name=watched.vehicle,
            title=_title(watched),
            mode=mode_name(watched.autopilot, watched.custom_mode),
            armed=watched.armed,
            landed=watched.landed,
            t=watched.last_t,
            us=watched.last_us,
            silent=silent,
            since=self._since,
            rotors=rotors,
            unusable=watched.unusable() or watched.missing_parameters(),
            airframe=f"{frame.name} from {frame.source.value}" if frame is not None else "",
            warnings=frame.warnings if frame is not None else (),
            refused=tuple(watched.refused.items()),
            imu_rate=watched.imu.rate(),
            blind=self._blind_map(watched),
            rows=tuple(self.rows),
        )

    def _rotor(
        self, watched: VehicleMonitor, frame: Airframe, k: int, silent: float, alarmed: dict[int, str]
    ) -> RotorShot:
        rotor, t = frame.rotors[k], watched.last_t
        verdict = watched.verdicts[k] if watched.verdicts else None
        figures = self._figures_of(frame, k)
        state, level = _state(verdict)
        if level is not Level.FAILED and rotor.motor in alarmed:
            state, level = alarmed[rotor.motor], Level.FAILED
        why = _why(verdict, figures)
        if silent > 1.0:  # whatever was known, it is not known now
            why = f"nothing heard for {silent:.0f} s"
            if level is not Level.FAILED:
                state, level = UNKNOWN, Level.UNKNOWN
        telemetry = watched.rotors.state(rotor.esc, t)
        stale = telemetry in (RotorState.STALE, RotorState.NOT_REPORTED)
        return RotorShot(
            motor=rotor.motor,
            seat=frame.seat(k),
            position=rotor.position,
            spin=rotor.spin,
            level=level,
            state=state,
            probability=verdict.probability if verdict is not None else NAN,
            since=verdict.since if verdict is not None else NAN,
            why=why,
            sources=verdict.sources if verdict is not None else (),
            posterior=tuple((kind.value, p) for kind, p in verdict.posterior) if verdict is not None else (),
            figures=figures,
            speed=NAN if stale else _at(self._speed, k),
            current=NAN if stale else _at(self._current, k),
            voltage=NAN if stale else _at(self._voltage, k),
            temperature_degc=watched.rotors.temperatures.get(rotor.esc, NAN),
            telemetry=telemetry.value,
            age=watched.rotors.age(rotor.esc, t) + silent,
            trail=self._trail_of(k, t + silent),
        )

    def _figures_of(self, frame: Airframe, k: int) -> tuple[Figure, ...]:
        esc = frame.rotors[k].esc
        found = [event for (index, _, _), event in self._figures.items() if index == esc]
        return tuple(self._figure(frame, event) for event in found)

    def _figure(self, frame: Airframe, event: EstimateEvent) -> Figure:
        together: tuple[int, ...] = ()
        if Reason.NOT_IDENTIFIABLE.value in event.reasons:
            alike = [
                rotor.motor
                for rotor in frame.rotors
                if (other := self._figures.get((rotor.esc, event.estimator, event.quantity))) is not None
                and Reason.NOT_IDENTIFIABLE.value in other.reasons
            ]
            together = tuple(alike) if len(alike) > 1 else ()
        trend = self._trends.get((event.rotor, event.quantity))
        change = NAN
        if trend and trend[-1][0] - trend[0][0] >= 20.0:
            change = 60.0 * (trend[-1][1] - trend[0][1]) / (trend[-1][0] - trend[0][0])
        return Figure(
            event.estimator,
            event.quantity,
            event.value,
            event.std,
            event.failure_probability,
            event.status,
            "; ".join(REASON_TEXT[Reason(reason)] for reason in event.reasons),
            event.detectable,
            together,
            change,
        )

    def _value(self, esc: int, quantity: str) -> float:
        event = self._figures.get((esc, quantity, quantity))  # the estimator bears its quantity's name
        return event.value if event is not None else NAN

    def _trail_of(self, k: int, t: float) -> tuple[float, ...]:
        trail = [NAN] * TRAIL
        if t == t:
            for second, failed in self._trail:
                at = TRAIL - 1 - (math.floor(t) - second)
                if 0 <= at < TRAIL and k < len(failed):
                    trail[at] = failed[k]
        return tuple(trail)

    def _blind_map(self, watched: VehicleMonitor) -> tuple[tuple[float, float], ...]:
        rate, fastest = watched.imu.rate(), max((w for w in self._speed if w == w), default=0.0)
        if rate <= 0.0 or fastest <= 0.0:
            return ()
        if not self._blind_due - 5.0 <= watched.last_t < self._blind_due:
            self._blind_due = watched.last_t + 1.0
            self._blind = blind_map(rate, FASTER * fastest, self._filter)
        return self._blind


def blind_map(rate: float, fastest: float, what: ImuFilter) -> tuple[tuple[float, float], ...]:
    """Return (rotor speed [rad/s], what is left of its 1/rev line [-]) at this sample rate [Hz]."""
    import numpy as np

    config = RecommendedConfig()
    corner = config.highpass_filtered if what.cutoff == what.cutoff else config.highpass
    omega = np.linspace(0.0, fastest, BLIND_POINTS + 1)[1:]
    gain = what.gain(omega) * highpass_gain(omega, corner, 1.0 / rate)
    return tuple(zip(omega.tolist(), gain.tolist(), strict=True))


def _state(verdict: Verdict | None) -> tuple[str, Level]:
    if verdict is None or verdict.state == UNKNOWN:
        return UNKNOWN, Level.UNKNOWN
    if verdict.kind is Kind.HEALTHY:
        return verdict.state, Level.OK
    return verdict.state, Level.FAILED if verdict.kind in FAILED else Level.WARN


def _why(verdict: Verdict | None, figures: tuple[Figure, ...]) -> str:
    if verdict is not None and verdict.known:
        return ""
    return next((figure.why for figure in figures if figure.quantity == "effectiveness" and figure.why), "")


def _title(watched: VehicleMonitor) -> str:
    maker = AUTOPILOT.get(watched.autopilot or -1, "")
    frame = watched.airframe
    what = VEHICLE_TYPE.get(watched.vehicle_type or -1, "vehicle")
    if frame is not None:
        what = frame.name if len(frame.name) <= LONGEST_NAME else f"{len(frame.rotors)} rotors"
    return what if what.startswith(maker) else f"{maker} {what}".strip()


def _at(values: list[float], k: int) -> float:
    return values[k] if k < len(values) else NAN
