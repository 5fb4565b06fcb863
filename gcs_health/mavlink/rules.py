"""How one field of a sample is read from a message's wire fields: the words of `message_table.py`.

Each rule is said once and applied two ways that agree to the last bit: as an expression over one
unpacked payload `r0, r1, …` (`expression`), compiled with its neighbours into one function a message, and over
a column of many (`many`). A rule without a column form of its own goes row by row.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gcs_health.mavlink.dialect import Message

Names = dict[str, Any]  # what an expression may call, by name
Columns = np.ndarray[Any, np.dtype[Any]]  # many payloads, as a structured array of Message.dtype
Many = Callable[[Columns], Sequence[Any]]
One = Callable[[int, int, int, bytes], Any]


def compiled(message: Message, expressions: Sequence[str], names: Names) -> Callable[[Sequence[Any]], Any]:
    """Return one function of an unpacked payload that gives all expressions as a tuple."""
    return _function("r", f"    {_elements(message)} = r\n    return ({', '.join(expressions)},)", names)


def compiled_sample(message: Message, kind: type, expressions: Sequence[str], names: Names) -> One:
    """Return one function of (receive_us, system, component, payload) that gives a sample of type `kind`.

    Compiled source and not a list of closures: it is what one-frame datagrams spend most of their time
    in, and takes a third as long (benchmarks/decode.py). The expressions are this module's own.
    `tuple.__new__` skips the NamedTuple's own constructor: a third of the time for 14 fields.
    """
    source = f"""
    if len(payload) < {message.size}:
        payload = payload.ljust({message.size}, zero)
    {_elements(message)} = unpack(payload)
    return new(kind, (system, component, {message.id}, receive_us, {", ".join(expressions)}))
    """
    more = {
        "len": len,
        "zero": b"\0",
        "unpack": message.layout.unpack_from,
        "new": tuple.__new__,
        "kind": kind,
    }
    return _function("receive_us, system, component, payload", source, names | more)


def _elements(message: Message) -> str:
    return "".join(f"r{k}, " for k in range(message.elements))


def _function(arguments: str, body: str, names: Names) -> Callable[..., Any]:
    scope: Names = {"__builtins__": {}, "nan": math.nan, **names}
    exec(f"def function({arguments}):\n{body}", scope)
    function: Callable[..., Any] = scope["function"]
    return function


class Rule:
    """Base: how to read one field of a sample."""

    def expression(self, message: Message, names: Names) -> str:
        """Return Python source over the unpacked payload `r`; functions it calls go into `names`."""
        raise NotImplementedError

    def many(self, message: Message) -> Many:
        """Return a function of a structured array; row by row unless a rule knows better."""
        names: Names = {}
        one, layout = compiled(message, [self.expression(message, names)], names), message.layout
        return lambda columns: [one(row)[0] for row in layout.iter_unpack(columns.tobytes())]


@dataclass(frozen=True)
class Constant(Rule):
    """The same value for every message."""

    value: int | float | None

    def expression(self, message: Message, names: Names) -> str:
        """See `Rule.expression`."""
        return repr(self.value)

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""
        return lambda columns: [self.value] * len(columns)


@dataclass(frozen=True)
class Integer(Rule):
    """An integer as it is, or all of an array as a tuple."""

    field: str

    def expression(self, message: Message, names: Names) -> str:
        """See `Rule.expression`."""
        at, count = message.positions[self.field]
        return f"({', '.join(f'r{at + k}' for k in range(count))},)" if count else f"r{at}"

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""
        count = message.positions[self.field][1]
        if count:
            return lambda columns: _tuples(columns[self.field])
        return lambda columns: columns[self.field].tolist()


@dataclass(frozen=True)
class Thousandfold(Rule):
    """Milliseconds as whole microseconds."""

    field: str

    def expression(self, message: Message, names: Names) -> str:
        """See `Rule.expression`."""
        return f"r{message.positions[self.field][0]} * 1000"

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""
        return lambda columns: (columns[self.field].astype(np.int64) * 1000).tolist()


@dataclass(frozen=True)
class Si(Rule):
    """A number brought to SI: value × scale; `absent` on the wire becomes NaN."""

    field: str
    scale: float = 1.0
    absent: float | None = None
    when: tuple[str, int] | None = None  # (bit field, bits): NaN unless one of the bits is set

    def expression(self, message: Message, names: Names) -> str:
        """See `Rule.expression`."""
        value = _scaled(message, message.positions[self.field][0], self.scale, self.absent)
        if self.when is not None:
            value = f"({value} if r{message.positions[self.when[0]][0]} & {self.when[1]} else nan)"
        return value

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""

        def column(columns: Columns) -> Sequence[Any]:
            value = _in_si(columns[self.field], self.scale, self.absent)
            if self.when is not None:
                missing = columns[self.when[0]] & self.when[1] == 0
                if missing.any():
                    value[missing] = math.nan
            return value.tolist()  # type: ignore[no-any-return]

        return column


@dataclass(frozen=True)
class SiArray(Rule):
    """An array brought to SI as a tuple; likewise."""

    field: str
    scale: float = 1.0
    absent: float | None = None

    def expression(self, message: Message, names: Names) -> str:
        """See `Rule.expression`."""
        at, count = message.positions[self.field]
        return f"({', '.join(_scaled(message, at + k, self.scale, self.absent) for k in range(count))},)"

    def many(self, message: Message) -> Many:
        """See `Rule.many`."""
        return lambda columns: _tuples(_in_si(columns[self.field], self.scale, self.absent))


@dataclass(frozen=True)
class Together(Rule):
    """Several rules as one tuple."""

    rules: tuple[Rule, ...]

    def expression(self, message: Message, names: Names) -> str:
        """See `Rule.expression`."""
        return f"({', '.join(rule.expression(message, names) for rule in self.rules)},)"


@dataclass(frozen=True)
class Text(Rule):
    """Characters up to the first NUL."""

    field: str

    def expression(self, message: Message, names: Names) -> str:
        """See `Rule.expression`."""
        names["text"] = text
        return f"text(r{message.positions[self.field][0]})"


@dataclass(frozen=True)
class Computed(Rule):
    """Whatever takes more than a scale: a function of wire fields by name."""

    fields: tuple[str, ...]
    function: Callable[..., Any]

    def expression(self, message: Message, names: Names) -> str:
        """See `Rule.expression`."""
        name = f"f{len(names)}"
        names[name] = self.function
        return f"{name}({', '.join(Integer(field).expression(message, names) for field in self.fields)})"


def text(raw: bytes) -> str:
    """Return the characters before the first NUL; what is not UTF-8 is replaced."""
    return raw.split(b"\0", 1)[0].decode("utf-8", "replace").rstrip()


def _scaled(message: Message, at: int, scale: float, absent: float | None) -> str:
    value = f"r{at}"
    if scale != 1.0 or at not in message.floats:
        value += f" * {scale!r}"  # × 1.0 makes a float of an integer
    return value if absent is None else f"(nan if r{at} == {absent!r} else {value})"


def _in_si(wire: np.ndarray[Any, Any], scale: float, absent: float | None) -> np.ndarray[Any, Any]:
    value = wire.astype(np.float64)
    if scale != 1.0:
        value *= scale
    if absent is not None:
        value[wire == absent] = math.nan
    return value


def _tuples(array: np.ndarray[Any, np.dtype[Any]]) -> list[Any]:
    """Rows of (n, k) as tuples: one flat list dealt k by k, half the time of tuple() over each row."""
    flat = iter(array.ravel().tolist())
    return list(zip(*[flat] * array.shape[1], strict=True))
