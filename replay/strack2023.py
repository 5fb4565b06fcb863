"""Strack van Schijndel et al. (2023) again, in the simulator: ejected propellers on a Bebop 2.

    python replay/strack2023.py                          the paper's 26 ejections and 7 healthy flights
    python replay/strack2023.py --flights 72 --seed 7    a larger campaign
    python replay/strack2023.py --quick                  a minute's worth: few flights, three sets

The simulated vehicle has Table II's control effectiveness as its truth (each flight's differs by a few per
cent); IMU and rotor speeds at 500 Hz, wind up to 10 m/s, hover, random, forward and aggressive flight.
Paper-exact mode with the 19 parameter sets of the released code (sheet 1 section 12), scored as there: the
first alarm of any rotor within 0 to 300 ms after the ejection counts, earlier ones in flight are false.
Beside the published rules, the same sets with the variance capped at P_ii <= .05 and with the single-fault
check. Nothing was tuned on these seeds. The ejection is instantaneous; a real propeller climbs off its shaft
first, which costs tens of ms.
"""

import argparse
import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from gcs_health.estimators.effectiveness_paper import PaperConfig, PaperFilter, parameter_sets
from gcs_health.samples import ImuReading, Reading, RotorReading
from gcs_health.simulate.batch import fly_many
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.telemetry import BOOTED

EJECTIONS, HEALTHY = 26, 7  # of the paper
DURATION, EJECTED = 11.0, (6.5, 10.5)  # s; at height from 5 s on
WITHIN = 0.3  # s
# kind of flight, wind [m/s], turbulence
GROUPS = (("hover", 2.0, "low"), ("random", 6.0, "low"), ("forward", 4.0, "low"), ("aggressive", 2.0, "low"))
GROUPS += (("random", 10.0, "moderate"),)
PAPER = {"found": "26 of 26", "false alarms": "0 in 33 flights", "95 % of delays": "28 to 132 ms"}
VARIANTS = {
    "published": {},
    "variance cap": {"variance_cap": 0.05},
    "single-fault check": {"single_fault_check": True},
}


@dataclass
class Tally:
    """What one parameter set did over all flights."""

    ejections: int = 0
    false: int = 0
    wrong: int = 0
    delays: list[float] = field(default_factory=list)  # ms

    def late(self, share: float) -> float:
        """A quantile of the delays [ms]; NaN without any."""
        return float(np.percentile(self.delays, share)) if self.delays else math.nan


def alarms(config: PaperConfig, flight: list[Reading], vehicle: object) -> Iterator[tuple[float, int]]:
    """Yield (time, rotor) whenever a rotor becomes the failed one."""
    paper = PaperFilter(vehicle, config)  # type: ignore[arg-type]
    for reading in flight:
        if isinstance(reading, ImuReading):
            changed = paper.imu(reading)
        elif isinstance(reading, RotorReading):
            changed = paper.rotor_speeds(reading)
        else:
            continue
        if changed and paper.failed is not None:
            yield reading.t, paper.failed


def score(tally: Tally, said: Iterator[tuple[float, int]], at: float, rotor: int) -> None:
    """Count one flight; `at` = inf where nothing was ejected."""
    tally.ejections += at < math.inf
    for t, named in said:
        if t < at:
            tally.false += 1
        else:
            if t <= at + WITHIN:
                tally.delays.append(1e3 * (t - at))
                tally.wrong += named != rotor
            return


def flights(ejections: int, healthy: int, seed: int) -> Iterator[tuple[list[Reading], float, int, object]]:
    """Yield (readings, time of ejection, rotor, airframe) of every flight."""
    rng = np.random.default_rng(seed)
    count = ejections + healthy
    at = np.where(np.arange(count) < ejections, rng.uniform(*EJECTED, count), math.inf)
    rotor = rng.integers(4, size=count)
    for nth, (kind, wind, turbulence) in enumerate(GROUPS):
        mine = np.arange(nth, count, len(GROUPS))
        if not len(mine):
            continue
        changes = ["vehicle=bebop2", f"trajectory.kind={kind}", f"trajectory.duration={DURATION}"]
        changes += ["trajectory.height=4.5", "trajectory.lands=false", f"wind.speed={wind}"]
        changes += [f"wind.turbulence={turbulence}", "trajectory.speed=6", "physics_rate=500"]
        changes += ["sensors.imu_integration_rate=500", "sensors.esc_rate=500", "sensors.esc_latency=0.002"]
        plan = load_scenario("healthy_quad", changes)
        ejected = (Fault("propeller_lost", rotor[mine], at[mine]),)
        flown = fly_many(plan, [seed + int(k) for k in mine], 500.0, 500.0, ejected)
        for column, k in enumerate(mine):
            # past the window nothing is scored
            end = BOOTED + at[k] + WITHIN
            readings = [reading for reading in flown.readings(column) if reading.t <= end]
            yield readings, BOOTED + at[k], int(rotor[k]), plan.vehicle.airframe()


def campaign(
    ejections: int, healthy: int, seed: int, sets: dict[str, PaperConfig]
) -> dict[str, dict[str, Tally]]:
    """Return what each set did, by variant and set."""
    tallies = {variant: {name: Tally() for name in sets} for variant in VARIANTS}
    for readings, at, rotor, airframe in flights(ejections, healthy, seed):
        for variant, changes in VARIANTS.items():
            for name, config in sets.items():
                told = alarms(replace(config, **changes), readings, airframe)  # type: ignore[arg-type]
                score(tallies[variant][name], told, at, rotor)
    return tallies


def table(tallies: dict[str, dict[str, Tally]]) -> Iterator[str]:
    """Yield the lines: every set as published, then each variant over all sets."""
    yield "| set | found | median ms | 2.5 % | 97.5 % | worst | false alarms | wrong rotor |"
    yield "|---|---|---|---|---|---|---|---|"
    for name, tally in tallies["published"].items():
        yield f"| {name} | {_cells(tally)} |"
    yield ""
    yield "| all sets | found | median ms | 2.5 % | 97.5 % | worst | false alarms | wrong rotor |"
    yield "|---|---|---|---|---|---|---|---|"
    for variant, sets in tallies.items():
        whole = Tally()
        for tally in sets.values():
            whole.ejections += tally.ejections
            whole.false += tally.false
            whole.wrong += tally.wrong
            whole.delays += tally.delays
        yield f"| {variant} | {_cells(whole)} |"


def _cells(tally: Tally) -> str:
    late = [f"{tally.late(share):.0f}" for share in (50.0, 2.5, 97.5, 100.0)]
    found = f"{len(tally.delays)}/{tally.ejections}"
    return " | ".join([found, *late, str(tally.false), str(tally.wrong)])


def plot(tallies: dict[str, dict[str, Tally]], folder: Path) -> None:
    """Draw the paper's figures 11 and 12: delays by parameter set, and of each flight of the base set."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    folder.mkdir(parents=True, exist_ok=True)
    published = tallies["published"]
    figure, axes = pyplot.subplots(figsize=(9.0, 5.0), layout="constrained")
    axes.boxplot([tally.delays for tally in published.values()], whis=(2.5, 97.5))
    axes.set_xticks(range(1, len(published) + 1), list(published), rotation=60, ha="right")
    axes.set_ylabel("detection delay [ms]")
    figure.savefig(folder / "strack2023_fig11.png", dpi=120)
    base = published["base"]
    figure, axes = pyplot.subplots(figsize=(9.0, 4.0), layout="constrained")
    axes.plot(base.delays, "o")
    for share in (2.5, 97.5):
        axes.axhline(base.late(share), linestyle=":")
    axes.set_xlabel("ejection")
    axes.set_ylabel("detection delay [ms]")
    figure.savefig(folder / "strack2023_fig12.png", dpi=120)
    pyplot.close("all")


def main(arguments: list[str] | None = None) -> None:
    """Print the paper's figures and ours."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--flights", type=int, default=EJECTIONS, help="ejections; healthy ones in proportion"
    )
    parser.add_argument("--seed", type=int, default=2023)
    parser.add_argument("--quick", action="store_true", help="four ejections, one healthy flight, three sets")
    parser.add_argument(
        "--plots", type=Path, metavar="FOLDER", help="draw figures 11 and 12; wants matplotlib"
    )
    args = parser.parse_args(arguments)
    sets = parameter_sets()
    ejections, healthy = args.flights, round(args.flights * HEALTHY / EJECTIONS)
    if args.quick:
        ejections, healthy = 4, 1
        sets = {name: sets[name] for name in ("base", "Q 0.04", "P_thr 0.94")}
    print(f"Paper, base set: {', '.join(f'{name} {value}' for name, value in PAPER.items())}.")
    print(f"Simulated: {ejections} ejections, {healthy} healthy flights, seed {args.seed}.\n")
    tallies = campaign(ejections, healthy, args.seed, sets)
    print("\n".join(table(tallies)))
    if args.plots:
        plot(tallies, args.plots)


if __name__ == "__main__":
    main()
