"""What comes in: rates and losses of the last seconds, who speaks for whom, what could be asked for."""

from collections import deque
from dataclasses import replace
from typing import NamedTuple

from gcs_health.dashboard.snapshot import NAN, NeedShot, VehicleShot
from gcs_health.mavlink.batch import FrameBatch
from gcs_health.mavlink.requests import RateRequests
from gcs_health.pipeline import Monitor, requests_to
from gcs_health.survey import SystemSurvey
from gcs_health.vehicle_monitor import VehicleMonitor

LOOK_US = 1_000_000  # µs between looks
LOOKS = 6
AT_ONCE_US = 4_000_000  # µs within which two links that speak for one vehicle do so at the same time
HEARTBEAT = 0


class _Facts(NamedTuple):
    """What was found of one vehicle at the last look."""

    clock: tuple[str, ...]
    imu: str
    telemetry: tuple[str, ...]
    needs: tuple[NeedShot, ...]
    requests: str
    messages: tuple[tuple[str, float], ...]
    loss: float


class LinkBook:
    """Looks at the monitor's counters once a second."""

    def __init__(self, can_ask: bool = False) -> None:
        self.counters: tuple[tuple[str, int], ...] = ()
        self.heard = False
        self._can_ask = can_ask
        self._ask: RateRequests | None = None
        self._due = 0
        self._looks: deque[tuple[int, dict[str, SystemSurvey]]] = deque(maxlen=LOOKS)
        self._facts: dict[str, _Facts] = {}
        self._heard_by: dict[str, dict[str, int]] = {}

    def copy(self) -> "LinkBook":
        """Return one that goes on by itself; it is of a recording, which cannot be asked."""
        other = LinkBook()
        other.counters, other.heard, other._due = self.counters, self.heard, self._due
        other._looks = self._looks.copy()
        other._facts = dict(self._facts)
        return other

    def hear(self, batch: FrameBatch, source: str) -> None:
        """Note who sends heartbeats for whom."""
        self.heard = True
        if not batch.few:  # a log: one source
            return
        for frame in batch.frames:
            if frame.message == HEARTBEAT:
                name = f"{frame.system}.{frame.component}"
                self._heard_by.setdefault(name, {})[source] = frame.receive_us

    def look(self, monitor: Monitor, us: int) -> None:
        """Count, if a second is over."""
        if self._due - LOOK_US <= us < self._due:
            return
        if us < self._due:
            self._looks.clear()  # a replay went back
        self._due = us + LOOK_US
        survey = monitor.survey()
        self.counters = survey.counters
        self._looks.append((us, {f"{s.system}.{s.component}": s for s in survey.systems}))
        of = {vehicle.vehicle: vehicle for vehicle in monitor.vehicles()}
        for facts in survey.vehicles:
            needs = tuple(
                NeedShot(estimator, need.input.value, need.rate, need.wanted, need.met, need.remedy)
                for estimator, wanted in facts.needs.items()
                for need in wanted
            )
            messages, loss = self._received(facts.vehicle)
            asks = self._request(monitor, of[facts.vehicle], us) if self._can_ask else ""
            self._facts[facts.vehicle] = _Facts(
                facts.clock, facts.imu, facts.rotor_telemetry, needs, asks, messages, loss
            )

    def complete(self, shot: VehicleShot, us: int) -> VehicleShot:
        """Return the picture with what the last look found."""
        heard_by = self._heard_by.get(shot.name, {})
        sources = tuple(source for source, at in heard_by.items() if us - at < AT_ONCE_US)
        facts = self._facts.get(shot.name)
        if facts is None:
            return replace(shot, sources=sources)
        return replace(shot, sources=sources, **facts._asdict())

    def _received(self, name: str) -> tuple[tuple[tuple[str, float], ...], float]:
        """Return the message rates [Hz] and the loss [-] between the oldest look kept and the newest."""
        (then, old), (now, new) = self._looks[0], self._looks[-1]
        after, before = new.get(name), old.get(name)
        if after is None:
            return (), NAN
        if before is None or now <= then:
            return tuple((m.name, m.rate) for m in after.messages), NAN
        counts = {m.message: m.count for m in before.messages}
        seconds = (now - then) * 1e-6
        rates = [(m.name, (m.count - counts.get(m.message, 0)) / seconds) for m in after.messages]
        frames, lost = after.frames - before.frames, after.lost - before.lost
        return tuple(rates), lost / (frames + lost) if frames + lost > 0 else NAN

    def _request(self, monitor: Monitor, vehicle: VehicleMonitor, us: int) -> str:
        if self._ask is None:
            self._ask = RateRequests()
        return requests_to(self._ask, monitor, vehicle, us)[1]
