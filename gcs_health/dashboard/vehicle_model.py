"""One vehicle's last minute, and its picture."""

import copy
import math
from collections import deque
from dataclasses import replace

from gcs_health.airframe import Airframe
from gcs_health.balance import words
from gcs_health.dashboard.snapshot import NAN, SILENT, TRAIL, Figure, Level, RotorShot, Row, VehicleShot
from gcs_health.dashboard.words import AUTOPILOT, mode_name
from gcs_health.estimators.amplitude_model import ImuFilter, highpass_gain
from gcs_health.estimators.contract import REASON_TEXT, Estimate, Quantity, Reason
from gcs_health.estimators.unbalance_config import RecommendedConfig
from gcs_health.fusion.alerts import CLEAR_KIND
from gcs_health.fusion.kinds import FAILED, UNKNOWN, Kind
from gcs_health.fusion.verdicts import Verdict
from gcs_health.gate import GRAVITY
from gcs_health.rotor_telemetry import RotorState
from gcs_health.samples import FlightReading, ImuFilterReading, ImuReading, Reading, RotorReading
from gcs_health.vehicle_monitor import VehicleMonitor

ROW_EVERY = 0.1  # s
ROWS = 620  # a minute, and what the plots wait with
BLIND_POINTS = 96  # of the blind-band map
LONGEST_NAME = 18
UNBALANCES = (Quantity.UNBALANCE, Quantity.UNBALANCE_RELATIVE)
FASTER = 1.3  # times the fastest rotor: how far the map reaches
VEHICLE_TYPE = {2: "quadrotor", 13: "hexarotor", 14: "octorotor", 15: "tricopter", 29: "dodecarotor"}


class VehicleModel:
    """Heard: readings; kept: the newest of each, rows of the last minute, trends."""

    def __init__(self) -> None:
        self.rows: deque[Row] = deque(maxlen=ROWS)
        self._trail: deque[tuple[int, tuple[float, ...]]] = deque(maxlen=TRAIL)
        self._airframe: Airframe | None = None  # that all this is of
        self._trends: dict[tuple[int, str], deque[tuple[float, float]]] = {}
        self._speed: list[float] = []
        self._current: list[float] = []
        self._voltage: list[float] = []
        self._lift, self._lifts = 0.0, 0
        self._due = -math.inf
        self._filter = ImuFilter()
        self._since = NAN
        self._seated: Airframe | None = None
        self._seats: tuple[str, ...] = ()

    def copy(self) -> "VehicleModel":
        """Return one that goes on by itself."""
        other = copy.copy(self)
        other.rows = self.rows.copy()
        other._trail = self._trail.copy()
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
        elif isinstance(reading, FlightReading):
            flies = reading.landed is False or (reading.landed is None and reading.armed is True)
            self._since = NAN if not flies else reading.t if self._since != self._since else self._since
        return not self._due - 5.0 * ROW_EVERY <= reading.t < self._due  # clocks may go back, too

    def keep_row(self, watched: VehicleMonitor) -> None:
        """Keep what is known now."""
        t, n = watched.last_t, len(watched.airframe.rotors) if watched.airframe is not None else 0
        self._due = (math.floor(t / ROW_EVERY) + 1) * ROW_EVERY
        lift = self._lift / self._lifts if self._lifts else NAN
        self._lift, self._lifts = 0.0, 0
        if not n:
            return
        if watched.airframe != self._airframe:  # another count, or another order, of rotors
            self._airframe = watched.airframe
            for kept in (self.rows, self._trail, self._trends):
                kept.clear()
        effectiveness = [NAN] * n
        for estimate in watched.latest:
            if estimate.estimator == estimate.quantity == Quantity.EFFECTIVENESS:
                effectiveness[estimate.rotor] = estimate.value
            elif estimate.quantity in UNBALANCES and estimate.value == estimate.value:
                self._keep_trend(estimate)
        verdicts = watched.verdicts
        failed = tuple(v.failed if v.known or v.failed > 0.5 else NAN for v in verdicts) or (NAN,) * n
        speed = tuple(self._speed) if len(self._speed) == n else (NAN,) * n
        current = tuple(self._current) if len(self._current) == n else (NAN,) * n
        expected = NAN
        hover = watched.bank.hover if watched.bank is not None else math.inf
        if math.isfinite(hover) and hover > 0.0:
            expected = GRAVITY * sum(w * w for w in speed) / (n * hover * hover)
        self.rows.append(Row(t, failed, tuple(effectiveness), speed, current, lift, expected))
        self._keep_trail(math.floor(t), failed)

    def _keep_trend(self, estimate: Estimate) -> None:
        trend = self._trends.setdefault((estimate.rotor, estimate.quantity), deque(maxlen=TRAIL))
        if not trend or not 0.0 <= estimate.t - trend[-1][0] < 1.0:
            trend.append((estimate.t, estimate.value))

    def _keep_trail(self, second: int, failed: tuple[float, ...]) -> None:
        """Keep the most of each second."""
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
        rotors: tuple[RotorShot, ...] = ()
        if frame is not None:
            rotors = tuple(self._rotor(watched, frame, k, silent, alarmed) for k in range(len(frame.rotors)))
        return VehicleShot(
            name=watched.vehicle,
            title=_title(watched),
            mode=mode_name(watched.autopilot, watched.custom_mode),
            armed=watched.phase.armed,
            landed=watched.phase.landed,
            t=watched.last_t,
            us=watched.last_us,
            silent=silent,
            since=self._since,
            rotors=rotors,
            unusable=watched.geometry.unusable() or watched.geometry.missing(),
            airframe=f"{frame.name} from {frame.source.value}" if frame is not None else "",
            warnings=frame.warnings if frame is not None else (),
            absorbed=watched.absorbed,
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
        figures = tuple(self._figure(watched, each) for each in watched.latest if each.rotor == k)
        gone = f"nothing heard for {silent:.0f} s" if silent > SILENT else ""
        state, level, sure = _state(verdict)
        if level is not Level.FAILED and rotor.motor in alarmed:
            state, level = alarmed[rotor.motor], Level.FAILED
        why = _why(verdict, figures)
        if gone:  # whatever was known, it is not known now
            why = gone
            figures = tuple(replace(f, value=NAN, std=NAN, detectable=NAN, why=gone) for f in figures)
            if level is not Level.FAILED:
                state, level = UNKNOWN, Level.UNKNOWN
        telemetry = watched.rotors.state(rotor.esc, t)
        stale = bool(gone) or telemetry in (RotorState.STALE, RotorState.NOT_REPORTED)
        return RotorShot(
            motor=rotor.motor,
            seat=self._seat(frame, k),
            position=rotor.position,
            spin=rotor.spin,
            level=level,
            state=state,
            probability=sure,
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

    def _seat(self, frame: Airframe, k: int) -> str:
        if self._seated is not frame:  # worked out once: it takes all pairs of rotors
            self._seated = frame
            self._seats = tuple(frame.seat(each) for each in range(len(frame.rotors)))
        return self._seats[k]

    def _figure(self, watched: VehicleMonitor, estimate: Estimate) -> Figure:
        together: tuple[int, ...] = ()
        if Reason.NOT_IDENTIFIABLE in estimate.reasons and watched.airframe is not None:
            alike = [
                watched.airframe.rotors[other.rotor].motor
                for other in watched.latest
                if (other.estimator, other.quantity) == (estimate.estimator, estimate.quantity)
                and Reason.NOT_IDENTIFIABLE in other.reasons
            ]
            together = (
                tuple(alike) if 1 < len(alike) < len(watched.airframe.rotors) else ()
            )  # all = no evidence
        trend = self._trends.get((estimate.rotor, estimate.quantity))
        change = NAN
        if trend and trend[-1][0] - trend[0][0] >= 20.0:
            change = 60.0 * (trend[-1][1] - trend[0][1]) / (trend[-1][0] - trend[0][0])
        return Figure(
            estimate.estimator,
            estimate.quantity.value,
            estimate.value,
            estimate.std,
            estimate.failure_probability,
            estimate.status.value,
            "; ".join(REASON_TEXT[reason] for reason in estimate.reasons),
            estimate.detectable,
            together,
            change,
            words(estimate.evidence) if estimate.quantity is Quantity.UNBALANCE else "",
        )

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
        return blind_map(rate, FASTER * fastest, self._filter)


def blind_map(rate: float, fastest: float, what: ImuFilter) -> tuple[tuple[float, float], ...]:
    """Return (rotor speed [rad/s], what is left of its 1/rev line [-]) at this sample rate [Hz]."""
    import numpy as np

    config = RecommendedConfig()
    corner = config.highpass_filtered if what.cutoff == what.cutoff else config.highpass
    omega = np.linspace(0.0, fastest, BLIND_POINTS + 1)[1:]
    gain = what.gain(omega) * highpass_gain(omega, corner, 1.0 / rate)
    return tuple(zip(omega.tolist(), gain.tolist(), strict=True))


def _state(verdict: Verdict | None) -> tuple[str, Level, float]:
    """Return the state in words, its level and how sure it is; as the alert has it while the kind is not clear."""
    if verdict is None:
        return UNKNOWN, Level.UNKNOWN, NAN
    if verdict.state == UNKNOWN:
        return UNKNOWN, Level.UNKNOWN, verdict.probability
    if verdict.kind is Kind.HEALTHY:
        return verdict.state, Level.OK, verdict.probability
    if verdict.kind not in FAILED:
        return verdict.state, Level.WARN, verdict.probability
    if verdict.probability < CLEAR_KIND * verdict.failed:
        return "rotor failed", Level.FAILED, verdict.failed
    return verdict.state, Level.FAILED, verdict.probability


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
