"""Listening live: endpoints, recording, and that nothing is sent unless asked."""

import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_health.cli import main
from gcs_health.mavlink.backlog import Backlog, Packet
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.endpoints import Links
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.spellings import parse_endpoint

FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"


@pytest.mark.parametrize(
    ("text", "kind", "host", "port"),
    [
        ("udpin://0.0.0.0:14550", "udpin", "0.0.0.0", 14550),
        ("udpin:127.0.0.1:14551", "udpin", "127.0.0.1", 14551),
        ("udp:127.0.0.1:14551", "udpin", "127.0.0.1", 14551),
        ("udpin://:14540", "udpin", "0.0.0.0", 14540),
        ("udpout://10.0.0.1:14550", "udpout", "10.0.0.1", 14550),
        ("udpin://[::1]:14550", "udpin", "::1", 14550),
        ("tcp:10.0.0.1:5760", "tcpout", "10.0.0.1", 5760),
        ("tcpout://10.0.0.1:5760", "tcpout", "10.0.0.1", 5760),
        ("tcpin://0.0.0.0:5760", "tcpin", "0.0.0.0", 5760),
        ("serial:///dev/ttyUSB0:921600", "serial", "/dev/ttyUSB0", 921600),
        ("/dev/ttyACM0,115200", "serial", "/dev/ttyACM0", 115200),
        ("/dev/ttyACM0", "serial", "/dev/ttyACM0", 57600),
        ("COM3:57600", "serial", "COM3", 57600),
        ("file:///somewhere/flight.tlog", "file", "/somewhere/flight.tlog", 0),
    ],
)
def test_both_families_of_spellings_are_understood(text: str, kind: str, host: str, port: int) -> None:
    assert parse_endpoint(text)[:3] == (kind, host, port)


def test_tcp_is_heard_and_a_dropped_link_is_told_once_and_comes_back() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        with Links([parse_endpoint(f"tcpout://127.0.0.1:{port}")]) as links:
            first, _ = server.accept()
            first.sendall(b"hello")
            packets = links.packets(0.02)
            assert next(p.data for p in packets if p.data) == b"hello"
            first.close()
            sources = set()
            second = None
            for packet in packets:
                if "link is back" in " ".join(links.notices) and second is None:
                    second, _ = server.accept()
                    second.sendall(b"again")
                if packet.data:
                    sources.add((packet.source, packet.data))
                    break
            assert second is not None
            second.close()
            assert sources == {(f"tcpout://127.0.0.1:{port} 2", b"again")}
            assert [n.split(": ", 1)[1][:9] for n in links.notices] == ["link lost", "link is b"]


def test_a_slow_moment_loses_nothing_and_what_waits_is_given_at_the_end() -> None:
    port = free_port()
    with (
        Links([parse_endpoint(f"udpin://127.0.0.1:{port}")]) as links,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender,
    ):
        sent = [f"{k}".encode() for k in range(3000)]
        got: list[bytes] = []
        packets = links.packets(0.02)
        for at in range(0, len(sent), 100):  # as many as any kernel holds
            for data in sent[at : at + 100]:
                sender.sendto(data, ("127.0.0.1", port))
            time.sleep(0.012)  # the reader is slow: it takes one, and more come meanwhile
            got += [next(p.data for p in packets if p.data)]
        got += [packet.data for packet in links.rest()]
        assert got == sent


def test_a_reader_that_is_late_is_told_so_once() -> None:
    backlog = Backlog()
    backlog.add(Packet("a", b"x", 1_000_000))
    assert backlog.notice(2_900_000) == ""
    assert "does not keep up" in backlog.notice(3_100_000)
    assert backlog.notice(9_000_000) == ""
    assert backlog.take() == Packet("a", b"x", 1_000_000)
    assert not backlog


@pytest.mark.parametrize(
    ("endpoint", "complaint"),
    [
        ("nonsense", "not an endpoint; expected one like udpin://0.0.0.0:14550"),
        ("udpin://0.0.0.0:99999", "a port up to 65535"),
        ("udpout://:14550", "expected a host to send to"),
        ("serial:///dev/absent:57600", "cannot open /dev/absent"),
        ("tcpout://127.0.0.1:1", "Connection refused"),
    ],
)
def test_an_endpoint_that_cannot_be_opened_is_told(
    capsys: pytest.CaptureFixture[str], endpoint: str, complaint: str
) -> None:
    assert main(["live", endpoint, "--duration", "0.1"]) == 2
    shown = capsys.readouterr().err
    assert shown.startswith(f"gcs-health: {endpoint}: ")
    assert complaint in shown
    assert shown.count("\n") == 1


def test_a_port_in_use_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        assert main(["live", f"udpin://127.0.0.1:{port}", "--duration", "0.1"]) == 2
    assert f"port {port} is in use" in capsys.readouterr().err


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def listen(port: int, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "gcs_health", "live", f"udpin://127.0.0.1:{port}", *options]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    for _ in range(400):
        if taken(port):
            return process
        time.sleep(0.05)
    raise AssertionError("the listener did not open its port")


def wait_until(holds: Callable[[], bool], limit: float = 30.0) -> None:
    """Give a busy machine its time."""
    for _ in range(round(limit / 0.05)):
        if holds():
            return
        time.sleep(0.05)
    raise AssertionError(f"not within {limit:.0f} s")


def taken(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return True
    return False


def send(port: int, data: bytes, speed: float) -> None:
    frames = list(FrameDecoder(default_dialect(), stamped=True).feed(data).raw())
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        before = frames[0][0]
        for stamp, frame in frames:
            time.sleep(max(0.0, min((stamp - before) * 1e-6 / speed, 0.05)))
            before = stamp
            out.sendto(frame, ("127.0.0.1", port))


def test_live_alerts_records_and_its_recording_replays_to_the_same(tmp_path: Path) -> None:
    port = free_port()
    lines, recording = tmp_path / "live.jsonl", tmp_path / "flight.tlog"
    process = listen(port, "--record", str(recording), "--jsonl", str(lines))
    send(port, FLIGHT.read_bytes(), speed=8.0)
    wait_until(lambda: '"type":"alert"' in lines.read_text())
    process.send_signal(signal.SIGINT)
    shown, complaints = process.communicate(timeout=20)
    assert process.returncode == 130, complaints
    assert "ROTOR_FAILED raised: motor 3" in shown
    assert "vehicle 1.1" in shown  # the summary, although interrupted
    again = tmp_path / "again.jsonl"
    assert main(["replay", str(recording), "--jsonl", str(again)]) == 0
    alerts = [[x for x in p.read_text().splitlines() if '"type":"alert"' in x] for p in (lines, again)]
    assert alerts[0] == alerts[1]
    assert sum('"state":"raised"' in line for line in alerts[0]) == 1


def test_live_sends_nothing_unless_asked(tmp_path: Path) -> None:
    for asked in (False, True):
        port = free_port()
        process = listen(port, "--duration", "4", *(["--request-rates"] if asked else []))
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
            vehicle.bind(("127.0.0.1", 0))
            vehicle.settimeout(3.5)
            for _, frame in list(
                FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT.read_bytes()).raw()
            )[:60]:
                vehicle.sendto(frame, ("127.0.0.1", port))
            heard = b""
            try:
                while True:
                    heard += vehicle.recv(2048)
            except TimeoutError:
                pass
        _, complaints = process.communicate(timeout=20)
        commands = [
            f for f in FrameDecoder(default_dialect(), stamped=False).feed(heard).frames if f.message == 76
        ]
        assert bool(commands) is asked
        assert ("asked 1.1 for ESC_STATUS 10 Hz" in complaints) is asked
        assert bool(heard) is asked


def test_a_killed_recording_loses_at_most_the_last_second(tmp_path: Path) -> None:
    port = free_port()
    recording = tmp_path / "flight.tlog"
    process = listen(port, "--record", str(recording))
    send(port, FLIGHT.read_bytes()[:60_000], speed=1.5)
    sent = list(FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT.read_bytes()[:60_000]).raw())
    process.kill()
    process.communicate(timeout=20)
    kept = list(FrameDecoder(default_dialect(), stamped=True).feed(recording.read_bytes()).raw())
    assert [frame for _, frame in kept] == [frame for _, frame in sent[: len(kept)]]
    # sent at 1.5 times real time: a second on this clock is 1.5 s of the flight's stamps
    assert sent[-1][0] - sent[len(kept) - 1][0] < 1.5e6


def test_a_file_is_an_endpoint_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["live", f"file://{FLIGHT}", "--fail-on-alert"]) == 3
    live = capsys.readouterr().out
    assert "garbage" not in live
    main(["replay", str(FLIGHT)])
    assert live.endswith(capsys.readouterr().out)


def test_a_recording_is_never_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    there = tmp_path / "flight.tlog"
    there.write_bytes(b"precious")
    assert (
        main(["live", f"udpin://127.0.0.1:{free_port()}", "--record", str(there), "--duration", "0.1"]) == 2
    )
    assert "exists already" in capsys.readouterr().err
    assert there.read_bytes() == b"precious"
