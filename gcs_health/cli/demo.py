"""`gcs-health demo`: a simulated vehicle over loopback UDP into the real `live` pipeline."""

import argparse
import socket
import subprocess
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING

from gcs_health.cli import DONE, INTERRUPTED
from gcs_health.cli.live import Session
from gcs_health.cli.monitoring import Output, make_monitor
from gcs_health.cli.receivers import evidence_of, sinks_of
from gcs_health.errors import GcsHealthError
from gcs_health.mavlink.endpoints import Links
from gcs_health.mavlink.spellings import parse_endpoint
from gcs_health.record.events import AlertEvent, EstimateEvent, Event
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.telemetry import BOOTED
from gcs_health.survey import Survey

if TYPE_CHECKING:
    from gcs_health.dashboard.watch import Watch

HOST = "127.0.0.1"
LOSSY = 0.02  # share of messages lost on a loopback link from which on a computer does not keep up
SKIP = 2.0  # s of standing about that a newcomer need not watch: until it climbs


def run(options: argparse.Namespace, watch: "Watch | None" = None) -> int:
    """Fly the scenario in a process of its own, listen to it, and compare with the truth.

    `watch` is the dashboard's.
    """
    scenario = load_scenario(options.scenario, options.set)
    length = (scenario.trajectory.duration - SKIP) / options.speed
    about = f"{scenario.about} It flies {length:.0f} s, over UDP on this computer"
    if watch is None:
        print(f"{about}; Ctrl-C ends it.", flush=True)
    else:
        watch.tell(about)
    code = DONE
    with (
        evidence_of(options, "demo") as (receivers, raw_tap),
        Output(
            options.jsonl, [*receivers, *sinks_of(options)], **(watch.outputs() if watch else {})
        ) as output,
    ):
        tap, raw_tap = watch.taps(raw_tap) if watch else (None, raw_tap)
        monitor = make_monitor(options, stamped=False, raw_tap=raw_tap, tap=tap)
        links, port = _listen()
        with links:
            vehicle = _start(options, port, quiet=watch is not None)
            told = Told(output)
            session = Session(monitor, told, links, request=False, watch=watch)  # type: ignore[arg-type]
            try:
                session.listen(None, Landed(vehicle))
                if watch is not None:
                    why = _why_unseen(monitor.survey())
                    truth = " ".join(told.verdict(fault, why) for fault in scenario.faults)
                    watch.linger(f"the flight is over. {truth}")
            except KeyboardInterrupt:
                code = INTERRUPTED
            finally:
                vehicle.terminate()
                vehicle.wait()
                session.close()
        left = watch is not None and watch.stopping  # before the vehicle had landed
        if code == DONE and vehicle.returncode and not left:
            raise GcsHealthError(f"the simulated vehicle ended with code {vehicle.returncode}")
        for fault in scenario.faults:
            print(told.verdict(fault, _why_unseen(monitor.survey())), file=output.text)
    return code


class Landed:
    """Whether the vehicle's process has ended, and what it sent last has had a moment to be heard."""

    def __init__(self, vehicle: "subprocess.Popen[bytes]") -> None:
        self._vehicle = vehicle
        self._looks = 0

    def __call__(self) -> bool:
        """See the class."""
        self._looks += self._vehicle.poll() is not None
        return self._looks > 2


class Told:
    """An `Output` that also remembers the alerts, to compare them with the truth."""

    def __init__(self, output: Output) -> None:
        self._output = output
        self._raised: list[AlertEvent] = []
        self._heard = 0.0  # until then [s, vehicle clock]

    def write(self, events: list[Event], *, at_once: bool) -> None:
        """See `Output.write`."""
        self._raised += [
            event for event in events if isinstance(event, AlertEvent) and event.state == "raised"
        ]
        self._heard = max([self._heard, *(e.t for e in events if isinstance(e, EstimateEvent))])
        self._output.write(events, at_once=at_once)

    def poll(self, now_us: int) -> None:
        """See `Output.poll`."""
        self._output.poll(now_us)

    @property
    def tell(self) -> Callable[[str], None]:
        """See `Output.tell`."""
        return self._output.tell

    def verdict(self, fault: Fault, why_unseen: str) -> str:
        """Say in a sentence whether a fault was found, and how fast; if not, why."""
        at, motor = BOOTED + float(fault.at), int(fault.rotor) + 1
        what = f"the truth: {fault.kind.replace('_', ' ')} on motor {motor} at {at:.3f} s"
        for event in self._raised:
            if event.t >= at:
                right = (
                    "right"
                    if event.motor == motor
                    else f"but it named motor {event.motor}"
                    if event.motor
                    else "but it named none"
                )
                return f"{what}; alert {(event.t - at) * 1e3:.0f} ms later, {right}"
        if self._heard < at:
            return f"{what}; no alert: nothing that was heard came later than {self._heard:.1f} s"
        return f"{what}; no alert: {why_unseen}"


def _why_unseen(survey: Survey) -> str:
    """Return what most likely kept a fault of the vehicle from being seen."""
    lost = sum(system.lost for system in survey.systems if system.role == "vehicle")
    sent = lost + sum(system.frames for system in survey.systems if system.role == "vehicle")
    if lost > LOSSY * sent:
        share = f"{lost} of {sent} messages were lost on the way"
        return f"{share}, this computer does not keep up; a smaller --speed helps"
    return (
        "it is smaller than this telemetry shows (the summary says what would be seen), or came on the ground"
    )


def _listen() -> tuple[Links, int]:
    """Return a link on a port that nobody else has, and the port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    return Links([parse_endpoint(f"udpin://{HOST}:{port}")]), port


def _start(options: argparse.Namespace, port: int, quiet: bool) -> "subprocess.Popen[bytes]":
    command = [sys.executable, "-m", "gcs_health", "simulate", options.scenario]
    command += ["--to", f"udpout://{HOST}:{port}", "--speed", str(options.speed), "--skip", str(SKIP)]
    for change in options.set:
        command += ["--set", change]
    where = subprocess.DEVNULL if quiet else None  # a dashboard has the terminal
    return subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=where, stderr=where)
