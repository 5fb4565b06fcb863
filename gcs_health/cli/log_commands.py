"""The options of what is done with recorded flights, one or many: convert, export, report, fleet."""

import argparse
from collections.abc import Callable
from typing import Any


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
