"""`--web`: the dashboard in a browser on this computer, through textual-serve."""

import argparse
import shlex
import sys

from gcs_health.cli import DONE
from gcs_health.errors import ConfigError

HOST = "127.0.0.1"  # nobody else's computer


def serve(options: argparse.Namespace) -> int:
    """Serve until interrupted; every page that is opened is a session of its own.

    Raises
    ------
    ConfigError : textual-serve is not installed.
    """
    try:
        from textual_serve.server import Server
    except ImportError:
        raise ConfigError("--web needs textual-serve: pip install 'gcs-health[web]'") from None
    server = Server(command(sys.argv[1:]), host=HOST, port=options.web, title="gcs_health")
    server.serve()
    return DONE


def command(arguments: list[str]) -> str:
    """Return the command of one session: what was asked for, without `--web`, on the screen it is given."""
    kept: list[str] = []
    skip = False
    for k, argument in enumerate(arguments):
        if skip:
            skip = False
        elif argument == "--web":
            skip = arguments[k + 1 : k + 2] != [] and arguments[k + 1].isdigit()
        elif not argument.startswith("--web="):
            kept.append(argument)
    return shlex.join([sys.executable, "-m", "gcs_health", *kept, "--dashboard"])
