"""Partial losses emulated in recorded healthy flight: the rotor named, how much, and what healthy flight shows.

    python benchmarks/partial_losses.py ../shared/data > benchmarks/partial_losses.md

From a time drawn while verdicts may be given, one rotor's speed is raised by 1 / sqrt(1 - loss): it turns faster
for the same thrust, as after a loss that the controller has levelled. What is said 1.8 s later counts. Healthy:
lessons of 0.4 s in which any rotor is seen to have lost more than .10. The thresholds are those of sheet 5, which
looked at these same flights.
"""

import argparse
import math
import random
import statistics
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from flight_logs import EJECTION, FLIGHTS, decimate, divisors, records

from gcs_health.airframe import Airframe
from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.samples import Reading, RotorReading
from gcs_health.vehicle_file import load_vehicle

AFTER = 1.8  # s
CELLS = ("full", "50/50")


@dataclass
class Cell:
    """What came of the trials of one rate and size."""

    trials: int = 0
    right: int = 0
    wrong: int = 0
    covered: int = 0  # truth within two standard deviations
    values: list[float] = field(default_factory=list)


def readings(
    folder: Path, name: str, cell: str, airframe: Airframe, phase: tuple[int, int] = (0, 0)
) -> list[Reading]:
    """Return what reaches an estimator of one flight at one rate; nothing where the log is too slow."""
    keep = divisors(name, cell)
    if keep is None:
        return []
    out: list[Reading] = []
    config = MonitorConfig(
        airframe=airframe, stamped=True, estimators=("effectiveness",), tap=lambda _, r: out.append(r)
    )
    monitor = Monitor(config)
    log = decimate(records(folder / f"{name}.tlog"), keep, phase)
    monitor.feed(b"".join(record.raw for record in log))
    return out


def raised(flight: list[Reading], rotor: int, loss: float, t0: float) -> Iterable[Reading]:
    """Yield the flight with one rotor faster from t0 on, up to when it is judged."""
    factor = 1.0 / math.sqrt(1.0 - loss)
    for reading in flight:
        if reading.t > t0 + AFTER:
            return
        if isinstance(reading, RotorReading) and reading.t >= t0:
            speed = tuple(s * factor if i == rotor else s for i, s in enumerate(reading.speed))
            yield reading._replace(speed=speed)
        else:
            yield reading


def healthy(flight: list[Reading], airframe: Airframe, until: float) -> tuple[int, int, list[float]]:
    """Return lessons, those with a loss seen, and times at which trials can begin."""
    estimator = EffectivenessEstimator(airframe)
    bank = estimator.bank
    assert bank is not None
    lessons = seen = 0
    told = -math.inf
    times: list[tuple[float, bool]] = []
    for reading in flight:
        if reading.t - flight[0].t > until:
            break
        estimator.feed(reading)
        if bank.partial.time != told and bank.partial.time > bank.partial.config.settle:
            lessons += 1
            seen += bank.partial.rotor is not None
            times.append((reading.t, bank.gate.verdicts))
        told = bank.partial.time
    lesson = estimator.config.recommended.lesson
    ahead = round(AFTER / lesson) + 1
    starts = [
        times[k][0]
        for k in range(len(times) - ahead)
        if times[k + ahead][0] - times[k][0] < 1.25 * lesson * ahead
        and all(ok for _, ok in times[k : k + ahead])
    ]
    return lessons, seen, starts


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--per-rotor", type=int, default=2, help="trials a rotor and flight")
    args = parser.parse_args()
    print("# Partial losses\n\nPrinted by `python benchmarks/partial_losses.py FOLDER", end=" ")
    print(f"--seed {args.seed} --per-rotor {args.per_rotor}`.\n")
    print((__doc__ or "").split("\n\n", 2)[2])
    for cell in CELLS:
        rng = random.Random(args.seed)
        lessons = seen = 0
        results = {loss: Cell() for loss in (0.2, 0.4, 0.6)}
        for name, (file, until) in FLIGHTS.items():
            airframe = load_vehicle(args.folder / "vehicles" / f"{file}.toml")
            flight = readings(args.folder, name, cell, airframe)
            if not flight:
                continue
            some, bad, starts = healthy(flight, airframe, 12.0 if name == EJECTION else until)
            lessons, seen = lessons + some, seen + bad
            for rotor in range(4):
                for _ in range(args.per_rotor if starts else 0):
                    t0 = rng.choice(starts)
                    for loss, result in results.items():
                        trial(raised(flight, rotor, loss, t0), airframe, rotor, loss, result)
        print(f"\n## {cell}: healthy, {seen} of {lessons} lessons show a loss\n")
        print(
            "| loss | seen, right rotor | wrong rotor | mean | RMSE | within 2 std |\n|---|---|---|---|---|---|"
        )
        for loss, r in results.items():
            rmse = math.sqrt(statistics.fmean((v - loss) ** 2 for v in r.values)) if r.values else math.nan
            mean = statistics.fmean(r.values) if r.values else math.nan
            print(
                f"| {loss:.0%} | {r.right}/{r.trials} | {r.wrong} | {mean:.3f} | {rmse:.3f} | "
                f"{r.covered}/{r.right} |",
                flush=True,
            )


def trial(flight: Iterable[Reading], airframe: Airframe, rotor: int, loss: float, result: Cell) -> None:
    """Fly one loss and note what is said at its end."""
    estimator = EffectivenessEstimator(airframe)
    t = 0.0
    for reading in flight:
        estimator.feed(reading)
        t = reading.t
    result.trials += 1
    said = [e for e in estimator.estimates(t) if "theta" in dict(e.evidence)]
    for estimate in said:
        if estimate.rotor != rotor:
            result.wrong += 1
            continue
        result.right += 1
        result.values.append(1.0 - estimate.value)
        result.covered += abs(1.0 - estimate.value - loss) < 2.0 * estimate.std


if __name__ == "__main__":
    main()
