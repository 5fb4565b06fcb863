"""`gcs-health fleet`: every log once, into tables and the history; what is done is not done again."""

import shutil
from pathlib import Path

import duckdb
import pytest

from gcs_health import MonitorConfig
from gcs_health.cli import main
from gcs_health.errors import ConfigError
from gcs_health.fleet import Job, analyse, find_logs
from gcs_health.fleet_store import FleetStore
from gcs_health.record.history import History

FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"
QUICK = ("--estimators", "effectiveness")


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    for name in ("one", "two"):
        (folder / name).mkdir()
        shutil.copy(FLIGHT, folder / name / "flight.tlog")
    (folder / "two" / "short.tlog").write_bytes(FLIGHT.read_bytes()[:30_000])
    (folder / "bad.tlog").write_bytes(b"no log at all")
    (folder / "notes.txt").write_text("no log, and not called like one")
    return folder


@pytest.fixture(scope="module")
def out(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    assert (
        main(["fleet", str(logs), "-o", str(folder), "--workers", "2", "--aircraft", "folder", *QUICK]) == 3
    )
    return folder


def test_every_log_has_its_outcome(out: Path) -> None:
    rows = FleetStore(out).read("flights", ["log", "outcome", "aircraft", "error"])
    told = {
        log.split("/logs0/")[1]: outcome for log, outcome in zip(rows["log"], rows["outcome"], strict=True)
    }
    assert told == {
        "one/flight.tlog": "findings",
        "two/flight.tlog": "findings",
        "two/short.tlog": "not judged",
        "bad.tlog": "unusable",
    }
    assert {a for a in rows["aircraft"] if a} == {"one", "two"}
    assert [e for e in rows["error"] if e] == [e for e in rows["error"] if e and "no MAVLink" in e]


def test_the_tables_can_be_asked_with_sql(out: Path) -> None:
    ask = duckdb.connect()
    events = ask.execute(
        f"select log, motor, kind from '{out}/events/*.parquet' "
        "where type = 'alert' and state = 'raised' order by log"
    ).fetchall()
    assert [(motor, kind) for _, motor, kind in events] == [(3, "ROTOR_FAILED")] * 2
    rotors = ask.execute(
        f"select motor, min(worst), avg(mean_speed) from '{out}/rotors/*.parquet' "
        "where quantity = 'effectiveness' and aircraft = 'one' group by motor order by motor"
    ).fetchall()
    assert [row[0] for row in rotors] == [1, 2, 3, 4]
    assert rotors[2][1] < 0.2
    assert 500.0 < rotors[0][2] < 900.0


def test_each_flight_is_in_the_history(out: Path) -> None:
    history = History(str(out / "history.sqlite"))
    assert [v["vehicle"] for v in history.vehicles()] == ["one", "two"]
    assert len(history.flights("one")) == 1
    history.close()


def test_what_is_done_is_not_done_again_unless_it_changed(
    logs: Path, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["fleet", str(logs), "-o", str(out), "--workers", "1", "--aircraft", "folder"]
    before = (out / "flights" / "part-000001.parquet").stat().st_mtime_ns
    assert main([*command, *QUICK]) == 3
    assert "4  of them done before" in capsys.readouterr().out
    assert (out / "flights" / "part-000001.parquet").stat().st_mtime_ns == before
    # another log in the place of one: that one alone is done again, and its old rows are gone
    (logs / "two" / "flight.tlog").write_bytes(FLIGHT.read_bytes()[:35_000])
    assert main([*command, *QUICK]) == 3
    assert "3  of them done before" in capsys.readouterr().out
    rows = FleetStore(out).read("flights", ["log", "outcome"])
    assert sorted(rows["outcome"]) == ["findings", "not judged", "not judged", "unusable"]
    events = FleetStore(out).read("events", ["log", "type"])
    assert {log for log, kind in zip(events["log"], events["type"], strict=True) if kind == "alert"} == {
        str(logs / "one" / "flight.tlog")
    }
    assert main([*command, *QUICK, "--mode", "paper"]) in (2, 3)  # another configuration: all anew
    assert "done before" not in capsys.readouterr().out


def test_a_batch_that_was_cut_short_leaves_nothing(tmp_path: Path) -> None:
    store = FleetStore(tmp_path)
    store.add(analyse(Job(str(tmp_path / "none.tlog"), 0, 0, MonitorConfig())))
    store.flush()
    (tmp_path / "flights" / "part-000001.parquet").rename(tmp_path / "flights" / "part-000001.new")
    again = FleetStore(tmp_path)
    assert again.done() == {}
    assert not list(tmp_path.glob("*/part*"))


def test_logs_behind_a_url_are_fetched() -> None:
    import fsspec

    memory = fsspec.filesystem("memory")
    memory.pipe("/logs/flight.tlog", FLIGHT.read_bytes()[:30_000])
    memory.pipe("/logs/readme.txt", b"")
    (job,) = find_logs(["memory://logs"], MonitorConfig(estimators=("effectiveness",)))
    assert job.log == "memory:///logs/flight.tlog"
    assert analyse(job).outcome == "not judged"
    memory.rm("/logs", recursive=True)
    assert analyse(job).outcome == "unusable"


def test_a_folder_without_logs_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no log in it"):
        find_logs([str(tmp_path)], MonitorConfig())
