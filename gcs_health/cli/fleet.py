"""`gcs-health fleet`: many logs through the monitor, in parallel, into tables; and a page about them."""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from time import monotonic

from gcs_health.cli import ALERT, BAD_INPUT, DONE
from gcs_health.cli.monitoring import monitor_config
from gcs_health.engine import Done, each
from gcs_health.errors import ConfigError
from gcs_health.fleet import OUTCOMES, UNUSABLE, Analysed, Job, analyse, find_logs
from gcs_health.fleet_store import FleetStore
from gcs_health.flight import FINDINGS, NOT_JUDGED
from gcs_health.record.history import History

TOLD_MOST = 40  # logs with findings, or without use, that are named at the end
WRITE_EVERY = 30.0  # s: so much is done again if this process is killed
REPORT = "report"


def run(options: argparse.Namespace) -> int:
    """Do the logs that are not done yet, or write the fleet's page."""
    if options.places[0] == REPORT:
        return _report(options)
    jobs = find_logs(options.places, monitor_config(options), by_folder=options.aircraft == "folder")
    store = FleetStore(Path(options.output))
    done = store.done()
    todo = [job for job in jobs if options.redo or done.get(job.log) != job.key]
    store.forget(job.log for job in todo if job.log in done)
    history = History(options.history or str(Path(options.output) / "history.sqlite"))
    try:
        ended = each(analyse, todo, workers=options.workers, scheduler=options.scheduler)
        written = monotonic()
        for one in with_progress(ended, len(todo)):
            result = _result(one)
            for record in result.records:
                history.store(record)
            store.add(result)
            if monotonic() - written > WRITE_EVERY:
                store.flush()
                written = monotonic()
    finally:  # what was done before an interruption stays done
        store.flush()
        history.close()
    return _tell(store, {job.log for job in jobs}, len(jobs) - len(todo))


def _report(options: argparse.Namespace) -> int:
    from gcs_health.report.fleet_page import fleet_page
    from gcs_health.report.page import write

    if len(options.places) != 2:
        raise ConfigError("fleet report: expected one folder, as in: fleet report OUT -o fleet.html")
    folder = Path(options.places[1])
    if not (folder / "flights").is_dir():
        raise ConfigError(
            f"{folder}: no fleet's results there; make them with: gcs-health fleet LOGS -o {folder}"
        )
    write(Path(options.output), fleet_page(FleetStore(folder)))
    print(options.output)
    return DONE


def _result(one: Done) -> Analysed:
    if not one.error:
        assert isinstance(one.result, Analysed)
        return one.result
    job: Job = one.item
    row = {"log": job.log, "key": job.key, "size": job.size, "outcome": UNUSABLE, "error": one.error}
    return Analysed([row], [], [], [])


def with_progress(ended: Iterable[Done], total: int) -> Iterator[Done]:
    """Pass on what ends; on a terminal a bar on standard error shows how far it is."""
    if not sys.stderr.isatty() or not total:
        yield from ended
        return
    from rich.console import Console
    from rich.progress import MofNCompleteColumn, Progress, TimeRemainingColumn

    columns = (*Progress.get_default_columns()[:2], MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("fleet", total=total)
        for one in ended:
            yield one
            progress.advance(task)


def _tell(store: FleetStore, logs: set[str], before: int) -> int:
    """Print the outcomes of the logs that were asked for; return the exit code."""
    rows = store.read("flights", ["log", "outcome", "error", "why", "aircraft"])
    told: dict[str, tuple[str, str]] = {}
    for log, outcome, error, why, aircraft in zip(*rows.values(), strict=True):
        if log in logs:
            told[log] = (outcome, error or why or aircraft or "")
    counts = Counter(outcome for outcome, _ in told.values())
    for outcome in OUTCOMES:
        print(f"{counts[outcome]:>8}  {outcome}")
    if before:
        print(f"{before:>8}  of them done before")
    for wanted in (FINDINGS, UNUSABLE, NOT_JUDGED):
        named = sorted(log for log, (outcome, _) in told.items() if outcome == wanted)
        for log in named[:TOLD_MOST]:
            print(f"{wanted:<12}{log}  {told[log][1]}".rstrip())
        if len(named) > TOLD_MOST:
            print(f"{wanted:<12}and {len(named) - TOLD_MOST} more, see {store.folder}")
    if counts[FINDINGS]:
        return ALERT
    return BAD_INPUT if counts[UNUSABLE] or counts[NOT_JUDGED] else DONE
