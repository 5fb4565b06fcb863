"""Where frames begin and end: pure functions over bytes. Knows MAVLink framing, not meaning.

    v1   FE len seq sys comp id       payload crc                 8 bytes besides the payload
    v2   FD len incompat compat seq sys comp id×3  payload crc    12, and 13 more if signed
    tlog 8-byte big-endian UNIX µs, then a frame; a stamp may head several frames

The CRC is CRC-16/MCRF4XX over all after the magic up to the payload's end, then one CRC_EXTRA byte.
Source: MAVLink developer guide, serialization and message signing.
"""

import re
from collections.abc import Sequence
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from fastcrc.crc16 import mcrf4xx

from gcs_health.mavlink.dialect import Dialect

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
SIGNED = 0x01  # the only incompatibility flag there is
SIGNATURE_LENGTH = 13
STAMP_LENGTH = 8
LATEST_STAMP_BYTE = 0x0E  # second byte of a stamp: 0x000E... µs is the year 2095
MAGIC = re.compile(b"[\xfd\xfe]")
FEW = 12  # frames below which plain Python beats numpy's fixed costs (benchmarks/decode.py)

Integers = np.ndarray[Any, np.dtype[np.int64]]


class Stop(Enum):
    """Why a walk ended."""

    LIMIT = "limit"
    INCOMPLETE = "incomplete"
    GARBAGE = "garbage"


class Fault(Enum):
    """Why a frame in its place is not kept."""

    CRC = "bad_crc"
    INCOMPAT = "unknown_incompat"
    UNDECIDED = "undecided"  # unknown id with nothing after it yet: not a fault, a wait


class Walk(NamedTuple):
    """A run of frames, each beginning where the last ended; nothing checked but the outline.

    Attributes
    ----------
    starts, ends : of each frame, magic byte to last byte.
    stamps : where each frame's stamp begins; -1 = the stamp of the frame before the first.
    next : where the next record should begin.
    """

    starts: list[int]
    ends: list[int]
    stamps: list[int]
    next: int
    stop: Stop


def walk(data: bytes, at: int, limit: int, stamped: bool) -> Walk:
    """Follow frame after frame from `at`, at most `limit` of them, trusting the lengths."""
    starts: list[int] = []
    ends: list[int] = []
    stamps: list[int] = []
    stop, end, stamp, lead = Stop.LIMIT, len(data), -1, STAMP_LENGTH if stamped else 0
    while len(starts) < limit:
        if at + lead >= end and (at >= end or data[at] < MAGIC_V2):
            stop = Stop.INCOMPLETE
            break
        start, magic = at, data[at]
        if magic < MAGIC_V2 and stamped:
            if magic or data[at + 1] > LATEST_STAMP_BYTE:
                stop = Stop.GARBAGE
                break
            start = at + STAMP_LENGTH
            magic = data[start]
        if magic == MAGIC_V2:
            if start + 2 >= end:
                stop = Stop.INCOMPLETE
                break
            after = start + data[start + 1] + (12 if not data[start + 2] & SIGNED else 12 + SIGNATURE_LENGTH)
        elif magic == MAGIC_V1:
            if start + 1 >= end:
                stop = Stop.INCOMPLETE
                break
            after = start + data[start + 1] + 8
        else:
            stop = Stop.GARBAGE
            break
        if after > end:
            stop = Stop.INCOMPLETE
            break
        if start != at:
            stamp = at
        starts.append(start)
        ends.append(after)
        stamps.append(stamp)
        at = after
    return Walk(starts, ends, stamps, at, stop)


def first_fault(data: bytes, run: Walk, dialect: Dialect, final: bool) -> tuple[int, Fault | None]:
    """Check a run; return how many frames are good before the first that is not, and what ails it.

    A frame of an unknown id has no CRC_EXTRA: it is let through if another outline follows it.
    """
    starts, ends = run.starts, run.ends
    if len(starts) < FEW:
        extra_of = dialect.crc_extra
        for k, (start, after) in enumerate(zip(starts, ends, strict=True)):
            fault = check(data, start, after, extra_of)
            if fault is Fault.UNDECIDED and (k + 1 < len(starts) or final):
                continue
            if fault is not None:
                return k, fault
        return len(starts), None
    return _first_fault_of_many(data, starts, ends, dialect, final)


def check(data: bytes, start: int, after: int, extra_of: dict[int, int]) -> Fault | None:
    """Check one whole frame; UNDECIDED for an id whose CRC_EXTRA is not known."""
    if data[start] == MAGIC_V2:
        incompat = data[start + 2]
        if incompat & ~SIGNED:
            return Fault.INCOMPAT
        message = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
        crc_at = after - 2 - (SIGNATURE_LENGTH if incompat else 0)
    else:
        message = data[start + 5]
        crc_at = after - 2
    extra = extra_of.get(message)
    if extra is None:
        return Fault.UNDECIDED
    crc = mcrf4xx(data[start + 1 : crc_at])
    byte = (extra ^ crc) & 0xFF
    byte ^= (byte << 4) & 0xFF
    crc = (crc >> 8) ^ (byte << 8) ^ (byte << 3) ^ (byte >> 4)
    return None if crc & 0xFFFF == data[crc_at] | data[crc_at + 1] << 8 else Fault.CRC


def _first_fault_of_many(
    data: bytes, starts: list[int], ends: list[int], dialect: Dialect, final: bool
) -> tuple[int, Fault | None]:
    raw = np.frombuffer(data, np.uint8)
    first = np.array(starts)
    v2 = raw[first] == MAGIC_V2
    flags = np.where(v2, raw[first + 2], 0).astype(np.int64)
    crc_at = np.array(ends) - 2 - SIGNATURE_LENGTH * (flags & SIGNED)
    place, known = _known(dialect, message_ids(raw, first, v2))
    # One C call a frame beats a table walked column by column: 0.2 against 0.35 µs (benchmarks/decode.py)
    crc = np.fromiter(
        map(mcrf4xx, [data[a + 1 : b] for a, b in zip(starts, crc_at.tolist(), strict=True)]),
        np.int64,
        len(starts),
    )
    byte = (dialect.extras[place] ^ crc) & 0xFF
    byte ^= (byte << 4) & 0xFF
    crc = ((crc >> 8) ^ (byte << 8) ^ (byte << 3) ^ (byte >> 4)) & 0xFFFF
    good = (crc == raw[crc_at] | raw[crc_at + 1].astype(np.int64) << 8) | ~known
    good &= (flags & ~SIGNED) == 0
    if not final and not known[-1] and good[-1]:
        good[-1] = False
    k = int(np.argmin(good))
    if good[k]:
        return len(starts), None
    return k, check(data, starts[k], ends[k], dialect.crc_extra)


def message_ids(raw: np.ndarray[Any, np.dtype[np.uint8]], first: Integers, v2: Any) -> Integers:
    """Message ids of the frames that begin at `first`."""
    low = np.where(v2, first + 7, first + 5)
    ids = raw[low].astype(np.int64)
    ids[v2] |= raw[first[v2] + 8].astype(np.int64) << 8 | raw[first[v2] + 9].astype(np.int64) << 16
    return ids


def _known(dialect: Dialect, ids: Integers) -> tuple[Integers, Any]:
    place = np.minimum(np.searchsorted(dialect.known_ids, ids), len(dialect.known_ids) - 1)
    return place, dialect.known_ids[place] == ids


def good_record(data: bytes, at: int, stamped: bool, extra_of: dict[int, int]) -> bool | None:
    """Whether a whole, checked frame stands at `at` (behind its stamp if `stamped`); None = not all there."""
    run = walk(data, at, 1, stamped)
    if not run.starts:
        return None if run.stop is Stop.INCOMPLETE else False
    return check(data, run.starts[0], run.ends[0], extra_of) is None


def hunt(
    data: bytes, at: int, stamped: bool, extra_of: dict[int, int], final: bool
) -> tuple[int, bool]:
    """Search from `at` for a record whose frame checks.

    Returns
    -------
    place : where the record begins, or from where to search on when more bytes are there.
    found : whether one stands there.

    Only a plausible stamp and a good CRC together count: 0xFD and 0xFE occur inside stamps and payloads.
    """
    lead = STAMP_LENGTH if stamped else 0
    for match in MAGIC.finditer(data, at + lead):
        record = match.start() - lead
        if stamped and (data[record] or data[record + 1] > LATEST_STAMP_BYTE):
            continue
        good = good_record(data, record, stamped, extra_of)
        if good:
            return record, True
        if good is None and not final:
            return record, False
    return max(at, len(data) - lead), False


def sequence_faults(last: int | None, seqs: Sequence[int]) -> tuple[int, int]:
    """Count what the sequence numbers of one sender say: frames lost, frames repeated.

    A step back by less than half the range is a late frame, not 200 lost ones.
    """
    lost = repeated = 0
    for seq in seqs:
        if last is not None:
            missing = (seq - last - 1) & 0xFF
            if missing == 0xFF:
                repeated += 1
            elif missing < 0x80:
                lost += missing
        last = seq
    return lost, repeated
