"""`gcs-health detectability`: what would be found on this airframe, with its noise and its rates."""

import argparse
import math
import sys
from collections.abc import Iterator

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
    motors = len(flights[0][1].airframe.rotors)
    print(
        f"{len(flights)} flight{'s' if len(flights) > 1 else ''}, {motors} motors, {options.trials} trials a row\n"
    )
    print("effectiveness left   found          right motor   delay, ms: median   97.5 %   before the fault")
    for left in LADDER:
        results = list(_trials(flights, airframe, left, options.trials, options.seed))
        found = [delay for delay, _, _ in results if delay == delay]
        right = sum(ok for delay, ok, _ in results if delay == delay)
        early = sum(early for _, _, early in results)
        low, high = wilson(len(found), len(results))
        delays = [f"{q:.0f}" for q in np.percentile(found, QUANTILES) * 1e3] if found else ["-", "-"]
        print(
            f"{left:<21.1f}{len(found)}/{len(results)} ({low:.0%}-{high:.0%})".ljust(36)
            + f"{right}/{len(found)}".ljust(14)
            + f"{delays[0]:>17}{delays[1]:>9}{early:>19}"
        )
    print(
        "\nintervals: Wilson, 95 %. A sudden loss, grafted by the linear model; a lost propeller is larger."
    )
    return DONE


def _trials(
    flights: list[tuple[list[tuple[int, bytes]], Flown]],
    airframe: Airframe | None,
    left: float,
    count: int,
    seed: int,
) -> Iterator[tuple[float, bool, bool]]:
    """Yield (delay [s] or NaN, right motor, alarm before the fault) of each trial."""
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
) -> tuple[float, bool, bool]:
    monitor = Monitor(MonitorConfig(airframe=airframe))
    for stamp, raw in Graft(flown, fault).frames(frames):
        for event in monitor.feed(raw, stamp):
            if isinstance(event, AlertEvent) and event.state == "raised":
                if event.t < at:
                    return math.nan, False, True
                return event.t - at, event.motor == fault.motor, False
        vehicles = monitor.vehicles()
        # before the vehicle's clock is known, times are on another axis
        if vehicles and vehicles[0].clock.settled and vehicles[0].last_t > at + WINDOW:
            break
    return math.nan, False, False


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
