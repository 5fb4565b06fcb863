"""`gcs-health download`: the logs that the autopilot keeps on board, listed or fetched through MAVSDK."""

import argparse
import sys
from pathlib import Path

from gcs_health.cli import DONE
from gcs_health.errors import ConfigError
from gcs_health.mavlink.mavsdk_logs import OnboardLog, OnboardLogs
from gcs_health.mavlink.spellings import parse_endpoint


def run(options: argparse.Namespace) -> int:
    """List what is on board; with `-o` fetch the newest, those named, or all."""
    if not options.output and (options.log or options.all):
        raise ConfigError("where to? -o DIR takes the logs")
    folder = Path(options.output) if options.output else None
    if folder is not None:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be a folder: {error.strerror}") from None
    with OnboardLogs(parse_endpoint(options.endpoint)) as logs:
        there = logs.list()
        if folder is None or not there:
            _print(there)
            return DONE
        for log in _chosen(there, options):
            _fetch(logs, log, folder)
    return DONE


def _print(logs: list[OnboardLog]) -> None:
    if not logs:
        print("MAVSDK tells of no logs on board")
    for log in logs:
        print(f"{log.id:5}  {log.date or 'no date':20}  {log.size:>12,} bytes")


def _chosen(there: list[OnboardLog], options: argparse.Namespace) -> list[OnboardLog]:
    """Return the logs that are asked for; without a word, the newest."""
    if options.all:
        return there
    if not options.log:
        return [max(there, key=lambda log: (log.date, log.id))]
    known = {log.id: log for log in there}
    for id in options.log:
        if id not in known:
            raise ConfigError(f"--log {id}: the vehicle has {', '.join(map(str, known))}")
    return [known[id] for id in dict.fromkeys(options.log)]


def _fetch(logs: OnboardLogs, log: OnboardLog, folder: Path) -> None:
    """Fetch one; a file that is there and as long is left as it is."""
    date = f"_{log.date.replace(':', '-')}" if log.date else ""
    path = folder / f"log_{log.id}{date}{logs.suffix}"
    if path.exists():
        if path.stat().st_size != log.size:
            raise ConfigError(f"{path}: is there, and not of the {log.size} bytes on board; move it away")
        print(f"{path}: is here already")
        return
    logs.fetch(log, path, lambda share: _progress(f"{path.name} {share:.0%}"))
    _progress("")
    print(f"{path}: {log.size:,} bytes", flush=True)


def _progress(what: str) -> None:
    if sys.stderr.isatty():
        print(f"\r{what:<50}\r", end="", file=sys.stderr, flush=True)
