"""What each registered estimator is worth at each telemetry rate, with and without filtering on board.

    python replay/rates.py
    python replay/rates.py --estimators effectiveness --flights 24 --seed 30000

Flights are simulated once at 500 Hz and thinned, as a stream of the newest values is. Filter "none": each
value is the mean of 2 ms (PX4 with IMU_INTEG_RATE 500); "20 Hz": ArduPilot's two-pole low-pass, which the
estimator is told of. Found = named within the entry's time after the fault, and nothing before.

To add an estimator, add an entry: which vehicle and fault show what it is for, and what it may be told.
"""

import argparse
import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, product

import numpy as np

from gcs_health.airframe import Airframe, Effectiveness
from gcs_health.estimators import load
from gcs_health.estimators.contract import Estimate
from gcs_health.samples import ImuFilterReading, Reading
from gcs_health.simulate.batch import Flights, fly_many
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import Scenario, Telemetry, load_scenario
from gcs_health.simulate.telemetry import BOOTED

RATES = ((500, 500), (250, 250), (100, 100), (100, 50), (50, 50), (50, 10), (10, 1))  # IMU, ESC [Hz]
FULL = 500.0  # Hz
CUTOFF = 20.0  # Hz
FILTERS = {  # name: autopilot, and what the estimator is told
    "none": ("px4", ImuFilterReading(0.0, 1.0 / FULL, math.nan, "simulated")),
    "20 Hz": ("ardupilot", ImuFilterReading(0.0, math.nan, CUTOFF, "simulated")),
}


def untold(airframe: Airframe) -> Airframe:
    """Return the geometry alone: gains are learned in flight."""
    return replace(airframe, effectiveness=Effectiveness())


def failed(estimate: Estimate) -> bool:
    """Whether an estimate names its rotor."""
    return estimate.failure_probability > 0.9


@dataclass(frozen=True)
class Entry:
    """What one estimator is asked.

    Attributes
    ----------
    vehicles : simulated ones. fault, size : of `simulate/faults.py`.
    changes : to the scenario. struck : fault between these times [s]; duration [s] of each flight.
    within : [s] in which the fault must be named. told : what the estimator knows of the airframe.
    named : which estimate names its rotor. commands : whether it is fed motor commands.
    asked_every : [s] between looks at `estimates`, for those that tell no change; 0 = `feed` alone.
    """

    vehicles: tuple[str, ...]
    fault: str
    size: float = math.nan
    changes: tuple[str, ...] = ("trajectory.kind=random", "wind.speed=4")
    struck: tuple[float, float] = (14.0, 20.0)
    duration: float = 21.0
    within: float = 1.0
    told: Callable[[Airframe], Airframe] = untold
    named: Callable[[Estimate], bool] = failed
    commands: bool = False
    asked_every: float = 0.0


ENTRIES: dict[str, Entry] = {
    "effectiveness": Entry(("bebop2", "melczer_hexa"), "propeller_lost"),
    # 40 mg at the tip, the paper's damage, which nobody tells it; its answers look back on 20 s and 10 s
    "unbalance": Entry(
        ("ghalamchi_medium",),
        "unbalance",
        4.0,
        struck=(14.0, 18.0),
        duration=46.0,
        within=27.0,
        asked_every=1.0,
    ),
    "motor_observer": Entry(("bebop2", "melczer_hexa"), "propeller_lost"),
    # without a trained model: its speed path, of a rotor that turns a fifth too slowly
    "pooled_ar": Entry(
        ("dutta_hexa",),
        "slow",
        0.8,
        struck=(18.0, 22.0),
        duration=28.0,
        within=5.0,
        commands=True,
        asked_every=0.1,
    ),
}


def plan(entry: Entry, vehicle: str, filtered: str) -> Scenario:
    """Return the scenario of an entry."""
    common = [f"vehicle={vehicle}", f"trajectory.duration={entry.duration}", "trajectory.height=7.5"]
    common += ["trajectory.lands=false", "physics_rate=500", f"sensors.esc_rate={FULL}"]
    common += [f"sensors.imu_integration_rate={FULL}", f"sensors.imu_filter={CUTOFF}"]
    scenario = load_scenario("healthy_quad", [*common, *entry.changes])
    return replace(scenario, telemetry=Telemetry(FILTERS[filtered][0]))


def thinned(flights: Flights, imu: float, esc: float) -> Flights:
    """Return what comes at lower rates [Hz], the newest value each time."""
    k, m = round(FULL / imu), round(FULL / esc)
    return replace(
        flights,
        imu_t=flights.imu_t[k - 1 :: k],
        imu=flights.imu[k - 1 :: k],
        height=flights.height[k - 1 :: k],
        rotor_t=flights.rotor_t[m - 1 :: m],
        speed=flights.speed[m - 1 :: m],
        current=flights.current[m - 1 :: m],
        command_t=flights.command_t[m - 1 :: m],
        command=flights.command[m - 1 :: m],
        control=flights.control[m - 1 :: m],
    )


def verdict(name: str, entry: Entry, airframe: Airframe, readings: Iterable[Reading]) -> tuple[float, int]:
    """Return (time, rotor) of the first rotor that is named; inf, -1 if none is."""
    estimator = load(name, entry.told(airframe))
    ask = 0.0
    for reading in readings:
        if type(reading) not in estimator.takes:
            continue
        said = list(estimator.feed(reading))
        if entry.asked_every and reading.t >= ask:
            ask = reading.t + entry.asked_every
            said += estimator.estimates(reading.t)
        for estimate in said:
            if entry.named(estimate):
                return reading.t, estimate.rotor
    return math.inf, -1


def verdicts(name: str, entry: Entry, scenario: Scenario, flights: Flights) -> list[tuple[float, int]]:
    """Return the verdict of each flight."""
    airframe = scenario.vehicle.airframe()
    told = next(told for autopilot, told in FILTERS.values() if autopilot == scenario.telemetry.autopilot)
    streams = [chain([told], flights.readings(k, entry.commands)) for k in range(flights.count)]
    return [verdict(name, entry, airframe, stream) for stream in streams]


def rows(name: str, entry: Entry, count: int, seed: int, rates: tuple[tuple[int, int], ...]) -> Iterator[str]:
    """Yield the table's rows of one estimator."""
    for vehicle, filtered in product(entry.vehicles, FILTERS):
        scenario = plan(entry, vehicle, filtered)
        rng = np.random.default_rng(seed)
        at = rng.uniform(*entry.struck, count)
        rotor = rng.integers(len(scenario.vehicle.rotors), size=count)
        struck = (Fault(entry.fault, rotor, at, entry.size),)
        faulty = fly_many(scenario, [seed + k for k in range(count)], FULL, FULL, struck)
        healthy = fly_many(scenario, [seed + 1000 + k for k in range(count)], FULL, FULL, ())
        hours = count * (entry.duration - scenario.trajectory.flying_from) / 3600.0
        for imu, esc in rates:
            said = verdicts(name, entry, scenario, thinned(faulty, imu, esc))
            alarms = sum(t < math.inf for t, _ in verdicts(name, entry, scenario, thinned(healthy, imu, esc)))
            delays = np.array([t for t, _ in said]) - BOOTED - at
            early = int(np.sum(delays < 0.0))
            in_time = (delays >= 0.0) & (delays <= entry.within)
            right = int(np.sum(in_time & (np.array([named for _, named in said]) == rotor)))
            found = 1e3 * delays[in_time]
            median, late = (
                [f"{v:.0f}" for v in np.percentile(found, [50.0, 97.5])] if len(found) else ["-", "-"]
            )
            yield (
                f"| {name} | {vehicle} | {entry.fault} | {filtered} | {imu}/{esc} | {len(found)}/{count - early} "
                f"| {right} | {median} | {late} | {early} | {alarms}/{count} | {hours:.2f} |"
            )


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--estimators", nargs="*", default=list(ENTRIES), choices=list(ENTRIES))
    parser.add_argument("--vehicles", nargs="*", help="of an entry's; all")
    parser.add_argument("--flights", type=int, default=12, help="with the fault, and as many healthy ones")
    parser.add_argument("--seed", type=int, default=30000)
    parser.add_argument("--quick", action="store_true", help="two flights at two rates")
    args = parser.parse_args(arguments)
    count = 2 if args.quick else args.flights
    rates = ((100, 50), (50, 10)) if args.quick else RATES
    print(
        "| estimator | vehicle | fault | filter | IMU/ESC Hz | found | right rotor | median ms | 97.5 % ms "
        "| before the fault | alarms in healthy flights | healthy h |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|---|---|", flush=True)
    for name in args.estimators:
        entry = ENTRIES[name]
        if args.vehicles:
            entry = replace(entry, vehicles=tuple(v for v in entry.vehicles if v in args.vehicles))
        for row in rows(name, entry, count, args.seed, rates):
            print(row, flush=True)


if __name__ == "__main__":
    main()
