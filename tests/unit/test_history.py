"""The history store on SQLite and on a real PostgreSQL: what is kept, once, across flights and versions."""

import json
import math
import random
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path

import postgresql
import pytest
from recorded import FLIGHT, feed, two_flights

from gcs_health.balance import figures, words
from gcs_health.cli import main
from gcs_health.condition.indicators import Indicator
from gcs_health.errors import ConfigError
from gcs_health.pipeline import MonitorConfig
from gcs_health.record import history_schema
from gcs_health.record.events import AlertEvent
from gcs_health.record.flight_results import FlightRecord, RotorResult
from gcs_health.record.history import History, MarkRow
from gcs_health.record.history_keeper import HistoryKeeper, StoreError
from gcs_health.record.trends import DAY_US

BEGAN = 1_780_000_000_000_000  # 2026-05-28


def result(motor: int, value: float, quantity: str = "unbalance") -> RotorResult:
    return RotorResult(
        motor, motor - 1, "unbalance", quantity, value, 1e-7, 2e-7, 900, 800, "valid", value, 9.0, 0.1
    )


def record(day: float, *results: RotorResult, alerts: tuple[AlertEvent, ...] = ()) -> FlightRecord:
    return FlightRecord(
        "1.1", "00ab", "Quad", 12, 2, BEGAN + int(day * DAY_US), 6.1, 600.0, tuple(results), alerts
    )


def alert(state: str = "raised") -> AlertEvent:
    return AlertEvent(9.0, BEGAN, "1.1", "1.1-1", "ROTOR_FAILED", 2, 3, state, 1, math.nan, "motor 3", {})


@pytest.fixture(scope="module")
def postgres() -> Iterator[str]:
    with postgresql.server() as url:
        yield url


@pytest.fixture(params=["sqlite", "postgresql"])
def store(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[History]:
    if request.param == "sqlite":
        history = History(str(tmp_path / "h.sqlite"))
    else:
        history = History(request.getfixturevalue("postgres"))
    yield history
    with history._transaction() as connection:
        for table in reversed(history_schema.METADATA.sorted_tables):
            if table.name != "schema_version":
                connection.exec_driver_sql(
                    f"DELETE FROM {table.name}" if table.name != "vehicle" else "SELECT 1"
                )
        connection.exec_driver_sql("DELETE FROM vehicle")
    history.close()


def test_a_flight_comes_back_as_it_was_stored(store: History) -> None:
    unknown = result(2, math.nan)
    store.store(record(0, result(1, 2e-6), unknown, alerts=(alert(),)))
    (vehicle,) = store.vehicles()
    assert vehicle == {
        "vehicle": "00ab", "sender": "1.1", "name": "Quad", "autopilot": 12, "vehicle_type": 2
    }  # fmt: skip
    (flight,) = store.flights("00ab")
    assert (flight["flight"], flight["started_us"], flight["duration"]) == (f"us:{BEGAN}", BEGAN, 600.0)
    one, two = store.results("00ab")
    assert (one.motor, one.quantity, one.value, one.std, one.valid) == (1, "unbalance", 2e-6, 1e-7, 800)
    assert math.isnan(two.value)
    (kept,) = store.alerts("00ab")
    assert (kept["code"], kept["motor"], kept["state"], kept["probability"]) == (
        "ROTOR_FAILED",
        3,
        "raised",
        None,
    )


def test_a_flight_stored_twice_is_one_and_the_later_counts(store: History) -> None:
    store.store(record(0, result(1, 2e-6), alerts=(alert(),)))
    store.store(record(1, result(1, 3e-6)))
    store.store(record(0, result(1, 2.5e-6), result(2, 1e-6), alerts=(alert("cleared"),)))
    assert [flight["started_us"] for flight in store.flights("00ab")] == [BEGAN, BEGAN + DAY_US]
    assert [(row.motor, row.value) for row in store.results("00ab")] == [(1, 2.5e-6), (2, 1e-6), (1, 3e-6)]
    assert [row["state"] for row in store.alerts("00ab")] == ["cleared"]


def test_the_condition_of_a_flight_comes_back_by_regime_and_is_replaced_with_it(store: History) -> None:
    hover = Indicator(2, 3, "unbalance", "hover", 2e-6, 1e-7, 60.0, 4e5, 15.2)
    windy = hover._replace(regime="wind", value=3e-6, voltage=math.nan)
    grew = hover._replace(slope=1e-6, low=5e-7, high=2e-6, grows=True, due=0.5, balance="2 g mm")
    store.store(record(0, result(3, 2e-6))._replace(condition=(hover, windy)))
    store.store(record(0, result(3, 2e-6))._replace(condition=(grew, windy)))
    store.store(record(1, result(3, 2e-6)))
    one, two = store.condition("00ab")
    assert (one.flight, one.started_us, one.motor, one.regime) == (f"us:{BEGAN}", BEGAN, 3, "hover")
    assert (one.value, one.seconds, one.load, one.voltage) == (2e-6, 60.0, 4e5, 15.2)
    assert (one.slope, one.low, one.high, one.grows, one.due) == (1e-6, 5e-7, 2e-6, 1, 0.5)
    assert (one.balance, two.balance) == ("2 g mm", "")
    assert (two.regime, two.grows, math.isnan(two.voltage)) == ("wind", 0, True)


def test_vehicles_are_found_by_what_people_call_them(store: History) -> None:
    store.store(record(0, result(1, 2e-6)))
    store.store(record(0, result(1, 2e-6))._replace(uid=None, vehicle="7.1", name="Hexa One"))
    for text in ("00ab", "00AB", "1.1", "quad", "qu"):
        assert store.find(text)["vehicle"] == "00ab"
    assert store.find("7.1")["vehicle"] == "7.1 Hexa One"
    with pytest.raises(ConfigError, match=r"no vehicle is called so in .*: 7\.1 Hexa One; 00ab"):
        store.find("octo")
    with pytest.raises(ConfigError, match="several vehicles are called so"):
        store.find("")


def test_marks_are_kept(store: History) -> None:
    store.store(record(0, result(1, 2e-6)))
    for what in ("propeller changed", "motor changed"):
        store.mark("00ab", MarkRow(1, BEGAN, what))
    store.mark("00ab", MarkRow(3, BEGAN - 1, "bearing"))
    assert store.marks("00ab") == [MarkRow(3, BEGAN - 1, "bearing"), MarkRow(1, BEGAN, "motor changed")]


def test_several_processes_may_write_at_once(tmp_path: Path) -> None:
    stores = [History(str(tmp_path / "h.sqlite")) for _ in range(3)]
    for k in range(12):
        stores[k % 3].store(record(k, result(1, 2e-6)))
    assert len(stores[0].flights("00ab")) == 12
    with sqlite3.connect(tmp_path / "h.sqlite") as direct:
        assert direct.execute("PRAGMA journal_mode").fetchone() == ("wal",)
    direct.close()
    for each in stores:
        each.close()


def test_an_older_store_is_brought_up_to_date_and_a_newer_one_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(tmp_path / "h.sqlite")
    with monkeypatch.context() as older:
        older.setattr("gcs_health.record.history.STEPS", history_schema.STEPS[:1])
        old = History(path)
        with old._transaction() as connection:  # as the version of then wrote it
            connection.exec_driver_sql("INSERT INTO vehicle VALUES ('00ab', '1.1', 'Quad', 12, 2)")
            connection.exec_driver_sql(
                f"INSERT INTO flight VALUES ('00ab', 'us:{BEGAN}', {BEGAN}, 6.1, 600.0, '0.1')"
            )
            connection.exec_driver_sql(
                "INSERT INTO result (vehicle, flight, motor, estimator, quantity, rotor, value, samples, valid, "
                f"status) VALUES ('00ab', 'us:{BEGAN}', 1, 'unbalance', 'unbalance', 0, 2e-6, 9, 9, 'valid')"
            )
        with pytest.raises(StoreError, match="no such table: mark"):
            old.marks("00ab")
        old.close()
    new = History(path)
    assert new.marks("00ab") == []
    assert new.condition("00ab") == []
    (kept,) = new.results("00ab")
    assert (kept.value, math.isnan(kept.balance_quality)) == (2e-6, True)
    new.close()
    monkeypatch.setattr("gcs_health.record.history.STEPS", history_schema.STEPS[:1])
    with pytest.raises(
        ConfigError, match=r"a newer gcs-health wrote this history \(schema 4, this one knows 1\)"
    ):
        History(path)


def test_a_step_that_fails_leaves_the_store_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = str(tmp_path / "h.sqlite")
    History(path).close()
    broken = (*history_schema.STEPS, ("CREATE TABLE half (a INTEGER)", "CREATE NONSENSE"))
    with monkeypatch.context() as newer:
        newer.setattr("gcs_health.record.history.STEPS", broken)
        with pytest.raises(StoreError):
            History(path)
    store = History(path)
    with store._transaction() as connection:
        assert not connection.exec_driver_sql("SELECT name FROM sqlite_master WHERE name = 'half'").all()
    store.close()


def test_the_tables_are_as_the_steps_make_them(store: History) -> None:
    from sqlalchemy import inspect

    found = inspect(store._engine)
    for table in history_schema.METADATA.sorted_tables:
        made = {column["name"]: column["nullable"] for column in found.get_columns(table.name)}
        assert set(made) == {column.name for column in table.columns}
        assert found.get_pk_constraint(table.name)["constrained_columns"] == [
            c.name for c in table.primary_key
        ]


# -- the command -----------------------------------------------------------------------------------------


def test_a_flight_replayed_twice_is_stored_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(tmp_path / "h.sqlite")
    for _ in range(2):
        assert main(["replay", str(FLIGHT), "--history", path]) == 0
    capsys.readouterr()
    assert main(["history", "--history", path, "--format", "json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["schema"] == "gcs_health.history/1"
    (vehicle,) = told["vehicles"]
    assert (vehicle["vehicle"], len(vehicle["flights"]), len(vehicle["alerts"])) == ("1.1", 1, 1)
    assert {row["motor"] for row in vehicle["results"]} == {1, 2, 3, 4}


def test_live_keeps_a_history_by_default_and_none_if_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert main(["live", f"file://{FLIGHT}", "--history", "none"]) == 0
    assert not list(tmp_path.iterdir())
    assert main(["live", f"file://{FLIGHT}"]) == 0
    assert (tmp_path / "gcs-health" / "history.sqlite").exists()
    capsys.readouterr()
    assert main(["history"]) == 0
    assert capsys.readouterr().out.startswith("vehicle 1.1: 1 flight\n")


@pytest.fixture
def worn(tmp_path: Path) -> str:
    """Ten flights on which the unbalance of motor 3 doubles, a repair, three flights as good as new."""
    path = str(tmp_path / "h.sqlite")
    history = History(path)
    noise = random.Random(2)
    for k in range(13):
        mean = 2e-6 * (1.0 + 0.1 * k) if k < 10 else 1.5e-6
        history.store(record(7 * k, result(2, noise.gauss(1e-6, 5e-8)), result(3, noise.gauss(mean, 5e-8))))
    history.close()
    return path


def test_growth_is_a_finding_with_a_date(worn: str, capsys: pytest.CaptureFixture[str]) -> None:
    history = History(worn)
    with history._transaction() as connection:
        for table in ("result", "flight"):
            connection.exec_driver_sql(f"DELETE FROM {table} WHERE flight > 'us:{BEGAN + 65 * DAY_US}'")
    history.close()
    assert main(["history", "--history", worn, "quad", "--limit", "unbalance=4e-6"]) == 0
    shown = capsys.readouterr().out
    lines = shown.splitlines()
    grown = next(k for k, line in enumerate(lines) if line.startswith("  motor 3  unbalance 3.8"))
    assert lines[grown + 1].lstrip().startswith("maintenance: grows by 0.2")
    assert "at 4 g mm about 2026-08-" in lines[grown + 1]
    calm = next(k for k, line in enumerate(lines) if line.startswith("  motor 2"))
    assert "no growth that the flights bear out" in lines[calm + 1]


def test_a_mark_begins_a_new_baseline_and_says_whether_it_helped(
    worn: str, capsys: pytest.CaptureFixture[str]
) -> None:
    mark = [
        "history",
        "mark",
        "Quad",
        "--history",
        worn,
        "--rotor",
        "3",
        "--propeller-changed",
        "--at",
        "2026-08-04",
    ]
    assert main(mark) == 0
    assert "00ab: motor 3: propeller changed, 2026-08-04 00:00 UTC" in capsys.readouterr().out
    assert main(["history", "Quad", "--history", worn, "--rotor", "3"]) == 0
    shown = capsys.readouterr().out
    assert "3 flights since the baseline began" in shown
    assert "motor 3: propeller changed: unbalance 2.87 g mm (2.43 to 3.3) before" in shown
    assert shown.rstrip().endswith("after: helped (unbalance)")
    assert main(["history", "Quad", "--history", worn, "--format", "csv"]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert len(rows) == 1 + 26
    assert rows[1].startswith(f"00ab,Quad,us:{BEGAN},{BEGAN},2,unbalance,unbalance,")


@pytest.fixture
def mixed(tmp_path: Path) -> str:
    """Twelve flights; every third with a third more payload. Drag of motor 1 grows, unknown to plain means.

    The plain unbalance of motor 3 falls with the payload, as the estimator's does that does not know of it.
    """
    path = str(tmp_path / "h.sqlite")
    history = History(path)
    noise = random.Random(4)
    for k in range(12):
        payload = 1.33 if k % 3 == 1 else 1.0
        condition, results = [], []
        for motor in (1, 2, 3, 4):
            drag = (1.0 + 0.02 * k if motor == 1 else 1.0) + noise.gauss(0.0, 0.003)
            unbalance = noise.gauss(2e-6 if motor == 3 else 1e-6, 2e-8) / payload
            of_all = (motor - 1, motor)
            condition += [
                Indicator(*of_all, "drag", "hover", drag, 0.01, 300.0, 4e5 * payload, 15.0),
                Indicator(*of_all, "unbalance", "hover", unbalance, 2e-8, 200.0, 4e5 * payload, 15.0),
                Indicator(*of_all, "unbalance", "manoeuvre", 9e-6, 2e-8, 20.0, 4e5 * payload, 15.0),
            ]
            results += [
                result(motor, unbalance),
                result(motor, 1.0, "drag")._replace(estimator="motor_observer"),
            ]
        if k == 11:
            condition[7] = condition[7]._replace(slope=1e-6, low=5e-7, high=2e-6, grows=True, due=0.5)
            condition[7] = condition[7]._replace(balance=words(figures(2e-6, 0.127, 0.009, 632.5)))
        history.store(record(7 * k, *results)._replace(condition=tuple(condition)))
    history.close()
    return path


def test_trends_stand_on_flights_alike_and_say_so(mixed: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["history", "--history", mixed, "quad"]) == 0
    lines = capsys.readouterr().out.splitlines()
    of = {
        line.split(",")[0].strip(): lines[k + 1].strip()
        for k, line in enumerate(lines)
        if line.startswith("  motor")
    }
    (worn,) = (said for head, said in of.items() if head.startswith("motor 1  drag"))
    assert worn.startswith("maintenance: grows by 0.0")
    assert worn.endswith("(hover of 12 flights, 3600 s against the other rotors)")
    others = [said for head, said in of.items() if not head.startswith("motor 1  drag")]
    assert len(others) == 7
    assert all(said.startswith("no growth that the flights bear out") for said in others)
    assert all("payload taken out" in said for head, said in of.items() if "unbalance" in head)
    (within,) = (line for line in lines if "grew within the flight" in line)
    assert "maintenance: motor 3: unbalance 2 g mm (15.7 mg at the tip), G 250 at 6040 rpm grew" in within


def test_a_repair_is_judged_by_flights_alike(mixed: str, capsys: pytest.CaptureFixture[str]) -> None:
    history = History(mixed)
    for k in range(12, 15):
        new = Indicator(0, 1, "drag", "hover", 1.0 + 0.001 * k, 0.01, 300.0, 4e5, 15.0)
        history.store(record(7 * k, result(1, 1e-6))._replace(condition=(new,)))
    history.mark("00ab", MarkRow(1, BEGAN + 80 * DAY_US, "new bearing"))
    history.close()
    assert main(["history", "--history", mixed, "quad", "--rotor", "1", "--format", "json"]) == 0
    (vehicle,) = json.loads(capsys.readouterr().out)["vehicles"]
    (drag,) = (each for each in vehicle["repairs"] if each["quantity"] == "drag")
    assert (drag["verdict"], drag["before"]["flights"], drag["after"]["flights"]) == ("helped", 12, 3)
    assert {each["regime"] for each in vehicle["condition"]} == {"hover", "manoeuvre"}


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["history", "--history", "nonsense://x/y"], "cannot be used"),
        (["history", "--history", "{place}/file/h.sqlite"], "unable to open database file"),
        (["history", "a", "b"], "quote a name with spaces"),
        (["history", "mark"], "expected mark and one vehicle, got none"),
        (["history", "mark", "x", "--history", "{place}/h"], "no vehicle is called so"),
        (["history", "--limit", "unbalance"], "expected QUANTITY=VALUE"),
        (["replay", str(FLIGHT), "--history", "{place}/file/h.sqlite"], "unable to open database file"),
        (["history", "--history", "postgresql://nobody@127.0.0.1:1/x"], "127.0.0.1"),
    ],
)
def test_what_cannot_be_is_told_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], complaint: str
) -> None:
    (tmp_path / "file").write_text("")
    assert main([word.format(place=tmp_path) for word in arguments]) == 2
    shown = capsys.readouterr()
    assert complaint in shown.err
    assert shown.err.count("\n") == 1


# -- a store that is not there ---------------------------------------------------------------------------


def keeper(fails: Callable[[], bool], path: Path) -> HistoryKeeper:
    def opens() -> History:
        if fails():
            raise StoreError("the database is gone")
        return History(str(path))

    return HistoryKeeper(opens)


def test_a_store_that_is_gone_is_told_once_and_gets_the_flights_when_it_is_back(tmp_path: Path) -> None:
    gone = [True]
    kept = keeper(lambda: gone[0], tmp_path / "h.sqlite")
    events = feed(two_flights(), MonitorConfig())
    kept.take(events)
    for k in range(5):
        assert kept._work is None or kept._work.result()
        kept.poll(1_000_000_000 + k * 20_000_000)
    assert kept.notices == ["history: the database is gone; trying again"]
    gone[0] = False
    kept.close()
    assert kept.notices[1:] == ["history: stored again"]
    store = History(str(tmp_path / "h.sqlite"))
    assert len(store.flights("1.1")) == 2
    store.close()


def test_what_could_not_be_stored_at_all_is_told(tmp_path: Path) -> None:
    kept = keeper(lambda: True, tmp_path / "h.sqlite")
    kept.take(feed(two_flights(), MonitorConfig()))
    kept.close()
    assert kept.notices[-1] == "2 flights are not in the history"
