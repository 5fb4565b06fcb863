"""The pooled AR estimator on the boom bench: errors, intervals, alarms, refusals, opposite pairs.

    python benchmarks/pooled_ar.py > benchmarks/pooled_ar.md

Vehicles and seeds: 1-4 fitted; 5-7 held out (orders, b); 1-7, other seeds, healthy (threshold); reported on fresh
seeds of 1-4 ("own") and on 11-13, seen by nothing before ("others"). Every figure is told by the estimator's own
on-line code. `--save FOLDER` keeps the trained models.
"""

import argparse
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from gcs_health.estimators.labelled_flights import LabelledFlight
from gcs_health.estimators.pooled_ar import PooledArConfig, PooledArEstimator
from gcs_health.estimators.pooled_ar_file import save
from gcs_health.estimators.pooled_ar_model import PooledModel
from gcs_health.estimators.pooled_ar_training import TrainingSettings, train
from gcs_health.estimators.pooled_ar_training import windows as windows_of
from gcs_health.estimators.pooled_ar_watch import Verdict, WatchConfig, judge
from gcs_health.simulate.boom_bench import Bench, BenchFlights, Plan, airframe, fly_bench

GUSTS = {"light": 0.5, "middle": 1.5, "severe": 2.3}  # m/s rms
FITTED, HELD_OUT, OTHERS = (1, 2, 3, 4), (5, 6, 7), (11, 12, 13)
STEPS, BETWEEN = (0.2, 0.4, 0.6, 0.8, 1.0), (0.1, 0.3, 0.5, 0.7, 0.9)
RATE = 1.0 / 3e-4
SETTLE = 6.0  # s after the onset, as the paper waits for
ONSET = 16.0
CALM = 47.0  # s, a healthy flight
AXES = ("ax", "ay", "az", "p", "q", "r")


@dataclass(frozen=True)
class Sensor:
    """One row of the tables: which signals, and how long a window."""

    name: str
    channels: tuple[str, ...]
    stream: str
    rate: float
    window: float
    orders: tuple[int, ...]
    basis: tuple[int, ...] = (2, 3, 4, 5, 6)
    mean_over: float = float("nan")


SENSORS = (
    Sensor("hub z", ("az",), "hub", RATE, 5.0, (16, 24, 43)),
    Sensor("hub z, p, q", ("az", "p", "q"), "hub", RATE, 5.0, (24, 43), (3, 4, 5)),
    Sensor("boom tip", ("boom",), "boom", RATE, 2.0, (16, 24, 40, 60)),
    Sensor("six axes, 100 Hz", AXES, "imu100", 100.0, 10.0, (8, 12, 16, 24), (2, 3, 4), 0.005),
)


@dataclass
class Windows:
    """What was said in value windows: error, std, whether refused, whether the right rotor fitted best."""

    error: list[float] = field(default_factory=list)
    std: list[float] = field(default_factory=list)
    refused: list[bool] = field(default_factory=list)
    right: list[bool] = field(default_factory=list)

    def row(self) -> str:
        """Return mean error, coverage of 95 %, width, n. e. s. of what was told, and the share refused."""
        told = ~np.array(self.refused)
        if not told.any():
            return "- | - | - | - | 100 %"
        error, std = np.array(self.error)[told], np.array(self.std)[told]
        inside = np.abs(error) <= 1.96 * std
        return (
            f"{100 * np.abs(error).mean():.1f} | {100 * inside.mean():.0f} % | {100 * 3.92 * std.mean():.0f} | "
            f"{np.mean((error / std) ** 2):.2f} | {100 * (1 - told.mean()):.0f} %"
        )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--regimes", default="light,middle,severe")
    parser.add_argument("--save", type=Path)
    options = parser.parse_args()
    regimes = options.regimes.split(",")
    print("# Pooled AR models on the boom bench\n\nPrinted by `python benchmarks/pooled_ar.py`.\n")
    print((__doc__ or "").split("\n\n")[2] + "\n")
    print("Errors and widths in % of k; n. e. s.: mean squared error over stated variance, 1 = as stated.\n")
    models: dict[tuple[str, str], PooledModel] = {}
    reports: dict[str, BenchFlights] = {}
    for regime in regimes:
        trained(regime, models)
        reports[regime] = fly(regime, between((*FITTED, *OTHERS), 20_000), 17.0)
        if options.save:
            options.save.mkdir(exist_ok=True)
            for (air, name), model in models.items():
                save(
                    model,
                    options.save / f"{air}_{name.split(',')[0].replace(' ', '_')}{len(model.channels)}.npz",
                )
    values(models, reports)
    for regime in regimes:
        alarms(regime, models)
    pairs(regimes, models)


def log(text: str) -> None:
    """Say how far it is."""
    print(text, file=sys.stderr, flush=True)


def fly(regime: str, plans: list[Plan], duration: float, onset: float = 0.0) -> BenchFlights:
    """Fly on the bench."""
    log(f"{regime}: {len(plans)} flights of {duration:.0f} s")
    return fly_bench(plans, Bench(gusts=GUSTS[regime], duration=duration, onset=onset))


def between(vehicles: tuple[int, ...], seed: int) -> list[Plan]:
    """Return flights at levels that are not fitted, both rotors."""
    rows = [(rotor, k) for rotor in (0, 1) for k in BETWEEN]
    return [Plan(v, seed + 100 * v + i, rotor, k) for v in vehicles for i, (rotor, k) in enumerate(rows)]


def healthy(vehicles: tuple[int, ...], seed: int, each: int) -> list[Plan]:
    """Return healthy flights."""
    return [Plan(v, seed + 100 * v + i) for v in vehicles for i in range(each)]


def trained(regime: str, models: dict[tuple[str, str], PooledModel]) -> None:
    """Train all sensors' models in one regime, and print what was chosen."""
    rows = [(0, 0.0), *[(rotor, k) for rotor in (0, 1) for k in STEPS]]
    fitted = fly(regime, [Plan(v, 100 * v + i, r, k) for v in FITTED for i, (r, k) in enumerate(rows)], 36.0)
    held_out = fly(regime, between(HELD_OUT, 1000), 18.0)
    calm = fly(regime, healthy((*FITTED, *HELD_OUT), 5000, 3), CALM)
    print(f"\n## Trained in {regime} air, {GUSTS[regime]} m/s rms\n")
    print(
        "| sensor | orders | p | b | threshold, 1 alarm per 5 min | healthy minutes | right rotor, held out |"
    )
    print("|---|---|---|---|---|---|---|")
    for sensor in SENSORS:
        settings = TrainingSettings(
            vehicle="Dutta hexacopter",
            regime=regime,
            rate=sensor.rate,
            channels=sensor.channels,
            mean_over=sensor.mean_over,
            orders=sensor.orders,
            basis=sensor.basis,
            value_window=sensor.window,
        )
        sets = [flights.labelled(SETTLE, sensor.stream) for flights in (fitted, held_out, calm)]
        model = train(sets[0], sets[1], sets[2], settings, airframe())
        models[regime, sensor.name] = model
        orders = ", ".join(str(len(part.theta)) for part in model.parts)
        print(
            f"| {sensor.name} | {orders} | {dict(model.facts)['p']:.0f} | {model.bias:.3f} | {model.threshold:.2f} | "
            f"{model.healthy_time / 60:.0f} | {100 * model.names:.0f} % |",
            flush=True,
        )


def values(models: dict[tuple[str, str], PooledModel], reports: dict[str, BenchFlights]) -> None:
    """Print errors and intervals at home, and how often the wrong regime is refused."""
    print("\n## Value, levels between, windows 5 s (hub), 2 s (boom), 10 s (six axes)\n")
    print("| air | sensor | vehicles | mean error | coverage | width | n. e. s. | refused | right rotor |")
    print("|---|---|---|---|---|---|---|---|---|")
    wrong = []
    for (trained_in, name), model in models.items():
        sensor = next(one for one in SENSORS if one.name == name)
        for flown_in, flights in reports.items():
            own, others = said(model, sensor.stream, flights)
            if trained_in == flown_in:
                for which, windows in (("own", own), ("others", others)):
                    right = 100 * np.mean(windows.right)
                    print(f"| {flown_in} | {name} | {which} | {windows.row()} | {right:.0f} % |", flush=True)
            else:
                refused = 100 * np.mean(own.refused + others.refused)
                count = len(own.refused + others.refused)
                wrong.append(f"| {name} | {trained_in} | {flown_in} | {refused:.1f} % | {count} |")
    print("\n## Windows of the wrong regime\n")
    print("| sensor | trained in | flown in | refused | windows |\n|---|---|---|---|---|")
    print("\n".join(wrong), flush=True)


def said(model: PooledModel, stream: str, flights: BenchFlights) -> tuple[Windows, Windows]:
    """Return what is said in windows that do not overlap, of own and other vehicles."""
    log(f"{model.regime} {model.channels} on {flights.bench.gusts} m/s")
    out = (Windows(), Windows())
    for plan, flight in zip(flights.plans, flights.labelled(SETTLE, stream), strict=True):
        windows = out[plan.vehicle in OTHERS]
        for verdict in verdicts(model, flight, every=round(model.value_window * model.rate / model.block)):
            view = verdict.views[plan.rotor]
            windows.error.append(view.k - plan.k)
            windows.std.append(view.std)
            windows.refused.append(bool(verdict.refused))
            windows.right.append(verdict.best == plan.rotor)
    return out


def verdicts(model: PooledModel, flight: LabelledFlight, every: int = 1) -> list[Verdict]:
    """Return the watch's verdicts in full windows, `every` blocks apart; t [s] from the stretch's beginning."""
    blocks = {rotor: windows_of(model, flight, rotor, model.value_window, every) for rotor in model.rotors}
    recent = round(model.alarm_window * model.rate / model.block)
    size = len(next(iter(blocks.values()))[0])
    return [
        judge(
            model,
            WatchConfig(),
            ((k * every + size) * model.block + model.longest) / model.rate,
            {rotor: grams[k] for rotor, grams in blocks.items()},
            recent,
            True,
        )
        for k in range(len(blocks[model.rotors[0]]))
    ]


def alarms(regime: str, models: dict[tuple[str, str], PooledModel]) -> None:
    """Print delays after the onset and the alarms of healthy flights."""
    calm = fly(regime, healthy((*FITTED, *OTHERS), 40_000, 2), CALM)
    onset = fly(regime, between(OTHERS, 50_000), 26.0, ONSET)
    print(f"\n## Alarms in {regime} air, windows of 1 s, other vehicles after an onset\n")
    print("| sensor | k = .1 | .3 | .5 | .7 | .9 | healthy alarms, own | others | expected of own, others |")
    print("|---|---|---|---|---|---|---|---|---|")
    for sensor in SENSORS:
        model = models[regime, sensor.name]
        shaken = onset.labelled(SETTLE, sensor.stream)
        cells = []
        for k in BETWEEN:
            found = [events(model, f) for f in shaken if f.k == k]
            delays = [min((t for t in each if t >= ONSET - SETTLE), default=np.inf) for each in found]
            seen = [delay - ONSET + SETTLE for delay in delays if delay < np.inf]
            text = f"{np.median(seen):.1f} s, worst {max(seen):.1f}" if seen else "-"
            missed = f", {len(delays) - len(seen)} of {len(delays)} missed" if len(seen) < len(delays) else ""
            cells.append(text + missed)
        counts, minutes = [0, 0], [0.0, 0.0]
        for plan, flight in zip(calm.plans, calm.labelled(SETTLE, sensor.stream), strict=True):
            other = plan.vehicle in OTHERS
            counts[other] += len(events(model, flight))
            minutes[other] += (CALM - SETTLE) / 60.0
        expected = ", ".join(f"{m * 60.0 / model.alarm_every:.1f}" for m in minutes)
        row = " | ".join(cells)
        told = " | ".join(f"{n} in {m:.0f} min" for n, m in zip(counts, minutes, strict=True))
        print(f"| {sensor.name} | {row} | {told} | {expected} |", flush=True)
    speeds(regime, onset, calm, models[regime, SENSORS[0].name])


def events(model: PooledModel, flight: LabelledFlight) -> list[float]:
    """Return when alarms began [s]: threshold passed, nothing within the hold before."""
    began: list[float] = []
    last = -np.inf
    for verdict in verdicts(model, flight):
        if not verdict.blind and max(view.k_alarm for view in verdict.views.values()) > model.threshold:
            if verdict.t - last > WatchConfig().hold:
                began.append(verdict.t)
            last = verdict.t
    return began


def speeds(regime: str, onset: BenchFlights, calm: BenchFlights, model: PooledModel) -> None:
    """Print the speed path: rotor speeds at 10 Hz with 15 rpm of noise, with and without commands."""
    print("\n| rotor speeds | mean error, 2 s | k = .1 seen after, worst | missed | healthy alarms |")
    print("|---|---|---|---|---|")
    for name, streams in (("alone", ("speed",)), ("with commands", ("speed", "command"))):
        errors, delays, false = [], [], 0
        for j, plan in enumerate(onset.plans):
            estimator = PooledArEstimator(airframe(), PooledArConfig(models=(model,)))
            first = np.inf
            for reading in onset.readings(j, streams):
                estimator.feed(reading)
                if reading.t > ONSET and first == np.inf and anywhere(estimator, reading.t) > 0.9:
                    first = reading.t - ONSET
            if plan.k == BETWEEN[0]:
                delays.append(first)
            errors.append(estimator.estimates(25.9)[plan.rotor].value - plan.k)
        for j in range(len(calm.plans)):
            estimator = PooledArEstimator(airframe(), PooledArConfig(models=(model,)))
            alarmed = False
            for reading in calm.readings(j, streams):
                estimator.feed(reading)
                alarmed = alarmed or anywhere(estimator, reading.t) > 0.9
            false += alarmed
        seen = [delay for delay in delays if delay < np.inf]
        print(
            f"| {name} | {100 * np.mean(np.abs(errors)):.2f} | {np.median(seen):.1f}, {max(seen):.1f} s | "
            f"{len(delays) - len(seen)} of {len(delays)} | in {false} of {len(calm.plans)} flights |",
            flush=True,
        )


def anywhere(estimator: PooledArEstimator, t: float) -> float:
    """Return the probability that some rotor is degraded."""
    return max(float(dict(one.evidence).get("probability_anywhere", 0.0)) for one in estimator.estimates(t))


def pairs(regimes: list[str], models: dict[tuple[str, str], PooledModel]) -> None:
    """Print how faults of all six rotors are named after an onset: right, another, or both of the pair."""
    print("\n## Opposite pairs: onsets on all six rotors, k = .3 .. .9, one rotor above .9 within 8 s\n")
    print("| air | by | right | its opposite | another | none named |\n|---|---|---|---|---|---|")
    for regime in regimes:
        plans = [Plan(OTHERS[i % 3], 60_000 + i, i % 6, BETWEEN[1 + i % 4]) for i in range(24)]
        flights = fly(regime, plans, 26.0, ONSET)
        ways = {
            "hub z": ("hub",),
            "boom tip": ("boom",),
            "speeds": ("speed",),
            "speeds and commands": ("speed", "command"),
        }
        for way, streams in ways.items():
            model = models[regime, way if way in ("hub z", "boom tip") else "hub z"]
            counts = [0, 0, 0, 0]
            for j, plan in enumerate(plans):
                counts[outcome(model, flights, j, plan.rotor, streams)] += 1
            print(f"| {regime} | {way} | " + " | ".join(map(str, counts)) + " |", flush=True)


def outcome(model: PooledModel, flights: BenchFlights, j: int, rotor: int, streams: tuple[str, ...]) -> int:
    """Return 0 right, 1 the opposite was ever named, 2 another, 3 none."""
    estimator = PooledArEstimator(airframe(), PooledArConfig(models=(model,)))
    named = set()
    for reading in flights.readings(j, streams):
        if reading.t < SETTLE:
            continue
        for estimate in estimator.feed(reading):
            if estimate.failure_probability > 0.9 and reading.t > ONSET:
                named.add(estimate.rotor)
    if not named:
        return 3
    if named == {rotor}:
        return 0
    return 1 if (rotor + 3) % 6 in named else 2


if __name__ == "__main__":
    main()
