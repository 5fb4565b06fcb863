"""What `calibrate` makes of the vibration's alarms: false alarms and detection on the boom bench, before and after.

    python benchmarks/pooled_ar.py --regimes light --sensors hub_z,six_axes_100_Hz --save MODELS
    python benchmarks/vibration_alarm.py --trained MODELS > benchmarks/vibration_alarm.md

Vehicles 31-33, of which the models have seen nothing, each alone: calibrated on 12 healthy flights of 34 s, seeds
60000-; false alarms in 24 others, seeds 70000-; a loss of 30 % of a rotor's speed 12 s into 12 more, rotors 1 and 2,
seeds 80000-. Light air. No seed here tuned anything. An alarm lasts 2 s beyond its window, as on line.
"""

import argparse
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pooled_ar_flights import Flown, flown, log

from gcs_health.calibration.false_alarms import most
from gcs_health.estimators.healthy_vibration import HealthyWatch
from gcs_health.estimators.pooled_ar_alarm import ModelHealth
from gcs_health.estimators.pooled_ar_file import load
from gcs_health.estimators.pooled_ar_model import PooledModel
from gcs_health.estimators.pooled_ar_watch import ModelWatch, WatchConfig
from gcs_health.estimators.vibration_baseline import VibrationBaseline
from gcs_health.samples import ImuReading, Reading
from gcs_health.simulate.boom_bench import Plan

VEHICLES = (31, 32, 33)
ONSET, K = 18.0, 0.3
BUDGETS = (12.0, 1.0, 0.1)  # false alarms an hour
HOLD = WatchConfig().hold
MODELS = (
    ("hub z, 3333 Hz", "light_hub_z.npz", "hub"),
    ("six axes, 100 Hz", "light_six_axes_100_Hz.npz", "imu100"),
)


class Series(NamedTuple):
    """What one flight's windows of 0.1 s steps said: time [s], the alarm's figure, NaN = nothing."""

    t: np.ndarray
    value: np.ndarray

    def began(self, threshold: float) -> list[float]:
        """Return when alarms began: passed, and not within the hold before."""
        out, last = [], -np.inf
        for t in self.t[self.value > threshold]:
            if t - last > HOLD:
                out.append(float(t))
            last = t
        return out

    @property
    def watched(self) -> float:
        """Time in which an alarm could have come [s]."""
        return 0.1 * float(np.isfinite(self.value).sum())


def by_model(model: PooledModel, readings: Iterator[Reading]) -> Series:
    """Return a model's largest k of any rotor in its alarm windows."""
    watch, rows = ModelWatch(model, WatchConfig()), []
    for reading in readings:
        if watch.feed(reading) and watch.verdict is not None:  # type: ignore[arg-type]
            verdict = watch.verdict
            k = max(view.k_alarm for view in verdict.views.values())
            rows.append((reading.t, np.nan if verdict.blind else k))
    return Series(*np.array(rows).T)


def by_baseline(watch: HealthyWatch, readings: Iterator[Reading]) -> Series:
    """Return the change of the vibration in its windows."""
    rows = []
    for reading in readings:
        assert isinstance(reading, ImuReading)
        if watch.feed(reading):
            rows.append((reading.t, np.nan if watch.other_air else watch.change))
    return Series(*np.array(rows).T)


class Row(NamedTuple):
    """One line of the table."""

    name: str
    threshold: list[float]
    alarms: int
    hours: float
    delays: list[float]
    early: int  # alarms before the onset: these flights are not counted as detections

    def text(self, budget: str) -> str:
        """Return it in Markdown."""
        seen = [delay for delay in self.delays if delay < np.inf]
        delay = f"{np.median(seen):.1f} s, worst {max(seen):.1f}" if seen else "-"
        low, high = min(self.threshold), max(self.threshold)
        return (
            f"| {self.name} | {budget} | {low:.2f} to {high:.2f} | {self.alarms} in {60 * self.hours:.0f} min | "
            f"{self.alarms / self.hours:.1f}, at most {most(self.alarms, self.hours):.1f} | "
            f"{len(seen)} of {len(self.delays)} | {delay} |"
        )


def row(name: str, judged: list[tuple[float, list[Series], list[Series]]]) -> Row:
    """Return the line of thresholds, one a vehicle, on its healthy and degraded flights."""
    alarms = sum(len(one.began(at)) for at, well, _ in judged for one in well)
    hours = sum(one.watched for _, well, _ in judged for one in well) / 3600.0
    delays, early = [], 0
    for at, _, slow in judged:
        for one in slow:
            began = one.began(at)
            early += any(t < ONSET for t in began)
            delays.append(min((t - ONSET for t in began if t >= ONSET), default=np.inf))
    return Row(name, [at for at, _, _ in judged], alarms, hours, delays, early)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trained", type=Path, required=True, help="the folder of pooled_ar.py --save")
    parser.add_argument("--cache", type=Path)
    options = parser.parse_args()
    print("# Alarms of the vibration, calibrated on a vehicle's own healthy flights\n")
    print("Printed by `python benchmarks/vibration_alarm.py --trained MODELS`; the models by")
    print("`python benchmarks/pooled_ar.py --regimes light --sensors hub_z,six_axes_100_Hz --save MODELS`.\n")
    print((__doc__ or "").split("\n\n")[2])
    fly = partial(flown, options.cache)
    groups = {v: vehicle(fly, v) for v in VEHICLES}
    print(
        "| watched by | false alarms borne | threshold | false alarms | an hour (95 %) | 30 % seen | after |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, file, stream in MODELS:
        of_model(name, load(options.trained / file), stream, groups)
    of_baseline(groups)
    refusals(fly, options.trained)


def vehicle(fly: partial[Flown], v: int) -> tuple[Flown, Flown, Flown]:
    """Return a vehicle's flights: to calibrate on, healthy others, and degraded ones."""
    calm = fly("light", f"own{v}", [Plan(v, 60_000 + 100 * v + j) for j in range(12)], 40.0)
    others = fly("light", f"well{v}", [Plan(v, 70_000 + 100 * v + j) for j in range(24)], 40.0)
    plans = [Plan(v, 80_000 + 100 * v + j, j % 2, K) for j in range(12)]
    return calm, others, fly("light", f"slow{v}", plans, 26.0, ONSET)


def of_model(name: str, model: PooledModel, stream: str, groups: dict[int, tuple[Flown, ...]]) -> None:
    """Print a trained model's lines: its own threshold, then each budget's."""
    judged = {}
    health = {}
    for v, (calm, others, slow) in groups.items():
        log(f"{name}: vehicle {v}")
        health[v] = ModelHealth(name, model)
        for j in range(len(calm.plans)):
            health[v].fly(calm.vibrated(j, stream))
        judged[v] = [
            [by_model(model, flights.vibrated(j, stream)) for j in range(len(flights.plans))]
            for flights in (others, slow)
        ]
    print(row(name, [(model.threshold, *both) for both in judged.values()]).text("the model's own, 12 /h"))
    for budget in BUDGETS:
        levels = {v: each.found(3600.0 / budget)[0] for v, each in health.items()}
        found = [(level.threshold, *judged[v]) for v, level in levels.items() if level is not None]
        print(row(name, found).text(f"{budget:g} /h"), flush=True)


def of_baseline(groups: dict[int, tuple[Flown, ...]]) -> None:
    """Print the lines of the healthy baseline, of which no fault was ever seen."""
    learned, judged = {}, {}
    for v, (calm, others, slow) in groups.items():
        log(f"baseline: vehicle {v}")
        learned[v] = VibrationBaseline()
        for j in range(len(calm.plans)):
            learned[v].fly(list(calm.vibrated(j, "imu100")))
        healthy, finding = learned[v].found(3600.0 / BUDGETS[0])
        log(finding.why)
        assert healthy is not None
        judged[v] = [
            [
                by_baseline(HealthyWatch(healthy, WatchConfig()), flights.vibrated(j, "imu100"))
                for j in range(len(flights.plans))
            ]
            for flights in (others, slow)
        ]
    for budget in BUDGETS:
        found = []
        for v, baseline in learned.items():
            healthy = baseline.found(3600.0 / budget)[0]
            assert healthy is not None
            found.append((healthy.alarm.threshold, *judged[v]))
        print(row("healthy baseline, six axes, 100 Hz", found).text(f"{budget:g} /h"), flush=True)


def refusals(fly: partial[Flown], trained: Path) -> None:
    """Print what is said of flights in air that the model was not trained in."""
    print("\nCalibrated in severe air (2.3 m/s rms) with the models of light air:\n")
    severe = fly("severe", "own31", [Plan(31, 90_000 + j) for j in range(4)], 40.0)
    for name, file, stream in MODELS:
        health = ModelHealth(file, load(trained / file))
        for j in range(len(severe.plans)):
            health.fly(severe.vibrated(j, stream))
        print(f"- {name}: {health.found(36_000.0)[1].why}")


if __name__ == "__main__":
    main()
