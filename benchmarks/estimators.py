"""What each estimator costs, and how fast a replay with all four runs, on one core.

    python benchmarks/estimators.py

A simulated quadrotor moves at random for a minute: HIGHRES_IMU at 250 Hz, ESC_STATUS and ACTUATOR_OUTPUT_STATUS at
50 Hz. First the whole Monitor, decoding, verdicts and events included; then every estimator alone, fed the same
readings, with its estimates taken ten times a second. CPU time; `benchmarks/estimators.md` is the output.
"""

import argparse
import gc
import io
import time

from gcs_health.airframe import Airframe
from gcs_health.estimators import REGISTRY, load
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.samples import ImuReading, Reading
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.scenario import load_scenario

RATES = ("HIGHRES_IMU=250", "ESC_STATUS=50", "ACTUATOR_OUTPUT_STATUS=50")


def flown(duration: float) -> bytes:
    """Return the .tlog."""
    changes = [f"telemetry.rates.{rate}" for rate in RATES]
    changes += ["trajectory.kind=random", f"trajectory.duration={duration}", "trajectory.lands=false"]
    log = io.BytesIO()
    for stamp, frame in Flight(load_scenario("healthy_quad", changes)).run():
        log.write(record(stamp, frame))
    return log.getvalue()


def whole(data: bytes, estimators: tuple[str, ...]) -> tuple[float, float]:
    """Replay once; return seconds of flight and of CPU time."""
    start = time.process_time()
    monitor = Monitor(MonitorConfig(stamped=True, estimators=estimators))
    for at in range(0, len(data), 1 << 18):
        monitor.feed(data[at : at + (1 << 18)])
    monitor.finish()
    vehicle = monitor.vehicles()[0]
    return vehicle.last_t - vehicle.first_t, time.process_time() - start


def alone(name: str, mode: str, airframe: Airframe, readings: list[Reading]) -> float:
    """Return CPU seconds of one estimator over all readings that it takes."""
    estimator = load(name, airframe, mode)
    taken = [reading for reading in readings if type(reading) in estimator.takes]
    due = 0.0
    start = time.process_time()
    for reading in taken:
        estimator.feed(reading)
        if reading.t >= due:
            due = reading.t + 0.1
            estimator.estimates(reading.t)
    return time.process_time() - start


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=60.0)
    parser.add_argument("--runs", type=int, default=5)
    args = parser.parse_args()
    gc.set_threshold(100_000, 20, 20)  # as the command line does
    data = flown(args.duration)
    readings: list[Reading] = []
    monitor = Monitor(MonitorConfig(stamped=True, tap=lambda _, reading: readings.append(reading)))
    monitor.feed(data)
    airframe = monitor.vehicles()[0].airframe
    assert airframe is not None
    samples = sum(type(reading) is ImuReading for reading in readings)
    print("| estimators | times real time, best of runs |\n|---|---|")
    for chosen in (tuple(REGISTRY), *((name,) for name in REGISTRY)):
        best = max(flight / spent for flight, spent in (whole(data, chosen) for _ in range(args.runs)))
        print(f"| {', '.join(chosen)} | {best:.0f} |")
    print("\n| estimator | mode | µs per IMU sample | times real time, alone |\n|---|---|---|---|")
    for name in REGISTRY:
        for mode in ("recommended", "paper"):
            spent = min(alone(name, mode, airframe, readings) for _ in range(args.runs))
            print(f"| {name} | {mode} | {spent / samples * 1e6:.1f} | {args.duration / spent:.0f} |")


if __name__ == "__main__":
    main()
