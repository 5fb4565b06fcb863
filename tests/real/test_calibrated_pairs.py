"""Cut propeller against healthy on the same airframe, through the vehicle file that `calibrate` writes."""

from pathlib import Path

import pytest

from gcs_health.cli import main
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import EstimateEvent
from gcs_health.vehicle_file import load_vehicle

DATA = Path(__file__).parents[3] / "shared" / "data"
pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recorded flights beside the checkout ({DATA.name})"
)

QUAD = "udesa_quadcarbono_M1_"


def damaged(flight: str, vehicle: Path) -> float:
    """Return the highest probability that some propeller is damaged."""
    monitor = Monitor(MonitorConfig(load_vehicle(str(vehicle)), ("unbalance",), stamped=True))
    events = monitor.feed((DATA / f"{flight}.tlog").read_bytes()) + monitor.finish()
    by_time: dict[float, list[float]] = {}
    for event in events:
        if isinstance(event, EstimateEvent) and event.failure_probability == event.failure_probability:
            by_time.setdefault(event.t, []).append(event.failure_probability)
    return max(sum(each) for each in by_time.values())


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
    assert (damaged(flight, out) > 0.9) is cut
