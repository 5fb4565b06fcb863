"""A long simulated session, received live and recorded: whether memory stays, and whether a frame is lost.

    python benchmarks/soak.py --hours 2 --speed 10 > benchmarks/soak.md

One flight of ten minutes is simulated, from before arming to after landing, and sent again and again over UDP,
each time after the vehicle has rebooted, so many times faster than it flew, to a `gcs-health live --record`. Its
resident memory is read after every flight from the kernel (Linux); at the end the frames in the recording are counted
against those sent. Memory is flat where the second half's largest is within 10 % of the first half's, the first
flight left out.
"""

import argparse
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from latency import Frames, send

from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.simulate.flight import Flight
from gcs_health.simulate.scenario import load_scenario


def flight(minutes: float, seed: int) -> Frames:
    """Return one flight's frames, (s from the first, frame)."""
    changes = ["trajectory.kind=random", "trajectory.height=5", f"trajectory.duration={60 * minutes}"]
    frames = list(Flight(load_scenario("healthy_quad", [*changes, f"seed={seed}", "wind.speed=4"])).run())
    return [((stamp - frames[0][0]) * 1e-6, frame) for stamp, frame in frames]


def memory(pid: int) -> float:
    """Return a process's resident memory [MB]."""
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS"):
            return float(line.split()[1]) / 1024.0
    return 0.0


def main() -> None:
    """Fly for as long as asked and print what was seen."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=2.0, help="of wall clock")
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--minutes", type=float, default=10.0, help="of one flight")
    parser.add_argument("--port", type=int, default=24553)
    args = parser.parse_args()
    frames = [(t / args.speed, frame) for t, frame in flight(args.minutes, 1)]
    rounds = max(1, round(3600.0 * args.hours / frames[-1][0]))
    rows = []
    with tempfile.TemporaryDirectory() as place:
        command = [sys.executable, "-m", "gcs_health", "live", f"udpin://127.0.0.1:{args.port}"]
        command += ["--record", f"{place}/", "--history", f"{place}/history.sqlite", "--config", "none"]
        said = Path(place) / "said.txt"
        with said.open("w") as text:
            live = subprocess.Popen(command, stdout=text, stderr=subprocess.STDOUT)
            time.sleep(2.0)
            late = 0.0
            for k in range(rounds):
                late = max(late, send(frames, args.port))
                rows.append((k + 1, memory(live.pid)))
            time.sleep(2.0)
            live.send_signal(2)
            live.wait(120)
        kept, alerts = 0, said.read_text().count(" raised: ")
        for file in sorted(Path(place).glob("**/*.tlog")):
            with open_log(str(file)) as log:
                monitor = Monitor(MonitorConfig(stamped=True, estimators=()))
                for block in log.blocks():
                    monitor.feed(block)
                kept += dict(monitor.survey().counters)["frames"]
    hours = rounds * args.minutes / 60.0
    print(f"# Soak\n\nPrinted by `python benchmarks/soak.py {' '.join(sys.argv[1:])}`.\n")
    print(f"{hours:.2f} flight hours in {rounds} flights, {len(frames) / frames[-1][0]:.0f} messages/s.\n")
    print("| after flight | resident MB |\n|---|---|")
    for k, megabytes in rows[:: max(1, len(rows) // 20)]:
        print(f"| {k} | {megabytes:.1f} |")
    later = [megabytes for _, megabytes in rows[1:]] or [rows[0][1]]
    half = max(1, len(later) // 2)
    growth = max(later[half:], default=later[-1]) / max(later[:half]) - 1.0
    print(f"\nGrowth of the second half over the first: {100 * growth:.1f} %. ", end="")
    print(f"Recorded {kept} of {rounds * len(frames)} frames. Alerts raised: {alerts}. ", end="")
    print(f"The sender was late by {1e3 * late:.0f} ms at most.")


if __name__ == "__main__":
    main()
