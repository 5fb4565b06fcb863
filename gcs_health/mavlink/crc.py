"""CRC-16/MCRF4XX of many frames at once, by columns.

The CRC is the remainder of the message, as a polynomial over GF(2), modulo P = x^16 + x^12 + x^5 + 1. Over
GF(2) the square of a sum is the sum of the squares, so P divides x^(16 m) + x^(12 m) + x^(5 m) + 1 for
m = 1, 2, 4, 8, 16: a bit may be struck out if the bits 4 m, 11 m and 16 m places further on are flipped.
That strikes out the leading eight bytes of all frames with a few exclusive ors of whole columns. Once 16
bytes are left a table of all two-byte steps ends it. (The table for all bytes takes half as long again.)
"""

from functools import cache
from typing import Any, NamedTuple

import numpy as np

Bytes = np.ndarray[Any, np.dtype[np.uint8]]
Words = np.ndarray[Any, np.dtype[np.uint64]]
Crcs = np.ndarray[Any, np.dtype[np.uint16]]

WORD = 8  # bytes
LONGEST = 272  # bytes under a CRC: header, payload and CRC_EXTRA, 265, in whole words


def crc_of_rows(block: Bytes, length: np.ndarray[Any, np.dtype[np.intp]]) -> Crcs:
    """CRC-16/MCRF4XX of the last `length` (n,) bytes of each row; `block` (n, whole words) is spent."""
    tables = _tables()
    words = block.view("<u8")
    width = words.shape[1]
    words &= _last(tables.last, length, width)  # zeros in front change nothing
    column = np.ascontiguousarray(words.T)
    for k in range(width - 4):
        _strike_out_word(column, k)
    if width >= 4:
        column = column[-4:]
        _strike_out_two(column)
        column = column[2:]
    crc: Crcs = np.zeros(len(block), np.uint16)
    for word in column:
        for part in word.view("<u2").reshape(-1, 4).T:
            crc = tables.step.take(crc ^ part, mode="wrap")
    crc ^= tables.start[length]
    return crc


def _strike_out_word(column: Words, k: int) -> None:
    """Move word k into words k + 1 to k + 4: m = 16, by 64, 176 and 256 bits."""
    word = column[k]
    column[k + 1] ^= word
    column[k + 2] ^= word << np.uint64(48)
    column[k + 3] ^= word >> np.uint64(16)
    column[k + 4] ^= word


def _strike_out_two(column: Words) -> None:
    """Move the first two of four words into the others: m = 8, by 32, 88 and 128 bits."""
    for k in range(2):
        word = column[k]
        word ^= word << np.uint64(32)  # its own lower half first
        column[k + 1] ^= word >> np.uint64(32)
        column[k + 1] ^= word << np.uint64(24)
        column[k + 2] ^= word >> np.uint64(40)
        column[k + 2] ^= word


def _last(masks: Words, length: np.ndarray[Any, np.dtype[np.intp]], width: int) -> Words:
    """Masks (n, width) that keep the last `length` bytes."""
    part = np.ascontiguousarray(masks[:, masks.shape[1] - width :])
    opaque = part.view(f"V{WORD * width}")[:, 0]  # one item a row: copied whole
    masks_of_rows: Words = opaque[length].view(np.uint64).reshape(len(length), width)
    return masks_of_rows


class _Tables(NamedTuple):
    """Attributes
    ----------
    step : (65536,) CRC after two bytes, by CRC before ^ those two as a little-endian word.
    start : (LONGEST,) what starting from 0xFFFF instead of 0 changes in the CRC, by bytes.
    last : (LONGEST, LONGEST / 8) masks of the last so many bytes.
    """

    step: Crcs
    start: Crcs
    last: Words


@cache
def _tables() -> _Tables:
    of_byte = np.arange(256, dtype=np.uint16)
    for _ in range(8):
        of_byte = np.where(of_byte & 1, (of_byte >> 1) ^ 0x8408, of_byte >> 1).astype(np.uint16)
    word = np.arange(65536, dtype=np.uint16)
    once = (word >> 8) ^ of_byte[word & 0xFF]
    step = ((once >> 8) ^ of_byte[once & 0xFF]).astype(np.uint16)
    start = [0xFFFF]
    for _ in range(LONGEST - 1):
        start.append(start[-1] >> 8 ^ int(of_byte[start[-1] & 0xFF]))
    at = np.arange(LONGEST)
    last = np.where(at >= LONGEST - at[:, None], 0xFF, 0).astype(np.uint8).view(np.uint64)
    return _Tables(step, np.array(start, np.uint16), last)
