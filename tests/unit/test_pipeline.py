"""The whole flow: determinism, chunking, several vehicles, what is said and when."""

import json
import struct
from itertools import pairwise
from pathlib import Path

import jsonschema
import pytest
from pymavlink.dialects.v20 import common as mavlink

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.airframe_tables import ardupilot_frame
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import (
    SCHEMA,
    AlertEvent,
    EstimateEvent,
    Event,
    SummaryEvent,
    VehicleEvent,
    lines,
)

ROOT = Path(__file__).parents[2]
FLIGHT = (ROOT / "replay" / "lost_propeller.tlog").read_bytes()
TRUTH = json.loads((ROOT / "replay" / "lost_propeller.truth.json").read_text())["truth"]
START_US = 1_700_000_000_000_000


def replay(data: bytes, chunk: int | None = None, **options: object) -> list[Event]:
    monitor = Monitor(MonitorConfig(stamped=True, **options))  # type: ignore[arg-type]
    events: list[Event] = []
    for at in range(0, len(data), chunk or len(data)):
        events += monitor.feed(data[at : at + (chunk or len(data))])
    return events + monitor.finish()


def record(t: float, message: object, link: object) -> bytes:
    frame = message.pack(link)  # type: ignore[attr-defined]
    link.seq = (link.seq + 1) % 256  # type: ignore[attr-defined]
    return struct.pack(">Q", START_US + round(t * 1e6)) + frame


def heartbeat(kind: int = 2, autopilot: int = 12) -> object:
    return mavlink.MAVLink_heartbeat_message(kind, autopilot, 129, 0, 4, 3)


def test_the_shipped_flight_names_the_lost_propeller_soon_and_nothing_else() -> None:
    alerts = [e for e in replay(FLIGHT) if isinstance(e, AlertEvent)]
    assert [(a.state, a.code, a.motor, a.rotor) for a in alerts] == [
        ("raised", "ROTOR_FAILED", TRUTH["rotor"], TRUTH["rotor"] - 1),
        ("escalated", "PROPELLER_LOST", TRUTH["rotor"], TRUTH["rotor"] - 1),
    ]
    assert 0.0 < alerts[0].t - TRUTH["vehicle_time_s"] < 0.15
    assert alerts[0].probability > 0.9
    assert "front left" in alerts[0].text
    assert len(alerts[0].text) <= 80


def test_paper_mode_finds_it_too() -> None:
    alerts = [e for e in replay(FLIGHT, mode="paper") if isinstance(e, AlertEvent)]
    assert alerts
    assert alerts[0].motor == TRUTH["rotor"]
    assert 0.0 < alerts[0].t - TRUTH["vehicle_time_s"] < 0.3


@pytest.mark.parametrize("chunk", [1, 7, 4096])
def test_any_chunking_gives_identical_lines(chunk: int) -> None:
    whole = list(lines(replay(FLIGHT)))
    # a byte at a time is slow: the flight's end, where the propeller leaves, is what matters
    part = FLIGHT[-60_000:] if chunk == 1 else FLIGHT
    reference = list(lines(replay(part))) if chunk == 1 else whole
    assert list(lines(replay(part, chunk))) == reference
    assert len(reference) > 20


def test_two_runs_give_identical_lines() -> None:
    assert list(lines(replay(FLIGHT))) == list(lines(replay(FLIGHT)))


def test_a_stream_of_datagrams_gives_the_same_alerts_as_its_log() -> None:
    from gcs_health.mavlink.dialect import default_dialect
    from gcs_health.mavlink.frames import FrameDecoder

    raw: list[tuple[int, bytes]] = []
    live = Monitor(MonitorConfig(raw_tap=lambda batch: raw.extend(batch.raw())))
    events: list[Event] = []
    for stamp, frame in FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT).raw():
        events += live.feed(frame, stamp, "udp 10.0.0.2:14550")
    events += live.finish()
    recorded = b"".join(struct.pack(">Q", at) + frame for at, frame in raw)
    assert recorded == FLIGHT
    alerts = [e for e in events if isinstance(e, AlertEvent)]
    assert alerts == [e for e in replay(recorded) if isinstance(e, AlertEvent)]
    assert alerts


def test_every_line_follows_the_published_schema() -> None:
    schema = json.loads((ROOT / "docs" / "reference" / "events.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    validator = jsonschema.Draft202012Validator(schema)
    written = [json.loads(line) for line in lines(replay(FLIGHT))]
    assert written[0]["schema"] == SCHEMA
    assert {line["type"] for line in written} == {
        "vehicle",
        "estimate",
        "verdict",
        "alert",
        "condition",
        "summary",
    }
    for line in written:
        validator.validate(line)
    with pytest.raises(jsonschema.ValidationError):
        validator.validate({**written[0], "vehicle": "one"})


def test_estimates_come_at_most_at_the_rate_asked_for() -> None:
    for rate in (2.0, 10.0):
        estimates = [e for e in replay(FLIGHT, estimate_rate=rate) if isinstance(e, EstimateEvent)]
        times = sorted({e.t for e in estimates if e.rotor == 0})
        assert len(times) == pytest.approx(13.0 * rate, rel=0.1)
        assert min(b - a for a, b in pairwise(times)) > 0.5 / rate


def test_two_vehicles_in_one_stream_are_kept_apart() -> None:
    first = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    second = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    data = b""
    for k in range(8):
        data += record(k, heartbeat(), first) + record(k + 0.1, heartbeat(13, 3), second)
        data += record(k + 0.2, heartbeat(6, 8), station)
    events = replay(data)
    summaries = [e for e in events if isinstance(e, SummaryEvent)]
    assert [s.vehicle for s in summaries] == ["1.1", "7.1"]
    assert [len(s.rotors) for s in summaries] == [4, 6]  # assumed from MAV_TYPE
    assert any("assumed" in note for note in summaries[1].notes)


def test_a_stream_without_rotor_speeds_or_imu_says_so_within_five_seconds() -> None:
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    data = b"".join(record(k, heartbeat(), link) for k in range(7))
    notices = [e for e in replay(data) if isinstance(e, VehicleEvent) and e.change == "notice"]
    assert len(notices) == 2
    assert all(e.t_unix_us <= START_US + 5_000_000 for e in notices)
    assert "param1=105" in notices[0].text
    assert "param1=291" in notices[1].text


def test_silence_alone_brings_the_same_notices() -> None:
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    monitor = Monitor(MonitorConfig())
    for k in range(4):  # unstamped messages alone: the vehicle's clock stays unknown, two seconds pass
        monitor.feed(heartbeat().pack(link), START_US + k * 1_000_000)  # type: ignore[attr-defined]
    assert not monitor.poll(START_US + 3_500_000)
    said = monitor.poll(START_US + 5_000_000)
    assert [e.change for e in said if isinstance(e, VehicleEvent)] == ["notice", "notice"]
    assert not monitor.poll(START_US + 6_000_000)


def test_a_plane_is_no_multirotor() -> None:
    link = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    data = b"".join(record(k, heartbeat(1, 3), link) for k in range(7))
    (summary,) = [e for e in replay(data) if isinstance(e, SummaryEvent)]
    assert not summary.rotors
    assert any("not a multirotor" in note for note in summary.notes)


def test_the_users_airframe_goes_before_the_parameters() -> None:
    found = ardupilot_frame(1, 0)
    assert found is not None
    mine = Airframe("mine", found[1], AirframeSource.FILE)
    events = replay(FLIGHT[:40_000], airframe=mine)
    frames = {e.airframe["name"] for e in events if isinstance(e, VehicleEvent) and e.airframe}
    assert frames == {"mine"}


def test_the_survey_counts_every_system_and_names_what_is_missing() -> None:
    vehicle = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
    data = b"".join(
        record(k, heartbeat(), vehicle) + record(k + 0.5, heartbeat(6, 8), station) for k in range(10)
    )
    monitor = Monitor(MonitorConfig(stamped=True))
    monitor.feed(data)
    survey = monitor.survey()
    assert [(s.system, s.component, s.role) for s in survey.systems] == [
        (1, 1, "vehicle"),
        (255, 190, "ground station"),
    ]
    assert survey.systems[1].messages[0].count == 10
    assert survey.systems[1].messages[0].rate == pytest.approx(1.0)
    missing = [need.input.value for need in survey.vehicles[0].needs["effectiveness"] if not need.met]
    assert missing == ["accelerations and rates", "rotor speeds", "airframe geometry", "landed state"]
