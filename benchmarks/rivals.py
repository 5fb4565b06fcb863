"""The published baselines beside ours on the same simulated flights.

    python benchmarks/rivals.py > benchmarks/rivals.md

IMU at 125 Hz, rotor speeds, currents and commands at 100 Hz, physics at 500 Hz, no MAVLink between. Each
baseline is told the vehicle's nominal control effectiveness, and its threshold is set for each vehicle from
healthy flights in hover, wind and aggressive flight of seeds 1 on: 1.3 times the highest score that one of
them held, as PX4 advises for its own check. ArduCopter's checks have no threshold to set. "effectiveness" is
ours as it ships: it learns the effectiveness in flight and is not tuned here; "effectiveness, paper" gets
the nominal one.

Reported flights have other seeds (--seed on). Faults come in random flight in 4 m/s of wind; found = named
within 2 s; a verdict before the fault counts as early, and not as found. Healthy: aggressive flight, and
hover in 10 m/s of moderate turbulence.
"""

import argparse
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from gcs_health.airframe import Airframe, Effectiveness
from gcs_health.errors import AirframeError
from gcs_health.estimators.comparison import METHODS, Verdict, load
from gcs_health.estimators.comparison.ardupilot_checks import (
    ControlReading,
    ThrustLossCheck,
    YawImbalanceCheck,
)
from gcs_health.estimators.comparison.px4_motor_check import ResidualCheck, fit
from gcs_health.estimators.effectiveness import EffectivenessConfig, EffectivenessEstimator
from gcs_health.estimators.effectiveness_paper import PaperConfig
from gcs_health.samples import Reading
from gcs_health.simulate.batch import Flights, fly_many
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import Scenario, load_scenario
from gcs_health.simulate.telemetry import BOOTED

DURATION, HEIGHT = 22.0, 7.5  # s, m: at height from 7 s on
FAULT_AT, WITHIN = (15.0, 19.5), 2.0  # s
MARGIN = 1.3
LEAST = {"multiple_model": math.log(9.0)}  # threshold where no healthy flight comes near one
LEAST_LOSS = 0.2
FAULTS = {"propeller lost": ("propeller_lost", math.nan), "40 % lost": ("effectiveness", 0.6)}
FAULTS["motor stopped"] = ("motor_stopped", math.nan)
HEALTHY = {
    "hover": ["trajectory.kind=hover", "wind.speed=2"],
    "wind": ["trajectory.kind=hover", "wind.speed=10", "wind.turbulence=moderate"],
    "aggressive": ["trajectory.kind=aggressive", "wind.speed=2"],
}
Watcher = Callable[[list[Reading | ControlReading]], Verdict | None]
Maker = Callable[[], Watcher]


def plan(vehicle: str, changes: list[str]) -> Scenario:
    """Return one kind of flight."""
    common = [f"vehicle={vehicle}", f"trajectory.duration={DURATION}", f"trajectory.height={HEIGHT}"]
    common += ["trajectory.lands=false", "physics_rate=500", "sensors.imu_integration_rate=250"]
    return load_scenario("healthy_quad", [*common, *changes])


def fly(vehicle: str, changes: list[str], seeds: list[int], faults: tuple[Fault, ...] = ()) -> Flights:
    """Fly at the rates of this benchmark."""
    return fly_many(plan(vehicle, changes), seeds, 125.0, 100.0, faults)


def readings(flights: Flights, k: int) -> list[Reading | ControlReading]:
    """Return everything of one flight, the controller's own values in their place."""
    saturated = flights.command[:, :, k].max(axis=1) > 0.999
    own: list[ControlReading] = []
    for t, row, full in zip(flights.command_t, flights.control[:, :, k].tolist(), saturated, strict=True):
        lean, error, thrust, climb, yaw = row
        own.append(ControlReading(float(t), lean, error, thrust, bool(full), climb, yaw))
    merged: list[Reading | ControlReading] = []
    due = iter(own)
    following = next(due, None)
    for reading in flights.readings(k, commands=True):
        while following is not None and following.t <= reading.t:
            merged.append(following)
            following = next(due, None)
        merged.append(reading)
    return merged


def baseline(method: object) -> Watcher:
    """Return what runs a baseline to its first verdict."""

    def watch(flight: list[Reading | ControlReading]) -> Verdict | None:
        for reading in flight:
            verdict: Verdict | None = method.feed(reading)  # type: ignore[attr-defined]
            if verdict is not None:
                return verdict
        return None

    return watch


def ours(airframe: Airframe, config: EffectivenessConfig) -> Watcher:
    """Return what runs our estimator to its first named failure."""
    estimator = EffectivenessEstimator(airframe, config)

    def watch(flight: list[Reading | ControlReading]) -> Verdict | None:
        for reading in flight:
            if not isinstance(reading, ControlReading):
                for estimate in estimator.feed(reading):
                    if estimate.failure_probability > 0.9:
                        return Verdict(estimate.rotor, estimate.t)
        return None

    return watch


def calibrated(vehicle: str, seeds: list[int]) -> dict[str, dict[str, float]]:
    """Return every baseline's options for a vehicle, from healthy flights."""
    flown = [fly(vehicle, changes, seeds) for changes in HEALTHY.values()]
    airframe = plan(vehicle, []).vehicle.airframe()
    late = [flights.command_t > flights.flying_from for flights in flown]
    command = np.concatenate([f.command[at].ravel() for f, at in zip(flown, late, strict=True)])
    current = np.concatenate([f.current[at].ravel() for f, at in zip(flown, late, strict=True)])
    c2t, idle = fit(command, current)
    given: dict[str, dict[str, float]] = {"px4_1_16": {"c2t": float(command @ current / (command @ command))}}
    given["px4_main"] = {"c2t": c2t, "idle": idle, "under": 1.0, "over": 1.0}
    options: dict[str, dict[str, float]] = {}
    peaks: dict[str, float] = {}
    over = -math.inf
    for flights in flown:
        for k in range(flights.count):
            flight = readings(flights, k)
            for name in METHODS:
                try:
                    method = load(name, airframe, threshold=math.inf, **given.get(name, {}))
                except AirframeError:
                    continue
                baseline(method)(flight)
                peaks[name] = max(peaks.get(name, -math.inf), method.judge.peak)
                if isinstance(method, ResidualCheck):
                    over = max(over, method.over_judge.peak)
    for name, peak in peaks.items():
        threshold = max(MARGIN * peak, LEAST.get(name, LEAST_LOSS))
        if name == "px4_1_16":  # what is set there is a current, the rest of the score
            threshold = 1.0 - max(1.0 - peak, 0.0) / MARGIN
        options[name] = {**given.get(name, {}), "threshold": threshold}
    options["px4_main"] |= {
        "under": options["px4_main"]["threshold"],
        "over": MARGIN * over,
        "threshold": 1.0,
    }
    return options


def contestants(vehicle: str, options: dict[str, dict[str, float]]) -> dict[str, Maker]:
    """Return who takes part, each as what makes a fresh one."""
    scenario = plan(vehicle, [])
    told = scenario.vehicle.airframe()
    untold = replace(told, effectiveness=Effectiveness())
    paper = EffectivenessConfig(mode="paper", paper=PaperConfig(arm_speed=0.9 * scenario.vehicle.hover))
    makers: dict[str, Maker] = {
        "effectiveness": lambda: ours(untold, EffectivenessConfig()),
        "effectiveness, paper": lambda: ours(told, paper),
    }
    for name in METHODS:
        if name in options:
            makers[name] = lambda name=name: baseline(load(name, told, **options[name]))  # type: ignore[misc]
    makers["ardupilot_thrust_loss"] = lambda: baseline(ThrustLossCheck(told))
    makers["ardupilot_yaw"] = lambda: baseline(YawImbalanceCheck(told))
    return makers


@dataclass
class Tally:
    """What one contestant did with one kind of fault."""

    flights: int = 0
    early: int = 0
    right: int = 0
    delays: list[float] = field(default_factory=list)

    def take(self, verdict: Verdict | None, at: float, rotor: int) -> None:
        """Count one flight."""
        self.flights += 1
        if verdict is None or verdict.t > at + WITHIN:
            return
        if verdict.t < at:
            self.early += 1
            return
        self.delays.append(1e3 * (verdict.t - at))
        self.right += verdict.rotor == rotor

    def __str__(self) -> str:
        """Found, right rotor and delays."""
        if not self.delays:
            return f"0/{self.flights - self.early}"
        median, late = np.percentile(self.delays, [50.0, 97.5])
        found = f"{len(self.delays)}/{self.flights - self.early}"
        return f"{found}, {self.right} right, {median:.0f} / {late:.0f}"


def campaign(
    vehicle: str, makers: dict[str, Maker], count: int, seed: int
) -> Iterator[tuple[str, list[str]]]:
    """Fly everything once, hand each flight to everyone, and yield the table's rows."""
    tallies = {name: {kind: Tally() for kind in FAULTS} for name in makers}
    false = {name: dict.fromkeys(("aggressive", "wind"), 0) for name in makers}
    rotors = len(plan(vehicle, []).vehicle.rotors)
    for nth, (kind, (fault, size)) in enumerate(FAULTS.items()):
        seeds = [seed + 1000 * nth + k for k in range(count)]
        rng = np.random.default_rng(seeds[0])
        at, rotor = rng.uniform(*FAULT_AT, count), rng.integers(rotors, size=count)
        struck = (Fault(fault, rotor, at, size),)
        flights = fly(vehicle, ["trajectory.kind=random", "wind.speed=4"], seeds, struck)
        for k in range(count):
            flight = readings(flights, k)
            for name, make in makers.items():
                tallies[name][kind].take(make()(flight), BOOTED + at[k], int(rotor[k]))
    for nth, kind in enumerate(("aggressive", "wind")):
        flights = fly(vehicle, HEALTHY[kind], [seed + 5000 + 1000 * nth + k for k in range(count)])
        for k in range(count):
            flight = readings(flights, k)
            for name, make in makers.items():
                false[name][kind] += make()(flight) is not None
    for name in makers:
        early = sum(tally.early for tally in tallies[name].values())
        row = [str(tallies[name][kind]) for kind in FAULTS]
        yield name, [*row, f"{early}/{3 * count}", *[f"{n}/{count}" for n in false[name].values()]]


def main() -> None:
    """Print a table for each vehicle."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=16, help="a kind of fault, and of healthy flight")
    parser.add_argument("--calibration", type=int, default=6, help="flights of each healthy kind that tune")
    parser.add_argument("--seed", type=int, default=20000)
    parser.add_argument("--vehicles", nargs="*", default=["bebop2", "melczer_hexa"])
    parser.add_argument("--ours", action="store_true", help="ours as it ships alone: nothing to calibrate")
    args = parser.parse_args()
    print(
        f"# Rivals\n\nPrinted by `python benchmarks/rivals.py --flights {args.flights} --seed {args.seed}`.\n"
    )
    print("\n".join(line for line in (__doc__ or "").split("\n")[4:]))
    for vehicle in args.vehicles:
        options = {} if args.ours else calibrated(vehicle, list(range(1, args.calibration + 1)))
        makers = contestants(vehicle, options)
        if args.ours:
            makers = {"effectiveness": makers["effectiveness"]}
        print(f"\n## {vehicle}\n")
        print(
            "Faults: found, right rotor, delay in ms, median / 97.5 %. Last three: alarms in healthy flight.\n"
        )
        heads = ["method", "threshold", *FAULTS, "before the fault", "aggressive", "wind"]
        print("| " + " | ".join(heads) + " |\n|" + "---|" * len(heads), flush=True)
        for name, row in campaign(vehicle, makers, args.flights, args.seed):
            level = options.get(name, {})
            shown = f"{level['threshold']:.2g}" if level else "-"
            if name == "px4_main":
                shown = f"-{level['under']:.2g} / +{level['over']:.2g} A"
            print("| " + " | ".join([name, shown, *row]) + " |", flush=True)
        for name in METHODS:
            if options and name not in options:
                print(f"\n{name}: cannot work on this airframe.")


if __name__ == "__main__":
    main()
