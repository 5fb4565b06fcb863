"""`gcs-health export`: a flight's tables as Parquet and MCAP."""

import argparse
from pathlib import Path

from gcs_health.cli import DONE
from gcs_health.cli.monitoring import monitor_config
from gcs_health.export import write_mcap, write_parquet
from gcs_health.flight import replay


def run(options: argparse.Namespace) -> int:
    """Replay the flight and write what was asked for."""
    flight = replay(options.file, monitor_config(options))
    folder = Path(options.output)
    written = write_parquet(flight, folder) if options.format != "mcap" else []
    if options.format != "parquet":
        path = folder / "flight.mcap"
        write_mcap(flight, path)
        written.append(path)
    for path in written:
        print(path)
    return DONE
