"""`gcs-health live`: listen, tell at once, record if asked."""

import argparse
import signal
from collections.abc import Callable
from types import FrameType
from typing import TYPE_CHECKING

from gcs_health.cli import ALERT, DONE, INTERRUPTED
from gcs_health.cli.monitoring import Output, make_monitor
from gcs_health.cli.receivers import live_receivers
from gcs_health.mavlink.endpoints import Links
from gcs_health.mavlink.mavsdk_link import MavsdkLinks
from gcs_health.mavlink.requests import RateRequests
from gcs_health.mavlink.spellings import Endpoint, parse_endpoint
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, requests_to
from gcs_health.record.events import Event
from gcs_health.record.recorder import Recorder
from gcs_health.vehicle_monitor import VehicleMonitor

if TYPE_CHECKING:
    from gcs_health.dashboard.watch import Watch

LISTEN_FIRST_US = 2_000_000  # to a vehicle before it is asked for more
SILENT_US = 5_000_000  # until we say that nothing was heard


def run(options: argparse.Namespace, watch: "Watch | None" = None) -> int:
    """Listen until interrupted or for `--duration`; then print the summary. `watch` is the dashboard's."""
    endpoints = [parse_endpoint(text) for text in options.endpoints]
    files = [endpoint for endpoint in endpoints if endpoint.kind == "file"]
    make_monitor(options, stamped=False)  # what is wrong with the options is told before a file is made
    with (
        Output(options.jsonl, **(watch.outputs() if watch else {})) as output,
        _open(options, [e for e in endpoints if e not in files]) as links,
        live_receivers(options) as (receivers, raw_tap),
        output.joined_by(receivers),
    ):
        tap, raw_tap = watch.taps(raw_tap) if watch else (None, raw_tap)
        for receiver in receivers:
            if watch is not None and options.record and isinstance(receiver, Recorder):
                watch.recorded(receiver.flights)
        monitor = make_monitor(options, stamped=False, raw_tap=raw_tap, tap=tap)
        session = Session(monitor, output, links, options.request_rates, watch)
        if watch is None:  # a dashboard's screen has the signals
            signal.signal(signal.SIGTERM, _interrupt)
        code = DONE
        try:
            session.read_files(files)
            if len(files) < len(endpoints):
                session.listen(options.duration)
            if watch is not None and options.duration is None:
                watch.linger("all files are read; q quits")
        except KeyboardInterrupt:
            code = INTERRUPTED
        finally:
            session.close()
        if code == DONE and options.fail_on_alert and output.raised:
            return ALERT
    return code


def _open(options: argparse.Namespace, endpoints: list[Endpoint]) -> Links | MavsdkLinks:
    if options.backend == "mavsdk":
        return MavsdkLinks(endpoints)
    return Links(endpoints)


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


class Session:
    """One run of `live`: record first, decode second, tell at once."""

    def __init__(
        self,
        monitor: Monitor,
        output: Output,
        links: Links | MavsdkLinks,
        request: bool,
        watch: "Watch | None" = None,
    ) -> None:
        self._monitor = monitor
        self._output = output
        self._links = links
        self._watch = watch
        self._requests = RateRequests() if request or watch is not None else None
        self._request = request
        self._asked: set[str] = set()
        self._met: dict[str, int] = {}  # when each vehicle was first seen
        self._heard = False
        self._warned = False
        if watch is not None:
            watch.begin(monitor, self.ask)

    def read_files(self, files: list[Endpoint]) -> None:
        """Feed endpoints that are files, as `replay` does."""
        for endpoint in files:
            with open_log(endpoint.host) as log:
                for block in log.blocks():
                    self._take(self._monitor.feed(block, 0, endpoint.text, log.stamped), 0)
                    if self._watch is not None and self._watch.stopping:
                        return

    def listen(self, duration: float | None, over: Callable[[], bool] = lambda: False) -> None:
        """Take packets until `duration` [s] is over, or `over` when nothing waits; else for ever."""
        started: int | None = None
        for packet in self._links.packets(0.2 if self._watch is None else 0.1):
            started = packet.receive_us if started is None else started
            if packet.data:
                self._heard = True
                if self._watch is not None:
                    self._watch.source = packet.source
                events = self._monitor.feed(packet.data, packet.receive_us, packet.source)
            else:
                events = self._monitor.poll(packet.receive_us)
            self._take(events, packet.receive_us)
            if self._watch is not None and self._watch.stopping:
                return
            self._output.poll(packet.receive_us)
            self._tell(packet.receive_us - started)
            self._ask(packet.receive_us)
            if duration is not None and packet.receive_us - started >= duration * 1e6:
                return
            if not packet.data and over():
                return

    def _take(self, events: list[Event], now_us: int) -> None:
        if self._watch is not None:
            events = events + self._watch.heard(events, now_us)
        self._output.write(events, at_once=True)

    def close(self) -> None:
        """End of the session: what is not worked off yet, and the summaries."""
        for packet in self._links.rest():
            self._take(self._monitor.feed(packet.data, packet.receive_us, packet.source), packet.receive_us)
        self._output.write(self._monitor.finish(), at_once=True)

    def _tell(self, since_start_us: int) -> None:
        for notice in self._links.notices:
            self._output.tell(notice)
        self._links.notices.clear()
        if since_start_us >= SILENT_US and not self._warned and not self._monitor.vehicles():
            self._warned = True
            heard = "MAVLink of no vehicle" if self._heard else "nothing"
            self._output.tell(
                f"{heard} heard for {since_start_us / 1e6:.0f} s; is the vehicle sending to this "
                "endpoint, and does no other program hold its port?"
            )

    def _ask(self, now_us: int) -> None:
        if not self._request:
            return
        for vehicle in self._monitor.vehicles():
            if vehicle.vehicle in self._asked or vehicle.autopilot is None:
                continue
            met = self._met.setdefault(vehicle.vehicle, now_us)
            if now_us - met < LISTEN_FIRST_US:
                continue  # what it sends already need not be asked for
            self._asked.add(vehicle.vehicle)
            self.ask(vehicle, now_us)

    def ask(self, vehicle: VehicleMonitor, now_us: int) -> None:
        """Ask a vehicle for what comes too seldom."""
        assert self._requests is not None
        frames, said = requests_to(self._requests, self._monitor, vehicle, now_us)
        for frame in frames:
            self._links.send(frame)
        if frames:
            self._output.tell(f"asked {vehicle.vehicle} for {said}")
