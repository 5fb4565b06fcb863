"""The options of what is done with recorded flights, one or many: convert, export, report, fleet."""

import argparse
from collections.abc import Callable
from typing import Any

from gcs_health.cli import argument_types


def add_log_commands(commands: Any, config_options: Callable[[argparse.ArgumentParser], None]) -> None:
    """Add the commands; `config_options` adds those options that decide what is said of given bytes."""
    convert = commands.add_parser("convert", help="a log of any format that is read, into another")
    convert.add_argument(
        "file", metavar="FROM", help=".ulg, .bin, .tlog, raw MAVLink; .gz, .xz, .zst of them"
    )
    convert.add_argument("output", metavar="TO", help=".tlog, .tlog.gz, .tlog.xz; .rlog without stamps")

    export = commands.add_parser("export", help="a flight as tables: Parquet, or MCAP for Foxglove")
    export.add_argument("file", metavar="FLIGHT")
    export.add_argument("-o", "--output", required=True, metavar="DIR")
    export.add_argument("--format", choices=("parquet", "mcap", "both"), default="both", help="default both")
    config_options(export)

    report = commands.add_parser("report", help="a flight as one page that opens anywhere")
    report.add_argument("file", metavar="FLIGHT")
    report.add_argument("-o", "--output", required=True, metavar="FLIGHT.html")
    report.add_argument("--pdf", action="store_true", help="print it too, beside it; needs chromium")
    config_options(report)

    fleet = commands.add_parser("fleet", help="many logs, in parallel, into tables; and a page about them")
    fleet.add_argument(
        "places",
        nargs="+",
        metavar="LOG_OR_DIR",
        help="logs, folders of them, URLs; or: report OUT, for a page about what was done into OUT",
    )
    fleet.add_argument("-o", "--output", required=True, metavar="OUT", help="folder; of report, the page")
    _engine_options(fleet)
    fleet.add_argument(
        "--aircraft",
        choices=("log", "folder"),
        default="log",
        help="whose a log is: as it says itself (the autopilot's uid), or the folder that it lies in",
    )
    fleet.add_argument("--redo", action="store_true", help="do again what is done")
    fleet.add_argument(
        "--history", metavar="URL", help="where each flight's results are kept (default OUT/history.sqlite)"
    )
    config_options(fleet)

    campaign = commands.add_parser("campaign", help="many seeds of a scenario, to rates with intervals")
    campaign.add_argument("scenario", metavar="SCENARIO", help="as of simulate")
    campaign.add_argument(
        "--seeds", type=argument_types.seeds, default=(1, 20), metavar="A-B", help="default 1-20"
    )
    campaign.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="change a value, as in wind.speed=5"
    )
    campaign.add_argument("--jsonl", metavar="OUT", help="write a line a flight; - is standard output")
    _engine_options(campaign)
    config_options(campaign)


def _engine_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--workers",
        type=argument_types.count,
        metavar="N",
        help="processes (default: this machine's cores; 1 = no other)",
    )
    parser.add_argument("--scheduler", metavar="tcp://HOST:PORT", help="a Dask cluster does the work")
