"""A flight's tables as files that other tools open: Parquet, one file a table, and MCAP for Foxglove.

`docs/reference/tables.md` says what the columns are; names and units are those of `Flight.columns`.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from gcs_health import __version__
from gcs_health.errors import ConfigError
from gcs_health.flight import TABLES, Flight
from gcs_health.flight_columns import READING_TABLES, Columns
from gcs_health.record.events import as_object, plain

Row = tuple[float, dict[str, object]]  # its time [s], and itself

SCHEMA = "gcs_health.tables/1"
NEEDS = "{}: writing {} needs {}: pip install 'gcs-health[export]'"


def write_parquet(flight: Flight, folder: Path) -> list[Path]:
    """Write each table as DIR/TABLE.parquet; return the files.

    Raises
    ------
    ConfigError : pyarrow is not installed, or the folder cannot be written.
    """
    try:
        from pyarrow import parquet
    except ModuleNotFoundError:
        raise ConfigError(NEEDS.format(folder, "Parquet", "pyarrow")) from None
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name in TABLES:
            path = folder / f"{name}.parquet"
            parquet.write_table(arrow_table(_columns(flight, name), flight.log), path, compression="zstd")
            written.append(path)
    except OSError as error:
        raise ConfigError(f"{folder}: cannot write: {error.strerror or error}") from None
    return written


def arrow_table(columns: Columns, log: str) -> Any:
    """Return columns as a `pyarrow.Table` that says which schema it has; text columns stay text when empty."""
    import pyarrow

    arrays = {
        name: pyarrow.array(column, pyarrow.string()) if column.dtype == object else pyarrow.array(column)
        for name, column in columns.items()
    }
    about = {"schema": SCHEMA, "written_by": f"gcs_health {__version__}", "log": log}
    return pyarrow.table(arrays).replace_schema_metadata(about)


def write_mcap(flight: Flight, path: Path) -> None:
    """Write readings, estimates, alerts and summaries as JSON messages; the axis is the vehicle's clock.

    Raises
    ------
    ConfigError : mcap is not installed, or the file cannot be written.
    """
    try:
        from mcap.writer import CompressionType, Writer
    except ModuleNotFoundError:
        raise ConfigError(NEEDS.format(path, "MCAP", "mcap")) from None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            writer = Writer(file, compression=CompressionType.ZSTD)
            writer.start(profile="", library=f"gcs_health {__version__}")
            for topic, rows in _topics(flight):
                channel = None
                for t, row in rows:
                    if channel is None:
                        schema = writer.register_schema(
                            f"gcs_health.{topic.split('/')[1]}",
                            "jsonschema",
                            json.dumps(_schema(row)).encode(),
                        )
                        channel = writer.register_channel(f"/{topic}", "json", schema)
                    if math.isfinite(t) and t >= 0.0:
                        ns = round(t * 1e9)
                        writer.add_message(channel, ns, json.dumps(row, allow_nan=False).encode(), ns)
            writer.finish()
    except OSError as error:
        raise ConfigError(f"{path}: cannot write: {error.strerror or error}") from None


def _columns(flight: Flight, name: str) -> Columns:
    """Return a table of all vehicles, those of readings with a column that says which."""
    if name not in READING_TABLES:
        return flight.columns(name)
    import numpy as np

    parts = [(vehicle, flight.columns(name, vehicle)) for vehicle in flight.vehicles]
    names = list(dict.fromkeys(column for _, columns in parts for column in columns))
    out: Columns = {
        "vehicle": np.array([v for v, columns in parts for _ in range(len(columns["t"]))], object)
    }
    for column in names:  # another vehicle may have fewer rotors
        out[column] = np.concatenate(
            [columns.get(column, np.full(len(columns["t"]), np.nan)) for _, columns in parts]
        )
    return out


def _topics(flight: Flight) -> Iterator[tuple[str, Iterator[Row]]]:
    for vehicle in flight.vehicles:
        for name in READING_TABLES:
            yield f"{vehicle}/{name}", _rows(flight.columns(name, vehicle))
        mine = flight.estimates["vehicle"] == vehicle
        estimates = {name: column[mine] for name, column in flight.estimates.items()}
        kinds = sorted(set(zip(estimates["quantity"], estimates["motor"].tolist(), strict=True)))
        for quantity, motor in kinds:
            chosen = (estimates["quantity"] == quantity) & (estimates["motor"] == motor)
            rows = _rows({name: column[chosen] for name, column in estimates.items()})
            yield f"{vehicle}/{quantity}/{motor}", rows
        steps = [(a.t, as_object(a)) for a in flight.alerts if a.vehicle == vehicle]
        yield f"{vehicle}/alerts", iter(steps)
        yield (
            f"{vehicle}/summary",
            iter([(s.t, as_object(s)) for s in flight.summaries if s.vehicle == vehicle]),
        )


def _rows(columns: Columns) -> Iterator[Row]:
    names = list(columns)
    for values in zip(*(column.tolist() for column in columns.values()), strict=True):
        row = dict(zip(names, map(plain, values), strict=True))
        t = row["t"]
        if isinstance(t, float):
            yield t, row


def _schema(row: dict[str, object]) -> dict[str, Any]:
    """Return a JSON Schema that a plot can be chosen by; a number may be absent (null)."""
    kinds = {str: "string", bool: "boolean", dict: "object", list: "array"}
    return {
        "type": "object",
        "properties": {name: {"type": kinds.get(type(value), "number")} for name, value in row.items()},
    }
