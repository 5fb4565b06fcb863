"""The motor observer on a bench of rotors: delays of ejected propellers, false alarms of healthy flights, and more.

    python benchmarks/motor_observer.py --flights 400 --seed 50000 delays      the table of delays and false alarms
    python benchmarks/motor_observer.py --flights 200 --seed 60000 slow        partial loss, friction, lost drive
    python benchmarks/motor_observer.py --flights 60 --seed 70000 identify     current side, constants
    python benchmarks/motor_observer.py --flights 100 --seed 10100 curve       delay and alarms by threshold
    python benchmarks/motor_observer.py --flights 8 cost                       time a reading takes

Four rotors (`motor_bench.py`), flights with take-off and landing. Delay is from the loss to the time of
the sample that named it; the link's latency comes on top. "Found" is a right rotor within 2 s and nothing before.
Seeds below 20000 tuned the rules; seeds from 50000 report.
"""

import argparse
import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from motor_bench import ROTORS, TORQUE_CONSTANT, Bench, Telemetry, Trouble, airframe, fly

from gcs_health.airframe import Airframe, Motor
from gcs_health.estimators.contract import Quantity, Reason
from gcs_health.estimators.motor_observer import MotorObserver, MotorObserverConfig
from gcs_health.estimators.motor_observer_config import RecommendedConfig
from gcs_health.estimators.torque_balance import BalanceConfig

BATCH = 100
WITHIN = 2.0  # s
CURVE = (3.0, 4.0, 5.0, 6.0, 8.0, 9.0, 10.0, 11.0, 12.0, 14.0, 16.0, 20.0)  # thresholds


@dataclass(frozen=True)
class Cell:
    """One row of the table: what the telemetry is like and what the vehicle file knows."""

    name: str
    telemetry: Telemetry
    known: dict[str, object] = field(default_factory=dict)
    inertia: float = 1.0
    blank: bool = False  # nothing known of the motor
    mode: str = "recommended"

    def craft(self, bench: Bench, flight: int) -> Airframe:
        """Return the vehicle of one flight."""
        return airframe(Motor()) if self.blank else bench.airframe(flight, self.inertia, **self.known)


AT50 = Telemetry(50.0)
AVERAGED = Telemetry(10.0, "mean")
CELLS = {
    cell.name: cell
    for cell in (
        Cell("50 Hz", AT50),
        Cell("50 Hz, J x0.5", AT50, inertia=0.5),
        Cell("50 Hz, J x1.5", AT50, inertia=1.5),
        Cell("50 Hz, nothing known", AT50, blank=True),
        Cell("50 Hz, 10 rpm and .1 A steps", Telemetry(50.0, rpm_step=10.0, current_step=0.1)),
        Cell("50 Hz, 10 rpm and 1 A steps", Telemetry(50.0, rpm_step=10.0, current_step=1.0)),
        Cell("50 Hz, battery amps", Telemetry(50.0, side="battery"), {"current_side": None}),
        Cell("50 Hz, current lag 40 ms", Telemetry(50.0, lag=0.04)),
        Cell("10 Hz averaged", AVERAGED),
        Cell("10 Hz averaged, J x0.5", AVERAGED, inertia=0.5),
        Cell("10 Hz averaged, J x1.5", AVERAGED, inertia=1.5),
        Cell("10 Hz averaged, nothing known", AVERAGED, blank=True),
        Cell("10 Hz snapshots", Telemetry(10.0)),
        Cell("500 Hz", Telemetry(500.0)),
        Cell("thesis, 50 Hz", AT50, mode="paper"),
        Cell("thesis, 50 Hz, J x0.5", AT50, inertia=0.5, mode="paper"),
        Cell("thesis, 50 Hz, J x1.5", AT50, inertia=1.5, mode="paper"),
        Cell("thesis, 10 Hz averaged", AVERAGED, mode="paper"),
    )
}


def observer(craft: Airframe, mode: str = "recommended") -> MotorObserver:
    """Return a new observer."""
    return MotorObserver(craft, MotorObserverConfig(mode=mode))  # type: ignore[arg-type]


def alarms(
    bench: Bench, flight: int, cell: Cell, until: float = math.inf
) -> Iterator[tuple[float, int, str, str]]:
    """Yield (time, rotor, quantity, rule) of each decision that something failed."""
    watching = observer(cell.craft(bench, flight), cell.mode)
    standing: set[tuple[int, str, str]] = set()
    for reading in bench.readings(flight, cell.telemetry):
        if reading.t > until:
            return
        for estimate in watching.feed(reading):
            rule = str(dict(estimate.evidence).get("rule", ""))
            if Reason.MOTOR_NOT_DRIVEN in estimate.reasons:
                rule = "motor_not_driven"
            key = (estimate.rotor, str(estimate.quantity), rule)
            if estimate.failure_probability >= 0.9:
                if key not in standing:
                    standing.add(key)
                    yield (estimate.t, *key)
            else:
                standing.discard(key)


def batches(
    count: int, seed: int, trouble: Trouble, lag: float = 0.0, duration: float = 60.0
) -> Iterator[Bench]:
    """Fly so many flights in batches."""
    for first in range(seed, seed + count, BATCH):
        yield fly(list(range(first, min(first + BATCH, seed + count))), duration, trouble, lag)


def share(found: int, of: int) -> str:
    """Return a count, and the exact 95 % upper bound of its rate where it is none."""
    return f"{found}/{of}" + (f" (<= {100.0 * (1.0 - 0.05 ** (1.0 / of)):.1f} %)" if not found and of else "")


@dataclass
class Tally:
    """What came of one row."""

    waits: list[float] = field(default_factory=list)  # ms
    bad: int = 0
    flown: int = 0
    false: int = 0
    healthy: int = 0


def delays(args: argparse.Namespace) -> None:
    """Print delays and false alarms of lost propellers."""
    cells = [CELLS[name] for name in args.cells or CELLS]
    rows = {cell.name: Tally() for cell in cells}
    for lag in sorted({cell.telemetry.lag for cell in cells}):
        group = [cell for cell in cells if cell.telemetry.lag == lag]
        for kind, seed in (("ejected", args.seed), ("none", args.seed + 5000)):
            done = 0
            for bench in batches(args.flights, seed, Trouble(kind), lag, args.duration):
                for cell in group:
                    most = args.flights // 4 if cell.telemetry.rate > 100.0 else args.flights
                    for flight in range(max(0, min(len(bench.seeds), most - done))):
                        tally(rows[cell.name], bench, flight, cell, kind, args.verbose)
                done += len(bench.seeds)
    print("| case | found | median ms | 95 % CI | 97.5 % ms | early or wrong | healthy: false alarms |")
    print("|---|---|---|---|---|---|---|")
    for name, row in rows.items():
        rng = np.random.default_rng(0)
        values = np.array(row.waits or [math.nan])
        medians = np.median(rng.choice(values, (1000, len(values))), axis=1)
        low, high = np.percentile(medians, [2.5, 97.5])
        print(
            f"| {name} | {len(row.waits)}/{row.flown} | {np.median(values):.0f} | {low:.0f}-{high:.0f} "
            f"| {np.percentile(values, 97.5):.0f} | {row.bad} | {share(row.false, row.healthy)} |"
        )


def tally(row: Tally, bench: Bench, flight: int, cell: Cell, kind: str, verbose: bool) -> None:
    """Watch one flight and count what was said of lost propellers."""
    at = float(bench.at[flight]) if kind == "ejected" else math.inf
    named = (a for a in alarms(bench, flight, cell, at + WITHIN) if a[2] == Quantity.EFFECTIVENESS)
    first = next(named, None)
    row.flown += kind == "ejected"
    row.healthy += kind == "none"
    if first is None:
        return
    if kind == "none":
        row.false += 1
    elif first[0] >= at and first[1] == bench.rotor[flight]:
        row.waits.append(1e3 * (first[0] - at))
        return
    else:
        row.bad += 1
    if verbose:
        print("   ", cell.name, kind, bench.seeds[flight], first, flush=True)


def curve(args: argparse.Namespace) -> None:
    """Print what each threshold of the sequential test would give; what is learned does not depend on it."""
    never = ((0.01, 60.0), (0.1, 60.0))
    config = MotorObserverConfig(recommended=RecommendedConfig(balance=BalanceConfig(thresholds=never)))
    print("| case | threshold | found | median ms | 97.5 % ms | early or wrong | healthy: false alarms |")
    print("|---|---|---|---|---|---|---|")
    for cell in [CELLS[name] for name in args.cells or ("50 Hz", "50 Hz, J x0.5", "10 Hz averaged")]:
        rows = {threshold: Tally() for threshold in CURVE}
        for kind, seed in (("ejected", args.seed), ("none", args.seed + 5000)):
            for bench in batches(args.flights, seed, Trouble(kind), cell.telemetry.lag, args.duration):
                for flight in range(len(bench.seeds)):
                    at = float(bench.at[flight]) if kind == "ejected" else math.inf
                    watching = MotorObserver(cell.craft(bench, flight), config)
                    for threshold, (t, rotor) in crossings(
                        watching, bench, flight, cell, at + WITHIN
                    ).items():
                        row = rows[threshold]
                        if kind == "none":
                            row.false += 1
                        elif t >= at and rotor == bench.rotor[flight]:
                            row.waits.append(1e3 * (t - at))
                        else:
                            row.bad += 1
        for threshold, row in rows.items():
            median, late = np.percentile(row.waits or [math.nan], [50.0, 97.5])
            print(
                f"| {cell.name} | {threshold} | {len(row.waits)}/{args.flights} | {median:.0f} | {late:.0f} "
                f"| {row.bad} | {share(row.false, args.flights)} |",
                flush=True,
            )


def crossings(
    watching: MotorObserver, bench: Bench, flight: int, cell: Cell, until: float
) -> dict[float, tuple[float, int]]:
    """Return when, and of which rotor, the log-likelihood ratio first passed each threshold."""
    found: dict[float, tuple[float, int]] = {}
    for reading in bench.readings(flight, cell.telemetry):
        if reading.t > until:
            break
        watching.feed(reading)
        for k, balance in enumerate(watching.core.balances):  # type: ignore[union-attr]
            if balance.llr > CURVE[0]:
                for threshold in CURVE:
                    if balance.llr > threshold:
                        found.setdefault(threshold, (reading.t, k))
    return found


def slow(args: argparse.Namespace) -> None:
    """Print what is made of partial losses, friction and lost drive."""
    cases = (
        ("30 % of the propeller gone", Trouble("partial", 0.7), "partial_loss"),
        ("15 % gone", Trouble("partial", 0.85), "partial_loss"),
        ("friction x5 over 20 s", Trouble("friction", 5.0, 20.0), "drag_rise"),
        ("drive lost", Trouble("undriven"), "motor_not_driven"),
        ("healthy", Trouble(), ""),
    )
    print("| 50 Hz | found | median s | 97.5 % s | rotor named wrong, or before | called a lost propeller |")
    print("|---|---|---|---|---|---|")
    cell = CELLS["50 Hz"]
    for name, trouble, rule in cases:
        waits, bad, lost = [], 0, 0
        for bench in batches(args.flights, args.seed, trouble, duration=args.duration):
            for flight in range(len(bench.seeds)):
                at = float(bench.at[flight]) if rule else math.inf
                hit = False
                for t, rotor, quantity, seen in alarms(bench, flight, cell):
                    lost += quantity == Quantity.EFFECTIVENESS and seen == "lost_propeller"
                    right = rotor == bench.rotor[flight] and t >= at
                    if seen == rule and right and not hit:
                        waits.append(t - at)
                        hit = True
                    bad += not right and quantity == Quantity.DRAG
                    if args.verbose and not right:
                        print("   ", bench.seeds[flight], t, at, rotor, bench.rotor[flight], quantity, seen)
        values = np.array(waits or [math.nan])
        print(
            f"| {name} | {len(waits)}/{args.flights} | {np.median(values):.2f} | {np.percentile(values, 97.5):.2f} "
            f"| {bad} | {lost} |",
            flush=True,
        )


def identify(args: argparse.Namespace) -> None:
    """Print how often the side is right, and how near the constants come to the truth."""
    print("| case | side right | wrong | kappa_tau 2.5/50/97.5 % | friction | J |")
    print("|---|---|---|---|---|---|")
    exact = replace(AT50, gain=0.0)
    plain = {"current_side": None}
    cells = (
        Cell("50 Hz, exact gain", exact, plain),
        Cell("50 Hz, gain error 3 %", AT50, plain),
        Cell("50 Hz, battery side, exact gain", replace(exact, side="battery"), plain),
        Cell("50 Hz, nothing known", exact, blank=True),
        Cell("10 Hz averaged", replace(AVERAGED, gain=0.0), plain),
        Cell("10 Hz averaged, battery side", replace(AVERAGED, gain=0.0, side="battery"), plain),
        Cell("10 Hz snapshots", Telemetry(10.0, gain=0.0), plain),
    )
    for cell in [one for one in cells if not args.cells or one.name in args.cells]:
        right, wrong, ratios = 0, 0, []
        for bench in batches(args.flights, args.seed, Trouble(), duration=args.duration):
            for flight in range(len(bench.seeds)):
                watching = observer(cell.craft(bench, flight))
                for reading in bench.readings(flight, cell.telemetry):
                    if reading.t > bench.duration - 4.0:
                        break
                    watching.feed(reading)
                core = watching.core
                right += core.measured_on == cell.telemetry.side  # type: ignore[union-attr]
                wrong += core.measured_on not in (None, cell.telemetry.side)  # type: ignore[union-attr]
                for k in range(ROTORS):
                    found = core.identified(k)  # type: ignore[union-attr]
                    if found is not None:
                        truth = [bench.truth[key][flight, k] for key in ("torque", "friction", "inertia")]
                        made = TORQUE_CONSTANT * np.array([found.a, found.f, found.c])
                        ratios.append(made / np.array(truth))
        columns = [np.percentile(column, [2.5, 50, 97.5]) for column in np.array(ratios).T]
        spread = " | ".join(" / ".join(f"{value:.3f}" for value in column) for column in columns)
        print(f"| {cell.name} | {right}/{args.flights} | {wrong} | {spread} |", flush=True)


def cost(args: argparse.Namespace) -> None:
    """Print the processor time of a reading of four rotors, and against a thousand float additions beside it."""
    print("| mode | rate Hz | µs a reading | of the time of 1000 additions |")
    print("|---|---|---|---|")
    bench = fly(list(range(args.seed, args.seed + args.flights)), 30.0)
    for mode in ("recommended", "paper"):
        for rate in (500.0, 50.0, 10.0):
            spent, count, additions = 0.0, 0, 0.0
            for flight in range(args.flights):
                watching = observer(bench.airframe(flight), mode)
                readings = list(bench.readings(flight, Telemetry(rate)))
                additions += thousand_additions()
                start = time.process_time()
                for reading in readings:
                    watching.feed(reading)
                spent += time.process_time() - start
                count += len(readings)
                additions += thousand_additions()
            each = spent / count
            print(
                f"| {mode} | {rate:.0f} | {1e6 * each:.1f} | {each / (additions / (2 * args.flights)):.2f} |",
                flush=True,
            )


def thousand_additions() -> float:
    """Return the processor time of a loop over 1000 float additions [s]."""
    start = time.process_time()
    for _ in range(200):
        total = 0.0
        for k in range(1000):
            total += k * 0.5
    return (time.process_time() - start) / 200


def main() -> None:
    """Run one of the campaigns."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaign", choices=("delays", "curve", "slow", "identify", "cost"))
    parser.add_argument("--flights", type=int, default=50, help="a row; a quarter at 500 Hz")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--duration", type=float, default=60.0, help="of a flight [s]")
    parser.add_argument("--cells", nargs="*", help="rows of a table")
    parser.add_argument("--verbose", action="store_true", help="name every false alarm")
    args = parser.parse_args()
    campaigns = {"delays": delays, "curve": curve, "slow": slow, "identify": identify, "cost": cost}
    campaigns[args.campaign](args)


if __name__ == "__main__":
    main()
