"""Evidence packets: each replays to the alert that it was saved for."""

import json
import random
import resource
import zipfile
from pathlib import Path

import pytest
from recorded import FLIGHT, alerts, feed, two_flights

from gcs_health.cli import main
from gcs_health.pipeline import MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.record.evidence import EvidenceWriter
from gcs_health.record.recorder import Recorder

VEHICLE = """\
schema = "gcs_health.vehicle/1"
name = "Parrot Bebop 2"
[[rotor]]
motor = 1
position = [0.0875, 0.115, 0.0]
spin = "ccw"
[[rotor]]
motor = 2
position = [-0.0875, -0.115, 0.0]
spin = "ccw"
[[rotor]]
motor = 3
position = [0.0875, -0.115, 0.0]
spin = "cw"
[[rotor]]
motor = 4
position = [-0.0875, 0.115, 0.0]
spin = "cw"
"""


def replayed(packet: Path, *options: str) -> list[dict[str, object]]:
    out = packet.parent / "again.jsonl"
    assert main(["replay", str(packet), "--jsonl", str(out), *options]) == 0
    return [line for line in map(json.loads, out.read_text().splitlines()) if line["type"] == "alert"]


def said(packet: Path) -> dict[str, object]:
    with zipfile.ZipFile(packet) as inside:
        return json.loads(inside.read("packet.json"))["alert"]


def test_a_packet_of_a_replay_replays_to_the_same_alert(tmp_path: Path) -> None:
    assert main(["replay", str(FLIGHT), "--evidence", str(tmp_path / "e")]) == 0
    (packet,) = (tmp_path / "e").iterdir()  # nothing else is left behind
    assert packet.name == "lost_propeller-ROTOR_FAILED-motor3-1.1-1.zip"
    assert replayed(packet)[0] == said(packet)


def test_an_unpacked_packet_replays_too(tmp_path: Path) -> None:
    main(["replay", str(FLIGHT), "--evidence", str(tmp_path / "e")])
    (packet,) = (tmp_path / "e").iterdir()
    with zipfile.ZipFile(packet) as inside:
        inside.extractall(tmp_path / "unpacked")
    assert replayed(tmp_path / "unpacked")[0] == said(packet)


def test_a_raw_stream_without_stamps_gives_a_packet_that_replays(tmp_path: Path) -> None:
    from recorded import records

    raw = tmp_path / "flight.rlog"
    raw.write_bytes(b"".join(frame for _, frame in records(FLIGHT.read_bytes())))
    main(["replay", str(raw), "--evidence", str(tmp_path / "e")])
    (packet,) = (tmp_path / "e").iterdir()
    assert replayed(packet)[0] == said(packet)


def test_recording_saves_a_packet_by_itself_of_the_second_flight_too(tmp_path: Path) -> None:
    """The estimators have learned from the first flight: it must be in the packet of the second."""
    recorder = Recorder(str(tmp_path / "record"))
    writer = EvidenceWriter(tmp_path / "record", lambda: recorder.flights, None, {}, {}, {})
    events = feed(two_flights(), MonitorConfig(raw_tap=recorder.write))
    writer.take(events)
    recorder.close()
    writer.close()
    (packet,) = writer.written
    with zipfile.ZipFile(packet) as inside:
        manifest = json.loads(inside.read("packet.json"))
    assert manifest["flights"] == [path.name for path in recorder.flights]
    assert manifest["left_out"] == []
    alert, *_ = alerts(events)
    again, *_ = replayed(packet)
    assert (again["t"], again["motor"], again["probability"]) == (alert.t, alert.motor, alert.probability)


def test_live_recording_leaves_packets_beside_it(tmp_path: Path) -> None:
    record = tmp_path / "f.tlog"
    assert main(["live", f"file://{FLIGHT}", "--record", str(record)]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "f-ROTOR_FAILED-motor3-1.1-1.zip",
        "f.jsonl",
        "f.tlog",
    ]
    assert record.read_bytes() == FLIGHT.read_bytes()
    packet = tmp_path / "f-ROTOR_FAILED-motor3-1.1-1.zip"
    assert replayed(packet)[0] == said(packet)


def test_a_packet_holds_the_configuration_and_uses_it(tmp_path: Path) -> None:
    vehicle = tmp_path / "bebop.toml"
    vehicle.write_text(VEHICLE)
    options = ["--vehicle", str(vehicle), "--mode", "paper", "--estimators", "effectiveness"]
    main(["replay", str(FLIGHT), "--evidence", str(tmp_path / "e"), *options])
    packets = sorted((tmp_path / "e").iterdir())
    assert packets
    for packet in packets:
        with zipfile.ZipFile(packet) as inside:
            assert inside.read("vehicle.toml").decode() == vehicle.read_text()
            manifest = json.loads(inside.read("packet.json"))
        assert manifest["configuration"]["mode"] == "paper"
        assert {"gcs_health", "numpy", "python"} <= set(manifest["versions"])
        assert said(packet) in replayed(packet)
    page = tmp_path / "packet.html"
    assert main(["report", str(packets[0]), "-o", str(page)]) == 0
    assert "Parrot Bebop 2" in page.read_text()


def event(t: float, kind: str = "raised", id: str = "1.1-1") -> AlertEvent:
    return AlertEvent(t, int(t * 1e6), "1.1", id, "ROTOR_FAILED", 0, 1, kind, 1, 0.9, "text", {})


def test_a_packet_waits_for_what_follows_unless_the_vehicle_falls_silent(tmp_path: Path) -> None:
    flight = tmp_path / "f.tlog"
    flight.write_bytes(b"x" * 100)
    writer = EvidenceWriter(tmp_path / "e", lambda: [flight], None, {}, {}, {})
    writer.take([event(100.0)])
    flight.write_bytes(b"x" * 200)
    writer.take([event(104.0, "updated")])
    writer.poll(int(109.9e6))
    writer.poll(int(110e6))
    writer.close()
    with zipfile.ZipFile(writer.written[0]) as inside:
        assert len(inside.read("flight.tlog")) == 200
        assert [s["state"] for s in json.loads(inside.read("packet.json"))["steps"]] == ["raised", "updated"]
    assert not writer.notices


def test_the_earliest_flights_are_left_out_where_they_are_too_many(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs_health.record.evidence.EARLIER_MOST", 250)
    flights = [tmp_path / f"{k}.tlog" for k in range(4)]
    for flight in flights:
        flight.write_bytes(b"x" * 100)
    writer = EvidenceWriter(tmp_path / "e", lambda: flights, None, {}, {}, {})
    writer.take([event(100.0)])
    writer.close()
    with zipfile.ZipFile(writer.written[0]) as inside:
        manifest = json.loads(inside.read("packet.json"))
    assert (manifest["flights"], manifest["left_out"]) == (["1.tlog", "2.tlog", "3.tlog"], ["0.tlog"])


def test_a_packet_that_cannot_be_saved_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    writer = EvidenceWriter(tmp_path / "e", lambda: [tmp_path], None, {}, {}, {})
    writer.take([event(100.0)])
    writer.close()
    assert "evidence was not saved" in writer.notices[0]
    assert not list((tmp_path / "e").iterdir())
    (tmp_path / "file").write_text("")
    assert main(["replay", str(FLIGHT), "--evidence", str(tmp_path / "file")]) == 2
    assert "cannot save evidence there" in capsys.readouterr().err


def test_a_full_disk_is_told_and_leaves_no_half_packet(tmp_path: Path) -> None:
    flight = tmp_path / "f.tlog"
    flight.write_bytes(random.Random(1).randbytes(3 << 20))  # does not compress
    writer = EvidenceWriter(tmp_path / "e", lambda: [flight], None, {}, {}, {})
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, before[1]))
    try:
        writer.take([event(100.0)])
        writer.close()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert writer.notices == [f"{tmp_path / 'e'}: evidence was not saved: File too large"]
    assert not list((tmp_path / "e").iterdir())


@pytest.mark.parametrize(
    ("member", "text", "complaint"),
    [
        ("packet.json", "{", "is no JSON"),
        ("packet.json", '{"schema": "other/1"}', "expected 'gcs_health.evidence/1', got 'other/1'"),
        ("notes.txt", "hello", "expected one log (.tlog, .tlog.raw, .rlog, .ulg, .bin) in it, found 0"),
    ],
)
def test_a_zip_that_is_no_packet_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], member: str, text: str, complaint: str
) -> None:
    path = tmp_path / "odd.zip"
    with zipfile.ZipFile(path, "w") as out:
        out.writestr(member, text)
    assert main(["replay", str(path)]) == 2
    assert complaint in capsys.readouterr().err


def test_a_damaged_packet_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["replay", str(FLIGHT), "--evidence", str(tmp_path / "e")])
    (packet,) = (tmp_path / "e").iterdir()
    data = bytearray(packet.read_bytes())
    data[len(data) // 2] ^= 0xFF
    packet.write_bytes(data)
    capsys.readouterr()
    assert main(["replay", str(packet)]) == 2
    assert "cannot read on" in capsys.readouterr().err
