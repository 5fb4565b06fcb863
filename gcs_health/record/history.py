"""The history store: what each flight said of each rotor, so that trends across flights exist.

SQLite by default, one file in the user's data directory that several processes may use at once (WAL);
PostgreSQL by URL. Through SQLAlchemy Core: tables and statements, no objects of its own making.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

from sqlalchemy import (
    Column,
    Connection,
    Engine,
    Table,
    create_engine,
    delete,
    event,
    insert,
    inspect,
    select,
    text,
    update,
)
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, SQLAlchemyError

from gcs_health import __version__
from gcs_health.errors import ConfigError
from gcs_health.record.flight_results import FlightRecord
from gcs_health.record.history_keeper import StoreError
from gcs_health.record.history_schema import (
    ALERT,
    CONDITION,
    FLIGHT,
    MARK,
    RESULT,
    SCHEMA_VERSION,
    STEPS,
    VEHICLE,
)

MIGRATION_LOCK = 1_918_989_172  # any number, the same in every process: of PostgreSQL's advisory lock
BUSY_MS = 10_000  # SQLite: how long another process may write


class ResultRow(NamedTuple):
    """One quantity of one rotor in one flight, as stored; see `flight_results.RotorResult`."""

    flight: str
    started_us: int
    motor: int
    estimator: str
    quantity: str
    value: float
    std: float
    spread: float
    samples: int
    valid: int
    status: str
    worst: float
    worst_probability: float
    balance_quality: float


class ConditionRow(NamedTuple):
    """One quantity of one rotor in one regime of one flight, as stored; see `condition.indicators.Indicator`."""

    flight: str
    started_us: int
    motor: int
    quantity: str
    regime: str
    value: float
    spread: float
    seconds: float
    load: float
    voltage: float
    slope: float
    low: float
    high: float
    grows: int
    due: float
    balance: str


class MarkRow(NamedTuple):
    """A repair: what was done to a motor, and when [UNIX µs]."""

    motor: int
    at_us: int
    what: str


class History:
    """An open store.

    Parameters
    ----------
    url : as SQLAlchemy has it (sqlite:///FILE, postgresql://USER@HOST/DATABASE), or a path.

    Raises
    ------
    ConfigError : the URL cannot be used, or the store was written by a newer version.
    StoreError : it cannot be reached now.
    """

    def __init__(self, url: str) -> None:
        self.url = _url(url)
        self.name = self.url.render_as_string(hide_password=True)
        try:
            self._engine = _engine(self.url)
        except (ArgumentError, SQLAlchemyError) as error:
            raise ConfigError(f"{self.name}: cannot be used: {error}") from None
        except ModuleNotFoundError as error:
            raise ConfigError(
                f"{self.name}: needs {error.name}: pip install 'gcs-health[postgresql]'"
            ) from None
        self._migrate(STEPS)

    def close(self) -> None:
        """Let go of it."""
        self._engine.dispose()

    def store(self, record: FlightRecord) -> None:
        """Keep a flight; one with the same identity is replaced."""
        key = {"vehicle": record.vehicle_identity, "flight": record.identity}
        vehicle = {
            "sender": record.vehicle,
            "name": record.name,
            "autopilot": record.autopilot,
            "vehicle_type": record.vehicle_type,
        }
        flight = {
            "started_us": record.started_us,
            "started_t": record.started_t,
            "duration": record.duration,
            "stored_by": __version__,
        }
        results = [key | {k: _or_null(v) for k, v in r._asdict().items()} for r in record.results]
        condition = [
            key | {k: _or_null(v) for k, v in each._asdict().items()} | {"grows": int(each.grows)}
            for each in record.condition
        ]
        wanted = {column.name for column in ALERT.columns} - set(key)
        alerts = [
            key
            | {k: _or_null(v) for k, v in alert._asdict().items() if k in wanted}
            | {"motor": alert.motor or 0}
            for alert in record.alerts
        ]
        with self._transaction() as connection:
            known = update(VEHICLE).where(VEHICLE.c.vehicle == key["vehicle"]).values(**vehicle)
            if not connection.execute(known).rowcount:
                connection.execute(insert(VEHICLE).values(vehicle=key["vehicle"], **vehicle))
            for table in (ALERT, CONDITION, RESULT, FLIGHT):
                same = (table.c.vehicle == key["vehicle"]) & (table.c.flight == key["flight"])
                connection.execute(delete(table).where(same))
            connection.execute(insert(FLIGHT).values(**key, **flight))
            for table, rows in ((RESULT, results), (CONDITION, condition), (ALERT, alerts)):
                if rows:
                    connection.execute(insert(table), rows)

    def vehicles(self) -> list[dict[str, Any]]:
        """Return the vehicles, by name."""
        return self._rows(select(VEHICLE).order_by(VEHICLE.c.name, VEHICLE.c.vehicle))

    def find(self, text: str) -> dict[str, Any]:
        """Return the vehicle that `text` names: its identity, "sysid.compid" or name, or the start of one.

        Raises
        ------
        ConfigError : none or several are named so.
        """
        vehicles = self.vehicles()
        wanted = text.lower()
        spelled = [[str(v[k]).lower() for k in ("vehicle", "sender", "name")] for v in vehicles]
        found = [v for v, names in zip(vehicles, spelled, strict=True) if wanted in names]
        if not found:
            found = [
                v
                for v, names in zip(vehicles, spelled, strict=True)
                if any(n.startswith(wanted) for n in names)
            ]
        if len(found) == 1:
            return found[0]
        known = "; ".join(v["vehicle"] for v in (found or vehicles)) or "none yet"
        raise ConfigError(
            f"{text}: {'several vehicles are' if found else 'no vehicle is'} called so in {self.name}: {known}"
        )

    def flights(self, vehicle: str) -> list[dict[str, Any]]:
        """Return the flights of a vehicle, oldest first."""
        return self._rows(
            select(FLIGHT).where(FLIGHT.c.vehicle == vehicle).order_by(FLIGHT.c.started_us, FLIGHT.c.flight)
        )

    def alerts(self, vehicle: str) -> list[dict[str, Any]]:
        """Return the alerts of a vehicle, oldest first."""
        return self._rows(
            select(ALERT).where(ALERT.c.vehicle == vehicle).order_by(ALERT.c.t_unix_us, ALERT.c.t)
        )

    def results(self, vehicle: str) -> list[ResultRow]:
        """Return the results of a vehicle, oldest first; what was not known is NaN."""
        order = (RESULT.c.motor, RESULT.c.estimator, RESULT.c.quantity)
        return [ResultRow._make(row) for row in self._of_flights(RESULT, ResultRow._fields, vehicle, order)]

    def condition(self, vehicle: str) -> list[ConditionRow]:
        """Return the condition of a vehicle by regime, oldest first; what was not known is NaN."""
        order = (CONDITION.c.motor, CONDITION.c.quantity, CONDITION.c.regime)
        rows = self._of_flights(CONDITION, ConditionRow._fields, vehicle, order)
        return [ConditionRow._make(row) for row in rows]

    def _of_flights(
        self, table: Table, names: Sequence[str], vehicle: str, order: Sequence[Column[Any]]
    ) -> list[list[Any]]:
        """Return columns of a table by flight, with when the flight started."""
        columns = [FLIGHT.c.started_us if name == "started_us" else table.c[name] for name in names]
        joined = table.join(
            FLIGHT, (table.c.vehicle == FLIGHT.c.vehicle) & (table.c.flight == FLIGHT.c.flight)
        )
        rows = self._rows(
            select(*columns)
            .select_from(joined)
            .where(table.c.vehicle == vehicle)
            .order_by(FLIGHT.c.started_us, table.c.flight, *order)
        )
        return [[math.nan if value is None else value for value in row.values()] for row in rows]

    def mark(self, vehicle: str, mark: MarkRow) -> None:
        """Note a repair: a new baseline begins for this motor."""
        with self._transaction() as connection:
            same = (MARK.c.vehicle == vehicle) & (MARK.c.motor == mark.motor) & (MARK.c.at_us == mark.at_us)
            connection.execute(delete(MARK).where(same))
            connection.execute(insert(MARK).values(vehicle=vehicle, **mark._asdict()))

    def marks(self, vehicle: str) -> list[MarkRow]:
        """Return the repairs of a vehicle, oldest first."""
        rows = self._rows(
            select(MARK.c.motor, MARK.c.at_us, MARK.c.what)
            .where(MARK.c.vehicle == vehicle)
            .order_by(MARK.c.at_us, MARK.c.motor)
        )
        return [MarkRow(**row) for row in rows]

    def _rows(self, statement: Any) -> list[dict[str, Any]]:
        with self._transaction() as connection:
            return [dict(row) for row in connection.execute(statement).mappings()]

    @contextmanager
    def _transaction(self) -> Iterator[Connection]:
        """A transaction whose failures are `StoreError`s of one line."""
        try:
            with self._engine.begin() as connection:
                yield connection
        except (SQLAlchemyError, OSError) as error:
            raise StoreError(f"{self.name}: {_one_line(error)}") from None

    def _migrate(self, steps: Sequence[Iterable[str]]) -> None:
        """Take the steps that this store has not taken yet, all of them or none."""
        with self._transaction() as connection:
            if connection.dialect.name == "postgresql":
                connection.execute(text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": MIGRATION_LOCK})
            if not inspect(connection).has_table(SCHEMA_VERSION.name):
                SCHEMA_VERSION.create(connection)
                connection.execute(insert(SCHEMA_VERSION).values(version=0))
            version = connection.execute(select(SCHEMA_VERSION.c.version)).scalar_one()
            if version > len(steps):
                raise ConfigError(
                    f"{self.name}: a newer gcs-health wrote this history (schema {version}, this one knows "
                    f"{len(steps)}): upgrade"
                )
            for step in steps[version:]:
                for statement in step:
                    connection.execute(text(statement))
            if version < len(steps):
                connection.execute(update(SCHEMA_VERSION).values(version=len(steps)))


def default_url() -> str:
    """Return the SQLite file in the user's data directory."""
    from platformdirs import user_data_path

    return f"sqlite:///{user_data_path('gcs-health', appauthor=False) / 'history.sqlite'}"


def _url(given: str) -> URL:
    if "://" not in given:
        return URL.create("sqlite", database=given)
    try:
        url = make_url(given)
    except (ArgumentError, ValueError):
        raise ConfigError(
            f"{given}: expected a URL like sqlite:///FILE or postgresql://USER@HOST/DATABASE, or a path"
        ) from None
    # psycopg is the driver that we name as an extra; SQLAlchemy would look for its predecessor
    return url.set(drivername="postgresql+psycopg") if url.drivername == "postgresql" else url


def _engine(url: URL) -> Engine:
    if url.get_backend_name() != "sqlite":
        return create_engine(url, pool_pre_ping=True)
    if url.database and url.database != ":memory:":
        with suppress(OSError):  # the database itself will say what is wrong with its place
            Path(url.database).parent.mkdir(parents=True, exist_ok=True)
    engine = create_engine(url, connect_args={"isolation_level": None, "timeout": BUSY_MS / 1e3})

    # Python's sqlite3 begins transactions late and ends them at a CREATE TABLE: ours are explicit
    @event.listens_for(engine, "connect")
    def _connected(connection: Any, _record: object) -> None:
        connection.execute("PRAGMA journal_mode=WAL")
        connection.execute("PRAGMA foreign_keys=ON")

    @event.listens_for(engine, "begin")
    def _begun(connection: Connection) -> None:
        connection.exec_driver_sql("BEGIN IMMEDIATE")

    return engine


def _or_null(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _one_line(error: BaseException) -> str:
    """Return what the database says, without the statement that SQLAlchemy adds."""
    said = getattr(error, "orig", None) or error
    return " ".join(str(said).split())
