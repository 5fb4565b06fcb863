"""What the effectiveness estimator does on recorded flights: detections, delays, false alarms, open gate.

    python benchmarks/real_flights.py ../shared/data > benchmarks/real_flights.md

Every flight goes through the project's own Monitor at five rates (IMU/ESC Hz); decimation keeps every
n-th message, from several start phases, for the ejection both equal for the two messages and spread over
each one's interval (an ESC message each 100 ms may come up to 100 ms after what it shows), else spread.
Paper mode runs at full rate and 100/50.

The rules and thresholds were taken from sheet 5, which tuned them on these same flights. Those added here
(window-wide upward push, timing error in the model error, typical noise that scales with the craft,
geometry check) were chosen on `nanodrone_*` and `indiflight_*` with moved stamps, dropped messages and
wrong gains. So this table shows what the rules do, not what they will do elsewhere.
"""

import argparse
from pathlib import Path

from flight_logs import (
    CELLS,
    EJECTED,
    EJECTION,
    FIRST_VISIBLE,
    FLIGHTS,
    LABEL,
    Run,
    decimate,
    divisors,
    records,
    run,
)

from gcs_health.airframe import Airframe
from gcs_health.vehicle_file import load_vehicle


def phases(keep: tuple[int, int], count: int, spread: bool) -> list[tuple[int, int]]:
    """Return start phases: equal for IMU and ESC messages, or each spread over its own interval."""
    if keep == (1, 1):
        return [(0, 0)]
    if spread:
        return [(k * keep[0] // count, k * keep[1] // count) for k in range(count)]
    return [(k % keep[0], k % keep[1]) for k in range(count)]


def runs(folder: Path, name: str, cell: str, count: int, mode: str, spread: bool = True) -> list[Run]:
    """Replay one flight at one rate from every phase."""
    keep = divisors(name, cell)
    if keep is None:
        return []
    vehicle, until = FLIGHTS[name]
    airframe: Airframe = load_vehicle(folder / "vehicles" / f"{vehicle}.toml")
    log = records(folder / f"{name}.tlog")
    return [run(decimate(log, keep, phase), airframe, mode, until) for phase in phases(keep, count, spread)]


def healthy_row(name: str, cell: str, mode: str, results: list[Run]) -> str:
    """Return one row of the table of flights without a fault."""
    alarms = [f"motor {motor} at {t:.2f}" for result in results for t, motor in result.alarms]
    geometry = sum(result.contradicted for result in results)
    if mode == "paper":
        return (
            f"| {name} | {mode} {cell} | {len(results)} | {len(alarms)} | - | - | {'; '.join(alarms[:4])} |"
        )
    opened = sum(result.open_time for result in results)
    flying = sum(result.flying_time for result in results)
    note = "; ".join(alarms[:4]) + (f"geometry contradicted in {geometry}" if geometry else "")
    share = opened / flying if flying else 0.0
    return (
        f"| {name} | {cell} | {len(results)} | {len(alarms)} | {opened / 60.0 / len(results):.2f} | "
        f"{share:.0%} | {note} |"
    )


def ejection_row(cell: str, mode: str, results: list[Run]) -> str:
    """Return one row of the table of the real ejection."""
    first = [result.alarms[0] for result in results if result.alarms]
    early = sum(t < FIRST_VISIBLE for t, _ in first)
    right = sum(motor == EJECTED for _, motor in first)
    times = sorted(t for t, _ in first)
    span = f"{times[0]:.3f}-{times[-1]:.3f}" if times else "-"
    delay = f"{1e3 * (times[0] - LABEL):.0f}-{1e3 * (times[-1] - LABEL):.0f}" if times else "-"
    return f"| {mode} {cell} | {len(results)} | {len(first)} | {right} | {early} | {span} | {delay} |"


def main() -> None:
    """Print the tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="recorded flights and their vehicles/")
    parser.add_argument("--phases", type=int, default=5)
    arguments = parser.parse_args()
    print("# The effectiveness estimator on recorded flights\n")
    print(f"Printed by `python benchmarks/real_flights.py FOLDER --phases {arguments.phases}`.\n")
    print((__doc__ or "").split("\n\n", 2)[2])
    modes = [("recommended", cell) for cell in CELLS] + [("paper", "full"), ("paper", "100/50")]
    print(f"## {EJECTION}: motor {EJECTED}, label {LABEL} s, first visible {FIRST_VISIBLE} s\n")
    print("| mode and rate | phases | alarms | right motor | before 12.24 s | alarm at s | after label, ms |")
    print("|---|---|---|---|---|---|---|")
    for mode, cell in modes:
        for spread in (False, True) if cell != "full" else (False,):
            results = runs(arguments.folder, EJECTION, cell, arguments.phases, mode, spread)
            print(ejection_row(cell + (", spread" if spread else ""), mode, results), flush=True)
    print("\n## Healthy flights\n")
    print("| flight | rate | phases | false alarms | open gate, min a phase | of time > 60 % hover | what |")
    print("|---|---|---|---|---|---|---|")
    for name in FLIGHTS:
        for mode, cell in modes:
            results = runs(arguments.folder, name, cell, arguments.phases, mode) if name != EJECTION else []
            if results:
                print(healthy_row(name, cell, mode, results), flush=True)


if __name__ == "__main__":
    main()
