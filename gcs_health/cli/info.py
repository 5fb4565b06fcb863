"""`gcs-health info`: what is in a log, per system, and what the estimators would need."""

import argparse
import dataclasses
import json
import sys

from gcs_health.cli import BAD_INPUT, DONE
from gcs_health.cli.text import survey_text
from gcs_health.errors import GcsHealthError
from gcs_health.mavlink.tlog import open_log
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import plain
from gcs_health.vehicle_file import load_vehicle


def run(options: argparse.Namespace) -> int:
    """Survey every file; an unreadable one is told and the rest still done."""
    code = DONE
    airframe = load_vehicle(options.vehicle) if options.vehicle else None
    for name in options.files:
        try:
            with open_log(name) as log:
                monitor = Monitor(MonitorConfig(airframe=airframe, stamped=log.stamped))
                for block in log.blocks():
                    monitor.feed(block)
                monitor.finish()
        except GcsHealthError as error:
            print(f"gcs-health: {error}", file=sys.stderr)
            code = BAD_INPUT
            continue
        survey = monitor.survey()
        if options.json:
            print(json.dumps({"file": name, "survey": plain(dataclasses.asdict(survey))}, allow_nan=False))
        else:
            print(survey_text(log.name, survey))
    return code
