"""One MAVLink dialect as a value: ids, CRC_EXTRA and wire layout of every message we can check.

The stock part is pymavlink's `all` (some 350 messages: the more ids are known, the fewer frames pass
unchecked); ESC_STATUS, ESC_INFO and EVENT come from `dialects/esc.xml`, what we send ourselves from
`dialects/gcs_health.xml`.
"""

import struct
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np

from gcs_health.errors import DialectError

# CRC_EXTRA of the messages that no released dialect has (MAVLink common.xml)
_ESC_CRC_EXTRA = {290: 251, 291: 10, 410: 160}

_NUMPY = {
    "uint8_t": "u1",
    "int8_t": "i1",
    "uint16_t": "<u2",
    "int16_t": "<i2",
    "uint32_t": "<u4",
    "int32_t": "<i4",
    "uint64_t": "<u8",
    "int64_t": "<i8",
    "float": "<f4",
    "double": "<f8",
    "char": "S1",
}


@dataclass(frozen=True)
class Message:
    """One message's wire layout, extension fields included.

    Attributes
    ----------
    id, name, crc_extra : as in the dialect's XML.
    fields : (name, MAVLink type, array length or 0) in wire order.
    units : unit of a field by its name, where it has one.
    """

    id: int
    name: str
    crc_extra: int
    fields: tuple[tuple[str, str, int], ...]
    units: dict[str, str]

    @cached_property
    def layout(self) -> struct.Struct:
        """Little-endian struct; arrays unpack to single elements, char arrays to one bytes value."""
        codes = ""
        for _, kind, length in self.fields:
            code = {"char": "s", "float": "f", "double": "d"}.get(kind) or _INTEGER_CODE[kind]
            codes += f"{length or 1}{code}" if code == "s" or length else code
        return struct.Struct("<" + codes)

    @cached_property
    def crc_extra_byte(self) -> bytes:
        """Return CRC_EXTRA as the byte to put behind a frame's bytes."""
        return bytes((self.crc_extra,))

    @cached_property
    def layout_of_zeros(self) -> list[Any]:
        """Return what `layout` packs to an empty message: copy it before filling it in."""
        zeros: list[Any] = []
        for _, kind, length in self.fields:
            zeros += [b""] if kind == "char" else [0] * (length or 1)
        return zeros

    @cached_property
    def scalars_of_zeros(self) -> dict[str, int] | None:
        """Return every field at 0 in wire order, where all are plain numbers; None where any is not."""
        plain = all(kind != "char" and not length for _, kind, length in self.fields)
        return dict.fromkeys((name for name, _, _ in self.fields), 0) if plain else None

    @cached_property
    def positions(self) -> dict[str, tuple[int, int]]:
        """Return (first element, count) of each field in the unpacked tuple; count 0 = a scalar."""
        at, places = 0, {}
        for name, kind, length in self.fields:
            places[name] = (at, 0 if kind == "char" else length)
            at += 1 if kind == "char" or not length else length
        return places

    @cached_property
    def elements(self) -> int:
        """How many elements `layout` unpacks to."""
        return sum(max(count, 1) for _, count in self.positions.values())

    @cached_property
    def floats(self) -> frozenset[int]:
        """Which elements of the unpacked tuple are floats."""
        kinds = {name: kind for name, kind, _ in self.fields}
        return frozenset(
            at + k
            for name, (at, count) in self.positions.items()
            for k in range(max(count, 1))
            if kinds[name] in ("float", "double")
        )

    @cached_property
    def dtype(self) -> np.dtype[Any]:
        """Packed structured dtype of the whole payload."""
        return np.dtype([(name, *_numpy_field(kind, length)) for name, kind, length in self.fields])

    @cached_property
    def kept(self) -> np.ndarray[Any, Any]:
        """Return masks of the first k bytes of a payload, k = 0 to its size, each as one opaque item."""
        at = np.arange(self.size + 1)
        return np.where(at[:-1] < at[:, None], 0xFF, 0).astype(np.uint8).view(f"V{self.size}")[:, 0]

    @property
    def size(self) -> int:
        """Length of the untruncated payload [bytes]."""
        return self.layout.size


_INTEGER_CODE = {
    "uint8_t": "B",
    "int8_t": "b",
    "uint16_t": "H",
    "int16_t": "h",
    "uint32_t": "I",
    "int32_t": "i",
    "uint64_t": "Q",
    "int64_t": "q",
}


def _numpy_field(kind: str, length: int) -> tuple[Any, ...]:
    if kind == "char":
        return (f"S{length or 1}",)
    return (_NUMPY[kind], (length,)) if length else (_NUMPY[kind],)


@dataclass(frozen=True)
class Dialect:
    """All messages by id, and the CRC_EXTRA of each."""

    messages: dict[int, Message]

    @cached_property
    def crc_extra(self) -> dict[int, int]:
        """CRC_EXTRA by message id."""
        return {id: message.crc_extra for id, message in self.messages.items()}

    @cached_property
    def crc_extra_byte(self) -> dict[int, bytes]:
        """CRC_EXTRA as one byte to put behind a frame's bytes, by message id."""
        return {id: bytes([extra]) for id, extra in self.crc_extra.items()}

    @cached_property
    def extras(self) -> np.ndarray[Any, np.dtype[np.int16]]:
        """CRC_EXTRA by message id up to 65535, -1 for an id that is not known (none beyond is)."""
        table = np.full(1 << 16, -1, dtype=np.int16)
        for id, extra in self.crc_extra.items():
            table[id] = extra
        return table

    def name(self, message: int) -> str:
        """Return a message's name; "UNKNOWN_n" for an id that is not in the dialect."""
        known = self.messages.get(message)
        return known.name if known else f"UNKNOWN_{message}"


@cache
def default_dialect() -> Dialect:
    """Return pymavlink's `all` with ESC_INFO, ESC_STATUS, EVENT and our own messages added.

    Raises
    ------
    DialectError : the generated messages do not have the published CRC_EXTRA.
    """
    from pymavlink.dialects.v20 import all as stock

    from gcs_health.mavlink.generated import esc, gcs_health

    messages = {}
    for source in (stock, esc, gcs_health):
        for id, cls in source.mavlink_map.items():
            messages[id] = _message(id, cls)
    for id, extra in _ESC_CRC_EXTRA.items():
        if messages[id].crc_extra != extra:
            raise DialectError(
                f"{messages[id].name}: CRC_EXTRA {messages[id].crc_extra} instead of {extra}: "
                "regenerate with dialects/regenerate.py"
            )
    return Dialect(messages)


def _message(id: int, cls: Any) -> Message:
    kinds = dict(zip(cls.fieldnames, cls.fieldtypes, strict=True))
    lengths = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    fields = tuple((name, kinds[name], lengths[name]) for name in cls.ordered_fieldnames)
    return Message(id, cls.msgname, cls.crc_extra, fields, dict(cls.fieldunits_by_name))
