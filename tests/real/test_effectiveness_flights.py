"""The estimator on recorded flights beside the checkout: the real ejection, and silence where nothing failed."""

import sys
from dataclasses import replace
from pathlib import Path

import pytest

DATA = Path(__file__).parents[3] / "shared" / "data"
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from flight_logs import EJECTED, EJECTION, FIRST_VISIBLE, FLIGHTS, decimate, divisors, records, run  # noqa: E402

from gcs_health.pipeline import Monitor, MonitorConfig  # noqa: E402
from gcs_health.record.events import AlertEvent, EstimateEvent  # noqa: E402
from gcs_health.vehicle_file import load_vehicle  # noqa: E402

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recorded flights beside the checkout ({DATA.name})"
)


def replay(name: str, cell: str, phase: int = 0, mode: str = "recommended"):  # type: ignore[no-untyped-def]
    vehicle, until = FLIGHTS[name]
    keep = divisors(name, cell)
    assert keep is not None
    log = decimate(records(DATA / f"{name}.tlog"), keep, (phase % keep[0], phase % keep[1]))
    return run(log, load_vehicle(DATA / "vehicles" / f"{vehicle}.toml"), mode, until)


@pytest.mark.parametrize(
    ("cell", "mode", "earliest", "latest"),
    [
        ("full", "recommended", FIRST_VISIBLE, 12.50),
        ("100/50", "recommended", FIRST_VISIBLE, 12.50),
        ("50/50", "recommended", FIRST_VISIBLE, 12.53),
        ("50/10", "recommended", FIRST_VISIBLE, 12.53),
        ("25/10", "recommended", FIRST_VISIBLE, 12.61),
        ("full", "paper", 12.49, 12.51),
    ],
)
def test_the_ejection_is_found(cell: str, mode: str, earliest: float, latest: float) -> None:
    for phase in (0,) if cell == "full" else (0, 3):
        result = replay(EJECTION, cell, phase, mode)
        assert len(result.alarms) == 1
        t, motor = result.alarms[0]
        assert motor == EJECTED
        assert earliest < t <= latest


@pytest.mark.parametrize("seats", [(0, 2, 1, 3), (1, 3, 0, 2), (3, 1, 2, 0)])
def test_with_the_file_of_another_order_nothing_is_alarmed_but_said(seats: tuple[int, ...]) -> None:
    right = load_vehicle(DATA / "vehicles" / "bebop2.toml")
    moved = tuple(
        replace(rotor, position=right.rotors[seat].position, spin=right.rotors[seat].spin)
        for rotor, seat in zip(right.rotors, seats, strict=True)
    )
    monitor = Monitor(MonitorConfig(stamped=True, airframe=replace(right, rotors=moved)))
    events = monitor.feed((DATA / f"{EJECTION}.tlog").read_bytes()) + monitor.finish()
    alerts = [event for event in events if isinstance(event, AlertEvent)]
    assert not [alert for alert in alerts if alert.code != "MOTOR_ORDER_WRONG"]
    said = [
        event for event in events if isinstance(event, EstimateEvent) and event.estimator == "effectiveness"
    ]
    assert said[-1].reasons[0] == "geometry_contradicted"


@pytest.mark.parametrize("name", [name for name in FLIGHTS if name != EJECTION])
def test_a_healthy_flight_is_silent_and_mostly_judged(name: str) -> None:
    for cell in ("full", "50/10"):
        result = replay(name, cell, 1)
        assert result.alarms == []
        assert not result.contradicted
        assert result.open_time > 0.75 * result.flying_time > 0.0
