"""Which rule of the effectiveness estimator costs how much time, and what it is good for.

    python benchmarks/ejection_rules.py ../shared/data --flights 20 --seed 41000

One rule is relaxed at a time. Simulated: the quadrotor's flights of `simulated_flights.py`, every one of which
loses a propeller, motor commands streamed too. Recorded: the healthy flights of `real_flights.py` at every rate and
from every start phase, and when the ejection among them (label 12.39 s) is told. The rules in force were tuned on
recorded flights (sheet 5); no rule was chosen with these seeds.
"""

import argparse
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from flight_logs import CELLS, EJECTED, EJECTION, FIRST_VISIBLE, FLIGHTS, divisors
from partial_losses import readings
from real_flights import phases
from simulated_flights import KINDS, Outcome, fly, hourly, quantile, thinned, watch

from gcs_health.airframe import Airframe
from gcs_health.estimators.effectiveness import EffectivenessConfig, EffectivenessEstimator
from gcs_health.estimators.effectiveness_config import RecommendedConfig
from gcs_health.samples import Reading
from gcs_health.vehicle_file import load_vehicle

Recorded = tuple[str, str, Airframe, list[Reading], float]
RATES = ("250/250", "50/50", "50/10")


def bank(**rules: object) -> Callable[[RecommendedConfig], RecommendedConfig]:
    """Return what changes these fields of the bank."""
    return lambda config: replace(config, bank=replace(config.bank, **rules))  # type: ignore[arg-type]


RULES: dict[str, Callable[[RecommendedConfig], RecommendedConfig]] = {
    "as it is": lambda config: config,
    "one tick fewer must agree (1, slow speeds 2)": lambda c: replace(c, ticks=1, ticks_slow=2),
    "windows from 3 ticks on, as it was": bank(min_ticks=3),
    "windows from 2 ticks on, however short": bank(shortest=0.0),
    "ticks of 4 ms, not 8, windows from 12 ms on": lambda c: replace(
        c, tick=0.004, bank=replace(c.bank, max_ticks=40, shortest=0.012)
    ),
    "LLR > 12, not 20": bank(llr=12.0),
    "no test of shape": bank(shape_share=0.0),
    "model error by speed changes halved": bank(model_error=(0.02, 0.25)),
}


def recorded(folder: Path, count: int) -> list[Recorded]:
    """Return (name, rate, airframe, readings, last second worth judging) of every flight, rate and phase."""
    out = []
    for name, (file, until) in FLIGHTS.items():
        airframe = load_vehicle(folder / "vehicles" / f"{file}.toml")
        for cell in CELLS:
            keep = divisors(name, cell)
            for phase in phases(keep, count, spread=True) if keep is not None else []:
                some = readings(folder, name, cell, airframe, phase)
                out.append((name, cell, airframe, some, until))
    return out


def told(flight: Recorded, config: EffectivenessConfig) -> tuple[float, int] | None:
    """Return when [s after the first reading] the first failure is named, and the motor."""
    _, _, airframe, some, until = flight
    estimator = EffectivenessEstimator(airframe, config)
    start = some[0].t
    for reading in some:
        if reading.t - start > until:
            return None
        for estimate in estimator.feed(reading):
            if estimate.failure_probability > 0.9:
                return estimate.t - start, airframe.rotors[estimate.rotor].motor
    return None


def on_record(flights: list[Recorded], config: EffectivenessConfig) -> str:
    """Return three cells: false alarms of healthy flights, where, and the ejection's times at every rate."""
    false: dict[str, int] = {}
    count = 0
    times: dict[str, list[float]] = {}
    wrong = 0
    for flight in flights:
        name, cell, *_ = flight
        alarm = told(flight, config)
        if name != EJECTION:
            count += 1
            if alarm is not None:
                false[f"{name} {cell}"] = false.get(f"{name} {cell}", 0) + 1
        elif alarm is None or alarm[1] != EJECTED or alarm[0] < FIRST_VISIBLE:
            wrong += 1
        else:
            times.setdefault(cell, []).append(alarm[0])
    where = "; ".join(f"{flight}: {number}" for flight, number in false.items()) or "-"
    spans = ", ".join(f"{cell} {np.median(some):.3f}" for cell, some in times.items())
    return f"{sum(false.values())}/{count} | {where} | {spans}{f'; {wrong} wrong or early' if wrong else ''}"


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path, help="recorded flights and their vehicles/")
    parser.add_argument("--flights", type=int, default=10, help="simulated, of each kind")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--vehicle", default="bebop2")
    parser.add_argument("--rates", nargs="*", default=list(RATES))
    parser.add_argument("--phases", type=int, default=5)
    parser.add_argument("--rules", nargs="*", default=list(RULES), choices=list(RULES))
    args = parser.parse_args()
    configs = {rule: EffectivenessConfig(recommended=RULES[rule](RecommendedConfig())) for rule in args.rules}
    outcomes: dict[tuple[str, str], list[Outcome]] = {}
    for kind in KINDS:
        flown = fly(args.vehicle, kind, args.flights, args.seed)
        for rates in args.rates:
            flights = thinned(flown.flights, *map(float, rates.split("/")), late=False)
            for rule, config in configs.items():
                some = watch(flown, kind, flights, True, config)
                outcomes[rule, rates] = [*outcomes.get((rule, rates), []), *some]
    print(
        "| rule | IMU/ESC Hz | healthy min | false alarms, an hour | found | wrong | median ms | 97.5 % ms |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for (rule, rates), some in outcomes.items():
        print(simulated_row(rule, rates, some), flush=True)
    print(
        "\n| rule | recorded healthy: false | where | ejection told at s, median of phases |\n|---|---|---|---|"
    )
    flights_on_record = recorded(args.folder, args.phases)
    for rule, config in configs.items():
        print(f"| {rule} | {on_record(flights_on_record, config)} |", flush=True)


def simulated_row(rule: str, rates: str, outcomes: list[Outcome]) -> str:
    """Return one row of the first table."""
    early = sum(outcome.what == "early" for outcome in outcomes)
    wrong = sum(outcome.what == "wrong" for outcome in outcomes)
    delays = [1e3 * outcome.delay for outcome in outcomes if outcome.what in ("found", "wrong")]
    healthy = sum(outcome.healthy for outcome in outcomes)
    return (
        f"| {rule} | {rates} | {healthy / 60.0:.1f} | {hourly(early, healthy / 3600.0)} | "
        f"{len(delays)}/{len(outcomes) - early} | {wrong} | {quantile(delays, 50.0)} | {quantile(delays, 97.5)} |"
    )


if __name__ == "__main__":
    main()
