"""Whether the battery's current helps where the ESCs tell no currents: sooner, or kinds told apart.

    python benchmarks/battery_current.py [SEEDS [FIRST]]

Simulated flights of the bundled quadrotor and hexarotor, ESC currents taken out of the telemetry before the monitor
hears of it. The battery's current is held against the rotors' speeds,

    r = I / (c sum w³) - 1                       c: mean over the 5 s before the fault

`sooner`: flights in which |r| passes four standard deviations of its healthy self before the alert is raised. `told
as`: the last code with the battery's current, and without it. The simulated sensor has no noise; `lag` puts it behind
a first-order lag, as autopilots filter it.
"""

import math
import statistics
import sys
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.samples import Battery, BatteryReading, Reading, RotorReading
from gcs_health.simulate.flight import Flight
from gcs_health.simulate.scenario import load_scenario
from gcs_health.vehicle_monitor import VehicleMonitor

AT, BOOTED = 9.0, 5.0  # s of the fault in flight; the vehicle has been on for 5 s when the flight begins
COMMON = ["trajectory.height=3", "trajectory.lands=false", "physics_rate=500", f"fault.0.at={AT}"]
FRAMES = {
    "quadrotor, hover": ["vehicle=bebop2", "trajectory.kind=hover"],
    "quadrotor, moves": ["vehicle=bebop2", "trajectory.kind=random"],
    "hexarotor, hover": ["vehicle=melczer_hexa", "trajectory.kind=hover"],
    "hexarotor, moves": ["vehicle=melczer_hexa", "trajectory.kind=random"],
}
KINDS = {
    "propeller lost": ["fault.0.kind=propeller_lost"],
    "slipping": ["fault.0.kind=slipping", "fault.0.size=0.1"],
    "thrust 60 %": ["fault.0.kind=effectiveness", "fault.0.size=0.6"],
    "motor stopped": ["fault.0.kind=motor_stopped"],
    "bearing": ["fault.0.kind=bearing", "fault.0.size=10"],
}
RATES = {"5 Hz": 5.0, "50 Hz": 50.0}
LAGS = {"none": 0.0, "0.5 s": 0.5, "2 s": 2.0}
SIGMAS = 4.0
EARLY = "alarm before the fault"


@dataclass
class Seen:
    """One flight: vehicle time of the alert and its last code; (t, I, sum w³) as heard."""

    raised: float = math.nan
    code: str = "none"
    rows: list[tuple[float, float, float]] = field(default_factory=list)


def fly(frame: str, kind: str, rate: float, lag: float, seed: int) -> Seen:
    """Simulate and monitor one flight without ESC currents; NaN rate = no battery current either."""
    seen = Seen()
    speeds: dict[int, float] = {}

    def tap(_: str, reading: Reading) -> None:
        if isinstance(reading, RotorReading):
            speeds.update({k: w for k, w in enumerate(reading.speed) if w == w})
        elif isinstance(reading, BatteryReading) and speeds and reading.current == reading.current:
            seen.rows.append((reading.t, reading.current, sum(w**3 for w in speeds.values())))

    changes = [*COMMON, *FRAMES[frame], *KINDS[kind], f"seed={seed}", f"trajectory.duration={AT + 2.0}"]
    changes += [f"telemetry.rates.SYS_STATUS={rate or 5.0}", "telemetry.rates.BATTERY_STATUS=0"]
    changes += ["telemetry.rates.ESC_STATUS=50", "telemetry.rates.HIGHRES_IMU=100"]
    monitor = Monitor(MonitorConfig(tap=tap))
    prepared = False
    for stamp, raw in Flight(load_scenario("lost_propeller", changes)).run():
        events = monitor.feed(raw, stamp)
        if not prepared and monitor.vehicles():
            prepared = True
            _prepare(monitor.vehicles()[0], lag if rate else math.nan)
        for event in events:
            if isinstance(event, AlertEvent) and event.t < AT + BOOTED:
                seen.code = EARLY
            elif isinstance(event, AlertEvent) and seen.code != EARLY:
                seen.raised = event.t if seen.raised != seen.raised else seen.raised
                seen.code = event.code
    return seen


def _prepare(vehicle: VehicleMonitor, lag: float) -> None:
    """Take the ESCs' currents out, and put the battery's behind a lag [s]; NaN = take it out too."""
    plain, on_battery = vehicle.rotors.feed, vehicle._handlers[Battery]
    state = [math.nan, math.nan]  # time and level

    def rotors(t: float, sample: Any) -> RotorReading | None:
        reading = plain(t, sample)
        return (
            reading._replace(current=(math.nan,) * len(reading.current))
            if isinstance(reading, RotorReading)
            else reading
        )

    def battery(t: float, sample: Any) -> None:
        share = 1.0 - math.exp(-max(t - state[0], 0.0) / lag) if lag and state[0] == state[0] else 1.0
        state[1] = sample.current if state[1] != state[1] else state[1] + share * (sample.current - state[1])
        state[0] = t
        on_battery(t, sample._replace(current=state[1] if lag == lag else math.nan))

    vehicle.rotors.feed = rotors  # type: ignore[method-assign, assignment]
    vehicle._handlers[Battery] = battery


def passes(seen: Seen) -> tuple[float, float]:
    """Return how long after the fault |r| passes its limit [s], and its healthy spread."""
    fault = AT + BOOTED
    early = [i / cubes for t, i, cubes in seen.rows if fault - 5.0 < t < fault and cubes > 0.0]
    c = statistics.fmean(early)
    spread = statistics.pstdev(each / c for each in early)
    late = (
        t - fault
        for t, i, cubes in seen.rows
        if t >= fault and cubes > 0.0 and abs(i / (c * cubes) - 1.0) > SIGMAS * spread
    )
    return next(late, math.nan), spread


def main(seeds: int, first: int) -> None:
    """Print the table."""
    print(f"Seeds {first} to {first + seeds - 1}.\n")
    print(
        "| craft | fault | battery | lag | alert ms | r passes ms | sooner | spread of r | told as | without it |"
    )
    print("|---|---|---|---|---|---|---|---|---|---|")
    for frame in FRAMES:
        for kind in KINDS:
            plain = [fly(frame, kind, 0.0, 0.0, seed) for seed in range(first, first + seeds)]
            delays = [seen.raised - AT - BOOTED for seen in plain]
            for rate, hertz in RATES.items():
                for lag, seconds in LAGS.items():
                    if rate == "50 Hz" and lag != "none":
                        continue
                    flights = [fly(frame, kind, hertz, seconds, seed) for seed in range(first, first + seeds)]
                    found = [passes(seen) for seen in flights]
                    sooner = sum(
                        p < d or (p == p and d != d) for (p, _), d in zip(found, delays, strict=True)
                    )
                    print(
                        f"| {frame} | {kind} | {rate} | {lag} | {_median(delays, 1e3)} | "
                        f"{_median([p for p, _ in found], 1e3)} | {sooner}/{seeds} | "
                        f"{_median([s for _, s in found])} | {_codes(flights)} | {_codes(plain)} |",
                        flush=True,
                    )


def _codes(flights: list[Seen]) -> str:
    return ", ".join(f"{code} {count}" for code, count in Counter(seen.code for seen in flights).items())


def _median(values: list[float], scale: float = 1.0) -> str:
    known = [value * scale for value in values if value == value]
    return f"{statistics.median(known):.3g}" if known else "-"


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8, int(sys.argv[2]) if len(sys.argv) > 2 else 1)
