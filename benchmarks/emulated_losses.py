"""How many emulated losses the recommended mode finds in recorded healthy flight, and how fast.

    python benchmarks/emulated_losses.py ../shared/data > benchmarks/emulated_losses.md

From t0, drawn while verdicts may be given, rotor i's modelled share leaves the recorded gyro and a_z, open
loop, each row scaled by .8 .. 1.25; at once in one half of the trials, over 80 ms in the other. Rotor
speeds stay as recorded. Delays are from t0. Seeds 1 and 2; the rules were worked out on seed 1.
"""

import argparse
import itertools
import random
import statistics
import struct
from collections import defaultdict
from pathlib import Path

from flight_logs import (
    CELLS,
    EJECTION,
    ESC_STATUS,
    FLIGHTS,
    HIGHRES_IMU,
    Record,
    decimate,
    divisors,
    records,
    repack,
)

from gcs_health.airframe import Airframe
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent
from gcs_health.vehicle_file import load_vehicle

RPM = 3.141592653589793 / 30.0
WINDOW, ROOM = 0.5, 0.6  # s to find it in; s of open gate that a trial needs


def chances(log: list[Record], airframe: Airframe, until: float) -> list[float]:
    """Return the times [s after the first record] at which verdicts may be given, with room behind."""
    monitor = Monitor(MonitorConfig(airframe=airframe, estimators=("effectiveness",), stamped=True))
    good: list[tuple[float, bool]] = []
    for record in log:
        t = (record.stamp - log[0].stamp) * 1e-6
        if t > until:
            break
        monitor.feed(record.raw)
        if record.message == HIGHRES_IMU and monitor.vehicles():
            bank = monitor.vehicles()[0].bank
            good.append((t, bank is not None and bank.gate.verdicts))
    times = [t for t, _ in good]
    out = []
    for k in range(0, len(good), 5):
        end = next((j for j in range(k, len(good)) if times[j] > times[k] + ROOM), None)
        if end is not None and times[end] < times[k] + ROOM + 0.1:
            span = [ok for _, ok in good[k:end]]
            if good[k][1] and sum(span) > 0.9 * len(span):
                out.append(times[k])
    return out


def emulate(
    log: list[Record], airframe: Airframe, rotor: int, t0: float, scale: list[float], ramp: float
) -> list[Record]:
    """Return the log with one rotor's share taken out of gyro and a_z from t0 on."""
    gains = airframe.effectiveness
    seat = airframe.rotors[rotor]
    reach = [max(abs(other.position[axis]) for other in airframe.rotors) for axis in (0, 1)]
    column = (
        -(gains.roll or 0.0) * seat.position[1] / reach[1],
        (gains.pitch or 0.0) * seat.position[0] / reach[0],
        (gains.yaw or 0.0) * seat.spin,
    )
    speeds = [
        (record.time, struct.unpack_from("<4i", record.payload, 8)[seat.esc] * RPM)
        for record in log
        if record.message == ESC_STATUS
    ]
    start = (
        next(record.time for record in log if record.message == HIGHRES_IMU)
        - (next(record.stamp for record in log if record.message == HIGHRES_IMU) - log[0].stamp) * 1e-6
    )
    out = []
    taken = [0.0, 0.0, 0.0]
    at = 0
    last = None
    for record in log:
        if record.message != HIGHRES_IMU or record.time - start < t0:
            out.append(record)
            continue
        t = record.time
        while at + 1 < len(speeds) and speeds[at + 1][0] < t:
            at += 1
        (ta, wa), (tb, wb) = speeds[at], speeds[min(at + 1, len(speeds) - 1)]
        w = wa + (wb - wa) * min(max((t - ta) / (tb - ta), 0.0), 1.0) if tb > ta else wa
        share = min((t - start - t0) / ramp, 1.0) if ramp else 1.0
        dt = min(t - last, 0.05) if last is not None else 0.0
        last = t
        payload = bytearray(record.payload)
        az, p, q, r = struct.unpack_from("<4f", payload, 16)
        for k in range(3):
            taken[k] += column[k] * scale[k] * w * w * share * dt
        az += scale[3] * (gains.thrust or 0.0) * w * w * share
        struct.pack_into("<4f", payload, 16, az, p - taken[0], q - taken[1], r - taken[2])
        out.append(repack(record, bytes(payload)))
    return out


def trial(log: list[Record], airframe: Airframe, rotor: int, t0: float) -> tuple[str, float]:
    """Return what became of one loss, and its delay [s]."""
    monitor = Monitor(
        MonitorConfig(airframe=airframe, estimators=("effectiveness",), stamped=True, estimate_rate=1.0)
    )
    for record in log:
        t = (record.stamp - log[0].stamp) * 1e-6
        if t > t0 + WINDOW:
            break
        for event in monitor.feed(record.raw):
            if isinstance(event, AlertEvent) and event.state == "raised":
                if t < t0:
                    return "early", 0.0
                return ("found" if event.motor == rotor + 1 else "wrong"), t - t0
    return "missed", 0.0


def main() -> None:
    """Print one table a seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--per-rotor", type=int, default=3, help="trials a rotor and flight")
    arguments = parser.parse_args()
    print("# Emulated losses\n\nPrinted by `python benchmarks/emulated_losses.py FOLDER`.\n")
    print("\n".join((__doc__ or "").split("\n\n")[2].split("\n")) + "\n")
    crafts = {
        name: load_vehicle(arguments.folder / "vehicles" / f"{FLIGHTS[name][0]}.toml") for name in FLIGHTS
    }
    logs = {name: records(arguments.folder / f"{name}.tlog") for name in FLIGHTS}
    room = {name: chances(logs[name], crafts[name], 12.0 if name == EJECTION else 1e9) for name in FLIGHTS}
    for seed in arguments.seeds:
        rng = random.Random(seed)
        results: dict[str, list[tuple[str, float]]] = defaultdict(list)
        for name, rotor, k in itertools.product(FLIGHTS, range(4), range(arguments.per_rotor)):
            t0 = rng.choice(room[name])
            scale = [rng.uniform(0.8, 1.25) for _ in range(4)]
            changed = emulate(logs[name], crafts[name], rotor, t0, scale, 0.08 if (k + rotor) % 2 else 0.0)
            for cell in CELLS:
                keep = divisors(name, cell)
                if keep is not None:
                    phase = (rng.randrange(keep[0]), rng.randrange(keep[1]))
                    results[cell].append(trial(decimate(changed, keep, phase), crafts[name], rotor, t0))
        print(
            f"## Seed {seed}\n\n| rate | found | wrong | before t0 | median ms | 97.5 % ms |\n"
            "|---|---|---|---|---|---|"
        )
        for cell, outcome in results.items():
            delays = sorted(delay for what, delay in outcome if what == "found")
            count = {what: sum(other == what for other, _ in outcome) for what in ("wrong", "early")}
            print(
                f"| {cell} | {len(delays)}/{len(outcome)} | {count['wrong']} | {count['early']} | "
                f"{1e3 * statistics.median(delays):.0f} | {1e3 * delays[int(0.975 * len(delays))]:.0f} |",
                flush=True,
            )
        print()


if __name__ == "__main__":
    main()
