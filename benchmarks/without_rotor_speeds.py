"""What the effectiveness estimator says from commands and rates alone, on recorded flights.

    python benchmarks/without_rotor_speeds.py ../shared/data > benchmarks/without_rotor_speeds.md

`crazypad_*` against the healthy hover of the same source (`normal_flight`, its last verdict counts); every
flight that carries commands, rotor speeds taken out, for the contradiction test. The thresholds are those of
sheet 5, which looked at these same flights.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

from gcs_health.airframe import Airframe, Baseline
from gcs_health.airframe_tables import assume_airframe
from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.samples import CommandReading, ImuReading, Reading, RotorReading
from gcs_health.vehicle_file import load_vehicle

HEALTHY = "normal_flight_E8_log00"
VEHICLES = {"crazypad": "crazypad", "indiflight": "indiflight", "nanodrone": "nanodrone", "bebop2": "bebop2"}


def readings(path: Path, airframe: Airframe | None) -> tuple[list[Reading], Airframe | None]:
    """Return what reaches an estimator of one log but rotor speeds, and the airframe."""
    out: list[Reading] = []
    config = MonitorConfig(
        airframe=airframe,
        stamped=True,
        estimators=("effectiveness",),
        tap=lambda _, reading: None if isinstance(reading, RotorReading) else out.append(reading),
    )
    monitor = Monitor(config)
    monitor.feed(path.read_bytes())
    monitor.finish()
    found = [vehicle.airframe for vehicle in monitor.vehicles() if vehicle.airframe is not None]
    return out, found[0] if found else airframe


def hover_of(flight: list[Reading], airframe: Airframe) -> Airframe:
    """Return the airframe with the root mean square commands of a healthy hover: above half the usual mean."""
    commands = [r.command for r in flight if isinstance(r, CommandReading) and min(r.command) > 0.2]
    means = sorted(sum(command) for command in commands)
    usual = means[len(means) // 2]
    steady = [command for command in commands if abs(sum(command) - usual) < 0.2 * usual]
    hover = [math.sqrt(sum(x * x for x in column) / len(steady)) for column in zip(*steady, strict=True)]
    return replace(airframe, baseline=Baseline(hover_command=tuple(hover)))


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    folder = parser.parse_args().folder
    print("# Without rotor speeds\n\nPrinted by `python benchmarks/without_rotor_speeds.py FOLDER`.\n")
    print((__doc__ or "").split("\n\n", 2)[2])
    print("## Hover trim\n\n| flight | state | motor | command | Y | explained | k |")
    print("|---|---|---|---|---|---|---|")
    for path in sorted(folder.glob("crazypad_*.tlog")):
        print(trim_row(folder, path), flush=True)
    print("\n## Contradiction\n\n| flight | s with commands and rates | named (s, motor) |\n|---|---|---|")
    for path in sorted(folder.glob("*.tlog")):
        line = contradiction_row(folder, path)
        if line:
            print(line, flush=True)


def vehicle(folder: Path, path: Path) -> Airframe | None:
    """Return the vehicle file of a log, if there is one."""
    name = VEHICLES.get(path.name.split("_")[0])
    return load_vehicle(folder / "vehicles" / f"{name}.toml") if name else None


def trim_row(folder: Path, path: Path) -> str:
    """Compare one flight with the healthy one of its source."""
    airframe = vehicle(folder, path)
    assert airframe is not None
    source = path.name.split("_")[1]
    healthy, _ = readings(folder / f"crazypad_{source}_{HEALTHY}.tlog", airframe)
    airframe = hover_of(healthy, airframe)
    estimator = EffectivenessEstimator(airframe)
    flight, _ = readings(path, airframe)
    for reading in flight:
        estimator.feed(reading)
    bare = estimator.without_speeds
    assert bare is not None
    trim = bare.trim
    most = max(range(len(trim.u)), key=lambda i: trim.u[i] / trim.reference[i])
    raised = math.sqrt(trim.u[most] / trim.reference[most]) - 1.0
    motor = airframe.rotors[trim.rotor].motor if trim.rotor >= 0 else "-"
    left = f"{trim.left(trim.rotor):.2f}" if trim.rotor >= 0 else "-"
    return (
        f"| {path.stem.removeprefix('crazypad_')} | {trim.state} | {motor} | "
        f"{airframe.rotors[most].motor} {raised:+.0%} | {trim.yaw:.2f} | {trim.explained:.2f} | {left} |"
    )


def contradiction_row(folder: Path, path: Path) -> str:
    """Feed one flight; return nothing where it has no commands or no rates."""
    try:
        flight, airframe = readings(path, vehicle(folder, path))
    except Exception as error:
        return f"| {path.stem} | not readable: {error} | |"
    kinds = {type(reading) for reading in flight}
    if airframe is None:
        airframe = assume_airframe(4, 2) if {CommandReading, ImuReading} <= kinds else None
    if airframe is None or not {CommandReading, ImuReading} <= kinds:
        return ""
    estimator = EffectivenessEstimator(airframe)
    named = []
    start = flight[0].t
    heard = [reading.t for reading in flight if isinstance(reading, CommandReading)]
    for reading in flight:
        for estimate in estimator.feed(reading):
            if dict(estimate.evidence).get("rule") == "contradiction":
                named.append(f"{reading.t - start:.2f}, {airframe.rotors[estimate.rotor].motor}")
    return f"| {path.stem} | {heard[-1] - heard[0]:.0f} | {'; '.join(named) or '-'} |"


if __name__ == "__main__":
    main()
