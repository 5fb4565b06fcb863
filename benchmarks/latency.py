"""From the socket to the event: how late, and with how many vehicles one process keeps up.

    python benchmarks/latency.py            # 1 vehicle at 1000 messages/s, then 16 at 500 each

A simulated flight is sent over UDP to a `gcs-health live --record` of its own process, in real time and in datagrams
of one frame. Every event says the vehicle's time of the datum that caused it, and so when that was due to be sent;
its way ends when this script reads the event's line. The sender's own delays count. The further vehicles are the
first one's frames under other system ids, each shifted in time. "caught up" is how long after the last frame the
recording still grew. Frames kept in the recording are counted against those sent.
"""

import argparse
import json
import math
import socket
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fastcrc.crc16 import mcrf4xx

from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.simulate.flight import Flight
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.telemetry import UNIX_BOOT_US

Frames = list[tuple[float, bytes]]
SETTLE = 3.0  # s after the first frame: imports, airframe
SHIFT = 0.0131  # s between the vehicles
DELAY = 0.004  # s, of the simulated link
REST = 23.0  # messages/s of the simulator's usual ones
FAST = {"HIGHRES_IMU": 1.0, "ESC_STATUS": 1.0, "ATTITUDE": 1.0, "SERVO_OUTPUT_RAW": 0.6}  # shares


@dataclass
class Sent:
    """Frames of a number of vehicles, (s from the first, frame), and the first vehicle's clock at the first [s]."""

    frames: Frames
    clock: float


def flight(rate: float, duration: float, lost_at: float | None) -> Sent:
    """Return (s from the first, frame) at about so many messages a second."""
    each = (rate - REST) / sum(FAST.values())
    changes = [
        "trajectory.kind=random",
        "trajectory.height=4",
        "trajectory.lands=false",
        "vehicle=ghalamchi_medium",
    ]
    changes += [f"trajectory.duration={duration}", "sensors.esc_rate=500", "sensors.imu_integration_rate=500"]
    changes += [f"telemetry.rates.{name}={each * share:.0f}" for name, share in FAST.items()]
    if lost_at is not None:
        changes.append(f'fault=[{{kind="propeller_lost", motor=3, at={lost_at}}}]')
    frames = list(Flight(load_scenario("healthy_quad", changes)).run())
    clock = frames[0][0] * 1e-6 - UNIX_BOOT_US * 1e-6 - DELAY
    return Sent([((stamp - frames[0][0]) * 1e-6, frame) for stamp, frame in frames], clock)


def renamed(frame: bytes, system: int, extras: dict[int, int]) -> bytes:
    """Return a frame under another system id, its checksum made anew."""
    body = bytearray(frame[:-2])
    body[5] = system
    crc = mcrf4xx(bytes(body[1:]) + bytes([extras[int.from_bytes(body[7:10], "little")]]))
    return bytes(body) + crc.to_bytes(2, "little")


def fleet(one: Sent, vehicles: int) -> Sent:
    """Return the frames of so many vehicles, in order of time."""
    extras = {message: row.crc_extra for message, row in default_dialect().messages.items()}
    out = []
    for k in range(vehicles):
        shift = SHIFT * k
        out += [(t + shift, frame if k == 0 else renamed(frame, k + 1, extras)) for t, frame in one.frames]
    return Sent(sorted(out, key=lambda each: each[0]), one.clock)


def send(frames: Frames, port: int) -> float:
    """Send in real time; return by how much the sender itself was late at worst [s]."""
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    start, worst = time.perf_counter(), 0.0
    for t, frame in frames:
        wait = t - (time.perf_counter() - start)
        if wait > 0.0005:
            time.sleep(wait)
        worst = max(worst, -wait)
        out.sendto(frame, ("127.0.0.1", port))
    return worst


def grown(place: Path, patience: float) -> float:
    """Wait until the recording no longer grows; return for how long it did [s]."""
    start = last = time.perf_counter()
    size = -1
    while time.perf_counter() - last < 1.0 and time.perf_counter() - start < patience:
        now = sum(file.stat().st_size for file in place.glob("*.tlog"))
        if now != size:
            size, last = now, time.perf_counter()
        time.sleep(0.05)
    return last - start


def measured(name: str, sent: Sent) -> str:
    """Return one row of the table."""
    frames = sent.frames
    probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    probe.bind(("127.0.0.1", 0))
    port = probe.getsockname()[1]
    probe.close()
    late: list[float] = []
    alerts: list[float] = []
    with tempfile.TemporaryDirectory() as place:
        recording = Path(place) / "flight.tlog"
        command = [sys.executable, "-m", "gcs_health", "live", f"udpin://127.0.0.1:{port}", "--jsonl", "-"]
        command += ["--record", str(recording), "--history", "none", "--config", "none"]
        live = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, bufsize=0)
        assert live.stdout is not None
        began: list[float] = []

        def read() -> None:
            assert live.stdout is not None
            for line in live.stdout:
                now = time.perf_counter()
                event = json.loads(line)
                if event["type"] not in ("estimate", "alert") or not began:
                    continue
                shift = SHIFT * (int(event["vehicle"].split(".")[0]) - 1)
                due = event["t"] - sent.clock + shift
                if due > SETTLE:
                    late.append(now - began[0] - due)
                    if event["type"] == "alert":
                        alerts.append(late[-1])

        drained = threading.Thread(target=lambda: [None for _ in live.stderr or ()])
        reader = threading.Thread(target=read)
        reader.start()
        drained.start()
        time.sleep(1.5)
        began.append(time.perf_counter())
        behind = send(frames, port)
        caught_up = grown(Path(place), 60.0)
        live.send_signal(2)
        live.wait(60)
        reader.join()
        drained.join()
        kept = 0
        for file in sorted(Path(place).glob("*.tlog")):
            with open_log(str(file)) as log:
                monitor = Monitor(MonitorConfig(stamped=True, estimators=()))
                for block in log.blocks():
                    monitor.feed(block)
                kept += dict(monitor.survey().counters)["frames"]
    quantiles = [1e3 * float(np.percentile(late, q)) for q in (50, 99, 100)] if late else [math.nan] * 3
    told = f"{1e3 * max(alerts):.1f}" if alerts else "-"
    rate = len(frames) / frames[-1][0]
    return (
        f"| {name} | {rate:.0f} | {len(late)} | {quantiles[0]:.1f} | {quantiles[1]:.1f} | {quantiles[2]:.1f} | "
        f"{told} | {kept}/{len(frames)} | {caught_up:.1f} | {1e3 * behind:.0f} |"
    )


def load(name: str, sent: Sent) -> str:
    """Return a row: how much of one core the monitor takes, without sockets."""
    frames = sent.frames
    monitor = Monitor(MonitorConfig())
    begin = time.process_time()
    for t, frame in frames:
        monitor.feed(frame, int(1.7e15 + t * 1e6))
    used = time.process_time() - begin
    span = frames[-1][0]
    return (
        f"| {name} | {len(frames) / span:.0f} | {100 * used / span:.0f} % | {1e6 * used / len(frames):.0f} |"
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--duration", type=float, default=20.0, help="s of flight")
    parser.add_argument("--vehicles", type=int, nargs="*", default=[4, 16])
    args = parser.parse_args()
    one = flight(1000.0, args.duration, args.duration - 4.0)
    slow = flight(500.0, args.duration, None)
    many = {count: fleet(slow, count) for count in args.vehicles}
    print(f"# Latency\n\nPrinted by `python {' '.join(['benchmarks/latency.py', *sys.argv[1:]])}`.\n")
    print(
        "| vehicles | messages/s | events | median ms | p99 ms | worst ms | alert ms | recorded | caught up s "
        "| sender late ms |"
    )
    print("|---" * 10 + "|")
    print(measured("1", one), flush=True)
    for count, frames in many.items():
        print(measured(str(count), frames), flush=True)
    print("\n| vehicles | messages/s | of one core | us a message |\n|---|---|---|---|")
    print(load("1", one), flush=True)
    for count, frames in many.items():
        print(load(str(count), frames), flush=True)


if __name__ == "__main__":
    main()
