"""How fast the simulator runs, on one core.

    python benchmarks/simulate.py

One flight: a quadrotor with its IMU at 500 Hz, physics at 1 kHz, all sensors on, written as a .tlog.
Many: the same flight from as many seeds side by side. RotorPy 3 flies its own quadrotor at 500 Hz in the same run,
where it is installed: machines are noisy, the ratio to it counts. CPU time; `benchmarks/simulate.md` is its output.
"""

import argparse
import io
import math
import time
import warnings

from gcs_health.simulate.batch import fly_many
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.scenario import load_scenario

FAST = [
    "telemetry.rates.HIGHRES_IMU=500",
    "sensors.imu_integration_rate=500",
    "telemetry.rates.ESC_STATUS=100",
]


def one(vehicle: str, duration: float) -> float:
    """Return flight seconds a CPU second of one flight into a log."""
    changes = [f"vehicle={vehicle}", f"trajectory.duration={duration}", "trajectory.lands=false", *FAST]
    scenario = load_scenario("healthy_quad", changes)
    start = time.process_time()
    log = io.BytesIO()
    for stamp, frame in Flight(scenario).run():
        log.write(record(stamp, frame))
    return duration / (time.process_time() - start)


def many(vehicle: str, flights: int, duration: float) -> float:
    """Return flight seconds a CPU second of many flights at once."""
    changes = [f"vehicle={vehicle}", f"trajectory.duration={duration}", "trajectory.lands=false"]
    scenario = load_scenario("healthy_quad", changes)
    start = time.process_time()
    fly_many(scenario, list(range(flights)), 250.0, 100.0)
    return flights * duration / (time.process_time() - start)


def rotorpy(duration: float = 5.0) -> float:
    """Return flight seconds a CPU second of RotorPy, its IMU and controller on; NaN where it is not installed."""
    try:
        from rotorpy.controllers.quadrotor_control import SE3Control
        from rotorpy.environments import Environment
        from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
        from rotorpy.vehicles.crazyflie_params import quad_params
        from rotorpy.vehicles.multirotor import Multirotor
    except ModuleNotFoundError:
        return math.nan
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        flown = Environment(
            Multirotor(quad_params), SE3Control(quad_params), ThreeDCircularTraj(), sim_rate=500
        )
        start = time.process_time()
        flown.run(t_final=duration)
    return duration / (time.process_time() - start)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=20.0)
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    one("bebop2", 10.0)  # imports and the dialect are paid once
    other = max(rotorpy() for _ in range(args.runs))
    print(
        "| flights | vehicle | flight seconds a core second, best of runs | over RotorPy's |\n|---|---|---|---|"
    )
    print(f"| 1, RotorPy at 500 Hz | its own | {other:.2f} | 1 |")
    for vehicle in ("bebop2", "ghalamchi_large", "octocopter"):
        best = max(one(vehicle, args.duration) for _ in range(args.runs))
        print(f"| 1, into a .tlog, IMU 500 Hz | {vehicle} | {best:.0f} | {best / other:.0f} |")
    for flights in (16, 64, 256, 1024):
        best = max(many("bebop2", flights, min(args.duration, 12.0)) for _ in range(args.runs))
        print(f"| {flights} | bebop2 | {best:.0f} | {best / other:.0f} |")
    best = max(many("octocopter", 256, min(args.duration, 12.0)) for _ in range(args.runs))
    print(f"| 256 | octocopter | {best:.0f} | {best / other:.0f} |")


if __name__ == "__main__":
    main()
