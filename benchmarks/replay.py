"""How much faster than real time a whole replay runs, on one core.

    python benchmarks/replay.py                      # synthetic: 8 rotors, IMU at 250 Hz, ESCs at 10 to 250 Hz
    python benchmarks/replay.py FLIGHT.tlog [--vehicle FILE.toml]

The synthetic log hovers with noise and ends healthy, so that the estimator never has the easy life after
a verdict. CPU time of this process: decoding, estimator and estimates of every rotor ten times a second, and
beside it the same with every event written as a JSON line, as `--jsonl` does. The table in
`benchmarks/replay.md` is this command's output. How fast a machine is today, the yardstick tells: pymavlink's
`recv_match` reads the same file, and nothing more, in the same minute.
"""

import argparse
import gc
import io
import math
import struct
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from gcs_health.airframe import Airframe
from gcs_health.airframe_tables import ardupilot_frame
from gcs_health.mavlink.generated import esc
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, SummaryEvent, to_json
from gcs_health.vehicle_file import load_vehicle

HOVER, ROTORS, RATE = 500.0, 8, 250  # rad/s, -, Hz
ESC_RATES = (10, 25, 50, 125, 250)  # Hz, of two ESC_STATUS messages each


def synthetic(duration: float, esc_rate: int = RATE, seed: int = 7) -> bytes:
    """Return a .tlog of an octocopter X at hover: rates follow the rotor speeds as the estimator models it."""
    rng = np.random.default_rng(seed)
    frame = ardupilot_frame(3, 1)
    assert frame is not None
    position = np.array([rotor.position for rotor in frame[1]])
    spin = np.array([rotor.spin for rotor in frame[1]])
    thrust = 9.81 / (ROTORS * HOVER**2)
    gain = np.array([-6.0 * position[:, 1], 6.0 * position[:, 0], 0.6 * spin]) * 20 * thrust
    stock, own = (d.MAVLink(None, srcSystem=1, srcComponent=1) for d in (mavlink, esc))
    log, rates, speed = io.BytesIO(), np.zeros(3), np.full(ROTORS, HOVER)

    def send(t: float, link: object, message: object) -> None:
        stamp = struct.pack(">Q", 1_700_000_000_000_000 + round(t * 1e6))
        log.write(stamp + message.pack(link))  # type: ignore[attr-defined]
        stock.seq = own.seq = (stock.seq + 1) % 256

    for name, value in (("FRAME_CLASS", 3.0), ("FRAME_TYPE", 1.0)):
        send(0.0, stock, mavlink.MAVLink_param_value_message(name.encode(), value, 2, 2, 0))
    for k in range(round(duration * RATE)):
        t = 1.0 + k / RATE
        stamp = round(t * 1e6)
        moment = gain @ (speed**2 - HOVER**2)
        rates = rates + moment / RATE
        force = -thrust * float(np.sum(speed**2))
        wanted = HOVER - 25 * np.linalg.pinv(gain * 2 * HOVER) @ rates + rng.normal(0, 6, ROTORS)
        speed = speed + (wanted - speed) / RATE / 0.05
        acc, gyro = rng.normal(0, 0.3, 3), rates + rng.normal(0, 0.01, 3)
        send(
            t,
            stock,
            mavlink.MAVLink_highres_imu_message(
                stamp, acc[0], acc[1], force + acc[2], *gyro, 0, 0, 0, 1013, 0, 0, 20, 63, 0
            ),
        )
        rpm = np.round(speed * 30 / math.pi).astype(int).tolist()
        for first in (0, 4) if k % (RATE // esc_rate) == 0 else ():
            send(
                t,
                own,
                esc.MAVLink_esc_status_message(first, stamp, rpm[first : first + 4], [22.0] * 4, [5.0] * 4),
            )
        if k % RATE == 0:
            send(t, stock, mavlink.MAVLink_heartbeat_message(14, 12, 129, 0, 4, 3))
            send(t, stock, mavlink.MAVLink_extended_sys_state_message(0, 2))
    return log.getvalue()


class Run(NamedTuple):
    """One replay: seconds of flight, CPU seconds without and with JSON lines, alerts."""

    flown: float
    spent: float
    with_lines: float
    alerts: int


def measure(data: bytes, airframe: Airframe | None) -> Run:
    """Replay once."""
    start = time.process_time()
    monitor = Monitor(MonitorConfig(stamped=True, airframe=airframe, estimators=("effectiveness",)))
    events = [e for at in range(0, len(data), 1 << 18) for e in monitor.feed(data[at : at + (1 << 18)])]
    events += monitor.finish()
    replayed = time.process_time()
    for event in events:
        to_json(event)
    written = time.process_time()
    flown = max(event.duration for event in events if isinstance(event, SummaryEvent))
    alerts = sum(isinstance(event, AlertEvent) for event in events)
    return Run(flown, replayed - start, written - start, alerts)


def yardstick(data: bytes) -> float:
    """Return the CPU seconds that pymavlink takes to read the log, message by message."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "flight.tlog"
        path.write_bytes(data)
        start = time.process_time()
        log = mavutil.mavlink_connection(str(path))
        while log.recv_match() is not None:
            pass
        spent = time.process_time() - start
        log.close()
    return spent


def main() -> None:
    """Print the ratio, best and median of several runs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("flights", nargs="*", type=Path)
    parser.add_argument("--vehicle")
    parser.add_argument("--duration", type=float, default=60.0, help="of the synthetic flight [s]")
    parser.add_argument("--runs", type=int, default=5)
    args = parser.parse_args()
    gc.set_threshold(100_000, 20, 20)  # as the command line does; it holds for all contestants
    airframe = load_vehicle(args.vehicle) if args.vehicle else None
    logs = [(path.name, path.read_bytes()) for path in args.flights] or [
        (f"synthetic, {ROTORS} rotors, IMU {RATE} Hz, ESCs {rate} Hz", synthetic(args.duration, rate))
        for rate in ESC_RATES
    ]
    print(
        "| flight | s | MB | times real time: best | median | with JSON lines | recv_match alone | alerts |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for name, data in logs:
        measure(data, airframe)
        runs = [measure(data, airframe) for _ in range(args.runs)]
        ratios = sorted(run.flown / run.spent for run in runs)
        with_lines = max(run.flown / run.with_lines for run in runs)
        read = runs[0].flown / min(yardstick(data) for _ in range(args.runs))
        print(
            f"| {name} | {runs[0].flown:.0f} | {len(data) / 1e6:.1f} | {ratios[-1]:.0f} | "
            f"{ratios[len(ratios) // 2]:.0f} | {with_lines:.0f} | {read:.0f} | {runs[0].alerts} |"
        )


if __name__ == "__main__":
    main()
