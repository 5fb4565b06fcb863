"""An alert that names no rotor, on its way out: null in the events, and what stands for it where null cannot."""

import json
import math
from pathlib import Path

import jsonschema

from gcs_health.dashboard.alerts_model import EntryBook
from gcs_health.dashboard.snapshot import Snapshot, VehicleShot
from gcs_health.dashboard.view.top import banner
from gcs_health.flight_columns import event_columns
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.record.events import AlertEvent, SummaryEvent, to_json
from gcs_health.record.flight_results import FlightRecord
from gcs_health.record.history import History
from gcs_health.report.flight_page import _states
from gcs_health.sinks.mavlink_out import rotor_alert

SCHEMA = Path(__file__).parents[2] / "docs" / "reference" / "events.schema.json"
TEXT = "a propeller is unbalanced, which one cannot be told, 96 % sure"
ALERT = AlertEvent(
    9.0, 1, "1.1", "1.1-1", "PROPELLER_UNBALANCED", None, None, "raised", 4, 0.96, TEXT,
    {"unbalance.one_of_motors": "1 3"},
)  # fmt: skip


def test_a_line_has_null_and_the_schema_takes_it() -> None:
    line = json.loads(to_json(ALERT))
    assert (line["rotor"], line["motor"]) == (None, None)
    schema = json.loads(SCHEMA.read_text("utf-8"))
    jsonschema.Draft202012Validator(schema).validate(line)


def test_by_mavlink_it_is_motor_0_without_an_esc() -> None:
    dialect = default_dialect()
    raw = rotor_alert(Encoder(dialect, 1), ALERT._replace(rotor=2, motor=3))
    unnamed = rotor_alert(Encoder(dialect, 1), ALERT)
    differing = [(a, b) for a, b in zip(raw[10:-2], unnamed[10:-2], strict=True) if a != b]
    assert differing == [(3, 0), (2, 255)]


def test_the_history_keeps_it_as_motor_0_and_columns_as_nan(tmp_path: Path) -> None:
    store = History(str(tmp_path / "h.sqlite"))
    store.store(FlightRecord("1.1", None, "", 12, 2, 1, 0.0, 9.0, (), (ALERT,)))
    assert [row["motor"] for row in store.alerts("1.1")] == [0]
    store.close()
    assert math.isnan(event_columns([ALERT], AlertEvent)["motor"][0])


def test_screen_and_report_blame_no_motor() -> None:
    book = EntryBook()
    book.alert(ALERT)
    vehicle = VehicleShot("1.1", "", "", True, False, 9.0, 1, 0.0, 0.0, ())
    said = "".join(text for text, _ in banner(Snapshot(1, (vehicle,), book.shots({})), vehicle, 100))
    assert "PROPELLER UNBALANCED" in said
    assert "one of the motors" in said
    gaps = {"count": 0, "longest": 0.0, "total": 0.0}
    summary = SummaryEvent(9.0, 1, "1.1", 9.0, {}, gaps, {}, (), (), ())  # type: ignore[arg-type]
    assert _states(summary, [ALERT]) == {}
