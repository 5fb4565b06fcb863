"""Many records of a .tlog at once: the same answers as `framing`, found by columns.

All places where a plausible stamp stands before a magic byte are candidates (in a clean log hardly more
than there are records). Their outlines and CRCs are worked out together, so that the decoder only has
to follow which candidate begins where another ends.
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from gcs_health.mavlink.dialect import Dialect
from gcs_health.mavlink.framing import (
    LATEST_STAMP_BYTE,
    LONGEST_RECORD,
    MAGIC_V1,
    MAGIC_V2,
    SIGNATURE_LENGTH,
    SIGNED,
    STAMP_LENGTH,
    Integers,
    check,
    message_ids,
)

Bytes = np.ndarray[Any, np.dtype[np.uint8]]
Flags = np.ndarray[Any, np.dtype[np.bool_]]

LEAST_BYTES = 1 << 13  # below, frame by frame is faster
_FEW_ROWS = 24  # rows still unfinished below which the C function, row by row, is faster


def rows(data: bytes, at: Integers, width: int) -> Bytes:
    """Gather `width` bytes from each of the places `at`: (n, width), a copy; `data` must reach so far."""
    # one opaque item a row: copied whole, some 20 times as fast as byte by byte
    windows: np.ndarray[Any, Any] = np.ndarray(
        (len(data) - width + 1,), dtype=f"V{width}", buffer=data, strides=(1,)
    )
    return windows[at].view(np.uint8).reshape(len(at), width)


class Records(NamedTuple):
    """Good records, in order of place; those inside another's payload among them.

    Attributes
    ----------
    places, ends : where each record begins (its stamp) and ends.
    breaks : numbers of those that the next does not follow directly.
    partial : places of those that reach beyond the data: good or not cannot be told yet.
    """

    places: Integers
    ends: Integers
    breaks: Integers
    partial: Integers

    def run(self, at: int) -> tuple[Integers, int] | None:
        """Return the places of the good records on end from `at` on, and where they end; None if none."""
        k = int(self.places.searchsorted(at))
        if k == len(self.places) or self.places[k] != at:
            return None
        last = int(self.breaks[self.breaks.searchsorted(k)])
        return self.places[k : last + 1], int(self.ends[last])

    def hunt(self, at: int, length: int, final: bool) -> tuple[int, bool]:
        """Do as `framing.hunt` does, over data of `length` bytes."""
        good, partial = int(self.places.searchsorted(at)), int(self.partial.searchsorted(at))
        place = int(self.places[good]) if good < len(self.places) else length
        if partial < len(self.partial) and self.partial[partial] < place and not final:
            return int(self.partial[partial]), False
        if place < length:
            return place, True
        return max(at, length - STAMP_LENGTH), False


def find(data: bytes, dialect: Dialect) -> Records:
    """Find all good records in a piece of a .tlog."""
    raw = np.frombuffer(data, np.uint8)
    magic = raw[STAMP_LENGTH:]
    places = np.flatnonzero((magic == MAGIC_V2) | (magic == MAGIC_V1))
    places = places[(raw[places] == 0) & (raw[places + 1] <= LATEST_STAMP_BYTE)]
    # a magic byte, its length and its flags must be there for an outline
    headless = places[places + STAMP_LENGTH + 2 >= len(raw)]
    places = places[: len(places) - len(headless)]
    starts = places + STAMP_LENGTH
    v2 = raw[starts] == MAGIC_V2
    flags = np.where(v2, raw[starts + 2], 0)
    ends = starts + raw[starts + 1] + np.where(v2, 12, 8)
    ends[flags & SIGNED > 0] += SIGNATURE_LENGTH
    whole = ends <= len(raw)
    good = whole & (flags <= SIGNED)
    _check(data, starts, v2, good, dialect)
    partial, places, ends = np.concatenate([places[~whole], headless]), places[good], ends[good]
    follows = np.zeros(len(places), dtype=np.bool_)
    follows[:-1] = ends[:-1] == places[1:]
    return Records(places, ends, np.flatnonzero(~follows), partial)


def _check(data: bytes, starts: Integers, v2: Flags, good: Flags, dialect: Dialect) -> None:
    """Clear `good` where the id is not known or the CRC does not hold."""
    chosen = np.flatnonzero(good)
    if not len(chosen):
        return
    padded = data + bytes(LONGEST_RECORD)
    raw = np.frombuffer(padded, np.uint8)
    start, is_v2 = starts[chosen], v2[chosen]
    ids = message_ids(raw, start, is_v2)
    extra = dialect.extras.take(ids, mode="clip")
    length = raw[start + 1].astype(np.int64) + np.where(is_v2, 9, 5)  # bytes under the CRC, magic left out
    order = np.argsort((LONGEST_RECORD - length).astype(np.uint16), kind="stable")  # radix: small integers
    length = length[order]
    said = start[order] + 1 + length
    received = raw[said] | raw[said + 1].astype(np.uint16) << 8
    crc = _crc(padded, start[order] + 1, length, extra[order].astype(np.uint8))
    holds = np.empty(len(chosen), dtype=np.bool_)
    holds[order] = crc == received
    holds &= extra >= 0
    # the longest few were left to the C function
    for k in order[: _few(length)].tolist():
        holds[k] = check(data, int(start[k]), dialect.crc_extra) is None
    good[chosen] = holds


def _few(length: Integers) -> int:
    """How many of the longest rows are checked one by one: long and rare, columns do not pay."""
    return _FEW_ROWS if len(length) > 4 * _FEW_ROWS and length[0] > length[_FEW_ROWS] + 8 else 0


def _crc(data: bytes, at: Integers, length: Integers, extra: Bytes) -> np.ndarray[Any, np.dtype[np.uint16]]:
    """CRC-16/MCRF4XX of each row's bytes and its CRC_EXTRA; rows by falling length, the first few skipped."""
    skip = _few(length)
    at, length, extra = at[skip:], length[skip:], extra[skip:]
    steps = (length + 1) // 2  # two bytes a step, CRC_EXTRA included
    table, table_of_byte = _tables()
    block = rows(data, at, 2 * int(steps[0]) + 2)  # even: words stay aligned
    block[np.arange(len(at)), length] = extra
    words = np.ascontiguousarray(block[:, : 2 * int(steps[0])].view("<u2").T)
    active = np.searchsorted(-steps, -np.arange(int(steps[0])), side="left")
    crc = np.full(len(at), 0xFFFF, np.uint16)
    for word, n in zip(words, active.tolist(), strict=True):
        crc[:n] = table.take(crc[:n] ^ word[:n], mode="wrap")
    odd = np.flatnonzero(length % 2 == 0)  # with CRC_EXTRA an odd number of bytes: one is left
    last = extra[odd]
    crc[odd] = (crc[odd] >> 8) ^ table_of_byte[(crc[odd] & 0xFF) ^ last]
    return np.concatenate([np.zeros(skip, np.uint16), crc])


@cache
def _tables() -> tuple[np.ndarray[Any, np.dtype[np.uint16]], np.ndarray[Any, np.dtype[np.uint16]]]:
    """CRC-16/MCRF4XX (polynomial 0x1021 reflected) after two zero-CRC bytes as one word, and after one."""
    of_byte = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        of_byte = np.where(of_byte & 1, (of_byte >> 1) ^ 0x8408, of_byte >> 1).astype(np.uint16)
    word = np.arange(65536, dtype=np.uint16)
    once = (word >> 8) ^ of_byte[word & 0xFF]
    return ((once >> 8) ^ of_byte[once & 0xFF]).astype(np.uint16), of_byte
