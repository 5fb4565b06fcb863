"""Many records of a .tlog at once: the same answers as `framing`, found by columns.

All places where a plausible stamp stands before a magic byte are candidates (in a clean log hardly more
than there are records). Their outlines and CRCs are worked out together, so that the decoder only has
to follow which candidate begins where another ends.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from gcs_health.mavlink.batch import FrameBatch, FrameColumns, headers, rows
from gcs_health.mavlink.crc import LONGEST, WORD, crc_of_rows
from gcs_health.mavlink.dialect import Dialect
from gcs_health.mavlink.framing import (
    LATEST_STAMP_BYTE,
    MAGIC_V2,
    SIGNATURE_LENGTH,
    SIGNED,
    STAMP_LENGTH,
    Integers,
    check,
)

Flags = np.ndarray[Any, np.dtype[np.bool_]]

LEAST_BYTES = 1 << 13  # below, frame by frame is faster
# Frames whose CRCs are worked out together, by bytes up to: a few long ones would make all rows long
_CLASSES = (0, 40, 80, LONGEST)
_FEW_ROWS = 100  # in a class: below, the C function, row by row, is faster
_MOST_ROWS = 1 << 14  # at once: what bounds the memory if there are candidates everywhere
_MARGIN = bytes(LONGEST)  # so that rows may reach beyond the data either way


class Records(NamedTuple):
    """Good records, in order of place; those inside another's payload among them.

    Attributes
    ----------
    places, ends : where each record begins (its stamp) and ends.
    breaks : numbers of those that the next does not follow directly.
    partial : places of those that reach beyond the data: good or not cannot be told yet.
    numbers : of each record among all candidates.
    columns : headers of all candidates.
    """

    places: Integers
    ends: Integers
    breaks: Integers
    partial: Integers
    numbers: Integers
    columns: FrameColumns

    def batch(self, data: bytes, runs: list[slice]) -> FrameBatch:
        """Return the frames of some runs of records."""
        starts = np.concatenate([self.places[run] for run in runs]) + STAMP_LENGTH
        columns = self.columns.choose(np.concatenate([self.numbers[run] for run in runs]))
        return FrameBatch(data, starts, columns.receive_us, columns=columns)

    def run(self, at: int) -> tuple[slice, int] | None:
        """Return the numbers of the good records on end from `at` on, and where they end; None if none."""
        k = int(self.places.searchsorted(at))
        if k == len(self.places) or self.places[k] != at:
            return None
        last = int(self.breaks[self.breaks.searchsorted(k)])
        return slice(k, last + 1), int(self.ends[last])

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
    magic = raw[STAMP_LENGTH:] - np.uint8(MAGIC_V2)
    places = np.flatnonzero(magic < 2)
    places = places[(raw[places] == 0) & (raw[places + 1] <= LATEST_STAMP_BYTE)]
    # a magic byte, its length and its flags must be there for an outline
    headless = places[places + STAMP_LENGTH + 2 >= len(data)]
    places = places[: len(places) - len(headless)]
    wide = b"".join((_MARGIN, data, _MARGIN))
    columns = headers(wide, len(_MARGIN), places + STAMP_LENGTH)
    ends = columns.payload + columns.length + 2
    ends[columns.flags & SIGNED > 0] += SIGNATURE_LENGTH
    whole = ends <= len(data)
    good = whole & (columns.flags <= SIGNED)
    _check(data, wide, places, columns, good, dialect)
    partial = np.concatenate([places[~whole], headless])
    numbers = np.flatnonzero(good)
    places, ends = places[numbers], ends[numbers]
    follows = np.zeros(len(places), dtype=np.bool_)
    follows[:-1] = ends[:-1] == places[1:]
    return Records(places, ends, np.flatnonzero(~follows), partial, numbers, columns)


def _check(
    data: bytes, wide: bytes, places: Integers, columns: FrameColumns, good: Flags, dialect: Dialect
) -> None:
    """Clear `good` where the id is not known or the CRC does not hold."""
    extra = dialect.extras.take(columns.message, mode="clip")
    good &= extra >= 0
    crc_at = columns.payload + columns.length
    length = crc_at - places - STAMP_LENGTH  # under the CRC: magic left out, CRC_EXTRA counted
    for least, most in pairwise(_CLASSES):
        chosen = np.flatnonzero(good & (length > least) & (length <= most))
        if len(chosen) < _FEW_ROWS:
            for k in chosen.tolist():
                good[k] = check(data, int(places[k]) + STAMP_LENGTH, dialect.crc_extra) is None
            continue
        for part in np.split(chosen, range(_MOST_ROWS, len(chosen), _MOST_ROWS)):
            good[part] = _holds(wide, crc_at[part], length[part], extra[part])


def _holds(wide: bytes, crc_at: Integers, length: Integers, extra: Any) -> Flags:
    """Whether the CRC holds of each frame (n,) whose CRC is at `crc_at` and covers `length` bytes."""
    end = crc_at + len(_MARGIN)
    width = -(-int(length.max()) // WORD) * WORD
    block = rows(wide, end + 1 - width, width)
    received = block[:, -1] | np.frombuffer(wide, np.uint8)[end + 1].astype(np.uint16) << 8
    block[:, -1] = extra  # in the place of the CRC's first byte
    holds: Flags = crc_of_rows(block, length) == received
    return holds
