"""Hours of simulated healthy flight, from bytes: what is alarmed of all the same.

    python benchmarks/healthy_hours.py --rounds 20 --seed 60000 --results hours.jsonl > benchmarks/healthy_hours.md
    python benchmarks/healthy_hours.py --one "payload drop" bebop2 60012 --rates 50/10 --log flight.tlog

Every flight takes off, does what its kind says and lands; vehicle, wind and what else is drawn depend on its seed
alone. It is flown once at the highest rates and its messages thinned out to the others, each received through the
whole monitor. A round has some two minutes of every kind with each vehicle; twenty are ten hours. An alarm is one id
of an alert of any severity, at any time of the log, under the code that it has escalated to. Hours count while the
monitor holds that the vehicle flies. Rates per hour: none seen in T hours bounds the rate by 3/T (95 %); else
Garwood's upper bound.

With `--results` flights already in that file are not flown again. Seeds from 61000 and from 70000 on were looked at.
"""

import argparse
import json
import sys
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from multiprocessing import Pool
from pathlib import Path

import numpy as np
from verdicts import FASTEST, MESSAGES, thinned

from gcs_health.fusion.alert_table import CATALOGUE
from gcs_health.fusion.verdicts import Verdict
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.simulate.flight import Flight
from gcs_health.simulate.scenario import Scenario, load_scenario
from gcs_health.simulate.telemetry import BOOTED

VEHICLES = ("bebop2", "melczer_hexa")
RATES = ("250/250", "50/50", "50/10")
GAP = 1.0  # s between verdicts that are still one flight
# of the file's capacity, so that some five sixths of it are flown empty in the flight
SMALL_BATTERY = {"bebop2": 0.22, "melczer_hexa": 0.5}
Draw = Callable[[float, float], float]


@dataclass(frozen=True)
class Alarm:
    """One alert: its last code, MAV_SEVERITY, motor and when it was raised [s, flight time]."""

    code: str
    severity: int
    motor: int | None
    t: float


@dataclass(frozen=True)
class Heard:
    """One flight at one rate: hours while it flew, and what was alarmed."""

    kind: str
    vehicle: str
    seed: int
    rates: str
    hours: float
    alarms: tuple[Alarm, ...]


def _hover(draw: Draw) -> list[str]:
    return ["trajectory.kind=hover", f"wind.speed={draw(0, 4)}", f"trajectory.height={draw(3, 20)}"]


def _random(draw: Draw) -> list[str]:
    return ["trajectory.kind=random", f"wind.speed={draw(0, 6)}", f"trajectory.height={draw(4, 20)}"]


def _aggressive(draw: Draw) -> list[str]:
    return ["trajectory.kind=aggressive", f"wind.speed={draw(0, 6)}", f"trajectory.height={draw(10, 25)}"]


def _windy(draw: Draw) -> list[str]:
    kind = "random" if draw(0, 1) < 0.5 else "hover"
    return [
        f"trajectory.kind={kind}",
        f"wind.speed={draw(6, 10)}",
        "wind.turbulence=moderate",
        f"trajectory.height={draw(5, 20)}",
    ]


def _descents(draw: Draw) -> list[str]:
    return [
        "trajectory.kind=descents",
        f"trajectory.speed={draw(3, 7)}",
        f"trajectory.every={draw(5, 9)}",
        f"trajectory.height={draw(15, 30)}",
        f"wind.speed={draw(0, 2)}",
        f"wind.wake={draw(0.03, 0.1)}",
    ]


def _landings(draw: Draw) -> list[str]:
    return ["trajectory.kind=hover", f"wind.speed={draw(0, 6)}", f"trajectory.height={draw(1.5, 6)}"]


def _payload(draw: Draw) -> list[str]:
    """Mass as a share of the vehicle's, until `scenario` multiplies by that."""
    return [
        f"trajectory.kind={'random' if draw(0, 1) < 0.5 else 'hover'}",
        f"trajectory.height={draw(5, 15)}",
        f"wind.speed={draw(0, 4)}",
        f"payload.mass={draw(0.05, 0.25)}",
        f"payload.position=[{draw(-0.03, 0.03)}, {draw(-0.03, 0.03)}, {draw(0.02, 0.08)}]",
        f"payload.dropped_at={draw(20, 55)}",
    ]


# how long [s], how many a round and vehicle, what is drawn
KINDS: dict[str, tuple[float, int, Callable[[Draw], list[str]]]] = {
    "hover": (120.0, 1, _hover),
    "random": (120.0, 1, _random),
    "aggressive": (120.0, 1, _aggressive),
    "windy": (120.0, 1, _windy),
    "descents": (120.0, 1, _descents),
    "take-off and landing": (40.0, 3, _landings),
    "payload drop": (80.0, 2, _payload),
    "battery sag": (480.0, 1, _random),  # with one vehicle every second round, by turns
}


def scenario(kind: str, vehicle: str, seed: int) -> Scenario:
    """Return the flight of a kind that belongs to a seed."""
    duration, _, drawn = KINDS[kind]
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(len(kind),)))
    changes = [f"vehicle={vehicle}", f"seed={seed}", f"trajectory.duration={duration}", "physics_rate=500"]
    changes += [f"wind.direction={rng.uniform(0, 360):.0f}"]
    changes += drawn(lambda low, high: round(float(rng.uniform(low, high)), 3))
    changes += [f"telemetry.rates.{name}={FASTEST:g}" for name in MESSAGES]
    changes += [f"sensors.esc_rate={FASTEST:g}", f"sensors.imu_integration_rate={FASTEST:g}"]
    flight = load_scenario("healthy_quad", changes)
    if flight.payload.mass:
        heavy = flight.payload.mass * flight.vehicle.mass
        flight = replace(flight, payload=replace(flight.payload, mass=heavy))
    if kind == "battery sag":
        battery = flight.vehicle.battery
        small = replace(battery, capacity=battery.capacity * SMALL_BATTERY[vehicle])
        flight = replace(flight, vehicle=replace(flight.vehicle, battery=small))
    return flight


def heard(log: bytes, kind: str, vehicle: str, seed: int, rates: str) -> Heard:
    """Receive one flight."""
    flying: list[float] = []

    def tap(_: str, verdicts: list[Verdict], flies: bool) -> None:
        if flies:
            flying.append(verdicts[0].t)

    monitor = Monitor(MonitorConfig(stamped=True, verdict_tap=tap))
    alarms: dict[str, Alarm] = {}
    for event in monitor.feed(log) + monitor.finish():
        if isinstance(event, AlertEvent) and event.state in ("raised", "escalated"):
            first = alarms[event.id].t if event.id in alarms else round(event.t - BOOTED, 2)
            alarms[event.id] = Alarm(event.code, event.severity, event.motor, first)
    steps = np.diff(flying)
    hours = float(steps[steps < GAP].sum()) / 3600.0
    return Heard(kind, vehicle, seed, rates, hours, tuple(alarms.values()))


def flown(task: tuple[str, str, int, list[str]]) -> list[Heard]:
    """Fly once, listen at all rates."""
    kind, vehicle, seed, rates = task
    frames = list(Flight(scenario(kind, vehicle, seed)).run())
    return [heard(thinned(frames, rate), kind, vehicle, seed, rate) for rate in rates]


def flights(rounds: int, seed: int, kinds: list[str]) -> Iterator[tuple[str, str, int]]:
    """Yield kind, vehicle and seed of every flight; each kind has its seeds, whichever others are flown."""
    for turn in range(rounds):
        for kind in kinds:
            _, count, _ = KINDS[kind]
            for k in range(count):
                for vehicle in VEHICLES:
                    if kind != "battery sag" or (turn % 2 == 0 and vehicle == VEHICLES[turn // 2 % 2]):
                        yield kind, vehicle, seed + turn * count + k


def known(path: Path | None) -> dict[tuple[str, str, int, str], Heard]:
    """Return what a results file holds."""
    out: dict[tuple[str, str, int, str], Heard] = {}
    if path is None or not path.exists():
        return out
    for line in path.read_text().splitlines():
        row = json.loads(line)
        row["alarms"] = tuple(Alarm(**alarm) for alarm in row["alarms"])
        one = Heard(**row)
        out[one.kind, one.vehicle, one.seed, one.rates] = one
    return out


def most(count: int, hours: float) -> str:
    """Return the upper 95 % bound of a rate per hour: 3/T where nothing was seen."""
    from scipy.stats import chi2

    if not hours:
        return "-"
    return f"{(3.0 if not count else float(chi2.ppf(0.95, 2 * count + 2)) / 2.0) / hours:.2f}"


def codes(results: list[Heard]) -> str:
    """Return the alarms' codes with severity and count."""
    seen = Counter(f"{alarm.code} (severity {alarm.severity})" for one in results for alarm in one.alarms)
    return ", ".join(f"{code} {count}" for code, count in seen.most_common())


def table(results: list[Heard]) -> None:
    """Print hours and alarms by kind and rate, then by rate alone."""
    cells: dict[tuple[str, str], list[Heard]] = defaultdict(list)
    for one in results:
        cells[one.kind, one.rates].append(one)
        cells["all", one.rates].append(one)
    print("| flight | rates | flights | h | alarms | per h, at most | codes |\n" + "|---" * 7 + "|")
    for kind in (*KINDS, "all"):
        for rates in dict.fromkeys(one.rates for one in results):
            many = cells[kind, rates]
            hours, count = sum(one.hours for one in many), sum(len(one.alarms) for one in many)
            if many:
                row = f"| {kind} | {rates} | {len(many)} | {hours:.2f} | {count} | {most(count, hours)} |"
                print(f"{row} {codes(many)} |")
    print("\n| severity | rates | h | alarms | per h | at most |\n" + "|---" * 6 + "|")
    for name, worst in (("critical (0 to 2)", range(3)), ("advisory (3 and above)", range(3, 8))):
        for rates in dict.fromkeys(one.rates for one in results):
            many = cells["all", rates]
            hours = sum(one.hours for one in many)
            count = sum(alarm.severity in worst for one in many for alarm in one.alarms)
            print(
                f"| {name} | {rates} | {hours:.2f} | {count} | {count / hours:.2f} | {most(count, hours)} |"
            )


def look(kind: str, vehicle: str, seed: int, rates: list[str], log: Path | None) -> None:
    """Fly one flight and say what was alarmed."""
    frames = list(Flight(scenario(kind, vehicle, seed)).run())
    for rate in rates:
        received = thinned(frames, rate)
        if log is not None:
            log.write_bytes(received)
        one = heard(received, kind, vehicle, seed, rate)
        print(f"{kind}, {vehicle}, seed {seed}, {rate}: {one.hours * 3600:.0f} s in flight")
        for alarm in one.alarms:
            print(f"  {CATALOGUE[alarm.code].code} motor {alarm.motor} at {alarm.t:.2f} s")


def main() -> None:
    """Fly and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--seed", type=int, default=60000)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    parser.add_argument("--rates", nargs="*", default=list(RATES))
    parser.add_argument("--results", type=Path, help="JSON lines, one a flight and rate")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--one", nargs=3, metavar=("KIND", "VEHICLE", "SEED"))
    parser.add_argument("--log", type=Path, help="with --one: write the received .tlog")
    args = parser.parse_args()
    if args.one:
        look(args.one[0], args.one[1], int(args.one[2]), args.rates, args.log)
        return
    before = known(args.results)
    plan = list(flights(args.rounds, args.seed, args.kinds))
    missing = [(*one, args.rates) for one in plan if any((*one, rate) not in before for rate in args.rates)]
    with Pool(args.processes) as pool:
        for fresh in pool.imap_unordered(flown, missing):
            before.update({(one.kind, one.vehicle, one.seed, one.rates): one for one in fresh})
            if args.results:
                with args.results.open("a") as file:
                    file.writelines(json.dumps(asdict(one)) + "\n" for one in fresh)
    results = [before[(*one, rate)] for one in plan for rate in args.rates]
    print(f"# Healthy hours\n\nPrinted by `python benchmarks/healthy_hours.py {' '.join(sys.argv[1:])}`.\n")
    table(results)


if __name__ == "__main__":
    main()
