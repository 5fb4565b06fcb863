"""`gcs-health history`: what the flights so far said of each rotor, where it leads, whether a repair helped."""

import argparse
import csv
import json
import math
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

from gcs_health.cli import DONE
from gcs_health.cli.history_text import days_text, vehicle_text
from gcs_health.errors import ConfigError
from gcs_health.mavlink.endpoints import now_us
from gcs_health.record.events import plain
from gcs_health.record.history import History, MarkRow, default_url
from gcs_health.record.history_keeper import StoreError
from gcs_health.record.vehicle_history import VehicleHistory

SCHEMA = "gcs_health.history/1"
FLIGHT_COLUMNS = ("vehicle", "name", "flight", "started_us", "motor", "estimator", "quantity")
RESULT_COLUMNS = (
    "value",
    "std",
    "spread",
    "samples",
    "valid",
    "status",
    "worst",
    "worst_probability",
    "balance_quality",
)


def run(options: argparse.Namespace) -> int:
    """Show the store, or one vehicle in it; or note a repair."""
    words = list(options.words)
    marking = words[:1] == ["mark"]
    vehicle = words[marking:]
    if len(vehicle) > 1 or (marking and not vehicle):
        raise ConfigError(
            f"history: expected {'mark and ' * marking}one vehicle, got {' '.join(vehicle) or 'none'}; "
            "quote a name with spaces"
        )
    limits = dict(_limit(text) for text in options.limit)
    try:
        history = History(options.history or default_url())
        try:
            if marking:
                _mark(history, history.find(vehicle[0]), options)
            else:
                found = [history.find(vehicle[0])] if vehicle else history.vehicles()
                _show(history, found, options, limits)
        finally:
            history.close()
    except StoreError as error:
        raise ConfigError(str(error)) from None
    return DONE


def _mark(history: History, vehicle: dict[str, Any], options: argparse.Namespace) -> None:
    if options.rotor is None or not options.what:
        raise ConfigError("history mark: expected --rotor N and --propeller-changed or --repair TEXT")
    at = _time(options.at) if options.at else now_us()
    history.mark(vehicle["vehicle"], MarkRow(options.rotor, at, options.what))
    print(
        f"{vehicle['vehicle']}: motor {options.rotor}: {options.what}, {days_text(at)}; a new baseline begins. "
        f"After two flights or more, gcs-health history {json.dumps(vehicle['vehicle'])} says whether it helped."
    )


def _show(
    history: History, vehicles: list[dict[str, Any]], options: argparse.Namespace, limits: dict[str, float]
) -> None:
    told = [VehicleHistory.of(history, vehicle, options.rotor, limits) for vehicle in vehicles]
    if options.format == "json":
        told_plain = [plain(each.as_object()) for each in told]
        print(json.dumps({"schema": SCHEMA, "vehicles": told_plain}, ensure_ascii=False, allow_nan=False))
    elif options.format == "csv":
        out = csv.writer(sys.stdout, lineterminator="\n")
        out.writerow((*FLIGHT_COLUMNS, *RESULT_COLUMNS))
        out.writerows(row for each in told for row in _csv_rows(each))
    elif told:
        print("\n".join(vehicle_text(each, brief=not options.words) for each in told), end="")
    else:
        print(f"no flight yet in {history.name}")


def _csv_rows(told: VehicleHistory) -> Iterator[list[object]]:
    for row in told.results:
        head = [told.vehicle["vehicle"], told.vehicle["name"]]
        values = [getattr(row, name) for name in (*FLIGHT_COLUMNS[2:], *RESULT_COLUMNS)]
        yield head + ["" if isinstance(v, float) and math.isnan(v) else v for v in values]


def _limit(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name, float(value)
    except ValueError:
        raise ConfigError(f"--limit {text}: expected QUANTITY=VALUE, as unbalance=2e-6") from None


def _time(text: str) -> int:
    try:
        return int(datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp() * 1e6)
    except ValueError:
        raise ConfigError(f"--at {text}: expected a date like 2026-05-04 or 2026-05-04T10:15") from None
