"""Events and readings → frozen snapshots: what the pipeline's side of the screen remembers, all of it bounded."""

from collections.abc import Callable, Iterable

from gcs_health.dashboard.alerts_model import EntryBook
from gcs_health.dashboard.link_model import LinkBook
from gcs_health.dashboard.snapshot import LinkShot, Snapshot, VehicleShot
from gcs_health.dashboard.vehicle_model import VehicleModel
from gcs_health.mavlink.batch import FrameBatch
from gcs_health.pipeline import Monitor
from gcs_health.record.events import AlertEvent, AutopilotEvent, Event, VehicleEvent
from gcs_health.samples import Reading
from gcs_health.vehicle_monitor import VehicleMonitor

Recording = Callable[[], tuple[tuple[str, ...], int]]


class Model:
    """Hears all of one monitor: wire `tap` and `frames` into its configuration, hand its events to `take`.

    Parameters
    ----------
    endpoints : as the user spelled them.
    recording : gives the files recorded so far, and their bytes.
    can_ask : whether there is a vehicle at the other end that could be asked for message rates.
    """

    def __init__(
        self,
        endpoints: tuple[str, ...] = (),
        recording: Recording = lambda: ((), 0),
        can_ask: bool = False,
    ) -> None:
        self.monitor: Monitor | None = None
        self.source = ""  # whose bytes are being fed
        self._endpoints = endpoints
        self.recording = recording
        self._vehicles: dict[str, VehicleModel] = {}
        self.entries = EntryBook()
        self._link = LinkBook(can_ask)

    def copy(self, monitor: Monitor) -> "Model":
        """Return one that goes on by itself, beside a copy of the monitor."""
        other = Model(self._endpoints, self.recording)
        other.monitor = monitor
        other._vehicles = {name: vehicle.copy() for name, vehicle in self._vehicles.items()}
        other.entries = self.entries.copy()
        other._link = self._link.copy()
        return other

    def tap(self, vehicle: str, reading: Reading) -> None:
        """Hear what reaches the estimators."""
        model = self._vehicles.get(vehicle)
        if model is None:
            model = self._vehicles[vehicle] = VehicleModel()
        if model.read(reading) and self.monitor is not None:
            for watched in self.monitor.vehicles():
                if watched.vehicle == vehicle:
                    model.keep_row(watched)

    def frames(self, batch: FrameBatch) -> None:
        """Hear all frames, of `source`."""
        self._link.hear(batch, self.source)

    def take(self, events: Iterable[Event]) -> None:
        """Hear what the monitor says."""
        for event in events:
            if isinstance(event, AlertEvent):
                self.entries.alert(event)
            elif isinstance(event, AutopilotEvent):
                self.entries.autopilot(event)
            elif isinstance(event, VehicleEvent):
                self.entries.vehicle(event)

    def note(self, text: str, us: int) -> None:
        """Hear a notice of the links, the recorder or a sink."""
        self.entries.notice(text, us)

    def snapshot(self, us: int, ended: str = "") -> Snapshot:
        """Return the picture at UNIX µs `us`."""
        assert self.monitor is not None
        self._link.look(self.monitor, us)
        vehicles = tuple(self._shot(watched, us, ended) for watched in self.monitor.vehicles())
        entries = self.entries.shots({name: model.rows for name, model in self._vehicles.items()})
        files, recorded = self.recording()
        link = LinkShot(self._link.counters, files, recorded, self._endpoints)
        waiting = (
            "" if vehicles else "listening" if not self._link.heard else "MAVLink, but of no vehicle yet"
        )
        return Snapshot(us, vehicles, entries, link, None, ended, waiting)

    def _shot(self, watched: VehicleMonitor, us: int, ended: str) -> VehicleShot:
        model = self._vehicles.setdefault(watched.vehicle, VehicleModel())
        silent = 0.0 if ended else max(us - watched.last_us, 0) * 1e-6
        failed = self.entries.failed_motors(watched.vehicle)
        shot = model.shot(watched, silent, failed)
        return self._link.complete(shot, us)
