"""Real flights with known truth, read from beside the checkout; their licences keep them out of it.

The full table over all rates is `benchmarks/real_flights.md`; here is what must never break.
"""

import json
from pathlib import Path

import pytest

from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, Event, SummaryEvent
from gcs_health.vehicle_file import load_vehicle

DATA = Path(__file__).parents[2].parent / "shared" / "data"
FLIGHTS = sorted(path.stem for path in DATA.glob("*.tlog"))
VEHICLE = {"bebop2": "bebop2", "indiflight": "indiflight", "nanodrone": "nanodrone", "crazypad": "crazypad"}
QUADS = ("udesa_quad", "udesa_garage", "udesa_px4", "ardupilot", "px4_uavcan")

pytestmark = pytest.mark.skipif(not FLIGHTS, reason="the real flights are not beside this checkout")


def vehicle_of(flight: str) -> str | None:
    if flight.startswith(QUADS):
        return "quad_x"
    return VEHICLE.get(flight.split("_")[0])


def replay(flight: str, vehicle: str | None, mode: str = "recommended") -> list[Event]:
    airframe = load_vehicle(DATA / "vehicles" / f"{vehicle}.toml") if vehicle else None
    monitor = Monitor(MonitorConfig(stamped=True, airframe=airframe, mode=mode))
    data = (DATA / f"{flight}.tlog").read_bytes()
    events = [e for at in range(0, len(data), 1 << 18) for e in monitor.feed(data[at : at + (1 << 18)])]
    return events + monitor.finish()


def alerts(events: list[Event]) -> list[AlertEvent]:
    return [event for event in events if isinstance(event, AlertEvent)]


def start_us(flight: str) -> int:
    return int(json.loads((DATA / f"{flight}.truth.json").read_text())["start_unix_us"])


def test_the_ejection_is_rotor_2_and_in_time() -> None:
    first = alerts(replay("bebop2_prop_eject", "bebop2"))[0]
    assert (first.state, first.motor) == ("raised", 2)
    assert 12.24 < (first.t_unix_us - start_us("bebop2_prop_eject")) * 1e-6 <= 12.50


def test_the_papers_filter_finds_it_when_its_authors_code_does() -> None:
    first = alerts(replay("bebop2_prop_eject", "bebop2", "paper"))[0]
    assert (first.state, first.motor) == ("raised", 2)
    seconds = (first.t_unix_us - start_us("bebop2_prop_eject")) * 1e-6
    assert seconds == pytest.approx(12.503, abs=0.003)  # sheet 1, section 12


@pytest.mark.parametrize("flight", [f for f in FLIGHTS if f != "bebop2_prop_eject"])
def test_no_other_flight_alarms(flight: str) -> None:
    """None of these loses a rotor's thrust where rotor speeds are streamed."""
    events = replay(flight, vehicle_of(flight))
    assert not alerts(events)
    assert any(isinstance(event, SummaryEvent) for event in events)


@pytest.mark.parametrize(
    ("flight", "vehicle"),
    [
        ("indiflight_00267", "nanodrone"),
        ("indiflight_00230", "quad_x"),
        ("nanodrone_square_run1", "indiflight"),
        ("nanodrone_square_run3", "quad_x"),
        ("bebop2_prop_eject", "quad_x"),
    ],
)
def test_a_wrong_geometry_is_contradicted_and_names_no_rotor(flight: str, vehicle: str) -> None:
    events = replay(flight, vehicle)
    told = alerts(events)
    assert {alert.code for alert in told} <= {"MOTOR_ORDER_WRONG"}  # which is what is wrong
    (summary,) = [event for event in events if isinstance(event, SummaryEvent)]
    reasons = {reason for rotor in summary.rotors for reason in rotor["final"]["reasons"]}  # type: ignore
    assert "geometry_contradicted" in reasons
