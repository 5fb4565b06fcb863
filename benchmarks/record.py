"""What recording, history and sinks cost the monitor: process time a frame, frame by frame as from a link.

python benchmarks/record.py

Each variant runs the shipped flight, the variants one after another in each of ROUNDS; the least of each is told, and
its ratio to the bare monitor's.
"""

import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from gcs_health.mavlink.batch import FrameBatch
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.history import History
from gcs_health.record.history_keeper import HistoryKeeper
from gcs_health.record.recorder import Recorder
from gcs_health.sinks import parse_sink
from gcs_health.sinks.outlet import Outlet

FLIGHT = Path(__file__).parents[1] / "replay" / "lost_propeller.tlog"
ROUNDS = 7
Frames = list[tuple[int, bytes]]


def bare(frames: Frames, _place: Path) -> float:
    """The monitor alone."""
    return run(frames, None, [])


def recording(frames: Frames, place: Path) -> float:
    """--record."""
    recorder = Recorder(str(place))
    return run(frames, recorder.write, [recorder])


def keeping_history(frames: Frames, place: Path) -> float:
    """--history FILE; the database works in its thread, and counts here."""
    return run(frames, None, [HistoryKeeper(lambda: History(str(place / "h.sqlite")))])


def sending(frames: Frames, place: Path) -> float:
    """--sink jsonl:FILE; its thread counts here too."""
    return run(frames, None, [Outlet(parse_sink(f"jsonl:{place / 'events.jsonl'}"))])


def run(frames: Frames, raw_tap: Callable[[FrameBatch], None] | None, receivers: list) -> float:  # type: ignore[type-arg]
    """Return the process time [s]."""
    monitor = Monitor(MonitorConfig(raw_tap=raw_tap))
    with ExitStack() as stack:
        for receiver in receivers:
            stack.callback(receiver.close)
        began = time.process_time()
        for stamp, frame in frames:
            events = monitor.feed(frame, stamp, "udp")
            for receiver in receivers:
                if events:
                    receiver.take(events)
                receiver.poll(stamp)
        return time.process_time() - began


def main() -> None:
    """Print the table."""
    frames = list(FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT.read_bytes()).raw())
    variants = (bare, recording, keeping_history, sending)
    least = dict.fromkeys(variants, float("inf"))
    for _ in range(ROUNDS):
        for variant in variants:
            with tempfile.TemporaryDirectory() as place:
                least[variant] = min(least[variant], variant(frames, Path(place)))
    print("| variant | µs a frame | ratio |\n|---|---|---|")
    for variant, seconds in least.items():
        name = (variant.__doc__ or "").split(";")[0].rstrip(".")
        print(f"| {name} | {seconds / len(frames) * 1e6:.1f} | {seconds / least[bare]:.2f} |")
    print(f"\n{len(frames)} frames, Python {sys.version.split()[0]}")


if __name__ == "__main__":
    main()
