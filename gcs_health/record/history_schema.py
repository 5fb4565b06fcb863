"""The tables of the history store, and the numbered steps that lead to them.

A step is plain SQL that SQLite and PostgreSQL both take, and never changes once released: the next change
of the schema is the next step. Keys are natural ones, so that a flight replayed twice is one flight.
`docs/reference/history.md` describes the tables.
"""

from sqlalchemy import BigInteger, Column, Double, Integer, MetaData, Table, Text

METADATA = MetaData()

SCHEMA_VERSION = Table("schema_version", METADATA, Column("version", Integer, nullable=False))

VEHICLE = Table(
    "vehicle",
    METADATA,
    Column("vehicle", Text, primary_key=True),  # the autopilot's uid, else system id and name
    Column("sender", Text, nullable=False),  # "sysid.compid"
    Column("name", Text, nullable=False),
    Column("autopilot", Integer),
    Column("vehicle_type", Integer),
)

FLIGHT = Table(
    "flight",
    METADATA,
    Column("vehicle", Text, primary_key=True),
    Column("flight", Text, primary_key=True),  # "us:" and its first stamp; "t:" and its first time
    Column("started_us", BigInteger, nullable=False),
    Column("started_t", Double, nullable=False),
    Column("duration", Double, nullable=False),
    Column("stored_by", Text, nullable=False),
)

RESULT = Table(
    "result",
    METADATA,
    Column("vehicle", Text, primary_key=True),
    Column("flight", Text, primary_key=True),
    Column("motor", Integer, primary_key=True),
    Column("estimator", Text, primary_key=True),
    Column("quantity", Text, primary_key=True),
    Column("rotor", Integer, nullable=False),
    Column("value", Double),
    Column("std", Double),
    Column("spread", Double),
    Column("samples", Integer, nullable=False),
    Column("valid", Integer, nullable=False),
    Column("status", Text, nullable=False),
    Column("worst", Double),
    Column("worst_t", Double),
    Column("worst_probability", Double),
    Column("balance_quality", Double),
)

ALERT = Table(
    "alert",
    METADATA,
    Column("vehicle", Text, primary_key=True),
    Column("flight", Text, primary_key=True),
    Column("id", Text, primary_key=True),
    Column("code", Text, nullable=False),
    Column("motor", Integer, nullable=False),
    Column("severity", Integer, nullable=False),
    Column("state", Text, nullable=False),
    Column("t", Double, nullable=False),
    Column("t_unix_us", BigInteger, nullable=False),
    Column("probability", Double),
    Column("text", Text, nullable=False),
)

MARK = Table(
    "mark",
    METADATA,
    Column("vehicle", Text, primary_key=True),
    Column("motor", Integer, primary_key=True),
    Column("at_us", BigInteger, primary_key=True),
    Column("what", Text, nullable=False),
)

CONDITION = Table(
    "condition",
    METADATA,
    Column("vehicle", Text, primary_key=True),
    Column("flight", Text, primary_key=True),
    Column("motor", Integer, primary_key=True),
    Column("quantity", Text, primary_key=True),
    Column("regime", Text, primary_key=True),
    Column("rotor", Integer, nullable=False),
    Column("value", Double, nullable=False),
    Column("spread", Double),
    Column("seconds", Double, nullable=False),
    Column("load", Double, nullable=False),
    Column("voltage", Double),
    Column("slope", Double),
    Column("low", Double),
    Column("high", Double),
    Column("grows", Integer, nullable=False),
    Column("due", Double),
    Column("balance", Text, nullable=False),
)

STEPS: tuple[tuple[str, ...], ...] = (
    (
        """CREATE TABLE vehicle (
            vehicle TEXT PRIMARY KEY, sender TEXT NOT NULL, name TEXT NOT NULL,
            autopilot INTEGER, vehicle_type INTEGER)""",
        """CREATE TABLE flight (
            vehicle TEXT NOT NULL REFERENCES vehicle, flight TEXT NOT NULL,
            started_us BIGINT NOT NULL, started_t DOUBLE PRECISION NOT NULL,
            duration DOUBLE PRECISION NOT NULL, stored_by TEXT NOT NULL,
            PRIMARY KEY (vehicle, flight))""",
        """CREATE TABLE result (
            vehicle TEXT NOT NULL, flight TEXT NOT NULL, motor INTEGER NOT NULL, estimator TEXT NOT NULL,
            quantity TEXT NOT NULL, rotor INTEGER NOT NULL, value DOUBLE PRECISION, std DOUBLE PRECISION,
            spread DOUBLE PRECISION, samples INTEGER NOT NULL, valid INTEGER NOT NULL, status TEXT NOT NULL,
            worst DOUBLE PRECISION, worst_t DOUBLE PRECISION, worst_probability DOUBLE PRECISION,
            PRIMARY KEY (vehicle, flight, motor, estimator, quantity),
            FOREIGN KEY (vehicle, flight) REFERENCES flight ON DELETE CASCADE)""",
        """CREATE TABLE alert (
            vehicle TEXT NOT NULL, flight TEXT NOT NULL, id TEXT NOT NULL, code TEXT NOT NULL,
            motor INTEGER NOT NULL, severity INTEGER NOT NULL, state TEXT NOT NULL,
            t DOUBLE PRECISION NOT NULL, t_unix_us BIGINT NOT NULL, probability DOUBLE PRECISION,
            text TEXT NOT NULL,
            PRIMARY KEY (vehicle, flight, id),
            FOREIGN KEY (vehicle, flight) REFERENCES flight ON DELETE CASCADE)""",
    ),
    (
        """CREATE TABLE mark (
            vehicle TEXT NOT NULL REFERENCES vehicle, motor INTEGER NOT NULL, at_us BIGINT NOT NULL,
            what TEXT NOT NULL, PRIMARY KEY (vehicle, motor, at_us))""",
    ),
    ("ALTER TABLE result ADD COLUMN balance_quality DOUBLE PRECISION",),
    (
        """CREATE TABLE condition (
            vehicle TEXT NOT NULL, flight TEXT NOT NULL, motor INTEGER NOT NULL, quantity TEXT NOT NULL,
            regime TEXT NOT NULL, rotor INTEGER NOT NULL, value DOUBLE PRECISION NOT NULL,
            spread DOUBLE PRECISION, seconds DOUBLE PRECISION NOT NULL, load DOUBLE PRECISION NOT NULL,
            voltage DOUBLE PRECISION, slope DOUBLE PRECISION, low DOUBLE PRECISION, high DOUBLE PRECISION,
            grows INTEGER NOT NULL, due DOUBLE PRECISION, balance TEXT NOT NULL,
            PRIMARY KEY (vehicle, flight, motor, quantity, regime),
            FOREIGN KEY (vehicle, flight) REFERENCES flight ON DELETE CASCADE)""",
    ),
)
