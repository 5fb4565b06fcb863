"""The command line: parse, call, print; one file a command. Nothing heavy is imported before it is needed.

Exit codes: 0 done, 1 our bug, 2 bad usage or unreadable input, 3 alert raised with --fail-on-alert,
130 interrupted.
"""

import argparse
import gc
import os
import sys
from collections.abc import Sequence
from importlib import import_module

from gcs_health import __version__
from gcs_health.cli import argument_types
from gcs_health.cli.log_commands import add_log_commands
from gcs_health.errors import GcsHealthError
from gcs_health.estimators import REGISTRY

DONE, BUG, BAD_INPUT, ALERT, INTERRUPTED = 0, 1, 2, 3, 130

_DESCRIPTION = """\
Says, rotor by rotor, what is wrong with a multirotor, from its MAVLink.

examples:
  gcs-health replay flight.tlog
  gcs-health replay flight.tlog --vehicle quad.toml --jsonl events.jsonl
  gcs-health live udpin://0.0.0.0:14550 --record flight.tlog
  gcs-health info flight.tlog
  gcs-health demo
  gcs-health simulate lost_propeller -o flight.tlog
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return its exit code. The only catcher of `GcsHealthError`."""
    arguments = _parser().parse_args(argv)
    command = import_module(f"gcs_health.cli.{'dashboard' if _on_screen(arguments) else arguments.command}")
    # samples come by the hundred thousand and never form cycles: looking for some among them at every
    # 700th costs a fifth of decoding (benchmarks/decode.py)
    gc.set_threshold(100_000, 20, 20)
    try:
        code: int = command.run(arguments)
        sys.stdout.flush()
        return code
    except GcsHealthError as error:
        print(f"gcs-health: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # whoever read our output has had enough; Python would complain again when it flushes at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE


def _on_screen(options: argparse.Namespace) -> bool:
    """Whether a dashboard is wanted: asked for, or `live` and `demo` on a terminal that can show one."""
    if options.command not in ("live", "demo", "replay"):
        return False
    if options.dashboard or options.web is not None:
        return True
    if options.command == "replay" or options.plain or options.jsonl == "-":
        return False
    return sys.stdin.isatty() and sys.stdout.isatty() and os.environ.get("TERM", "dumb") != "dumb"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="gcs-health",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"gcs-health {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    replay = commands.add_parser("replay", help="run recorded flights through the monitor")
    replay.add_argument(
        "files", nargs="+", metavar="FILE", help="a .tlog or raw MAVLink; - is standard input"
    )
    _monitor_options(replay)
    replay.add_argument(
        "--sweep",
        action="store_true",
        help="replay under other phases, losses, rates and jitter: which verdicts hold, and which are luck",
    )
    replay.add_argument(
        "--history",
        default="none",
        metavar="URL",
        help="keep each flight's results: default, a file, postgresql://... (default none)",
    )

    _screen_options(replay)

    live = commands.add_parser("live", help="listen to a vehicle; sends nothing unless asked to")
    live.add_argument(
        "endpoints",
        nargs="+",
        metavar="ENDPOINT",
        help="udpin://HOST:PORT, udpout://HOST:PORT, tcpout://HOST:PORT, tcpin://HOST:PORT, "
        "serial://DEVICE:BAUD, file://PATH, or as mavutil spells them",
    )
    _monitor_options(live)
    live.add_argument(
        "--record",
        metavar="WHERE",
        help="record what is received, a file a flight: FILE.tlog, FILE-2.tlog ..., or into a folder",
    )
    live.add_argument(
        "--request-rates",
        action="store_true",
        help="ask the vehicle for the message rates that the estimators need (this transmits)",
    )
    live.add_argument(
        "--backend",
        choices=("direct", "mavsdk"),
        default="direct",
        help="mavsdk: through MAVSDK, which sends heartbeats of its own; direct (default) only listens",
    )
    live.add_argument(
        "--history",
        default="default",
        metavar="URL",
        help="where each flight's results are kept: none, a file, postgresql://...; default: a file in the "
        "user's data folder",
    )
    live.add_argument(
        "--duration", type=argument_types.positive, metavar="S", help="stop after so many seconds"
    )
    _screen_options(live)

    download = commands.add_parser(
        "download", help="the logs that the autopilot keeps on board, through MAVSDK (this transmits)"
    )
    download.add_argument("endpoint", metavar="ENDPOINT", help="as of live; no file")
    download.add_argument("-o", "--output", metavar="DIR", help="fetch into this folder; without it, list")
    download.add_argument(
        "--log",
        action="append",
        type=argument_types.log,
        metavar="ID",
        help="this one (default the newest); repeatable",
    )
    download.add_argument("--all", action="store_true", help="every log")

    info = commands.add_parser("info", help="what is in a log, and what the estimators would need")
    info.add_argument("files", nargs="+", metavar="FILE", help="a .tlog or raw MAVLink; - is standard input")
    info.add_argument("--vehicle", metavar="FILE.toml", help="the vehicle's geometry")
    info.add_argument("--json", action="store_true", help="print one JSON object a file")

    simulate = commands.add_parser("simulate", help="fly a scenario into a log, or live over a link")
    simulate.add_argument(
        "scenario", nargs="?", metavar="SCENARIO", help="a .toml file, or the name of a shipped one (--list)"
    )
    _scenario_options(simulate)
    simulate.add_argument("--list", action="store_true", help="the shipped scenarios, one a line")
    simulate.add_argument("-o", "--output", metavar="FLIGHT.tlog", help="write a log, its truth beside it")
    simulate.add_argument("--to", metavar="ENDPOINT", help="fly live, as to udpout:127.0.0.1:14550")
    simulate.add_argument(
        "--skip",
        type=argument_types.not_negative,
        default=0.0,
        metavar="S",
        help="leave out the first seconds",
    )
    simulate.add_argument(
        "--signals", metavar="OUT.npz", help="with -o: also what MAVLink does not carry (boom tips)"
    )

    graft = commands.add_parser("graft", help="put a fault into a recorded healthy flight")
    graft.add_argument("file", metavar="HEALTHY.tlog")
    graft.add_argument(
        "--fault",
        action="append",
        required=True,
        metavar="FAULT",
        help='as in "rotor=3 effectiveness=0.6 at=120"; rotor: the motor as the autopilot counts, from 1; at, until: '
        "seconds after the log's first datum; effectiveness: what is left, from 0.3; or unbalance=GMM (g mm), "
        "drag=FACTOR, telemetry=lost|frozen, telemetry=swapped with=M; ramp=S grows it slowly",
    )
    graft.add_argument("-o", "--output", required=True, metavar="FAULTY.tlog")
    graft.add_argument("--vehicle", metavar="FILE.toml", help="the vehicle's geometry, before its parameters")

    calibrate = commands.add_parser(
        "calibrate", help="from healthy flights, a vehicle file with what the estimators need"
    )
    calibrate.add_argument("files", nargs="+", metavar="HEALTHY.tlog", help="of one vehicle, without faults")
    calibrate.add_argument("-o", "--output", required=True, metavar="VEHICLE.toml")
    calibrate.add_argument(
        "--vehicle", metavar="FILE.toml", help="the vehicle's geometry, before its parameters"
    )
    calibrate.add_argument(
        "--false-alarms",
        type=argument_types.positive,
        default=0.1,
        metavar="PER_HOUR",
        help="of the vibration's alarms that are bearable (default: 0.1, one in ten hours)",
    )

    train = commands.add_parser(
        "train", help="from flights of known degradation, a model of the vehicle's vibration"
    )
    train.add_argument(
        "files",
        nargs="+",
        metavar="FLIGHT.tlog",
        help="of one kind of vehicle, a FLIGHT.truth.json beside each",
    )
    train.add_argument("-o", "--output", required=True, metavar="MODEL.npz")
    train.add_argument("--vehicle", metavar="FILE.toml", help="the vehicle's geometry, before its parameters")
    train.add_argument("--regime", default="unnamed", help="how and in what air they were flown, in words")
    train.add_argument(
        "--channels",
        type=argument_types.channels,
        default=argument_types.AXES,
        metavar="az,p,q",
        help="signals of the IMU, of ax,ay,az,p,q,r (default: all)",
    )

    detect = commands.add_parser("detectability", help="which faults would be found on this airframe")
    detect.add_argument("files", nargs="+", metavar="HEALTHY.tlog")
    detect.add_argument(
        "--vehicle", metavar="FILE.toml", help="the vehicle's geometry, before its parameters"
    )
    detect.add_argument(
        "--trials",
        type=argument_types.count,
        default=8,
        metavar="N",
        help="moments at which every motor fails (default 8)",
    )
    detect.add_argument(
        "--only",
        action="append",
        choices=("effectiveness", "unbalance", "drag", "telemetry"),
        help="this fault alone; may be repeated. Unbalance and drag take longest",
    )
    detect.add_argument(
        "--seed", type=argument_types.count, default=1, help="of the moments drawn (default 1)"
    )
    detect.add_argument("--jsonl", metavar="OUT", help="write the table as JSON lines; - is standard output")

    config = commands.add_parser(
        "config", help="the alert rules that hold, each with its source; thresholds from healthy flights"
    )
    _config_option(config)
    config.add_argument(
        "--of",
        action="append",
        metavar="VEHICLE",
        help="as they hold for this vehicle: its name, sysid.compid or uid; repeatable, the last the strongest",
    )
    config.add_argument("--json", action="store_true", help="print one JSON object")
    config.add_argument(
        "--fit", nargs="+", default=[], metavar="HEALTHY.tlog", help="fit thresholds to these healthy flights"
    )
    config.add_argument("-o", "--output", metavar="CONFIG.toml", help="with --fit: write them")
    config.add_argument("--vehicle", metavar="FILE.toml", help="with --fit: the vehicle's geometry")

    history = commands.add_parser(
        "history", help="what the flights so far said of each rotor, and where it leads"
    )
    history.add_argument(
        "words", nargs="*", metavar="[mark] VEHICLE", help="mark: note a repair of it, a new baseline begins"
    )
    history.add_argument(
        "--history", metavar="URL", help="the store, if not the one in the user's data folder"
    )
    history.add_argument("--format", choices=("text", "csv", "json"), default="text")
    history.add_argument(
        "--rotor", type=argument_types.count, metavar="N", help="the motor as the autopilot counts, from 1"
    )
    history.add_argument(
        "--propeller-changed", dest="what", action="store_const", const="propeller changed", help="with mark"
    )
    history.add_argument(
        "--repair", dest="what", metavar="TEXT", help="with mark: any other repair, in words"
    )
    history.add_argument(
        "--at", metavar="WHEN", help="with mark: 2026-05-04 or 2026-05-04T10:15, UTC; default now"
    )
    history.add_argument(
        "--limit",
        action="append",
        default=[],
        metavar="QUANTITY=VALUE",
        help="at which maintenance is due, SI; default: unbalance twice, drag 1.5 times its first value",
    )

    demo = commands.add_parser("demo", help="a simulated vehicle loses a propeller before your eyes")
    demo.add_argument(
        "scenario", nargs="?", default="demo", metavar="SCENARIO", help="another flight to show"
    )
    _scenario_options(demo)
    _monitor_options(demo)
    _screen_options(demo)
    add_log_commands(commands, _config_options)
    return parser


def _screen_options(parser: argparse.ArgumentParser) -> None:
    if not parser.prog.endswith("replay"):
        parser.add_argument("--plain", action="store_true", help="lines of text instead of the dashboard")
    parser.add_argument(
        "--dashboard", action="store_true", help="the dashboard; default of live and demo on a terminal"
    )
    parser.add_argument(
        "--theme",
        choices=("dark", "light", "high-contrast", "colour-blind", "no-colour"),
        default="dark",
        help="of the dashboard; NO_COLOR is obeyed",
    )
    parser.add_argument(
        "--web",
        nargs="?",
        type=argument_types.port,
        const=8000,
        metavar="PORT",
        help="the dashboard in a browser on this computer (default port 8000)",
    )


def _scenario_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change a value, as in wind.speed=5"
    )
    parser.add_argument(
        "--speed",
        type=argument_types.positive,
        default=1.0,
        metavar="X",
        help="times real time, when live (default 1)",
    )


def _config_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--config",
        metavar="FILE.toml",
        help="alert rules and budgets; none = the catalogue's; default config.toml in the user's settings folder",
    )


def _config_options(parser: argparse.ArgumentParser) -> None:
    """What decides what is said of given bytes."""
    _config_option(parser)
    parser.add_argument(
        "--vehicle", metavar="FILE.toml", help="the vehicle's geometry, before its parameters"
    )
    parser.add_argument(
        "--mode",
        choices=("recommended", "paper"),
        default="recommended",
        help="of the estimators; paper: each as its authors published it",
    )
    parser.add_argument(
        "--estimators",
        type=argument_types.estimators,
        default=tuple(REGISTRY),
        metavar="NAME,...",
        help=f"which to run, of {', '.join(REGISTRY)} (default all)",
    )
    parser.add_argument(
        "--estimate-rate",
        type=argument_types.rate,
        default=10.0,
        metavar="HZ",
        help="at most so many estimates a second and rotor, up to 10 (default)",
    )
    parser.add_argument(
        "--signing-key", metavar="FILE", help="32 bytes, or 64 hex digits: verify signed frames with it"
    )


def _monitor_options(parser: argparse.ArgumentParser) -> None:
    _config_options(parser)
    parser.add_argument("--jsonl", metavar="OUT", help="write events as JSON lines; - is standard output")
    parser.add_argument(
        "--sink",
        action="append",
        default=[],
        metavar="SPEC",
        help="send alerts on, as often as wanted: bell, jsonl:FILE, command:ARGV, syslog[:ADDRESS], mqtt://HOST, "
        "prometheus:PORT, apprise:URL, mavlink:ENDPOINT (transmits)",
    )
    parser.add_argument(
        "--evidence", metavar="FOLDER", help="save what each alert rests on as a .zip that can be replayed"
    )
    parser.add_argument("--fail-on-alert", action="store_true", help="exit with 3 if an alert was raised")
