"""`gcs-health report`: one flight as a self-contained page, and on paper where chromium is there."""

import argparse
from pathlib import Path

from gcs_health.cli import DONE
from gcs_health.cli.monitoring import monitor_config
from gcs_health.cli.receivers import options_for
from gcs_health.flight import replay
from gcs_health.report.flight_page import flight_page
from gcs_health.report.page import print_to_pdf, write


def run(options: argparse.Namespace) -> int:
    """Replay the flight and write its page."""
    page = Path(options.output)
    with options_for(options, options.file) as chosen:
        flight = replay(options.file, monitor_config(chosen))
    write(page, flight_page(flight))
    print(page)
    if options.pdf:
        pdf = page.with_suffix(".pdf")
        print_to_pdf(page, pdf)
        print(pdf)
    return DONE
