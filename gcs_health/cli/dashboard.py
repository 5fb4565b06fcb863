"""`live`, `demo` and `replay --dashboard` on a screen: the same sessions in a thread, a Textual app before them.

Nothing heavy is imported before the first picture is on the screen: what the pipeline needs loads in its thread.
"""

import argparse
import io
import sys

from gcs_health.cli import DONE, INTERRUPTED
from gcs_health.dashboard.app import Dashboard
from gcs_health.dashboard.interface import Worker
from gcs_health.dashboard.snapshot import LinkShot, Snapshot
from gcs_health.errors import ConfigError


class Session:
    """One session behind a screen: `job` runs in the worker's thread.

    Attributes
    ----------
    code : its exit code. text, notices : what is printed once the terminal is free again.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.code = DONE
        self.text = io.StringIO()
        self.notices: list[str] = []

    @property
    def names(self) -> tuple[str, ...]:
        """What is listened to, as the user spelled it."""
        if self.options.command == "demo":
            return (f"the demo's vehicle: {self.options.scenario}",)
        return tuple(self.options.endpoints if self.options.command == "live" else self.options.files)

    def job(self, worker: Worker) -> None:
        """Run the session."""
        if self.options.command == "replay":
            from gcs_health.cli.replay import run_on_screen

            self.code = run_on_screen(self.options, worker, self.text, self.notices)
            return
        from gcs_health.dashboard.watch import Watch

        watch = Watch(worker, self.text, self.notices, self.names)
        if self.options.command == "live":
            from gcs_health.cli.live import run as run_live

            self.code = run_live(self.options, watch)
        else:
            from gcs_health.cli.demo import run as run_demo

            self.code = run_demo(self.options, watch)


def run(options: argparse.Namespace) -> int:
    """Show the session; return its exit code once the operator or its end closed it."""
    if options.jsonl == "-":
        raise ConfigError("--jsonl -: the dashboard has standard output; name a file, or use --plain")
    if options.command == "replay" and len(options.files) > 1:
        raise ConfigError("--dashboard shows one flight at a time; name one file (a folder is one session)")
    if options.command == "replay" and options.files == ["-"]:
        raise ConfigError("--dashboard reads keys from standard input: name a file instead of -")
    if options.web is not None:
        from gcs_health.cli.web import serve

        return serve(options)
    session = Session(options)
    worker = Worker(session.job)
    app = Dashboard(
        worker,
        Snapshot(0, link=LinkShot(endpoints=session.names)),
        options.theme.replace("colour-blind", "colour_blind").replace("-", " ").replace("_", "-"),
        leaves=lambda: options.command == "live" and options.duration is not None,
    )
    try:
        app.run()
    finally:
        worker.stop()
    print(session.text.getvalue(), end="")
    for notice in session.notices:
        print(f"gcs-health: {notice}", file=sys.stderr)
    if worker.error is not None:
        raise worker.error
    return INTERRUPTED if app.interrupted else session.code
