"""Every kind of fault on every vehicle of the simulator: does it fly on, and what does the monitor say.

    python benchmarks/faults.py --seed 70001 > benchmarks/faults.md

One flight each: random setpoints in 2 m/s of wind, IMU 100 Hz, ESC_STATUS 50 Hz, 14 s before the fault and 8 s after
it, on motor 2, through a log of bytes and the whole monitor with its defaults. *On* = still more than 1 m above the
ground 4 s after. Codes are those of motor 2 in the order in which they came, the delay that of the first; what else
was raised comes behind. One seed a cell says what happens, not how often.
"""

import argparse
import io
import tempfile
from collections.abc import Iterator
from pathlib import Path

from gcs_health import MonitorConfig, replay
from gcs_health.simulate.faults import KINDS
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.telemetry import BOOTED

VEHICLES = (
    "bebop2",
    "ghalamchi_small",
    "ghalamchi_medium",
    "ghalamchi_large",
    "dutta_hexa",
    "melczer_hexa",
    "octocopter",
)
SIZES = {
    "effectiveness": 0.6,
    "slow": 0.8,
    "blade_cut": 0.15,
    "unbalance": 20.0,
    "bearing": 20.0,
    "slipping": 0.2,
    "esc_swapped": 3,
    "esc_heat": 110.0,
    "esc_flags": 2,
}
MOTOR, AT, AFTER = 2, 14.0, 8.0


def flown(vehicle: str, kind: str, seed: int, path: Path) -> bool:
    """Write the flight's log; return whether it flew on."""
    size = f", size={SIZES[kind]}" if kind in SIZES else ""
    changes = [
        f"vehicle={vehicle}",
        "trajectory.kind=random",
        f"trajectory.duration={AT + AFTER}",
        f"seed={seed}",
    ]
    changes += ["trajectory.height=12", "trajectory.lands=false", "wind.speed=2"]
    changes += ["telemetry.rates.HIGHRES_IMU=100", "telemetry.rates.ESC_STATUS=50"]
    changes += [f"fault=[{{kind='{kind}', motor={MOTOR}, at={AT}{size}}}]"]
    flight = Flight(load_scenario("healthy_quad", changes))
    log, on = io.BytesIO(), False
    for stamp, frame in flight.run():
        log.write(record(stamp, frame))
        if flight.world.t < AT + 4.0:
            on = -flight.world.plant.position[2] > 1.0
    path.write_bytes(log.getvalue())
    return on


def said(path: Path) -> Iterator[tuple[int | None, str, float]]:
    """Yield (motor, code, seconds after the fault) of every alert raised or escalated."""
    for alert in replay(path, MonitorConfig(), readings=False).alerts:
        if alert.state in ("raised", "escalated"):
            yield alert.motor, alert.code, alert.t - BOOTED - AT


def cell(vehicle: str, kind: str, seed: int, folder: Path) -> str:
    """Return one cell of the table."""
    on = flown(vehicle, kind, seed, folder / "flight.tlog")
    alerts = list(said(folder / "flight.tlog"))
    own = [(code, t) for motor, code, t in alerts if motor == MOTOR and t > 0.0]
    rest = [
        f"{code} {'?' if motor is None else motor} at {t:+.1f} s"
        for motor, code, t in alerts
        if motor != MOTOR or t <= 0.0
    ]
    text = " → ".join(code for code, _ in own) + (f", {1e3 * own[0][1]:.0f} ms" if own else "-")
    return f"{'on' if on else 'falls'}: {text}" + (f" **also {'; '.join(rest)}**" if rest else "")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seed", type=int, default=70001)
    parser.add_argument("--vehicles", nargs="*", default=VEHICLES)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS))
    options = parser.parse_args()
    print(f"| fault | {' | '.join(options.vehicles)} |")
    print("|---" * (len(options.vehicles) + 1) + "|")
    with tempfile.TemporaryDirectory() as folder:
        for kind in options.kinds:
            name = f"{kind} {SIZES[kind]:g}" if kind in SIZES else kind
            cells = [cell(vehicle, kind, options.seed, Path(folder)) for vehicle in options.vehicles]
            print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
