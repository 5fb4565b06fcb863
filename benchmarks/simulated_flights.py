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
from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from gcs_health.airframe import Airframe, Effectiveness
from gcs_health.estimators.effectiveness import EffectivenessConfig, EffectivenessEstimator
from gcs_health.simulate.batch import Flights, fly_many
from gcs_health.simulate.detect import wilson
from gcs_health.simulate.faults import Fault
from gcs_health.simulate.scenario import Scenario, load_scenario
from gcs_health.simulate.telemetry import BOOTED

KINDS = ("hover", "random", "aggressive", "forward")
DURATION, LOST_AT = 24.0, (12.0, 23.4)  # s
LATENCY = 0.006  # s, of the ESCs
FASTEST = 500.0  # Hz, telemetry as flown, of which every n-th is kept
FOUND_WITHIN = 0.5  # s


class Flown(NamedTuple):
    """Flights of one kind with a fault each: its rotor and time [s of flight], telemetry as fast as flown."""

    flights: Flights
    airframe: Airframe  # what the estimator is told: no gains
    at: NDArray[np.float64]
    rotor: NDArray[np.int64]


class Outcome(NamedTuple):
    """What came of one flight: found, wrong (rotor), early or missed; delay [s]; healthy time watched [s]."""

    kind: str
    what: str
    delay: float
    healthy: float


def scenario(
    vehicle: str, kind: str, wind: float = 4.0, turbulence: str = "low", duration: float = DURATION
) -> Scenario:
    """Return a flight, in light wind [m/s] if not said otherwise."""
    changes = [f"vehicle={vehicle}", f"trajectory.kind={kind}", f"trajectory.duration={duration}"]
    changes += ["trajectory.height=12", "trajectory.lands=false", "trajectory.speed=8"]
    changes += [f"wind.speed={wind}", f"wind.turbulence={turbulence}"]
    return load_scenario("healthy_quad", changes)


def thinned(
    flights: Flights, imu_rate: float, esc_rate: float, late: bool, command_rate: float | None = None
) -> Flights:
    """Keep telemetry at these rates; `late` stamps speeds by their sending: latency and rest of the period."""
    imu, esc = round(FASTEST / imu_rate), round(FASTEST / esc_rate)
    command = imu if command_rate is None else round(FASTEST / command_rate)
    return replace(
        flights,
        imu_t=flights.imu_t[::imu],
        imu=flights.imu[::imu],
        height=flights.height[::imu],
        rotor_t=flights.rotor_t[::esc] + (LATENCY + 0.5 * min(1.0 / esc_rate, 0.01) if late else 0.0),
        speed=flights.speed[::esc],
        current=flights.current[::esc],
        command_t=flights.command_t[::command],
        command=flights.command[::command],
    )


def fly(vehicle: str, kind: str, count: int, seed: int) -> Flown:
    """Fly one kind of flight, `count` times; every one loses a propeller."""
    plan = scenario(vehicle, kind)
    rng = np.random.default_rng(seed)
    at = rng.uniform(*LOST_AT, count)
    rotor = rng.integers(len(plan.vehicle.rotors), size=count)
    seeds = [seed + k for k in range(count)]
    flights = fly_many(plan, seeds, FASTEST, FASTEST, (Fault("propeller_lost", rotor, at),))
    return Flown(flights, replace(plan.vehicle.airframe(), effectiveness=Effectiveness()), at, rotor)


def watch(
    flown: Flown, kind: str, flights: Flights, commands: bool, config: EffectivenessConfig | None = None
) -> list[Outcome]:
    """Return what comes of every flight at one rate."""
    out = []
    for k, (at, rotor) in enumerate(zip(flown.at, flown.rotor, strict=True)):
        t, named, healthy = verdict(flights, k, flown.airframe, BOOTED + at, commands, config)
        delay = t - BOOTED - at
        what = "missed" if delay != delay else "early" if delay < 0.0 else "found"
        out.append(Outcome(kind, "wrong" if what == "found" and named != rotor else what, delay, healthy))
    return out


def verdict(
    flights: Flights,
    flight: int,
    airframe: Airframe,
    lost_at: float,
    commands: bool = False,
    config: EffectivenessConfig | None = None,
) -> tuple[float, int, float]:
    """Return (time, rotor) of the first failure named, NaN and -1 if none, and seconds of open gate before."""
    estimator = EffectivenessEstimator(airframe, config)
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
    parser.add_argument(
        "--commands", type=float, nargs="?", const=50.0, help="motor commands too, at so many Hz"
    )
    args = parser.parse_args()
    print(
        "| vehicle | IMU/ESC Hz | healthy min | false alarms, an hour | lost: found, % | wrong rotor | "
        "median ms | 97.5 % ms | missed |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for vehicle in args.vehicles:
        outcomes: dict[str, list[Outcome]] = defaultdict(list)
        for kind in KINDS:
            flown = fly(vehicle, kind, args.flights, args.seed)
            for rates in args.rates:
                imu, esc = map(float, rates.split("/"))
                flights = thinned(flown.flights, imu, esc, args.late, args.commands)
                outcomes[rates] += watch(flown, kind, flights, bool(args.commands))
        for rates, some in outcomes.items():
            print(row(vehicle, rates, some), flush=True)


def row(vehicle: str, rates: str, outcomes: list[Outcome]) -> str:
    """Return one row of the table; intervals are of 95 %."""
    count = Counter(outcome.what for outcome in outcomes)
    delays = [o.delay * 1e3 for o in outcomes if o.what in ("found", "wrong")]
    lost = len(outcomes) - count["early"]
    healthy = sum(outcome.healthy for outcome in outcomes)
    low, high = (100.0 * share for share in wilson(len(delays), lost))
    missed = Counter(outcome.kind for outcome in outcomes if outcome.what == "missed")
    return (
        f"| {vehicle} | {rates} | {healthy / 60.0:.1f} | {hourly(count['early'], healthy / 3600.0)} | "
        f"{len(delays)}/{lost}, {low:.1f}-{high:.1f} | {count['wrong']} | "
        f"{quantile(delays, 50.0)} | {quantile(delays, 97.5)} | "
        f"{', '.join(f'{kind} {number}' for kind, number in missed.items()) or '-'} |"
    )


def hourly(count: int, hours: float) -> str:
    """Return events an hour within the bounds that a Poisson process may have; one-sided if there was none."""
    if not count:
        return f"0, < {-math.log(0.05) / hours:.1f}"
    low, high = chi2.ppf(0.025, 2 * count) / 2.0, chi2.ppf(0.975, 2 * count + 2) / 2.0
    return f"{count}, {low / hours:.1f}-{high / hours:.1f}"


def quantile(values: list[float], percent: float) -> str:
    """Return a quantile with what resampling the flights makes of it."""
    if not values:
        return "-"
    low, high = resampled(values, lambda some: np.percentile(some, percent, axis=1))
    return f"{np.percentile(values, percent):.0f} ({low:.0f}-{high:.0f})"


def resampled(
    values: Sequence[float], of: Callable[[NDArray[np.float64]], NDArray[np.float64]]
) -> tuple[float, float]:
    """Return the bootstrap's 95 % interval of a statistic; `of` takes (resamples, values)."""
    draws = np.random.default_rng(0).choice(np.asarray(values), (1000, len(values)))
    low, high = np.percentile(of(draws), [2.5, 97.5])
    return float(low), float(high)


if __name__ == "__main__":
    main()
