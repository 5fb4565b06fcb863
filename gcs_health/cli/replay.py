"""`gcs-health replay`: recorded flights through the monitor, as fast as it can."""

import argparse
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, TextIO

from gcs_health.cli import ALERT, BAD_INPUT, DONE
from gcs_health.cli.monitoring import Output, make_monitor
from gcs_health.cli.receivers import evidence_of, history_of, options_for, sinks_of
from gcs_health.errors import GcsHealthError, LogError
from gcs_health.mavlink.tlog import Log, open_log
from gcs_health.monitor_config import Tap
from gcs_health.pipeline import Monitor
from gcs_health.record.events import Event

if TYPE_CHECKING:
    from gcs_health.cli.receivers import RawTap
    from gcs_health.dashboard.interface import Worker


def run(options: argparse.Namespace) -> int:
    """Replay every file; an unreadable one is told and the rest still done."""
    if options.sweep:
        from gcs_health.cli.sweep import run as run_sweep

        return run_sweep(options)
    code = DONE
    make_monitor(options, stamped=True)  # what is wrong with the options is wrong for every file
    receivers = [*history_of(options), *sinks_of(options, patient=True)]
    with Output(options.jsonl, receivers) as output:
        for name in options.files:
            try:
                with options_for(options, name) as chosen:
                    _replay(name, chosen, output)
            except GcsHealthError as error:
                print(f"gcs-health: {error}", file=sys.stderr)
                code = BAD_INPUT
    if output.lost:
        return BAD_INPUT
    return ALERT if code == DONE and options.fail_on_alert and output.raised else code


def _replay(name: str, options: argparse.Namespace, output: Output) -> None:
    with open_log(name) as log, evidence_of(options, name) as (receivers, raw_tap):
        monitor = make_monitor(options, stamped=log.stamped, raw_tap=raw_tap)
        with output.joined_by(receivers):
            _feed(monitor, log, options, output)


def _feed(monitor: Monitor, log: Log, options: argparse.Namespace, output: Output) -> None:
    seen = output.vehicles
    if len(options.files) > 1:
        print(f"== {log.name}", file=output.text)
    for block in _with_progress(log):
        output.write(monitor.feed(block), at_once=False)
    output.write(monitor.finish(), at_once=False)
    if output.vehicles == seen:
        systems = ", ".join(f"{s.system}.{s.component} ({s.role})" for s in monitor.survey().systems)
        raise LogError(f"{log.name}: no vehicle in this log; it holds {systems or 'no checked frame'}")


def run_on_screen(options: argparse.Namespace, worker: "Worker", text: TextIO, notices: list[str]) -> int:
    """Replay one file on the dashboard's screen; what its events are wanted for is done to the flight's end."""
    from gcs_health.dashboard.player import play
    from gcs_health.dashboard.tape import Tape

    wanted = bool(options.jsonl or options.sink or options.evidence or options.fail_on_alert)
    wanted |= options.history != "none"
    name = options.files[0]
    receivers = [*history_of(options), *sinks_of(options, patient=True)]
    with (
        Output(options.jsonl, receivers, text=text, tell=notices.append) as output,
        options_for(options, name) as chosen,
        open_log(name) as log,
        evidence_of(options, name) as (more, raw_tap),
        output.joined_by(more),
    ):
        tape = Tape(b"".join(log.blocks()), log.stamped)

        def make(tap: Tap, raw_tap: "RawTap | None") -> Monitor:
            return make_monitor(chosen, stamped=log.stamped, raw_tap=raw_tap, tap=tap)

        def take(events: list[Event]) -> None:
            output.write(events, at_once=False)

        fore = play(worker, tape, make, name, take, raw_tap)
        if wanted and not fore.done:
            fore.halted = False
            fore.run()
    return ALERT if options.fail_on_alert and output.raised else DONE


def _with_progress(log: Log) -> Iterator[bytes]:
    """Yield the log's blocks; on a terminal a bar on standard error shows how far it is."""
    if not sys.stderr.isatty() or log.size is None:
        yield from log.blocks()
        return
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("replay", total=log.size)
        for block in log.blocks():
            yield block
            progress.advance(task, len(block))
