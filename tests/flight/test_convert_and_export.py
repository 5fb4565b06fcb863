"""`gcs-health convert` and `gcs-health export`."""

import json
from pathlib import Path

import numpy as np
import pytest
from log_writers import as_ulog, samples_of
from mcap.reader import make_reader
from pyarrow import parquet

from gcs_health.cli import main
from gcs_health.flight import TABLES
from gcs_health.mavlink.tlog import open_log

FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"


def bytes_of(path: Path) -> bytes:
    with open_log(str(path)) as log:
        return b"".join(log.blocks())


def test_a_ulog_becomes_a_tlog_that_replays_alike(tmp_path: Path) -> None:
    ulg, tlog = tmp_path / "flight.ulg", tmp_path / "flight.tlog"
    ulg.write_bytes(as_ulog(samples_of(FLIGHT.read_bytes())))
    assert main(["convert", str(ulg), str(tlog)]) == 0
    assert tlog.read_bytes() == bytes_of(ulg)
    packed = tmp_path / "flight.tlog.xz"
    assert main(["convert", str(tlog), str(packed)]) == 0
    assert packed.stat().st_size < tlog.stat().st_size
    assert bytes_of(packed) == tlog.read_bytes()


def test_a_tlog_becomes_raw_but_not_the_other_way(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    raw = tmp_path / "flight.rlog"
    assert main(["convert", str(FLIGHT), str(raw)]) == 0
    with open_log(str(raw)) as log:
        assert not log.stamped
    assert len(raw.read_bytes()) == FLIGHT.stat().st_size - 8 * len(samples_of(FLIGHT.read_bytes()))
    capsys.readouterr()
    assert main(["convert", str(raw), str(tmp_path / "back.tlog")]) == 2
    assert main(["convert", str(raw), str(tmp_path / "flight.csv")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert "no receive stamps" in lines[0]
    assert ".tlog, .rlog or .raw" in lines[1]


def test_export_writes_every_table_and_an_mcap(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    assert main(["export", str(FLIGHT), "-o", str(out), "--estimators", "effectiveness"]) == 0
    assert len(capsys.readouterr().out.splitlines()) == len(TABLES) + 1
    alerts = parquet.read_table(out / "alerts.parquet").to_pydict()
    assert (alerts["code"], alerts["motor"]) == (["ROTOR_FAILED", "PROPELLER_LOST"], [3, 3])
    imu = parquet.read_table(out / "imu.parquet")
    assert imu.schema.metadata[b"schema"] == b"gcs_health.tables/1"
    assert -12.0 < np.median(imu["az"]) < -8.0
    with (out / "flight.mcap").open("rb") as file:
        messages = [
            (channel.topic, schema.name, json.loads(message.data))
            for schema, channel, message in make_reader(file).iter_messages()
        ]
    steps = [row for topic, _, row in messages if topic == "/1.1/alerts"]
    assert [(step["state"], step["motor"]) for step in steps] == [("raised", 3), ("escalated", 3)]
    assert {name for topic, name, _ in messages if topic == "/1.1/imu"} == {"gcs_health.imu"}
    estimates = [row for topic, _, row in messages if topic == "/1.1/effectiveness/3"]
    assert len(estimates) > 100
