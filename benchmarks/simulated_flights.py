"""The effectiveness estimator on simulated flights: false alarms of healthy ones, delays of lost propellers.

    python benchmarks/simulated_flights.py --flights 24 --seed 1000

Sensor values go straight to the estimator, without MAVLink between; rotor speeds carry the time of their
measurement, or, as the newest PX4 stamps them, of their sending ("late"). Fresh seeds: nothing was tuned on them.
`benchmarks/simulated_flights.md` is this command's output.
"""

import argparse
import math
from dataclasses import replace

import numpy as np

from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.simulate.batch import Flights, fly_many
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import Scenario, load_scenario
from gcs_health.simulate.telemetry import BOOTED

KINDS = ("hover", "random", "aggressive", "forward")
DURATION, LOST_AT = 40.0, (20.0, 38.0)  # s
LATENCY = 0.006  # s, of the ESCs


def scenario(vehicle: str, kind: str) -> Scenario:
    """Return a flight in light wind."""
    changes = [f"vehicle={vehicle}", f"trajectory.kind={kind}", f"trajectory.duration={DURATION}"]
    changes += ["trajectory.height=12", "trajectory.lands=false", "trajectory.speed=8", "wind.speed=4"]
    return load_scenario("healthy_quad", changes)


def late(flights: Flights, interval: float) -> Flights:
    """Stamp rotor speeds when they are sent: later by the latency, and by what is left of the ESC's period."""
    return replace(flights, rotor_t=flights.rotor_t + LATENCY + 0.5 * min(interval, 0.01))


def verdict(flights: Flights, flight: int, plan: Scenario) -> tuple[float, int, float]:
    """Return (time, rotor) of the first failure named, and seconds of open gate; NaN, -1 if none."""
    airframe = plan.vehicle.airframe()
    airframe = replace(airframe, effectiveness=type(airframe.effectiveness)())  # learned in flight
    estimator = EffectivenessEstimator(airframe)
    for reading in flights.readings(flight):
        for estimate in estimator.feed(reading):
            if estimate.failure_probability > 0.9:
                bank = estimator.bank
                return estimate.t, estimate.rotor, bank.open_time if bank else 0.0
    bank = estimator.bank
    return math.nan, -1, bank.open_time if bank else 0.0


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--flights", type=int, default=24, help="a cell")
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument(
        "--vehicles", nargs="*", default=["bebop2", "ghalamchi_medium", "ghalamchi_large", "octocopter"]
    )
    parser.add_argument("--rates", nargs="*", default=["250/250", "100/50", "50/10"])
    args = parser.parse_args()
    print(
        "| vehicle | flight | IMU/ESC Hz | stamps | open gate h | false alarms | lost: found | right "
        "| median ms | 97.5 % ms |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for vehicle in args.vehicles:
        for kind in KINDS:
            for rates in args.rates:
                cell(args, vehicle, kind, rates)


def cell(args: argparse.Namespace, vehicle: str, kind: str, rates: str) -> None:
    """Fly one cell, healthy and with a propeller lost, and print its rows."""
    imu, esc = (float(rate) for rate in rates.split("/"))
    plan = scenario(vehicle, kind)
    seeds = [args.seed + k for k in range(args.flights)]
    rng = np.random.default_rng(args.seed)
    at = rng.uniform(*LOST_AT, args.flights)
    rotor = rng.integers(len(plan.vehicle.rotors), size=args.flights)
    healthy = fly_many(plan, seeds, imu, esc)
    lost = fly_many(plan, seeds, imu, esc, (Fault("propeller_lost", rotor, at),))
    for stamps in ("measured", "late"):
        if stamps == "late":
            healthy, lost = late(healthy, 1.0 / esc), late(lost, 1.0 / esc)
        verdicts = [verdict(healthy, k, plan) for k in range(args.flights)]
        alarms = sum(t == t for t, _, _ in verdicts)
        hours = sum(open_time for _, _, open_time in verdicts) / 3600.0
        delays, right, early = [], 0, 0
        for k in range(args.flights):
            t, named, _ = verdict(lost, k, plan)
            delay = t - BOOTED - at[k]
            if delay < 0.0:
                early += 1
            elif delay < 0.5:
                delays.append(delay * 1e3)
                right += named == rotor[k]
        found = args.flights - early
        quantiles = np.percentile(delays, [50, 97.5]) if delays else [math.nan] * 2
        print(
            f"| {vehicle} | {kind} | {rates} | {stamps} | {hours:.2f} | {alarms} | {len(delays)}/{found} | "
            f"{right} | {quantiles[0]:.0f} | {quantiles[1]:.0f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
