"""Cut propeller against healthy on the same airframe, through the vehicle file that `calibrate` writes."""

from pathlib import Path

import pytest

from gcs_health.cli import main
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, EstimateEvent
from gcs_health.vehicle_file import load_vehicle

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recorded flights beside the checkout ({DATA.name})"
)

QUAD = "udesa_quadcarbono_M1_"


def damaged(flight: str, vehicle: Path) -> tuple[float, list[AlertEvent]]:
    """Return the highest probability that some propeller is damaged, and what the operator is told."""
    monitor = Monitor(MonitorConfig(load_vehicle(str(vehicle)), ("unbalance",), stamped=True))
    events = monitor.feed((DATA / f"{flight}.tlog").read_bytes()) + monitor.finish()
    by_time: dict[float, list[float]] = {}
    for event in events:
        if isinstance(event, EstimateEvent) and event.failure_probability == event.failure_probability:
            by_time.setdefault(event.t, []).append(event.failure_probability)
    told = [event for event in events if isinstance(event, AlertEvent)]
    return max(sum(each) for each in by_time.values()), told


@pytest.mark.parametrize(
    ("healthy", "geometry", "flight", "cut"),
    [
        (f"{QUAD}Hnominal_corto", "quad_x.toml", f"{QUAD}Hasymm164", True),
        (f"{QUAD}Hnominal_corto", "quad_x.toml", f"{QUAD}Hnominal_corto", False),
        ("agh_octo_14", "", "agh_octo_07", True),
        ("agh_octo_14", "", "agh_octo_01", False),
    ],
)
def test_a_cut_propeller_is_told_from_a_healthy_one(
    healthy: str, geometry: str, flight: str, cut: bool, tmp_path: Path
) -> None:
    out = tmp_path / "mine.toml"
    given = ["--vehicle", str(DATA / "vehicles" / geometry)] if geometry else []
    assert main(["calibrate", str(DATA / f"{healthy}.tlog"), *given, "-o", str(out)]) == 0
    probability, told = damaged(flight, out)
    assert (probability > 0.9) is cut
    # no rotor speeds: that a propeller is unbalanced is known, which one is not
    assert [(e.code, e.motor, e.rotor) for e in told if e.state == "raised"] == [
        ("PROPELLER_UNBALANCED", None, None)
    ] * cut
