"""Live sessions behind the screen: what the pipeline's side hears, obeys and records."""

import argparse
import io
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from gcs_health.cli import _parser, live
from gcs_health.cli.dashboard import Session as ScreenSession
from gcs_health.cli.dashboard import run as run_screen
from gcs_health.cli.monitoring import Output
from gcs_health.cli.web import command
from gcs_health.dashboard import commands as c
from gcs_health.dashboard.interface import Worker
from gcs_health.dashboard.snapshot import Entry, Level, Snapshot
from gcs_health.dashboard.watch import Watch
from gcs_health.errors import ConfigError
from gcs_health.mavlink.backlog import Packet
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.samples import FlightReading

FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"
FRAMES = list(FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT.read_bytes()).raw())
START = FRAMES[0][0]
S = 1_000_000  # µs


class Air:
    """Links that give the flight at its own stamps, at once, and keep what is sent."""

    def __init__(
        self, frames: list[tuple[int, bytes]], source: Callable[[int], str] = lambda k: "udp 1"
    ) -> None:
        self.notices: list[str] = []
        self.sent: list[bytes] = []
        self._frames, self._source = frames, source

    def packets(self, tick: float = 0.2) -> Iterator[Packet]:
        for k, (stamp, frame) in enumerate(self._frames):
            yield Packet(self._source(k), frame, stamp)
        yield Packet("", b"", self._frames[-1][0] + 4 * S)

    def rest(self) -> Iterator[Packet]:
        yield from ()

    def send(self, data: bytes) -> None:
        self.sent.append(data)


class Desk(Worker):
    """A worker without a thread: keeps all pictures, and gives a command at a time of the flight."""

    def __init__(self, *wishes: tuple[int, Callable[[Snapshot], c.Command]]) -> None:
        super().__init__(lambda worker: None)
        self.shown: list[Snapshot] = []
        self._wishes = list(wishes)

    def publish(self, snapshot: Snapshot) -> None:
        self.shown.append(snapshot)
        while self._wishes and snapshot.us - START >= self._wishes[0][0]:
            self.send(self._wishes.pop(0)[1](snapshot))


def flown(air: Air, desk: Desk, jsonl: str | None = None) -> tuple[Watch, list[str]]:
    notices: list[str] = []
    watch = Watch(desk, io.StringIO(), notices, ("udpin://here",))
    with Output(jsonl, **watch.outputs()) as output:
        tap, raw = watch.taps(None)
        session = live.Session(Monitor(MonitorConfig(tap=tap, raw_tap=raw)), output, air, False, watch)  # type: ignore[arg-type]
        session.listen(None)
        session.close()
    return watch, notices


@pytest.fixture(scope="module")
def whole() -> tuple[Air, list[Snapshot]]:
    """The whole flight, undisturbed."""
    air, desk = Air(FRAMES), Desk()
    flown(air, desk)
    return air, desk.shown


EARLY = [(stamp, frame) for stamp, frame in FRAMES if stamp - START < 5_500_000]


def of_alerts(shown: Snapshot) -> list[Entry]:
    return [entry for entry in shown.entries if entry.kind == "alert"]


def test_pictures_come_ten_a_second_and_tell_the_flight(whole: tuple[Air, list[Snapshot]]) -> None:
    _, shown = whole
    length = (FRAMES[-1][0] - START) / S
    assert 9.0 * length <= len(shown) <= 10.0 * length + 2
    assert shown[0].waiting or shown[0].vehicles
    last = shown[-2]
    (alert,) = of_alerts(last)
    assert (alert.code, alert.motor, alert.open) == ("PROPELLER_LOST", 3, True)
    craft = last.vehicles[0]
    assert (craft.title, craft.mode, craft.armed) == ("PX4 4 rotors", "POSCTL", True)
    assert {rotor.motor: rotor.level for rotor in craft.rotors}[3] is Level.FAILED
    assert craft.imu_rate == pytest.approx(100.0, rel=0.05)
    assert dict(craft.messages)["ESC_STATUS"] == pytest.approx(50.0, rel=0.1)
    assert craft.loss == 0.0


def test_a_silent_link_makes_all_unknown_but_keeps_the_alarm(whole: tuple[Air, list[Snapshot]]) -> None:
    last = whole[1][-1].vehicles[0]  # the empty packet, four seconds later
    assert last.stale
    assert {rotor.motor: rotor.level for rotor in last.rotors} == {
        1: Level.UNKNOWN, 2: Level.UNKNOWN, 3: Level.FAILED, 4: Level.UNKNOWN,
    }  # fmt: skip
    assert all(rotor.speed != rotor.speed for rotor in last.rotors)
    assert not any(figure.known for rotor in last.rotors for figure in rotor.figures)


def test_the_operators_deeds_are_events_too(tmp_path: Path) -> None:
    at = 13 * S
    desk = Desk(
        (at, lambda shown: c.Acknowledge(of_alerts(shown)[0].key)),
        (at, lambda shown: c.Shelve(of_alerts(shown)[0].key, 600.0)),
    )
    lines = tmp_path / "events.jsonl"
    flown(Air(FRAMES), desk, str(lines))
    states = [
        json.loads(line)["state"] for line in lines.read_text().splitlines() if '"type":"alert"' in line
    ]
    assert states[:1] == ["raised"]
    assert {"acknowledged", "shelved"} <= set(states)
    (alert,) = of_alerts(desk.shown[-2])
    assert alert.acknowledged
    assert alert.shelved(desk.shown[-2].vehicles[0].t)


def test_nothing_is_sent_until_the_operator_confirmed(whole: tuple[Air, list[Snapshot]]) -> None:
    assert whole[0].sent == []
    air = Air(EARLY)
    desk = Desk((5 * S, lambda shown: c.RequestRates("1.1")))
    _, notices = flown(air, desk)
    before = next(shown for shown in desk.shown if shown.us - START >= 5 * S)
    assert before.vehicles[0].requests
    assert len(air.sent) == len(before.vehicles[0].requests.split(", "))
    assert f"asked 1.1 for {before.vehicles[0].requests}" in notices
    assert any("asked 1.1 for" in entry.text for entry in desk.shown[-1].entries)


def test_two_links_that_speak_for_one_vehicle_at_once_are_shown() -> None:
    desk = Desk()
    flown(Air(EARLY, lambda k: f"udp {k // 7 % 2}"), desk)
    assert set(desk.shown[-2].vehicles[0].sources) == {"udp 0", "udp 1"}
    alone = Desk()
    half = START + S
    flown(Air(EARLY, lambda k: "udp 1" if FRAMES[k][0] < half else "udp 2"), alone)
    assert alone.shown[-2].vehicles[0].sources == ("udp 2",)  # it only came back by another port


def test_a_reboot_is_told_and_another_airframe_forgets_the_estimates_of_the_last() -> None:
    again = [(stamp + 20 * S, frame) for stamp, frame in FRAMES if stamp - START < S]
    desk = Desk()
    watch, _ = flown(Air([*EARLY, *again]), desk)
    assert any("rebooted" in entry.text for entry in desk.shown[-1].entries)
    assert watch.model.monitor is not None
    (vehicle,) = watch.model.monitor.vehicles()
    assert vehicle.airframe is not None
    assert vehicle.latest
    vehicle._adopt(replace(vehicle.airframe, rotors=vehicle.airframe.rotors[:3]))
    watch.model.tap(vehicle.vehicle, FlightReading(1e3, True, False))  # a row falls due
    assert vehicle.latest == []
    assert len(watch.model.snapshot(desk.shown[-1].us).vehicles[0].rotors) == 3


def options(*arguments: str) -> argparse.Namespace:
    return _parser().parse_args(arguments)


def until(true: Callable[[], bool], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_session_over_udp_records_and_closes_its_recording_when_the_screen_is_left(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    record = tmp_path / "flight.tlog"
    session = ScreenSession(
        options("live", f"udpin://127.0.0.1:{port}", "--record", str(record), "--history", "none")
    )
    worker = Worker(session.job)
    worker.start()
    shown: list[Snapshot] = []

    def seen() -> Snapshot | None:
        shown.extend(filter(None, [worker.take()]))
        return shown[-1] if shown else None

    until(lambda: seen() is not None)
    over = threading.Event()

    def fly() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as to:
            for _, frame in FRAMES[:400]:
                to.sendto(frame, ("127.0.0.1", port))
                time.sleep(0.001)
        over.set()

    threading.Thread(target=fly, daemon=True).start()
    whole = sum(8 + len(frame) for _, frame in FRAMES[:400])
    until(lambda: over.is_set() and bool(seen()) and shown[-1].link.recorded == whole)
    worker.stop()
    assert worker.error is None
    assert shown[-1].link.recording == (str(record),)
    recorded = FrameDecoder(default_dialect(), stamped=True).feed(record.read_bytes())
    assert len(recorded) == 400
    assert record.with_suffix(".jsonl").exists()
    assert "vehicle 1.1" in session.text.getvalue()


def test_files_are_shown_and_stay_until_the_operator_leaves() -> None:
    session = ScreenSession(options("live", f"file://{FLIGHT}", "--history", "none"))
    worker = Worker(session.job)
    worker.start()
    shown: list[Snapshot] = []

    def ended() -> bool:
        shown.extend(filter(None, [worker.take()]))
        return bool(shown and shown[-1].ended)

    until(ended)
    assert of_alerts(shown[-1])[0].code == "PROPELLER_LOST"
    worker.stop()
    assert "ROTOR_FAILED raised" in session.text.getvalue()


def test_a_replay_writes_what_a_plain_replay_writes(tmp_path: Path) -> None:
    from gcs_health.cli import main

    plain, screen = tmp_path / "plain.jsonl", tmp_path / "screen.jsonl"
    assert main(["replay", str(FLIGHT), "--jsonl", str(plain)]) == 0
    session = ScreenSession(
        options("replay", str(FLIGHT), "--dashboard", "--jsonl", str(screen), "--fail-on-alert")
    )
    worker = Worker(session.job)
    worker.start()
    worker.stop()  # left at once: what was asked for is done to the end
    assert worker.error is None
    assert session.code == 3
    assert screen.read_bytes() == plain.read_bytes()
    assert "ROTOR_FAILED raised" in session.text.getvalue()


def test_an_endpoint_that_cannot_be_opened_is_one_clear_line() -> None:
    session = ScreenSession(options("live", "tcpout://127.0.0.1:9", "--history", "none"))
    worker = Worker(session.job)
    worker.start()
    worker.stop()
    assert "127.0.0.1:9" in str(worker.error)


def test_what_does_not_go_together_is_told() -> None:
    with pytest.raises(ConfigError, match="--plain"):
        run_screen(options("demo", "--dashboard", "--jsonl", "-"))
    with pytest.raises(ConfigError, match="one flight at a time"):
        run_screen(options("replay", "a.tlog", "b.tlog", "--dashboard"))
    with pytest.raises(ConfigError, match="name a file"):
        run_screen(options("replay", "-", "--dashboard"))


def test_the_browsers_session_is_the_command_without_web() -> None:
    said = ["live", "udpin://0.0.0.0:1", "--web", "9000", "--record", "a b"]
    assert command(said).endswith(" -m gcs_health live udpin://0.0.0.0:1 --record 'a b' --dashboard")
    assert command(["demo", "--web"]).endswith(" -m gcs_health demo --dashboard")
    assert command(["demo", "--web=9000", "--speed", "2"]).endswith(" demo --speed 2 --dashboard")
