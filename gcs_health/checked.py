"""Reading a user's TOML: every value checked, every complaint one line that names file and key."""

import dataclasses
import difflib
import math
import tomllib
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from gcs_health.errors import ConfigError

T = TypeVar("T")
_REQUIRED: Any = object()


class Table:
    """One table of a file; what was never asked for is unknown, and `done` says so."""

    def __init__(self, values: dict[str, Any], file: str, at: str = "") -> None:
        self._values = values
        self._file = file
        self._at = at
        self._asked: set[str] = set()

    @classmethod
    def read(cls, path: Path) -> "Table":
        """Read a file."""
        try:
            text = path.read_bytes().decode("utf-8")
        except UnicodeDecodeError:
            raise ConfigError(f"{path}: expected TOML, this is not text") from None
        except OSError as error:
            raise ConfigError(f"{path}: cannot read: {error.strerror}") from None
        return cls.parsed(text, str(path))

    @classmethod
    def parsed(cls, text: str, file: str) -> "Table":
        """Parse TOML."""
        try:
            return cls(tomllib.loads(text), file)
        except tomllib.TOMLDecodeError as error:
            raise ConfigError(f"{file}: not valid TOML: {error}") from None

    def fail(self, key: str, what: str) -> NoReturn:
        """Raise the one line."""
        raise ConfigError(f"{self._file}: {self._at}{key}: {what}")

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def keys(self) -> list[str]:
        """Return the keys that the file gives."""
        return list(self._values)

    def value(self, key: str, default: Any = _REQUIRED) -> Any:
        """Return a raw value."""
        self._asked.add(key)
        if key in self._values:
            return self._values[key]
        if default is _REQUIRED:
            near = difflib.get_close_matches(key, self._values, 1)
            self.fail(key, f"is missing{f'; is {near[0]!r} it?' if near else ''}")
        return default

    def schema(self, name: str) -> None:
        """Check the schema's name."""
        if self.value("schema", None) != name:
            self.fail("schema", f"expected {name!r}, got {self._values.get('schema')!r}")

    def number(
        self, key: str, default: Any = _REQUIRED, least: float = -math.inf, most: float = math.inf
    ) -> float:
        """Return a finite number, not below `least`, not above `most`."""
        value = self.value(key, default)
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            self.fail(key, f"expected a number, got {value!r}")
        if value < least:
            self.fail(key, f"expected a number from {least:g} on, got {value!r}")
        if value > most:
            self.fail(key, f"expected a number up to {most:g}, got {value!r}")
        return float(value)

    def positive(self, key: str, default: Any = _REQUIRED) -> float:
        """Return a number above 0."""
        value = self.number(key, default)
        if value <= 0.0:
            self.fail(key, f"expected a number above 0, got {value:g}")
        return value

    def integer(self, key: str, default: Any = _REQUIRED, least: int = 0) -> int:
        """Return a whole number, not below `least`."""
        value = self.value(key, default)
        if isinstance(value, bool) or not isinstance(value, int) or value < least:
            self.fail(key, f"expected a whole number from {least} on, got {value!r}")
        return int(value)

    def flag(self, key: str, default: Any = _REQUIRED) -> bool:
        """Return true or false."""
        value = self.value(key, default)
        if not isinstance(value, bool):
            self.fail(key, f"expected true or false, got {value!r}")
        return value

    def text(self, key: str, default: Any = _REQUIRED) -> str:
        """Return text."""
        value = self.value(key, default)
        if not isinstance(value, str):
            self.fail(key, f"expected text, got {value!r}")
        return value

    def choice(self, key: str, choices: tuple[str, ...], default: Any = _REQUIRED) -> str:
        """Return one of `choices`."""
        value = self.value(key, default)
        if value not in choices:
            near = difflib.get_close_matches(str(value), choices, 1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            self.fail(key, f"expected one of {', '.join(choices)}, got {value!r}{hint}")
        return str(value)

    def numbers(self, key: str, count: int, default: Any = _REQUIRED) -> list[float]:
        """Return a list of `count` numbers."""
        value = self.value(key, default)
        if not isinstance(value, list | tuple) or len(value) != count:
            self.fail(key, f"expected {count} numbers, got {value!r}")
        return [Table({"v": v}, self._file, f"{self._at}{key}[{k}]").number("v") for k, v in enumerate(value)]

    def vector(
        self, key: str, default: Any = _REQUIRED, positive: bool = False
    ) -> tuple[float, float, float]:
        """Return [x, y, z]."""
        x, y, z = self.numbers(key, 3, default)
        if positive and min(x, y, z) <= 0.0:
            self.fail(key, f"expected three numbers above 0, got {[x, y, z]}")
        return x, y, z

    def tables(self, key: str, least: int = 0, most: int = 1 << 30) -> list["Table"]:
        """Return the tables of an array."""
        rows = self.value(key, [])
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            self.fail(key, f"expected [[{self._at}{key}]] tables")
        if not least <= len(rows) <= most:
            self.fail(key, f"expected {least} to {most} of them, got {len(rows)}")
        return [Table(row, self._file, f"{self._at}{key}[{k}].") for k, row in enumerate(rows)]

    def table(self, key: str) -> "Table":
        """Return a table, empty if it is not there."""
        row = self.value(key, {})
        if not isinstance(row, dict):
            self.fail(key, f"expected a table, got {row!r}")
        return Table(row, self._file, f"{self._at}{key}.")

    def record(self, key: str, kind: type[T]) -> T:
        """Return a table of non-negative numbers as a dataclass; those without a default are required."""
        row = self.table(key)
        values: dict[str, Any] = {}
        for field in dataclasses.fields(kind):  # type: ignore[arg-type]
            required = field.default is dataclasses.MISSING
            values[field.name] = (
                row.positive(field.name) if required else row.number(field.name, field.default, least=0.0)
            )
        row.done()
        return kind(**values)

    def done(self) -> None:
        """Complain of keys that nobody asked for."""
        for key in self._values:
            if key not in self._asked:
                near = difflib.get_close_matches(key, self._asked, 1)
                known = f"known are {', '.join(sorted(self._asked))}"
                self.fail(key, f"unknown key; {f'did you mean {near[0]!r}?' if near else known}")
