"""The motor observer on recorded flights beside the checkout: one with motor currents, the others without."""

from pathlib import Path

import pytest

from gcs_health.estimators.motor_observer import MotorObserver
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, EstimateEvent
from gcs_health.samples import Reading
from gcs_health.vehicle_file import load_vehicle

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recorded flights beside the checkout ({DATA.name})"
)


def replay(name: str, vehicle: str, upto: int | None = None):  # type: ignore[no-untyped-def]
    """Return the events of the motor observer on a flight, and the readings that it got."""
    readings: list[Reading] = []
    monitor = Monitor(
        MonitorConfig(
            airframe=load_vehicle(DATA / "vehicles" / f"{vehicle}.toml"),
            estimators=("motor_observer",),
            stamped=True,
            estimate_rate=2.0,
            tap=lambda _, reading: readings.append(reading),
        )
    )
    events = monitor.feed((DATA / f"{name}.tlog").read_bytes()[:upto])
    events += monitor.finish()
    return events, readings


def test_battery_side_currents_at_three_hertz_are_recognised_and_not_judged() -> None:
    events, readings = replay("px4_uavcan_esc", "quad_x")
    assert not any(isinstance(event, AlertEvent) for event in events)
    estimates = [event for event in events if isinstance(event, EstimateEvent)]
    assert not any(e.failure_probability > 0.5 for e in estimates)
    assert not any(e.status == "valid" for e in estimates if e.quantity == "effectiveness")
    flying = [e for e in estimates if e.quantity == "effectiveness" and e.t - estimates[0].t > 8.0]
    assert sum("rate_too_low" in e.reasons for e in flying) > 0.8 * len(flying)

    craft = load_vehicle(DATA / "vehicles" / "quad_x.toml")
    observer = MotorObserver(craft)
    for reading in readings:
        observer.feed(reading)
    assert observer.core.measured_on == "battery"  # type: ignore[union-attr]
    assert 2.6 < observer.core.side.exponent < 3.3  # type: ignore[union-attr]  # sheet 5: 2.93
    assert observer.core.witness == "unusable"  # type: ignore[union-attr]  # sheet 5: 48-59 A against 27 A


@pytest.mark.parametrize(
    ("name", "vehicle"),
    [
        ("bebop2_prop_eject", "bebop2"),
        ("indiflight_00258", "indiflight"),
        ("nanodrone_square_run3", "nanodrone"),
    ],
)
def test_flights_without_currents_say_so(name: str, vehicle: str) -> None:
    events, _ = replay(name, vehicle)
    estimates = [event for event in events if isinstance(event, EstimateEvent)]
    assert not any(e.failure_probability > 0.0 for e in estimates)
    assert all(
        set(e.reasons) & {"no_currents", "no_rotor_speeds", "rotor_speed_stale", "rotor_not_reported"}
        for e in estimates
    )
    assert sum("no_currents" in e.reasons for e in estimates) > 0.5 * len(estimates)
