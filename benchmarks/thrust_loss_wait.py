"""How long a missing part of the thrust is watched before it is told: delay against false alarms.

    python benchmarks/thrust_loss_wait.py ../shared/data --flights 2 > benchmarks/thrust_loss_wait.md

A part that is missing counts in full once part times time reaches `PART_MISSES` (0.2 s as shipped); before that, and
where only the motor's drag has fallen, it is a vote. Delays: of the first alert on the rotor, 40 % of whose thrust is
lost, in the flights of `verdicts.py` (tuning seeds 7000 on). False: alerts of a lost part, a slipping propeller or a
failed rotor in the recorded healthy flights at every rate, two phases each, and in simulated healthy ones (tuning
seeds 61000 on of `healthy_hours.py`: aggressive, windy, descents, payload drop).
"""

import argparse
from pathlib import Path

import numpy as np
import verdicts
from flight_logs import CELLS, EJECTION, FLIGHTS, decimate, divisors, records
from healthy_hours import RATES, VEHICLES, scenario

import gcs_health.fusion.evidence as evidence
import gcs_health.fusion.panel as panel
from gcs_health.estimators.contract import Estimate
from gcs_health.fusion.kinds import Kind
from gcs_health.fusion.verdicts import BOUND, Evidence
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.simulate.flight import Flight
from gcs_health.simulate.telemetry import BOOTED
from gcs_health.vehicle_file import load_vehicle

WAITS = (0.05, 0.1, 0.2)  # s
FAULT = "40 % of the thrust lost"
CODES = {"THRUST_LOSS", "PROPELLER_SLIPPING", "PROPELLER_LOST", "ROTOR_FAILED"}
HEALTHY = ("aggressive", "windy", "descents", "payload drop")
Log = tuple[str, bytes, MonitorConfig]  # what it is, its bytes, how it is heard


def fallen_drag_in_full(estimate: Estimate) -> Evidence | None:
    """A drag that fell as evidence of its own, not as a vote."""
    said = evidence.drag(estimate)
    if said is None or Kind.THRUST_LOSS not in dict(said.odds):
        return said
    return said._replace(
        sees_thrust=True, odds=tuple((k, BOUND if k is Kind.THRUST_LOSS else o) for k, o in said.odds)
    )


def broken(flights: int) -> list[tuple[str, bytes, float, int]]:
    """Return rates, log, time of the loss and rotor of every flight."""
    out = []
    for vehicle in VEHICLES:
        for seed in range(7000, 7000 + flights):
            frames, at, rotor = verdicts.flown(vehicle, FAULT, seed)
            out += [(rate, verdicts.thinned(frames, rate), at + BOOTED, rotor) for rate in RATES]
    return out


def recorded(folder: Path) -> list[Log]:
    """Return the healthy recorded flights at every rate."""
    out = []
    for name, (vehicle, _) in FLIGHTS.items():
        config = MonitorConfig(stamped=True, airframe=load_vehicle(folder / "vehicles" / f"{vehicle}.toml"))
        log = records(folder / f"{name}.tlog")
        for cell in CELLS:
            keep = divisors(name, cell)
            if name == EJECTION or keep is None:
                continue
            for phase in {(0, 0), (keep[0] // 2, keep[1] // 2)}:
                out.append((name, b"".join(each.raw for each in decimate(log, keep, phase)), config))
    return out


def simulated(seeds: int) -> list[Log]:
    """Return simulated healthy flights at every rate."""
    out = []
    for kind in HEALTHY:
        for vehicle in VEHICLES:
            for seed in range(61000, 61000 + seeds):
                frames = list(Flight(scenario(kind, vehicle, seed)).run())
                for rate in RATES:
                    out.append((kind, verdicts.thinned(frames, rate), MonitorConfig(stamped=True)))
    return out


def alerts(log: bytes, config: MonitorConfig) -> list[AlertEvent]:
    """Return what is raised."""
    monitor = Monitor(config)
    events = monitor.feed(log) + monitor.finish()
    return [e for e in events if isinstance(e, AlertEvent) and e.state == "raised"]


def false(logs: list[Log]) -> int:
    """Return in how many logs a rotor is accused of a loss of thrust."""
    return sum(any(alert.code in CODES for alert in alerts(log, config)) for _, log, config in logs)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--flights", type=int, default=4, help="broken, and healthy ones of a kind and vehicle"
    )
    args = parser.parse_args()
    flights, real, healthy = broken(args.flights), recorded(args.folder), simulated(args.flights)
    print("# How long a missing part of the thrust is watched\n")
    print(f"Printed by `python benchmarks/thrust_loss_wait.py FOLDER --flights {args.flights}`.\n")
    print(
        f"40 % of the thrust lost, {len(flights) // len(RATES)} flights a rate; {len(real)} replays of "
        f"recorded, {len(healthy)} of simulated healthy flights.\n"
    )
    print(f"| s | fallen drag | {', '.join(RATES)}: told | median ms | recorded: false | simulated: false |")
    print("|---|---|---|---|---|---|")
    usual = evidence._OF_ESTIMATOR["motor_observer", "drag"]
    for drag in (usual, fallen_drag_in_full):
        evidence._OF_ESTIMATOR["motor_observer", "drag"] = drag
        for wait in WAITS if drag is usual else (0.2,):
            panel.PART_MISSES = wait
            delays: dict[str, list[float]] = {rate: [] for rate in RATES}
            for rate, log, at, rotor in flights:
                said = [
                    e.t - at
                    for e in alerts(log, MonitorConfig(stamped=True))
                    if e.rotor == rotor and e.t > at
                ]
                delays[rate] += said[:1]
            told = ", ".join(f"{len(some)}" for some in delays.values())
            medians = ", ".join(f"{1e3 * np.median(some):.0f}" if some else "-" for some in delays.values())
            name = "vote" if drag is usual else "in full"
            print(
                f"| {wait:g} | {name} | {told} | {medians} | {false(real)} | {false(healthy)} |", flush=True
            )


if __name__ == "__main__":
    main()
