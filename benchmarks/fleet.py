"""What a fleet of logs costs: throughput against one core, memory of a worker, overhead of a log, growth.

    python benchmarks/fleet.py [--logs 16] [--many 200] [--short 60000] [--copies 1 4 16] [--plot docs/fleet.svg]

Logs are the shipped flight of 14 s (`replay/lost_propeller.tlog`); longer ones are several of it on end, the
vehicle reboots between them; the short ones of the overhead are its first 60 kB. Ratios are within one run. Memory
is told by Linux alone.
"""

import argparse
import os
import struct
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from gcs_health.engine import each
from gcs_health.fleet import Job, analyse, find_logs
from gcs_health.fleet_store import FleetStore
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.pipeline import MonitorConfig
from gcs_health.record.history import History

FLIGHT = Path(__file__).parents[1] / "replay" / "lost_propeller.tlog"
SHORT = 60_000  # bytes
AGAIN_US = 20_000_000


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--logs", type=int, default=16, help="for the throughput")
    parser.add_argument("--many", type=int, nargs="+", default=[50, 200], help="short logs, for the overhead")
    parser.add_argument("--short", type=int, default=SHORT, help="bytes of each of these")
    parser.add_argument("--copies", type=int, nargs="+", default=[1, 4, 16], help="of the flight in one log")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--plot", type=Path, help="write the growth with length as a picture (matplotlib)")
    options = parser.parse_args()
    print(f"`{' '.join(['python benchmarks/fleet.py', *sys.argv[1:]])}`\n")
    with tempfile.TemporaryDirectory() as place:
        _throughput(Path(place), options.logs, options.workers)
        _overhead(Path(place), options.many, options.short)
        _length(Path(place), options.copies, options.plot)


def _throughput(place: Path, count: int, workers: int) -> None:
    logs = _folder(place / "throughput", count, FLIGHT.read_bytes())
    wall = {n: _run(logs, place / f"out{n}", n) for n in (1, workers)}
    print(f"## {count} logs of 14 s on {workers} cores\n")
    print("| processes | s | logs a second | against one |\n|---|---|---|---|")
    for n, seconds in wall.items():
        print(f"| {n} | {seconds:.1f} | {count / seconds:.2f} | {wall[1] / seconds:.2f} |")
    print("\nStarting the processes and importing what they need is in it.\n")


def _overhead(place: Path, counts: Sequence[int], short: int) -> None:
    print(f"## Overhead of a log: short logs of {short} bytes, one process\n")
    print("| logs | s | of it replay | overhead a log [ms] |\n|---|---|---|---|")
    for count in counts:
        logs = _folder(place / f"many{count}", count, FLIGHT.read_bytes()[:short])
        out = place / f"outmany{count}"
        wall = _run(logs, out, 1)
        replay = sum(FleetStore(out).read("flights", ["seconds"])["seconds"])
        print(f"| {count} | {wall:.1f} | {replay:.1f} | {1e3 * (wall - replay) / count:.1f} |")
    print()


def _length(place: Path, copies: Sequence[int], plot: Path | None) -> None:
    print("## Growth with the length of a log: one worker of its own for each\n")
    print("| flight [s] | MB | s | s for each s of flight | peak memory [MB] |\n|---|---|---|---|---|")
    rows = []
    for count in copies:
        path = place / f"long{count}.tlog"
        path.write_bytes(_several(count))
        job = Job(str(path), path.stat().st_size, 0, MonitorConfig())
        (done,) = each(_measured, [job], workers=2)
        assert not done.error, done.error
        seconds, peak = done.result
        flight = 13.9 * count
        rows.append((flight, seconds, peak))
        size = path.stat().st_size / 1e6
        print(f"| {flight:.0f} | {size:.1f} | {seconds:.1f} | {seconds / flight:.3f} | {peak:.0f} |")
    print("\nPeak memory is the whole process, interpreter and libraries in it.")
    if plot is not None:
        _draw(rows, plot)


def _draw(rows: Sequence[tuple[float, float, float]], path: Path) -> None:
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, (left, right) = pyplot.subplots(1, 2, figsize=(8, 3), layout="constrained")
    flight, seconds, peak = zip(*rows, strict=True)
    left.plot(flight, seconds, "o-")
    left.set(xlabel="flight [s]", ylabel="replay [s]", ylim=0)
    right.plot(flight, peak, "o-")
    right.axhline(150.0, linestyle=":", color="gray")
    right.set(xlabel="flight [s]", ylabel="peak memory of a worker [MB]", ylim=0)
    figure.savefig(path)


def _measured(job: Job) -> tuple[float, float]:
    begun = time.perf_counter()
    analyse(job)
    # not ru_maxrss: that of a child begins with what its parent had when it was made
    peak = next(
        line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM")
    )
    return time.perf_counter() - begun, int(peak.split()[1]) / 1e3


def _run(logs: Path, out: Path, workers: int) -> float:
    """Do a folder as `gcs-health fleet` does; return the seconds."""
    begun = time.perf_counter()
    store, history = FleetStore(out), History(str(out / "history.sqlite"))
    for one in each(analyse, find_logs([str(logs)], MonitorConfig()), workers=workers):
        assert not one.error, one.error
        store.add(one.result)
        for record in one.result.records:
            history.store(record)
    store.flush()
    history.close()
    return time.perf_counter() - begun


def _folder(place: Path, count: int, data: bytes) -> Path:
    place.mkdir()
    for k in range(count):
        (place / f"{k:06d}.tlog").write_bytes(data)
    return place


def _several(count: int) -> bytes:
    """The flight `count` times on end."""
    records = list(FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT.read_bytes()).raw())
    return b"".join(
        struct.pack(">Q", stamp + k * AGAIN_US) + frame for k in range(count) for stamp, frame in records
    )


if __name__ == "__main__":
    main()
