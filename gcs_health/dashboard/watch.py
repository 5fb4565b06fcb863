"""The pipeline's side of a live screen: hears all, obeys the operator, publishes ten pictures a second."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

from gcs_health.dashboard.commands import Acknowledge, Command, RequestRates, Shelve
from gcs_health.dashboard.interface import PICTURE_US, Worker
from gcs_health.dashboard.model import Model
from gcs_health.mavlink.batch import FrameBatch
from gcs_health.monitor_config import Tap
from gcs_health.pipeline import Monitor
from gcs_health.record.events import Event
from gcs_health.vehicle_monitor import VehicleMonitor

Ask = Callable[[VehicleMonitor, int], None]
RawTap = Callable[[FrameBatch], None]


class Watch:
    """Hooks for `cli.live.Session`.

    Parameters
    ----------
    text : where alerts and summaries go until the terminal is free again.
    notices : what else is to be told then.
    """

    def __init__(
        self,
        worker: Worker,
        text: TextIO,
        notices: list[str],
        endpoints: tuple[str, ...] = (),
        can_ask: bool = True,
    ) -> None:
        self.model = Model(endpoints, can_ask=can_ask)
        self._worker = worker
        self._text, self._notices = text, notices
        self._now_us = 0
        self._due = 0
        self._ask: Ask | None = None

    @property
    def stopping(self) -> bool:
        """Whether the operator has had enough."""
        return self._worker.stopping

    @property
    def source(self) -> str:
        """Whose bytes are being fed."""
        return self.model.source

    @source.setter
    def source(self, source: str) -> None:
        self.model.source = source

    def outputs(self) -> dict[str, Any]:
        """Return where an `Output` shall write what would spoil the screen."""
        return {"text": self._text, "tell": self.tell}

    def tell(self, notice: str) -> None:
        """Show a notice, and keep it for the terminal."""
        self._notices.append(notice)
        self.model.note(notice, self._now_us)

    def taps(self, raw_tap: RawTap | None) -> tuple[Tap, RawTap]:
        """Return what the monitor must call: a recorder's way in comes first."""
        if raw_tap is None:
            return self.model.tap, self.model.frames

        def both(batch: FrameBatch) -> None:
            raw_tap(batch)
            self.model.frames(batch)

        return self.model.tap, both

    def recorded(self, flights: list[Path]) -> None:
        """Show how much these files, which grow in number and length, hold."""

        def recording() -> tuple[tuple[str, ...], int]:
            paths = tuple(str(path) for path in flights)
            return paths, sum(os.stat(path).st_size for path in paths if os.path.exists(path))

        self.model.recording = recording

    def begin(self, monitor: Monitor, ask: Ask) -> None:
        """Take the monitor to be watched, and the way to ask its vehicles for message rates."""
        self.model.monitor = monitor
        self._ask = ask

    def heard(self, events: list[Event], now_us: int) -> list[Event]:
        """Take what was said until now [UNIX µs]; return what the operator's wishes cause."""
        self._now_us = now_us
        self.model.take(events)
        caused = self._obey()
        self.model.take(caused)
        if not self._due - PICTURE_US <= now_us < self._due:
            self._due = now_us + PICTURE_US
            self._worker.publish(self.model.snapshot(now_us))
        return caused

    def linger(self, ended: str) -> None:
        """Show the last picture until the operator has had enough."""
        while not self.stopping:
            self.model.take(self._obey())
            self._worker.publish(self.model.snapshot(self._now_us, ended))
            self._worker.rest(PICTURE_US * 1e-6)

    def _obey(self) -> list[Event]:
        caused: list[Event] = []
        for command in self._worker.commands():
            if isinstance(command, RequestRates):
                for vehicle in self._vehicles(command.vehicle):
                    if self._ask is not None:
                        self._ask(vehicle, self._now_us)
            else:
                caused += obey(self.model, command)
        return caused

    def _vehicles(self, name: str) -> list[VehicleMonitor]:
        assert self.model.monitor is not None
        return [vehicle for vehicle in self.model.monitor.vehicles() if vehicle.vehicle == name]


def obey(model: Model, command: Command) -> list[Event]:
    """Do what the operator wants of an alert; return what that causes."""
    if not isinstance(command, Acknowledge | Shelve) or model.monitor is None:
        return []
    name, _, number = command.alert.rpartition("-")
    for vehicle in model.monitor.vehicles():
        if vehicle.vehicle != name:
            continue
        if isinstance(command, Acknowledge):
            return vehicle.acknowledge(int(number))
        caused = vehicle.shelve(int(number), command.seconds)
        if not command.seconds:  # the event says "shelved" until now; the list says that it is over
            model.take(caused)
            model.entries.unshelve(command.alert)
            return []
        return caused
    return []
