"""What a recording holds, whatever happens to the process or the disk."""

import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from recorded import FLIGHT, alerts, feed, records, two_flights

from gcs_health.cli import main
from gcs_health.errors import ConfigError
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.append_file import WAITING_MOST, AppendFile
from gcs_health.record.events import AlertEvent
from gcs_health.record.recorder import Recorder

SECOND = 1_000_000


@contextmanager
def files_no_longer_than(size: int) -> Iterator[None]:
    """A disk that is full at `size` bytes a file."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def replayed(path: Path) -> list[AlertEvent]:
    monitor = Monitor(MonitorConfig(stamped=True))
    return alerts(monitor.feed(path.read_bytes()) + monitor.finish())


def test_a_full_disk_is_told_once_and_nothing_is_torn_when_it_has_room_again(tmp_path: Path) -> None:
    file = AppendFile(tmp_path / "f")
    file.append(b"a" * 700, 0)
    with files_no_longer_than(1000):
        for k in range(5):
            file.append(bytes([k]) * 200, k * SECOND)
        assert (tmp_path / "f").stat().st_size == 1000
        assert file.waiting == 700
    file.append(b"z", 4 * SECOND + 1)  # less than a second after the last attempt
    assert file.waiting == 701
    file.retry(5 * SECOND)
    file.close()
    assert (tmp_path / "f").read_bytes() == b"a" * 700 + b"".join(bytes([k]) * 200 for k in range(5)) + b"z"
    assert [notice.split(": ", 1)[1] for notice in file.notices] == [
        "cannot write: File too large; trying again",
        "written again, 0 bytes lost",
    ]


def test_what_waits_for_a_full_disk_is_bounded_and_what_is_lost_is_told(tmp_path: Path) -> None:
    file = AppendFile(tmp_path / "f")
    with files_no_longer_than(10):
        file.append(b"a" * WAITING_MOST, 0)
        file.append(b"b" * 100, SECOND)
        assert (file.waiting, file.lost) == (WAITING_MOST - 10, 100)
    file.append(b"c", 3 * SECOND)
    file.append(b"d", 4 * SECOND)
    file.close()
    assert file.path.stat().st_size == WAITING_MOST + 2
    assert file.path.read_bytes().endswith(b"acd")  # whole appends are left out, never parts of one
    assert file.notices[-1].endswith("100 bytes were not written")


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A folder on a file system of its own that is nearly full."""
    place = tmp_path / "small"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(place)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip(f"a small file system cannot be mounted here: {mounted.stderr.decode().strip()}")
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)


def test_live_goes_on_when_the_disk_fills(small_disk: Path, capfd: pytest.CaptureFixture[str]) -> None:
    code = main(["live", f"file://{FLIGHT}", "--record", str(small_disk / "f.tlog"), "--fail-on-alert"])
    shown = capfd.readouterr()
    assert code == 3
    assert "ROTOR_FAILED raised: motor 3" in shown.out
    assert shown.err.count("f.tlog: cannot write: No space left on device; trying again") == 1
    assert "bytes were not written" in shown.err
    kept = records((small_disk / "f.tlog").read_bytes())
    assert kept == records(FLIGHT.read_bytes())[: len(kept)]
    assert len(kept) > 100


def test_live_under_a_limit_of_file_size_tells_it_and_goes_on(tmp_path: Path) -> None:
    """The same without the right to mount: no file of the process may grow beyond 50 kB."""
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "gcs_health",
            "live",
            f"file://{FLIGHT}",
            "--record",
            str(tmp_path / "f.tlog"),
        ],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, 50_000)),
    )
    assert done.returncode == 0, done.stderr
    assert "ROTOR_FAILED raised: motor 3" in done.stdout
    assert done.stderr.count("f.tlog: cannot write: File too large; trying again") == 1
    assert (tmp_path / "f.tlog").read_bytes() == FLIGHT.read_bytes()[:50_000]


def test_json_lines_on_a_full_disk_are_told_once_and_never_stop_the_alerts(
    small_disk: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = small_disk / "out.jsonl"
    assert main(["live", f"file://{FLIGHT}", "--jsonl", str(out), "--fail-on-alert"]) == 3
    shown = capfd.readouterr()
    assert "ROTOR_FAILED raised: motor 3" in shown.out
    assert shown.err.count("out.jsonl: cannot write: No space left on device; trying again") == 1
    assert shown.err.count("bytes were not written") == 1
    out.unlink()
    assert main(["replay", str(FLIGHT), "--jsonl", str(out)]) == 2  # not all that was asked for


_KILLED = """
import os, signal, sys
from recorded import FLIGHT, records
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.recorder import Recorder
recorder = Recorder(sys.argv[1])
monitor = Monitor(MonitorConfig(raw_tap=recorder.write))
for k, (stamp, frame) in enumerate(records(FLIGHT.read_bytes())):
    recorder.take(monitor.feed(frame, stamp))
    if k == 1500:
        os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_killed_process_leaves_every_frame_it_took_and_every_event(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    done = subprocess.run(
        [sys.executable, "-c", _KILLED, str(path)],
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])},
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    sent = records(FLIGHT.read_bytes())[:1501]
    assert records(path.read_bytes()) == sent
    lines = [json.loads(line) for line in path.with_suffix(".jsonl").read_text().splitlines()]
    assert lines[0]["schema"] == "gcs_health.events/1"
    assert lines[-1]["t_unix_us"] > sent[-1][0] - SECOND


def test_a_frame_is_on_disk_before_it_is_decoded(tmp_path: Path) -> None:
    recorder = Recorder(str(tmp_path / "f.tlog"))
    monitor = Monitor(MonitorConfig(raw_tap=recorder.write))

    def fails(_: object) -> None:
        raise ZeroDivisionError

    monitor._messages.samples = fails  # type: ignore[method-assign, assignment]
    stamp, frame = records(FLIGHT.read_bytes())[0]
    with pytest.raises(ZeroDivisionError):
        monitor.feed(frame, stamp)
    assert records((tmp_path / "f.tlog").read_bytes()) == [(stamp, frame)]
    recorder.close()


@pytest.mark.parametrize("folder", [True, False])
def test_every_flight_has_a_file_that_stands_by_itself(tmp_path: Path, folder: bool) -> None:
    session = two_flights()
    recorder = Recorder(str(tmp_path if folder else tmp_path / "day.tlog"))
    events = feed(session, MonitorConfig(raw_tap=recorder.write))
    recorder.close()
    names = [path.name for path in recorder.flights]
    stamped = ["20231114T221325Z-1.tlog", "20231114T221346Z-2.tlog"]
    assert names == (stamped if folder else ["day.tlog", "day-2.tlog"])
    first, second = (records(path.read_bytes()) for path in recorder.flights)
    arming = next(k for k, r in enumerate(session) if r == second[-(len(session) - len(first))])
    assert first == session[:arming]
    head, rest = second[: arming - len(session)], second[arming - len(session) :]
    assert rest == session[arming:]
    assert {frame[7] for _, frame in head} == {0, 22}  # the last HEARTBEAT and the parameters
    assert {stamp for stamp, _ in head} == {rest[0][0]}
    said = alerts(events)
    assert [(a.code, a.motor, a.state) for a in said] == [
        ("ROTOR_FAILED", 3, "raised"),
        ("PROPELLER_LOST", 3, "escalated"),
    ]
    alone = replayed(recorder.flights[1])  # its geometry is in the head of the file
    assert [(a.code, a.motor) for a in alone] == [("ROTOR_FAILED", 3), ("PROPELLER_LOST", 3)]
    assert not replayed(recorder.flights[0])


def test_the_folder_of_a_session_replays_to_the_very_same_alerts(tmp_path: Path) -> None:
    recorder = Recorder(str(tmp_path))
    said = alerts(feed(two_flights(), MonitorConfig(raw_tap=recorder.write)))
    recorder.close()
    out = tmp_path / "again.jsonl"
    assert main(["replay", str(tmp_path), "--jsonl", str(out)]) == 0
    again = [x for x in map(json.loads, out.read_text().splitlines()) if x["type"] == "alert"]
    assert [(a.t, a.t_unix_us, a.code, a.motor, a.probability) for a in said] == [
        (x["t"], x["t_unix_us"], x["code"], x["motor"], x["probability"]) for x in again
    ]


def test_the_arming_of_another_vehicle_does_not_cut_a_flight_in_two(tmp_path: Path) -> None:
    from gcs_health.mavlink.encoder import Encoder

    one, two = Encoder(default_dialect(), 1), Encoder(default_dialect(), 2)

    def beat(encoder: Encoder, armed: bool) -> bytes:
        return encoder.frame("HEARTBEAT", type=2, autopilot=12, base_mode=128 * armed, mavlink_version=3)

    recorder = Recorder(str(tmp_path))
    decoder = FrameDecoder(default_dialect(), stamped=False)
    steps = [(one, True), (two, True), (one, False), (one, True), (two, False), (one, False), (two, True)]
    for k, (encoder, armed) in enumerate(steps):
        recorder.write(decoder.feed(beat(encoder, armed), 1_700_000_000_000_000 + k * SECOND))
    recorder.close()
    assert [len(records(path.read_bytes())) for path in recorder.flights] == [6, 2 + 1]


def test_a_ground_station_that_is_armed_is_no_flight(tmp_path: Path) -> None:
    from gcs_health.mavlink.encoder import Encoder

    station = Encoder(default_dialect(), 255, 190)
    recorder = Recorder(str(tmp_path))
    decoder = FrameDecoder(default_dialect(), stamped=False)
    for k in range(6):
        frame = station.frame("HEARTBEAT", type=6, autopilot=8, base_mode=128 * (k % 2), mavlink_version=3)
        recorder.write(decoder.feed(frame, 1_700_000_000_000_000 + k))
    recorder.close()
    assert len(recorder.flights) == 1


def test_nothing_is_overwritten_and_a_place_that_cannot_be_is_told(tmp_path: Path) -> None:
    (tmp_path / "f.jsonl").write_text("precious")
    with pytest.raises(ConfigError, match="exists already"):
        Recorder(str(tmp_path / "f.tlog"))
    assert not (tmp_path / "f.tlog").exists()
    (tmp_path / "file").write_text("")
    with pytest.raises(ConfigError, match="cannot record there"):
        Recorder(str(tmp_path / "file" / "folder"))
