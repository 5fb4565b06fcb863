"""Decoding beside pymavlink (and fasttlogparser where it is installed): CPU time, as ratios.

    python benchmarks/decode.py                    # synthetic logs, clean and dirty
    python benchmarks/decode.py FLIGHT.tlog ...    # these logs too
    python benchmarks/decode.py --big 1000         # also: peak memory over a log of 1000 MB

All contestants run interleaved in one process, several rounds, best round counts: machines are noisy, so
only the ratios mean anything. `benchmarks/decode.md` is this command's output.
"""

import argparse
import gc
import io
import os
import random
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ["MAVLINK20"] = "1"

from pymavlink import mavutil
from pymavlink.dialects.v20 import all as stock

from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.messages import MessageDecoder
from gcs_health.mavlink.tlog import BLOCK

START_US = 1_700_000_000_000_000


def synthetic(frames: int, dirty: bool, seed: int = 1) -> bytes:
    """Return a .tlog as a ground station writes it: IMU, attitude, ESC telemetry and slow messages."""
    rng = random.Random(seed)
    link = stock.MAVLink(None, srcSystem=1, srcComponent=1)
    log = io.BytesIO()
    for k in range(frames):
        ms = 20 * k
        kind = k % 10
        if kind < 5:
            acc = [rng.gauss(0, 1) for _ in range(6)]
            message = stock.MAVLink_highres_imu_message(1000 * ms, *acc, 0.1, 0.2, 0.3, 1013, 0, 20, 25, 63)
        elif kind < 7:
            message = stock.MAVLink_attitude_message(ms, *[rng.gauss(0, 1) for _ in range(6)])
        elif kind < 9:
            rpm = [rng.randrange(4000, 6000) for _ in range(4)]
            message = stock.MAVLink_esc_telemetry_1_to_4_message(
                [40] * 4, [1600] * 4, [500] * 4, [10] * 4, rpm, [k % 65536] * 4
            )
        elif k % 100 == 9:
            message = stock.MAVLink_heartbeat_message(2, 3, 129, 5, 4, 3)
        else:
            message = stock.MAVLink_vibration_message(1000 * ms, 1.0, 2.0, 3.0, 0, 0, 0)
        frame = message.pack(link)
        link.seq = (link.seq + 1) % 256
        if dirty and rng.random() < 0.02:
            log.write(rng.randbytes(rng.randrange(1, 60)))
        if dirty and rng.random() < 0.02:
            frame = bytearray(frame)
            frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
        log.write(struct.pack(">Q", START_US + 1000 * ms) + frame)
    return log.getvalue()


def blocks(data: bytes) -> list[bytes]:
    """Split as a file is read."""
    return [data[at : at + BLOCK] for at in range(0, len(data), BLOCK)]


def to_columns(data: bytes) -> int:
    """Ours, to columns; return the frames."""
    frames, messages, count = FrameDecoder(default_dialect(), stamped=True), DECODER, 0
    for block in blocks(data):
        batch = frames.feed(block)
        messages.columns(batch)
        count += len(batch)
    return count + len(frames.finish())


def to_samples(data: bytes) -> int:
    """Ours, to samples in order; return the frames."""
    frames, count = FrameDecoder(default_dialect(), stamped=True), 0
    for block in blocks(data):
        batch = frames.feed(block)
        DECODER.samples(batch)
        count += len(batch)
    return count + len(frames.finish())


def recv_match(data: bytes) -> int:
    """Return the messages of pymavlink's way to read a log."""
    with tempfile.NamedTemporaryFile(suffix=".tlog") as file:
        file.write(data)
        file.flush()
        log = mavutil.mavlink_connection(file.name)
        count = 0
        while (message := log.recv_match()) is not None:
            count += message.get_type() != "BAD_DATA"
        log.close()
    return count


def fasttlogparser(data: bytes) -> int:
    """Return what the C++ parser finds."""
    import fasttlogparser as fast

    with tempfile.NamedTemporaryFile(suffix=".tlog") as file:
        file.write(data)
        file.flush()
        parsed = fast.parseTLog(file.name)
    table = parsed[0] if isinstance(parsed, tuple) else parsed
    return sum(len(next(iter(columns.values()))) for columns in table.values())


def live_frames(data: bytes) -> list[bytes]:
    """Return the frames of a clean log without stamps, one a datagram."""
    return [frame for _, frame in FrameDecoder(default_dialect(), stamped=True).feed(data).raw()]


def ours_live(datagrams: list[bytes]) -> int:
    """Ours, datagram by datagram, to samples."""
    frames = FrameDecoder(default_dialect(), stamped=False)
    return sum(len(DECODER.samples(frames.feed(data, START_US))) for data in datagrams)


def pymavlink_live(datagrams: list[bytes]) -> int:
    """Pymavlink's parse_buffer, datagram by datagram."""
    link = stock.MAVLink(None)
    link.robust_parsing = True
    return sum(len(link.parse_buffer(data) or ()) for data in datagrams)


def each(feed: Callable[[bytes], object], datagrams: list[bytes]) -> float:
    """Return the median time of one datagram [µs]."""
    times = []
    for data in datagrams:
        start = time.perf_counter_ns()
        feed(data)
        times.append(time.perf_counter_ns() - start)
    return sorted(times)[len(times) // 2] / 1000


def spent(run: Callable[[], int]) -> tuple[float, int]:
    """Return CPU seconds and what it counted."""
    start = time.process_time()
    count = run()
    return time.process_time() - start, count


def compare(contestants: dict[str, Callable[[], int]], rounds: int) -> dict[str, tuple[float, int]]:
    """Run all in turn, `rounds` times; return the best CPU time and the count of each."""
    best: dict[str, tuple[float, int]] = {}
    for _ in range(rounds):
        for name, run in contestants.items():
            result = spent(run)
            best[name] = min(best.get(name, result), result)
    return best


def report_logs(logs: dict[str, bytes], rounds: int) -> None:
    """Print the table of logs."""
    try:
        import fasttlogparser as _fast  # noqa: F401

        has_fast = True
    except ImportError:
        has_fast = False
    print("| log | reader | messages | µs each | times recv_match |\n|---|---|---|---|---|")
    for name, data in logs.items():
        contestants: dict[str, Callable[[], int]] = {
            "recv_match": lambda data=data: recv_match(data),
            "to columns": lambda data=data: to_columns(data),
            "to samples": lambda data=data: to_samples(data),
        }
        if has_fast:
            contestants["fasttlogparser (C++)"] = lambda data=data: fasttlogparser(data)
        best = compare(contestants, rounds)
        reference = best["recv_match"][0] / max(best["recv_match"][1], 1)
        for reader, (seconds, count) in best.items():
            per = seconds / max(count, 1)
            print(f"| {name} | {reader} | {count} | {per * 1e6:.2f} | {reference / per:.1f} |")


def report_live(rounds: int) -> None:
    """Print the table of live decoding: one frame a datagram, and reads as TCP and serial give them."""
    datagrams = live_frames(synthetic(20_000, dirty=False))
    stream = b"".join(datagrams)
    print("\n| live | parse_buffer | ours | ratio |\n|---|---|---|---|")
    frames, link = FrameDecoder(default_dialect(), stamped=False), stock.MAVLink(None)
    ours, theirs = [], []
    for _ in range(rounds):
        theirs.append(each(link.parse_buffer, datagrams))
        ours.append(each(lambda data: DECODER.samples(frames.feed(data, START_US)), datagrams))
    a, b = min(theirs), min(ours)
    print(f"| one-frame datagram, p50 [µs] | {a:.2f} | {b:.2f} | {a / b:.1f} |")
    for size in (0, 1400, 4096, 65536):
        chunks = [stream[at : at + size] for at in range(0, len(stream), size)] if size else datagrams
        best = compare(
            {
                "parse_buffer": lambda chunks=chunks: pymavlink_live(chunks),
                "ours": lambda chunks=chunks: ours_live(chunks),
            },
            rounds,
        )
        a, b = (best[name][0] / len(datagrams) * 1e6 for name in ("parse_buffer", "ours"))
        assert best["ours"][1] == best["parse_buffer"][1] == len(datagrams)
        what = f"reads of {size} bytes" if size else "one frame a datagram"
        print(f"| {what}, CPU a frame [µs] | {a:.2f} | {b:.2f} | {a / b:.1f} |")


def report_memory(megabytes: int) -> None:
    """Print the peak memory above the imports over a long log, in a process of its own."""
    with tempfile.TemporaryDirectory() as place:
        path = Path(place) / "long.tlog"
        piece = synthetic(20_000, dirty=False)
        with path.open("wb") as file:
            for _ in range(megabytes * 1_000_000 // len(piece) + 1):
                file.write(piece)
        said = subprocess.run(
            [sys.executable, __file__, "--memory-of", str(path)], capture_output=True, text=True, check=True
        )
        print(
            f"\nPeak memory above the imports over {path.stat().st_size / 1e6:.0f} MB: {said.stdout.strip()}"
        )


def memory_of(path: str) -> None:
    """Decode a file to samples and print how far the peak rose above what the imports left resident."""
    from gcs_health.mavlink.tlog import open_log

    Path("/proc/self/clear_refs").write_text("5")  # forget the imports' own peak
    before = resident("VmRSS")
    frames = FrameDecoder(default_dialect(), stamped=True)
    with open_log(path) as log:
        for block in log.blocks():
            DECODER.samples(frames.feed(block))
    print(f"{resident('VmHWM') - before:.1f} MB ({frames.counters.frames} frames)")


def resident(field: str) -> float:
    """Return VmRSS (now) or VmHWM (peak) of this process [MB]. Linux alone tells."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return float(next(line.split()[1] for line in lines if line.startswith(field))) / 1024


DECODER = MessageDecoder(default_dialect())


def main() -> None:
    """Print all tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("logs", nargs="*", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--big", type=int, metavar="MB", help="measure memory over a log of so many MB")
    parser.add_argument("--memory-of", help=argparse.SUPPRESS)
    args = parser.parse_args()
    gc.set_threshold(100_000, 20, 20)  # as the command line does; it holds for all contestants
    if args.memory_of:
        memory_of(args.memory_of)
        return
    logs = {"synthetic, clean": synthetic(20_000, False), "synthetic, dirty": synthetic(20_000, True)}
    logs |= {path.name: path.read_bytes() for path in args.logs}
    report_logs(logs, args.rounds)
    report_live(args.rounds)
    if args.big:
        report_memory(args.big)


if __name__ == "__main__":
    main()
