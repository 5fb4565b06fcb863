"""The healthy vibration of recorded craft: how far their other flights stray from it, healthy and not.

    python benchmarks/vibration_alarm_real.py ../shared/data

None of these is long enough to calibrate on (`gcs-health calibrate` asks for two minutes in pieces of 10 s), so there
is no threshold here: the change itself, in windows of 5 s, by an AR model of other flights of the same craft. Nothing
was tuned on them.
"""

import sys
from pathlib import Path

import numpy as np

from gcs_health.cli.recorded import recorded_flight
from gcs_health.errors import GcsHealthError
from gcs_health.estimators.healthy_vibration import HealthyWatch
from gcs_health.estimators.pooled_ar_watch import WatchConfig
from gcs_health.estimators.vibration_baseline import VibrationBaseline
from gcs_health.samples import FlightReading, ImuFilterReading, ImuReading, Reading
from gcs_health.vehicle_file import load_vehicle

INDIFLIGHT = ("indiflight_00230", "indiflight_00267", "indiflight_00341")
QUAD = "udesa_quadcarbono_M1_{}"
# learned on, judged, vehicle file, what is true
ROWS = [
    *(([o for o in INDIFLIGHT if o != name], name, "indiflight", "healthy") for name in INDIFLIGHT),
    *(
        ([QUAD.format("Hnominal_corto")], QUAD.format(which), "quad_x", truth)
        for which, truth in (
            ("Hnominal_corto", "healthy, the flight itself"),
            ("Hasymm164", "propeller 1 cut by 16 mm"),
        )
    ),
]


def main() -> None:
    """Print the table."""
    data = Path(sys.argv[1])
    print("| learned on | judged | truth | windows | change: median | largest |\n|---|---|---|---|---|---|")
    for learned, judged, vehicle, truth in ROWS:
        print(
            f"| {', '.join(learned)} | {judged} | {truth} | {line(data, learned, judged, vehicle)} |",
            flush=True,
        )


def line(data: Path, learned: list[str], judged: str, vehicle: str) -> str:
    """Return how many windows, their median and their largest change."""
    baseline = VibrationBaseline()
    try:
        for name in learned:
            baseline.fly(readings(data, name, vehicle))
        watch, changes = HealthyWatch(baseline.model(), WatchConfig()), []
        for reading in readings(data, judged, vehicle):
            if isinstance(reading, ImuReading | FlightReading | ImuFilterReading) and watch.feed(reading):
                changes.append(watch.change)
    except (GcsHealthError, IndexError) as error:
        return f"- | - | {error}"
    known = np.array(changes)[np.isfinite(changes)] if changes else np.zeros(0)
    return f"{len(known)} | {np.median(known):.2f} | {known.max():.2f}" if len(known) else "0 | - | gaps"


def readings(data: Path, name: str, vehicle: str) -> list[Reading]:
    """Return what the estimators take of one flight."""
    given = load_vehicle(data / "vehicles" / f"{vehicle}.toml")
    return recorded_flight(str(data / f"{name}.tlog"), given, ("effectiveness",)).readings


if __name__ == "__main__":
    main()
