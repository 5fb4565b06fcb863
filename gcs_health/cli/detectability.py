"""`gcs-health detectability`: what would be found on this airframe, with its noise and its rates."""

import argparse
import math
import sys
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gcs_health.airframe import Airframe
from gcs_health.cli import DONE
from gcs_health.errors import ConfigError
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.simulate.graft import Graft
from gcs_health.simulate.graft_fault import GraftFault
from gcs_health.simulate.recording import Flown, first_pass, read_frames
from gcs_health.vehicle_file import load_vehicle

LADDER = (0.8, 0.7, 0.6, 0.5, 0.4)  # what is left of the rotor
WINDOW = 2.0  # s after the fault in which an alert counts
QUANTILES = (50.0, 97.5)


def run(options: argparse.Namespace) -> int:
    """Graft the ladder over every rotor into every flight; print what was found."""
    airframe = load_vehicle(options.vehicle) if options.vehicle else None
    flights = []
    for name in options.files:
        frames = read_frames(name)
        flown = first_pass(name, frames, airframe)
        if not len(_starts(flown)):
            raise ConfigError(f"{name}: the gate never opens for long: no moment to judge a fault at")
        flights.append((frames, flown))
    numbers = [rotor.motor for rotor in flights[0][1].airframe.rotors]
    plural = "s" if len(flights) > 1 else ""
    print(f"{len(flights)} flight{plural}, {len(numbers)} motors, {options.trials} trials a row\n")
    print(ROW.format("left", "found", "right", "median ms", "97.5 % ms", "too early", "found, by motor"))
    for left in LADDER:
        trials = list(_trials(flights, airframe, left, options.trials, options.seed))
        found = [trial for trial in trials if trial.delay == trial.delay]
        low, high = wilson(len(found), len(trials))
        quantiles = np.percentile([trial.delay for trial in found], QUANTILES) * 1e3 if found else ()
        delays = [f"{value:.0f}" for value in quantiles] or ["-", "-"]
        right, early = sum(trial.right for trial in found), sum(trial.early for trial in trials)
        by_motor = " ".join(_share(trials, motor) for motor in numbers)
        share = f"{len(found)}/{len(trials)} ({low:.0%}-{high:.0%})"
        print(ROW.format(f"{left:.1f}", share, f"{right}/{len(found)}", *delays, early, by_motor))
    print(
        "\nleft: what is left of the rotor's thrust after a sudden loss, grafted by the linear model. Intervals:"
        "\nWilson, 95 %. Unbalance, drag and telemetry faults have no estimator yet that would find them."
    )
    return DONE


ROW = "{:<6}{:<20}{:<9}{:>10}{:>11}{:>11}   {}"


class Trial(NamedTuple):
    """One graft: motor, delay [s] (NaN = not found), motor named rightly, alarm before the fault."""

    motor: int
    delay: float
    right: bool
    early: bool


def _share(trials: list[Trial], motor: int) -> str:
    mine = [trial for trial in trials if trial.motor == motor]
    return f"{sum(trial.delay == trial.delay for trial in mine)}/{len(mine)}"


def _trials(
    flights: list[tuple[list[tuple[int, bytes]], Flown]],
    airframe: Airframe | None,
    left: float,
    count: int,
    seed: int,
) -> Iterator[Trial]:
    """Yield the trials of one row of the ladder: every motor in turn, at times drawn from the seed."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(round(left * 100),)))
    for k in range(count):
        frames, flown = flights[k % len(flights)]
        rotors = flown.airframe.rotors
        motor = rotors[(k // len(flights)) % len(rotors)].motor
        at = float(rng.choice(_starts(flown)))
        fault = GraftFault(motor, "effectiveness", at - flown.first_t, left)
        if sys.stderr.isatty():
            print(f"\r{left:.1f} left: {k + 1}/{count} ", end="", file=sys.stderr, flush=True)
        yield _trial(frames, flown, airframe, fault, at)
    if sys.stderr.isatty():
        print("\r" + " " * 40 + "\r", end="", file=sys.stderr)


def _trial(
    frames: list[tuple[int, bytes]], flown: Flown, airframe: Airframe | None, fault: GraftFault, at: float
) -> Trial:
    monitor = Monitor(MonitorConfig(airframe=airframe))
    for stamp, raw in Graft(flown, fault).frames(frames):
        for event in monitor.feed(raw, stamp):
            if isinstance(event, AlertEvent) and event.state == "raised":
                if event.t < at:
                    return Trial(fault.motor, math.nan, False, True)
                return Trial(fault.motor, event.t - at, event.motor == fault.motor, False)
        vehicles = monitor.vehicles()
        # before the vehicle's clock is known, times are on another axis
        if vehicles and vehicles[0].clock.settled and vehicles[0].last_t > at + WINDOW:
            break
    return Trial(fault.motor, math.nan, False, False)


def _starts(flown: Flown) -> np.ndarray:
    """Return the times at which verdicts could be given, with room behind for the fault to show."""
    opened = flown.opened
    return opened[opened < flown.last_t - 0.6] if len(opened) else opened


def wilson(hits: int, count: int) -> tuple[float, float]:
    """Return the 95 % Wilson interval of a share."""
    if not count:
        return 0.0, 1.0
    z = 1.959964
    share = hits / count
    middle = (share + z * z / (2 * count)) / (1 + z * z / count)
    half = z / (1 + z * z / count) * math.sqrt(share * (1 - share) / count + z * z / (4 * count * count))
    return max(middle - half, 0.0), min(middle + half, 1.0)
