"""`from gcs_health import replay`: the same answers as the command line, as columns."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import gcs_health
from gcs_health import Flight, MonitorConfig, replay
from gcs_health.cli import main
from gcs_health.errors import ConfigError, LogError
from gcs_health.flight import TABLES
from gcs_health.record.events import to_json

FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"


@pytest.fixture(scope="module")
def flight() -> Flight:
    return replay(FLIGHT, MonitorConfig(estimators=("effectiveness",)))


def test_importing_the_package_loads_nothing_heavy() -> None:
    code = (
        "import sys, gcs_health\n"
        "assert not {'numpy', 'pymavlink', 'textual'} & set(sys.modules)\n"
        "assert 'replay' in dir(gcs_health)\n"
        "from gcs_health import replay, Monitor\n"
        "assert callable(replay) and not {'pandas', 'pyarrow', 'plotly', 'dask'} & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr


def test_an_unknown_name_is_no_attribute() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        gcs_health.nothing  # noqa: B018


def test_the_estimates_are_those_of_the_command_line(flight: Flight, tmp_path: Path) -> None:
    out = tmp_path / "events.jsonl"
    assert main(["replay", str(FLIGHT), "--estimators", "effectiveness", "--jsonl", str(out)]) == 0
    lines = [json.loads(line) for line in out.read_text().splitlines()]
    told = [line for line in lines if line["type"] == "estimate"]
    columns = flight.columns("estimates")
    for name in ("t", "t_unix_us", "motor", "estimator", "quantity", "status"):
        assert columns[name].tolist() == [line[name] for line in told]
    values = [math.nan if line["value"] is None else line["value"] for line in told]
    np.testing.assert_array_equal(columns["value"], values)
    assert len(flight.events) == len(lines) - len(told)


def test_the_flight_knows_its_outcome(flight: Flight) -> None:
    assert flight.outcome == "findings"
    assert flight.vehicles == ("1.1",)
    assert [(a.code, a.motor, a.state) for a in flight.alerts] == [
        ("ROTOR_FAILED", 3, "raised"),
        ("PROPELLER_LOST", 3, "escalated"),
    ]


def test_a_flight_of_which_too_little_is_known_is_not_called_healthy(tmp_path: Path) -> None:
    short = tmp_path / "short.tlog"
    short.write_bytes(FLIGHT.read_bytes()[:6_000])
    assert replay(short).outcome == "not judged"


def test_every_table_has_columns_of_one_length(flight: Flight) -> None:
    for table in TABLES:
        lengths = {len(column) for column in flight.columns(table).values()}
        assert len(lengths) == 1, table
    rotors, imu = flight.columns("rotors"), flight.columns("imu")
    assert rotors["speed_3"].dtype == float
    assert 300.0 < np.nanmedian(rotors["speed_3"]) < 1200.0
    assert -12.0 < np.median(imu["az"]) < -8.0
    assert flight.columns("autopilot")["t"].dtype == float  # empty here, and still numbers


def test_a_table_becomes_a_data_frame(flight: Flight) -> None:
    frame = flight.frame("results")
    assert set(frame["motor"]) == {1, 2, 3, 4}
    assert frame["value"].dtype == float


def test_thinned_estimates_leave_the_verdicts_as_they_are(flight: Flight) -> None:
    thin = replay(FLIGHT, MonitorConfig(estimators=("effectiveness",)), readings=False, estimates_every=2.0)
    assert list(map(to_json, thin.events)) == list(map(to_json, flight.events))
    assert 4 < len(thin.estimates["t"]) < len(flight.estimates["t"]) / 10
    with pytest.raises(ConfigError, match=r"no vehicle 9\.9"):
        flight.columns("imu", "9.9")
    with pytest.raises(ConfigError, match="expected a table of"):
        flight.columns("nothing")


def test_a_log_without_a_vehicle_is_an_error(tmp_path: Path) -> None:
    empty = tmp_path / "empty.tlog"
    empty.write_bytes(b"")
    with pytest.raises(LogError, match="empty"):
        replay(empty)
