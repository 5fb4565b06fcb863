"""What of a session's events is kept of a flight, and what a flight is."""

import math
from pathlib import Path

import pytest
from recorded import feed, two_flights

from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import EstimateEvent, VehicleEvent
from gcs_health.record.flight_results import FlightCollector, FlightRecord

BEGAN = 1_780_000_000_000_000  # 2026-05-28


def collected(*monitored: list[object]) -> list[FlightRecord]:
    collector = FlightCollector()
    ended: dict[str, FlightRecord] = {}
    for events in monitored:
        for each in collector.feed(events):  # type: ignore[arg-type]
            ended[each.identity] = each
    return list(ended.values())


def test_a_session_of_two_flights_is_two_flights() -> None:
    session = two_flights()
    one, two = collected(feed(session, MonitorConfig()))  # type: ignore[arg-type]
    assert (one.started_us, two.started_us) == (1700000006104000, 1700000026104000)
    assert [row.status for row in one.results if row.quantity == "effectiveness"].count("unobservable") == 0
    assert not one.alerts
    assert [(a.code, a.motor) for a in two.alerts] == [("PROPELLER_LOST", 3)]
    # time on the ground between them belongs to neither
    assert one.duration < 9.0


def test_a_vehicle_on_the_ground_has_flown_nothing() -> None:
    encoder = Encoder(default_dialect())
    frames = [
        (BEGAN + k * 1_000_000, encoder.frame("HEARTBEAT", type=2, autopilot=12, mavlink_version=3))
        for k in range(20)
    ]
    assert not collected(feed(frames, MonitorConfig()))  # type: ignore[arg-type]


def test_mean_spread_and_worst_are_those_of_the_valid_estimates() -> None:
    def estimate(t: float, value: float, status: str, p: float) -> EstimateEvent:
        return EstimateEvent(t, 1, "1.1", "e", 0, 1, "drag", value, 0.3, p, status, (), math.nan)

    said = [
        VehicleEvent(0.0, 5, "1.1", "flight", "armed", armed=True),
        estimate(1.0, 9.0, "converging", 0.5),
        estimate(2.0, 1.0, "valid", 0.1),
        estimate(3.0, 2.0, "valid", 0.2),
        estimate(4.0, math.nan, "unobservable", math.nan),
        VehicleEvent(5.0, 6, "1.1", "flight", "disarmed", armed=False),
    ]
    (flight,) = FlightCollector().feed(said)
    (row,) = flight.results
    assert (row.value, row.std, row.samples, row.valid, row.status) == (
        1.5,
        pytest.approx(0.3),
        4,
        2,
        "unobservable",
    )
    assert row.spread == pytest.approx(math.sqrt(0.5))
    assert (row.worst, row.worst_t, row.worst_probability) == (9.0, 1.0, 0.5)


def test_the_uid_tells_a_vehicle_by_its_hardware(tmp_path: Path) -> None:
    encoder = Encoder(default_dialect())
    monitor = Monitor(MonitorConfig())
    said = []
    for fields, uid in (
        ({"uid": 0xAB}, "00000000000000ab"),
        ({"uid": 1, "uid2": [0] * 17 + [7]}, "00" * 17 + "07"),
    ):
        monitor.feed(encoder.frame("HEARTBEAT", type=2, autopilot=12, mavlink_version=3), BEGAN)
        said += monitor.feed(encoder.frame("AUTOPILOT_VERSION", **fields), BEGAN + 3_000_000)
        assert [e.uid for e in said if isinstance(e, VehicleEvent)][-1] == uid
