"""Healthy recorded flights must not be called degraded: no trained model, speeds and commands as they are."""

from pathlib import Path

import pytest

from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import EstimateEvent
from gcs_health.vehicle_file import load_vehicle

DATA = Path(__file__).parents[3] / "shared" / "data"
# the rule "three looks on end" was found on the first; the others report
FLIGHTS = {
    "indiflight_00230": "indiflight",
    "indiflight_00267": "indiflight",
    "indiflight_00341": "indiflight",
    "nanodrone_square_run3": "nanodrone",
    "nanodrone_square_run5": "nanodrone",
    "px4_uavcan_esc": "quad_x",
}

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recorded flights beside the checkout ({DATA.name})"
)


@pytest.mark.parametrize("name", FLIGHTS)
def test_nobody_is_called_degraded(name: str) -> None:
    vehicle = load_vehicle(DATA / "vehicles" / f"{FLIGHTS[name]}.toml")
    monitor = Monitor(MonitorConfig(airframe=vehicle, estimators=("pooled_ar",)))
    events = monitor.feed((DATA / f"{name}.tlog").read_bytes(), stamped=True)
    told = [event for event in events if isinstance(event, EstimateEvent)]
    assert len(told) > 100
    assert [event for event in told if event.failure_probability and event.failure_probability > 0.9] == []
    if name != "px4_uavcan_esc":  # no commands there
        assert sum(event.status == "valid" for event in told) > 100
