"""How soon the demo shows something: from the command to the first estimate, from the fault to its alert.

    python benchmarks/demo.py --runs 5

Wall-clock time of the whole command on this computer, which should do nothing else meanwhile: `demo` starts,
starts the vehicle's process, hears it over UDP. The first estimate is the first with a value. The alert's delay is in
vehicle time, which the demo flies at.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path


def one(folder: Path) -> tuple[float, float]:
    """Return (command to first estimate, fault to alert) of one demo [s]."""
    lines = folder / "demo.jsonl"
    started = time.time_ns() // 1000
    command = [sys.executable, "-m", "gcs_health", "demo", "--jsonl", str(lines)]
    told = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    events = [json.loads(line) for line in lines.read_text().splitlines()]
    first = next(e["t_unix_us"] for e in events if e["type"] == "estimate" and e["value"] is not None)
    alert = next(e["t"] for e in events if e["type"] == "alert")
    at = float(told.split("the truth: propeller lost on motor 3 at ")[1].split()[0])
    return (first - started) * 1e-6, alert - at


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=3)
    args = parser.parse_args()
    print("| run | command to first estimate, s | fault to alert, s |\n|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for run in range(args.runs):
            first, alert = one(Path(folder))
            print(f"| {run + 1} | {first:.2f} | {alert:.3f} |", flush=True)


if __name__ == "__main__":
    main()
