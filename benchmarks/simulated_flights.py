"""The effectiveness estimator on simulated flights: false alarms before the fault, delays of lost propellers.

    python benchmarks/simulated_flights.py --vehicles bebop2 ghalamchi_large --flights 25 --seed 5000

Sensor values go straight to the estimator, without MAVLink between. A quarter of the flights each hovers, moves
at random, flies aggressively, and forward at 8 m/s, in a light wind of 4 m/s; every one loses a propeller at a
random time, and what it flew before with the gate open counts as healthy. Each is flown once and its telemetry
thinned out to every rate; motor commands come with `--commands`. Rotor speeds carry the time of their
measurement, or, with `--late`, of their sending. The gains are not given: they are learned in flight. Seeds 1000
on were looked at while rules were chosen; report with others.
"""

import argparse
import math
from collections import defaultdict
from dataclasses import replace

import numpy as np

from gcs_health.airframe import Airframe, Effectiveness
from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.simulate.batch import Flights, fly_many
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import Scenario, load_scenario
from gcs_health.simulate.telemetry import BOOTED

KINDS = ("hover", "random", "aggressive", "forward")
DURATION, LOST_AT = 24.0, (12.0, 23.4)  # s
LATENCY = 0.006  # s, of the ESCs
FASTEST = 500.0  # Hz, telemetry as flown, of which every n-th is kept
FOUND_WITHIN = 0.5  # s


def scenario(vehicle: str, kind: str) -> Scenario:
    """Return a flight in light wind."""
    changes = [f"vehicle={vehicle}", f"trajectory.kind={kind}", f"trajectory.duration={DURATION}"]
    changes += ["trajectory.height=12", "trajectory.lands=false", "trajectory.speed=8", "wind.speed=4"]
    return load_scenario("healthy_quad", changes)


def thinned(flights: Flights, imu_rate: float, esc_rate: float, late: bool) -> Flights:
    """Keep telemetry at these rates; `late` stamps speeds by their sending: latency and rest of the period."""
    imu, esc = round(FASTEST / imu_rate), round(FASTEST / esc_rate)
    return replace(
        flights,
        imu_t=flights.imu_t[::imu],
        imu=flights.imu[::imu],
        height=flights.height[::imu],
        rotor_t=flights.rotor_t[::esc] + (LATENCY + 0.5 * min(1.0 / esc_rate, 0.01) if late else 0.0),
        speed=flights.speed[::esc],
        current=flights.current[::esc],
        command_t=flights.command_t[::imu],
        command=flights.command[::imu],
    )


def verdict(
    flights: Flights, flight: int, airframe: Airframe, lost_at: float, commands: bool = False
) -> tuple[float, int, float]:
    """Return (time, rotor) of the first failure named, NaN and -1 if none, and seconds of open gate before."""
    estimator = EffectivenessEstimator(airframe)
    flown = 0.0
    for reading in flights.readings(flight, commands):
        told = estimator.feed(reading)
        if reading.t < lost_at and estimator.bank is not None:
            flown = estimator.bank.open_time
        for estimate in told:
            if estimate.failure_probability > 0.9:
                return estimate.t, estimate.rotor, flown
        if reading.t > lost_at + FOUND_WITHIN:
            break
    return math.nan, -1, flown


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=25, help="of each kind")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--vehicles", nargs="*", default=["bebop2", "ghalamchi_large"])
    parser.add_argument("--rates", nargs="*", default=["250/250", "100/50", "50/50", "50/10"])
    parser.add_argument("--late", action="store_true")
    parser.add_argument("--commands", action="store_true", help="motor commands too, at the IMU's rate")
    args = parser.parse_args()
    print(
        "| vehicle | IMU/ESC Hz | healthy min | false alarms | lost: found | right | median ms | 97.5 % ms |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for vehicle in args.vehicles:
        outcome: dict[str, list[tuple[str, float, float]]] = defaultdict(list)
        for kind in KINDS:
            fly(args, vehicle, kind, outcome)
        for rates, flights in outcome.items():
            print(row(vehicle, rates, flights), flush=True)


def fly(
    args: argparse.Namespace, vehicle: str, kind: str, outcome: dict[str, list[tuple[str, float, float]]]
) -> None:
    """Fly one kind of flight and add (what, delay, healthy seconds) of every flight to its rates."""
    plan = scenario(vehicle, kind)
    rng = np.random.default_rng(args.seed)
    at = rng.uniform(*LOST_AT, args.flights)
    rotor = rng.integers(len(plan.vehicle.rotors), size=args.flights)
    seeds = [args.seed + k for k in range(args.flights)]
    flown = fly_many(plan, seeds, FASTEST, FASTEST, (Fault("propeller_lost", rotor, at),))
    airframe = replace(plan.vehicle.airframe(), effectiveness=Effectiveness())
    for rates in args.rates:
        flights = thinned(flown, *(float(rate) for rate in rates.split("/")), late=args.late)
        for k in range(args.flights):
            t, named, healthy = verdict(flights, k, airframe, BOOTED + at[k], args.commands)
            delay = t - BOOTED - at[k]
            what = "missed" if delay != delay else "early" if delay < 0.0 else "found"
            if what == "found" and named != rotor[k]:
                what = "wrong"
            outcome[rates].append((what, delay, healthy))


def row(vehicle: str, rates: str, flights: list[tuple[str, float, float]]) -> str:
    """Return one row of the table."""
    delays = [delay * 1e3 for what, delay, _ in flights if what in ("found", "wrong")]
    count = {what: sum(other == what for other, _, _ in flights) for what in ("found", "wrong", "early")}
    quantiles = np.percentile(delays, [50, 97.5]) if delays else [math.nan] * 2
    healthy = sum(seconds for _, _, seconds in flights) / 60.0
    return (
        f"| {vehicle} | {rates} | {healthy:.1f} | {count['early']} | "
        f"{len(delays)}/{len(flights) - count['early']} | {count['found']} | "
        f"{quantiles[0]:.0f} | {quantiles[1]:.0f} |"
    )


if __name__ == "__main__":
    main()
