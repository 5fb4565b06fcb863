"""`gcs-health live`: listen, tell at once, record if asked."""

import argparse
import signal
import sys
from collections.abc import Callable
from types import FrameType

from gcs_health.airframe import AirframeSource
from gcs_health.cli import ALERT, DONE, INTERRUPTED
from gcs_health.cli.monitoring import Output, make_monitor
from gcs_health.cli.receivers import live_receivers
from gcs_health.mavlink.endpoints import Links
from gcs_health.mavlink.mavsdk_link import MavsdkLinks
from gcs_health.mavlink.requests import RateRequests
from gcs_health.mavlink.spellings import Endpoint, parse_endpoint
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor

LISTEN_FIRST_US = 2_000_000  # to a vehicle before it is asked for more
SILENT_US = 5_000_000  # until we say that nothing was heard


def run(options: argparse.Namespace) -> int:
    """Listen until interrupted or for `--duration`; then print the summary."""
    endpoints = [parse_endpoint(text) for text in options.endpoints]
    files = [endpoint for endpoint in endpoints if endpoint.kind == "file"]
    make_monitor(options, stamped=False)  # what is wrong with the options is told before a file is made
    with (
        Output(options.jsonl) as output,
        _open(options, [e for e in endpoints if e not in files]) as links,
        live_receivers(options) as (receivers, raw_tap),
        output.joined_by(receivers),
    ):
        monitor = make_monitor(options, stamped=False, raw_tap=raw_tap)
        session = Session(monitor, output, links, options.request_rates)
        signal.signal(signal.SIGTERM, _interrupt)
        code = DONE
        try:
            session.read_files(files)
            if len(files) < len(endpoints):
                session.listen(options.duration)
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
    ) -> None:
        self._monitor = monitor
        self._output = output
        self._links = links
        self._requests = RateRequests() if request else None
        self._asked: set[str] = set()
        self._met: dict[str, int] = {}  # when each vehicle was first seen
        self._heard = False
        self._warned = False

    def read_files(self, files: list[Endpoint]) -> None:
        """Feed endpoints that are files, as `replay` does."""
        for endpoint in files:
            with open_log(endpoint.host) as log:
                for block in log.blocks():
                    events = self._monitor.feed(block, 0, endpoint.text, log.stamped)
                    self._output.write(events, at_once=True)

    def listen(self, duration: float | None, over: Callable[[], bool] = lambda: False) -> None:
        """Take packets until `duration` [s] is over, or `over` when nothing waits; else for ever."""
        started: int | None = None
        for packet in self._links.packets():
            started = packet.receive_us if started is None else started
            if packet.data:
                self._heard = True
                events = self._monitor.feed(packet.data, packet.receive_us, packet.source)
            else:
                events = self._monitor.poll(packet.receive_us)
            self._output.write(events, at_once=True)
            self._output.poll(packet.receive_us)
            self._tell(packet.receive_us - started)
            self._ask(packet.receive_us)
            if duration is not None and packet.receive_us - started >= duration * 1e6:
                return
            if not packet.data and over():
                return

    def close(self) -> None:
        """End of the session: the rest, and the summaries."""
        self._output.write(self._monitor.finish(), at_once=True)

    def _tell(self, since_start_us: int) -> None:
        for notice in self._links.notices:
            print(f"gcs-health: {notice}", file=sys.stderr, flush=True)
        self._links.notices.clear()
        if since_start_us >= SILENT_US and not self._warned and not self._monitor.vehicles():
            self._warned = True
            heard = "MAVLink of no vehicle" if self._heard else "nothing"
            print(
                f"gcs-health: {heard} heard for {since_start_us / 1e6:.0f} s; is the vehicle sending to this "
                "endpoint, and does no other program hold its port?",
                file=sys.stderr,
                flush=True,
            )

    def _ask(self, now_us: int) -> None:
        if self._requests is None:
            return
        for vehicle in self._monitor.vehicles():
            if vehicle.vehicle in self._asked or vehicle.autopilot is None:
                continue
            met = self._met.setdefault(vehicle.vehicle, now_us)
            if now_us - met < LISTEN_FIRST_US:
                continue  # what it sends already need not be asked for
            self._asked.add(vehicle.vehicle)
            system, component = map(int, vehicle.vehicle.split("."))
            heard = self._monitor.rates(system, component, now_us)
            known = vehicle.airframe is not None and vehicle.airframe.source is not AirframeSource.ASSUMED
            frames, said = self._requests.to(
                system, component, vehicle.autopilot, heard, known, vehicle.uid is not None
            )
            for frame in frames:
                self._links.send(frame)
            if frames:
                print(f"gcs-health: asked {vehicle.vehicle} for {said}", file=sys.stderr, flush=True)
