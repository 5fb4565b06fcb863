"""Condition for maintenance: what regimes do to the indicators, and what is found of slow growth.

    python benchmarks/condition.py --vehicles 6 --seed 2000 --long 4

A vehicle's twelve flights, a week apart, of 60 s: hover in light air, gusts, a long climb, a third more payload, a
low battery, drawn at random; each with its own mass (1 %) and air (2 %). On every second vehicle the unbalance of
motor 3 grows by 60 % over the flights, and the bearing of motor 1 until its torque is up by some 15 %; on the others
nothing does. Sensor values go straight to the estimators, without MAVLink between; what they say goes the whole way
through the history store. Seeds 1 to 4 and 1000 to 1007 were looked at for the thresholds of the regimes.

Then flights of 230 s in calm air, on every second of which the unbalance of motor 3 doubles and the torque of motor 1
grows by a fifth while it flies.
"""

import argparse
import math
import tempfile
from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gcs_health.condition.growth import line
from gcs_health.condition.indicators import Indicator
from gcs_health.estimator_bench import EstimatorBench
from gcs_health.record.condition_log import ConditionLog
from gcs_health.record.describe import estimate_event
from gcs_health.record.events import SummaryEvent, VehicleEvent
from gcs_health.record.flight_results import FlightCollector, FlightRecord
from gcs_health.record.history import History
from gcs_health.record.trends import DAY_US, Point
from gcs_health.record.vehicle_history import VehicleHistory
from gcs_health.samples import FlightReading
from gcs_health.simulate.batch import Flights, fly_many
from gcs_health.simulate.detect import wilson
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import Scenario, load_scenario

BEGAN = 1_780_000_000_000_000  # UNIX µs
FLIGHTS, DURATION, LONG = 12, 60.0, 230.0
STEPS = 24  # of what grows within a flight
IMU, ESC = 200.0, 50.0  # Hz
KINDS = {"hover": 0.35, "gusts": 0.2, "climb": 0.15, "payload": 0.2, "low battery": 0.1}
WORN_UNBALANCE, WORN_DRAG = 3, 1  # motors
PAYLOAD, USED = 1.33, 1.9  # factor on the mass; A h of 2.2
ESTIMATORS = ("unbalance", "motor_observer")
ROTORS = 4


class Plan(NamedTuple):
    """One flight: whose, which, of what kind, and its rotors: g mm, factor on the friction, factor on the thrust."""

    vehicle: int
    flight: int
    kind: str
    seed: int
    unbalance: tuple[float, ...]
    friction: tuple[float, ...]
    thrust: tuple[float, ...]


def scenario(kind: str, duration: float) -> Scenario:
    """Return how a flight of this kind is flown."""
    changes = [
        "vehicle=ghalamchi_medium",
        "trajectory.lands=false",
        "trajectory.height=12",
        "physics_rate=500",
    ]
    changes += [f"trajectory.duration={duration}", "sensors.residual_unbalance=0", "wind.speed=2"]
    changes += ["spread.mass=0.01", "spread.thrust=0.02", "spread.inertia=0", "spread.rotor=0"]
    if kind == "calm":
        changes += ["wind.turbulence=none"]
    elif kind == "gusts":
        changes += ["wind.speed=8", "wind.turbulence=severe"]
    elif kind == "climb":
        changes += ["trajectory.height=50"]
    return load_scenario("healthy_quad", changes)


def plans(vehicles: int, seed: int) -> list[Plan]:
    """Draw the flights of all vehicles; every second one wears."""
    found = []
    for v in range(vehicles):
        rng = np.random.default_rng(seed + v)
        unbalance, friction = rng.uniform(0.3, 1.0, ROTORS), rng.uniform(1.0, 3.0, ROTORS)
        thrust = rng.uniform(0.97, 1.0, ROTORS)
        for k in range(FLIGHTS):
            kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
            share = k / (FLIGHTS - 1) if v % 2 else 0.0
            u, f = unbalance.copy(), friction.copy()
            u[WORN_UNBALANCE - 1] *= 1.0 + 0.6 * share
            f[WORN_DRAG - 1] += 7.0 * share
            found.append(Plan(v, k, kind, 1000 * (seed + v) + k, tuple(u), tuple(f), tuple(thrust)))
    return found


def fly(flights: list[Plan], kind: str, duration: float, more: tuple[Fault, ...] = ()) -> Flights:
    """Fly plans of one kind side by side."""
    faults = []
    for k in range(ROTORS):
        for name, values in (
            ("unbalance", "unbalance"),
            ("bearing", "friction"),
            ("effectiveness", "thrust"),
        ):
            size = np.array([getattr(plan, values)[k] for plan in flights])
            faults.append(Fault(name, k, np.zeros(len(flights)), size))
    payload = np.array([PAYLOAD if plan.kind == "payload" else 1.0 for plan in flights])
    used = np.array([USED if plan.kind == "low battery" else 0.0 for plan in flights])
    seeds = [plan.seed for plan in flights]
    return fly_many(scenario(kind, duration), seeds, IMU, ESC, (*faults, *more), payload=payload, used=used)


def watch(flown: Flights, k: int, plan: Plan) -> FlightRecord:
    """Let the estimators see one flight; return what the history keeps of it."""
    airframe = scenario(
        "hover", DURATION
    ).vehicle.airframe()  # as the vehicle file has it: without the payload
    bench, log, collector = (
        EstimatorBench(airframe, ESTIMATORS, "recommended"),
        ConditionLog("1.1"),
        FlightCollector(),
    )
    log.adopt(airframe)
    us, name = BEGAN + 7 * plan.flight * DAY_US, f"{plan.vehicle + 1}.1"
    collector.feed([VehicleEvent(0.0, us, name, "flight", "armed", armed=True)])
    flies, due, t = True, -math.inf, 0.0
    for reading in flown.readings(k):
        t = reading.t
        log.read(reading)
        bench.feed(reading)
        if isinstance(reading, FlightReading):
            flies = reading.flies
        if t >= due:
            due = t + 0.1
            said = bench.routine(t)
            log.routine(t, said, flies)
            collector.feed(estimate_event(each, airframe, us, name) for each in said)
    told = [event._replace(vehicle=name) for event in log.end(t, us)]
    (record,) = collector.feed([*told, SummaryEvent(t, us, name, t, {}, {}, {}, (), (), ())])
    return record


def fly_all(flights: list[Plan]) -> list[tuple[Plan, FlightRecord]]:
    """Fly and watch all plans of the first part."""
    found = []
    for kinds in (
        ("hover", "payload", "low battery"),
        ("gusts",),
        ("climb",),
    ):  # each way of flying side by side
        alike = [plan for plan in flights if plan.kind in kinds]
        if len(alike) > 1:  # one flight alone has floats for columns
            flown = fly(alike, kinds[0], DURATION)
            found += [(plan, watch(flown, k, plan)) for k, plan in enumerate(alike)]
    return sorted(found, key=lambda each: each[0][:2])


class Judged(NamedTuple):
    """One series of a vehicle: its worn motor or not, and what was said without and with regimes."""

    quantity: str
    worn: bool
    plain: tuple[Point, ...]
    alike: tuple[Point, ...]
    old: bool
    new: bool
    regime: str


def judge(records: list[FlightRecord], wears: bool) -> list[Judged]:
    """Put a vehicle's flights into a history; return what it says of each series."""
    with tempfile.TemporaryDirectory() as folder:
        history = History(str(Path(folder) / "h.sqlite"))
        for record in records:
            history.store(record)
        told = VehicleHistory.of(history, history.vehicles()[0], None, {})
        history.close()
    found = []
    for each in told.lines:
        if each.quantity not in ("unbalance", "drag"):
            continue
        worn = wears and each.motor == (WORN_UNBALANCE if each.quantity == "unbalance" else WORN_DRAG)
        days = [((point.at_us - BEGAN) / DAY_US, point.value) for point in each.points]
        old = len(days) >= 5 and line(days, 0.025).low > 0.0
        new = each.trend is not None and each.trend.grows
        found.append(Judged(each.quantity, worn, each.points, each.alike.points, old, new, each.alike.regime))
    return found


def spread(points: tuple[Point, ...]) -> float:
    """Return the scatter of one series over its mean [-]."""
    values = [point.value for point in points]
    return float(np.std(values, ddof=1) / np.mean(values)) if len(values) > 2 else math.nan


def grown(points: tuple[Point, ...]) -> float:
    """Return by how much a line through one series grows from its first to its last flight [-]."""
    fitted = line([(point.at_us / DAY_US, point.value) for point in points], 0.025)
    return fitted.now / fitted.start - 1.0


def report_series(judged: list[Judged]) -> None:
    """Print scatter on healthy series, false findings and found ones."""
    print(
        "| indicator | healthy series | scatter plain | scatter alike | false plain | false alike |", end=""
    )
    print(" growing series | found plain | found alike | grown plain | grown alike |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for quantity in ("unbalance", "drag"):
        healthy = [each for each in judged if each.quantity == quantity and not each.worn]
        worn = [each for each in judged if each.quantity == quantity and each.worn]
        cells = [quantity, str(len(healthy))]
        cells.append(f"{np.nanmedian([spread(each.plain) for each in healthy]):.1%}")
        cells.append(f"{np.nanmedian([spread(each.alike) for each in healthy]):.1%}")
        cells += [share([e.old for e in healthy]), share([e.new for e in healthy])]
        cells += [str(len(worn)), share([e.old for e in worn]), share([e.new for e in worn])]
        cells += [
            f"{np.median([grown(getattr(each, of)) for each in worn]):+.1%}" for of in ("plain", "alike")
        ]
        print(f"| {' | '.join(cells)} |")


def share(said: list[bool]) -> str:
    """Return how many with the 95 % interval of their share (Wilson)."""
    if not said:
        return "-"
    low, high = wilson(sum(said), len(said))
    return f"{sum(said)} ({low:.0%} to {high:.0%})"


def report_kinds(flown: list[tuple[Plan, FlightRecord]]) -> None:
    """Print what each kind of flight was taken for, and by how much each indicator is off the vehicle's hover."""
    print("\n| flown | flights | taken for (s a flight) | unbalance plain | alike | drag plain | alike |")
    print("|---|---|---|---|---|---|---|")
    healthy = [(plan, record) for plan, record in flown if plan.vehicle % 2 == 0]
    plain: dict[tuple[int, int, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    alike: dict[tuple[int, int, str], dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    seconds: dict[str, dict[str, float]] = defaultdict(lambda: defaultdict(float))
    for plan, record in healthy:
        for row in record.results:
            if row.valid and row.quantity in ("unbalance", "drag"):
                plain[plan.vehicle, row.motor, row.quantity][plan.kind].append(row.value)
        best: dict[tuple[int, str], Indicator] = {}
        for each in record.condition:
            if each.motor == 1 and each.quantity == "drag":
                seconds[plan.kind][each.regime] += each.seconds
            key = each.motor, each.quantity
            if key not in best or each.seconds > best[key].seconds:
                best[key] = each
        for (motor, quantity), each in best.items():
            value = each.value * (each.load if quantity == "unbalance" else 1.0)
            alike[plan.vehicle, motor, quantity][plan.kind].append(value)
    for kind in KINDS:
        count = sum(plan.kind == kind for plan, _ in healthy)
        if not count:
            continue
        ranked = sorted(seconds[kind].items(), key=lambda item: -item[1])
        words = ", ".join(f"{regime} {s / count:.0f}" for regime, s in ranked if s / count >= 1.0)
        cells = [off(of, kind, quantity) for quantity in ("unbalance", "drag") for of in (plain, alike)]
        print(f"| {kind} | {count} | {words} | {' | '.join(cells)} |")


def off(of: dict[tuple[int, int, str], dict[str, list[float]]], kind: str, quantity: str) -> str:
    """Return the median difference from the same rotor's hover flights."""
    ratios = [
        np.mean(kinds[kind]) / np.mean(kinds["hover"]) - 1.0
        for (_, _, name), kinds in of.items()
        if name == quantity and kinds.get(kind) and kinds.get("hover")
    ]
    return f"{np.median(ratios):+.1%}" if ratios else "-"


def within(flights: int, seed: int) -> None:
    """Print what is found of growth within single flights."""
    made = [plan for plan in plans(2 * flights, seed + 500) if plan.flight == 0][: 2 * flights]
    worn = np.arange(len(made)) % 2 == 1
    unbalance = np.array([plan.unbalance[WORN_UNBALANCE - 1] for plan in made])
    friction = np.array([plan.friction[WORN_DRAG - 1] for plan in made])
    more = []
    for k in range(1, STEPS + 1):
        at, part = np.full(len(made), 12.0 + k * (LONG - 12.0) / (STEPS + 1)), worn * k / STEPS
        more.append(Fault("bearing", WORN_DRAG - 1, at, friction + 9.0 * part))
        more.append(Fault("unbalance", WORN_UNBALANCE - 1, at, unbalance * (1.0 + part)))
    flown = fly(made, "calm", LONG, tuple(more))
    grew: dict[tuple[str, bool], list[bool]] = defaultdict(list)
    for k, plan in enumerate(made):
        for each in watch(flown, k, plan).condition:
            if each.slope == each.slope:
                motor = WORN_UNBALANCE if each.quantity == "unbalance" else WORN_DRAG
                grew[each.quantity, bool(worn[k]) and each.motor == motor].append(each.grows)
    print("\n| within a flight | healthy series | false findings | growing | found |\n|---|---|---|---|---|")
    for quantity in ("unbalance", "drag"):
        calm, grown = grew[quantity, False], grew[quantity, True]
        print(f"| {quantity} | {len(calm)} | {share(calm)} | {len(grown)} | {share(grown)} |")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--vehicles", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--long", type=int, default=4, help="healthy flights of the second part, and as many worn"
    )
    args = parser.parse_args()
    flown = fly_all(plans(args.vehicles, args.seed))
    judged = []
    for v in range(args.vehicles):
        judged += judge([record for plan, record in flown if plan.vehicle == v], bool(v % 2))
    report_series(judged)
    report_kinds(flown)
    if args.long:
        within(args.long, args.seed)


if __name__ == "__main__":
    main()
