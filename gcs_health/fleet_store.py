"""A fleet's results on disk: OUT/{flights,rotors,events}/part-N.parquet, written by one process, readable by any.

A batch of logs is one part of each table. The flights' part is written last and by renaming, so that a log is done
when its row stands there; rows of a batch that was cut short are removed when the next run begins.
"""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from gcs_health.errors import ConfigError
from gcs_health.fleet import Analysed, Row

BATCH = 200  # logs: so many are done again if the power fails
TABLES = ("events", "rotors", "flights")  # the order in which they are written
_TYPES: dict[str, dict[str, str]] = {
    "flights": {
        "log": "string",
        "key": "string",
        "version": "string",
        "config": "string",
        "size": "int64",
        "outcome": "string",
        "error": "string",
        "seconds": "double",
        "vehicle": "string",
        "aircraft": "string",
        "name": "string",
        "flight": "string",
        "autopilot": "int32",
        "vehicle_type": "int32",
        "started_us": "int64",
        "duration": "double",
        "alerts": "int32",
        "why": "string",
    },
    "rotors": {
        "log": "string",
        "vehicle": "string",
        "aircraft": "string",
        "flight": "string",
        "started_us": "int64",
        "rotors": "int32",
        "rotor_speed": "double",
        "mean_speed": "double",
        "motor": "int32",
        "rotor": "int32",
        "estimator": "string",
        "quantity": "string",
        "value": "double",
        "std": "double",
        "spread": "double",
        "samples": "int64",
        "valid": "int64",
        "status": "string",
        "worst": "double",
        "worst_t": "double",
        "worst_probability": "double",
    },
    "events": {
        "log": "string",
        "type": "string",
        "t": "double",
        "t_unix_us": "int64",
        "vehicle": "string",
        "motor": "int32",
        "kind": "string",
        "state": "string",
        "severity": "int32",
        "probability": "double",
        "text": "string",
        "line": "string",
    },
}


class FleetStore:
    """The folder; `add` results, `close` at the end.

    Raises
    ------
    ConfigError : pyarrow is not installed, or the folder cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        try:
            import pyarrow  # noqa: F401
        except ModuleNotFoundError:
            raise ConfigError(f"{folder}: needs pyarrow: pip install 'gcs-health[fleet]'") from None
        self.folder = folder
        self._batch: list[Analysed] = []
        try:
            for table in TABLES:
                (folder / table).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"{folder}: cannot be used: {error.strerror}") from None
        done = {path.name for path in (folder / "flights").glob("part-*.parquet")}
        for table in TABLES:
            for path in (folder / table).iterdir():
                if path.name not in done:
                    path.unlink()  # of a batch that was cut short
        self._next = 1 + max((int(name[5:-8]) for name in done), default=0)

    def done(self) -> dict[str, str]:
        """Return the key of each log that is done."""
        rows = self.read("flights", ["log", "key"])
        return dict(zip(rows["log"], rows["key"], strict=True))

    def forget(self, logs: Iterable[str]) -> None:
        """Remove all rows of these logs: they are to be done anew."""
        import pyarrow.compute as pc
        from pyarrow import array, parquet

        gone = array(sorted(logs), "string")
        if not len(gone):
            return
        for table in reversed(TABLES):  # the flights' rows first: without them a log is not done
            for path in sorted((self.folder / table).glob("part-*.parquet")):
                rows = parquet.read_table(path)
                kept = rows.filter(pc.invert(pc.is_in(rows["log"], gone)))
                if len(kept) < len(rows):
                    self._write(path, kept)

    def add(self, analysed: Analysed) -> None:
        """Take one log's rows."""
        self._batch.append(analysed)
        if len(self._batch) >= BATCH:
            self.flush()

    def flush(self) -> None:
        """Write what was taken."""
        if not self._batch:
            return
        name = f"part-{self._next:06d}.parquet"
        for table in TABLES:
            rows = [row for each in self._batch for row in getattr(each, table)]
            self._write(self.folder / table / name, _table(table, rows))
        self._next += 1
        self._batch.clear()

    def read(self, table: str, columns: list[str] | None = None) -> dict[str, list[Any]]:
        """Return a whole table by columns."""
        from pyarrow import concat_tables, parquet

        parts = sorted((self.folder / table).glob("part-*.parquet"))
        tables = [parquet.read_table(path, columns=columns) for path in parts]
        rows: dict[str, list[Any]] = (
            concat_tables(tables).to_pydict() if tables else {name: [] for name in columns or _TYPES[table]}
        )
        return rows

    def _write(self, path: Path, rows: Any) -> None:
        from pyarrow import parquet

        beside = path.with_suffix(".new")
        try:
            parquet.write_table(rows, beside, compression="zstd")
            beside.replace(path)
        except OSError as error:
            raise ConfigError(f"{path}: cannot write: {error.strerror or error}") from None


def _table(name: str, rows: list[Row]) -> Any:
    import pyarrow

    schema = pyarrow.schema([(column, pyarrow.type_for_alias(kind)) for column, kind in _TYPES[name].items()])
    return pyarrow.Table.from_pylist(rows, schema=schema.with_metadata({"schema": "gcs_health.fleet/1"}))
