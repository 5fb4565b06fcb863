"""Every recorded flight, every estimator: what it said at its worst, beside what is true.

    python benchmarks/every_flight.py ../shared/data > benchmarks/every_flight.md

Each log goes through the project's own Monitor once, with its craft's vehicle file where the log carries no
geometry. Of each estimator and quantity the table has the rotor that it believed in most at any time (motor
number, value, failure probability), how many rotors were valid at any time, or why none was. A rotor's
probability above a half is marked. What the simulator made is not here.
"""

import argparse
import json
from collections import Counter
from pathlib import Path

from gcs_health.airframe import Airframe
from gcs_health.estimators import REGISTRY
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, EstimateEvent, Event
from gcs_health.vehicle_file import load_vehicle

VEHICLES = {"bebop2": "bebop2", "indiflight": "indiflight", "nanodrone": "nanodrone", "crazypad": "crazypad"}
OWN_GEOMETRY = ("px4_v6c", "agh_octo")


def airframe(folder: Path, name: str) -> Airframe | None:
    """Return the craft's vehicle file; None where the log has its geometry itself."""
    if name.startswith(OWN_GEOMETRY):
        return None
    stem = next((file for start, file in VEHICLES.items() if name.startswith(start)), "quad_x")
    if "hexa" in name or "plane" in name or "dirty" in name:
        return None
    return load_vehicle(folder / "vehicles" / f"{stem}.toml")


def replayed(path: Path, vehicle: Airframe | None) -> list[Event]:
    """Return all events of one log."""
    monitor = Monitor(MonitorConfig(airframe=vehicle, stamped=True, estimate_rate=5.0))
    return monitor.feed(path.read_bytes()) + monitor.finish()


def said(events: list[Event], estimator: str) -> str:
    """Return what one estimator said at its worst, quantity by quantity."""
    quantities: dict[str, list[EstimateEvent]] = {}
    for event in events:
        if isinstance(event, EstimateEvent) and event.estimator == estimator:
            quantities.setdefault(event.quantity, []).append(event)
    parts = [f"{quantity}: {_worst(estimates)}" for quantity, estimates in quantities.items()]
    return "<br>".join(parts) or "-"


def _worst(estimates: list[EstimateEvent]) -> str:
    valid = [e for e in estimates if e.status == "valid"]
    judged = [e for e in estimates if e.failure_probability == e.failure_probability]
    if not valid and not judged:
        reasons = Counter(reason for e in estimates for reason in e.reasons)
        return ", ".join(reason for reason, _ in reasons.most_common(2)) or estimates[-1].status
    text = f"{len({e.rotor for e in valid})} rotors valid"
    if judged:
        worst = max(judged, key=lambda e: e.failure_probability)
        mark = "**" if worst.failure_probability > 0.5 else ""
        text += f", {mark}motor {worst.motor} p {worst.failure_probability:.2g}{mark} ({worst.value:.3g})"
    return text


def truth_of(path: Path) -> str:
    """Return what is known of the flight, in a few words."""
    truth = json.loads(path.with_suffix("").with_suffix(".truth.json").read_text())["truth"]
    rotor = truth.get("rotor")
    what = truth.get("fault") or ""
    text = f"{truth.get('condition', '')}: {what}" if what else str(truth.get("condition", ""))
    return (text[:90] + ("..." if len(text) > 90 else "")) + (f" (motor {rotor})" if rotor else "")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    print("# Every recorded flight, every estimator\n")
    print("Printed by `python benchmarks/every_flight.py ../shared/data`; one run of each, no phases.\n")
    print(f"| flight | true | {' | '.join(REGISTRY)} | alerts |")
    print("|" + "---|" * (3 + len(REGISTRY)))
    for path in sorted(folder.glob("*.tlog")):
        events = replayed(path, airframe(folder, path.stem))
        alerts = [
            f"{e.code} motor {e.motor} at {e.t:.2f} s"
            for e in events
            if isinstance(e, AlertEvent) and e.state in ("raised", "escalated")
        ]
        cells = [said(events, estimator) for estimator in REGISTRY]
        print(
            f"| {path.stem} | {truth_of(path)} | {' | '.join(cells)} | {'<br>'.join(alerts) or '-'} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
