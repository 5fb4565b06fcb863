"""How one field of a sample is read from a message's wire fields: the words of `message_table.py`.

Each rule is said once and applied two ways that agree to the last bit: to one unpacked payload
(`one`) and to a column of many (`many`). A rule without a column form of its own goes row by row.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_health.mavlink.dialect import Message

Raw = Sequence[Any]  # one payload unpacked by Message.layout
Columns = np.ndarray[Any, np.dtype[Any]]  # many, as a structured array of Message.dtype
One = Callable[[Raw], Any]
Many = Callable[[Columns], list[Any]]


class Rule:
    """Base: how to read one field of a sample."""

    def one(self, message: Message) -> One:
        """Return a function of one unpacked payload."""
        raise NotImplementedError

    def many(self, message: Message) -> Many:
        """Return a function of a structured array; row by row unless a rule knows better."""
        one, layout = self.one(message), message.layout
        return lambda columns: [one(layout.unpack(row)) for row in _rows(columns)]


def _rows(columns: Columns) -> list[bytes]:
    size = columns.dtype.itemsize
    flat = columns.tobytes()
    return [flat[k : k + size] for k in range(0, len(flat), size)]


@dataclass(frozen=True)
class Constant(Rule):
    """The same value for every message."""

    value: Any

    def one(self, message: Message) -> One:
        """See `Rule.one`."""
        return lambda raw: self.value

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""
        return lambda columns: [self.value] * len(columns)


@dataclass(frozen=True)
class Integer(Rule):
    """An integer as it is, or the four of an array."""

    field: str

    def one(self, message: Message) -> One:
        """See `Rule.one`."""
        at, count = message.positions[self.field]
        if count:
            return lambda raw: raw[at : at + count]
        return lambda raw: raw[at]

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""
        if message.positions[self.field][1]:
            return lambda columns: list(map(tuple, columns[self.field].tolist()))
        return lambda columns: columns[self.field].tolist()


@dataclass(frozen=True)
class Si(Rule):
    """A number brought to SI: value × scale + offset; `absent` on the wire becomes NaN."""

    field: str
    scale: float = 1.0
    absent: float | None = None
    offset: float = 0.0
    when: tuple[str, int] | None = None  # (bit field, bits): NaN unless one of the bits is set

    def one(self, message: Message) -> One:
        """See `Rule.one`."""
        at, scale, absent, offset = message.positions[self.field][0], self.scale, self.absent, self.offset
        if self.when is None:
            if absent is None:
                return lambda raw: raw[at] * scale + offset
            return lambda raw: math.nan if raw[at] == absent else raw[at] * scale + offset
        flags, bits = message.positions[self.when[0]][0], self.when[1]
        return lambda raw: raw[at] * scale + offset if raw[flags] & bits else math.nan

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""

        def column(columns: Columns) -> list[Any]:
            wire = columns[self.field]
            value = wire.astype(np.float64) * self.scale + self.offset
            if self.absent is not None:
                value[wire == self.absent] = math.nan
            if self.when is not None:
                value[columns[self.when[0]] & self.when[1] == 0] = math.nan
            result: list[Any] = value.tolist()
            return result

        return column


@dataclass(frozen=True)
class SiArray(Rule):
    """An array brought to SI as a tuple; likewise."""

    field: str
    scale: float = 1.0
    absent: float | None = None

    def one(self, message: Message) -> One:
        """See `Rule.one`."""
        at, count = message.positions[self.field]
        scale, absent = self.scale, self.absent
        if absent is None:
            return lambda raw: tuple([v * scale for v in raw[at : at + count]])
        return lambda raw: tuple([math.nan if v == absent else v * scale for v in raw[at : at + count]])

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""

        def column(columns: Columns) -> list[Any]:
            wire = columns[self.field]
            value = wire.astype(np.float64) * self.scale
            if self.absent is not None:
                value[wire == self.absent] = math.nan
            return list(map(tuple, value.tolist()))

        return column


@dataclass(frozen=True)
class Together(Rule):
    """Several scalar rules as one tuple."""

    rules: tuple[Rule, ...]

    def one(self, message: Message) -> One:
        """See `Rule.one`."""
        ones = [rule.one(message) for rule in self.rules]
        return lambda raw: tuple([one(raw) for one in ones])

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""
        manys = [rule.many(message) for rule in self.rules]
        return lambda columns: list(zip(*[many(columns) for many in manys], strict=True))


@dataclass(frozen=True)
class Text(Rule):
    """Characters up to the first NUL."""

    field: str

    def one(self, message: Message) -> One:
        """See `Rule.one`."""
        at = message.positions[self.field][0]
        return lambda raw: raw[at].split(b"\0", 1)[0].decode("utf-8", "replace").rstrip()


@dataclass(frozen=True)
class Computed(Rule):
    """Whatever takes more than a scale: a function of wire fields by name, applied row by row."""

    fields: tuple[str, ...]
    function: Callable[..., Any]

    def one(self, message: Message) -> One:
        """See `Rule.one`."""
        readers = [Integer(field).one(message) for field in self.fields]
        function = self.function
        return lambda raw: function(*[read(raw) for read in readers])
