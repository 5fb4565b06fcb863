"""Where frames begin and end: pure functions over bytes. Knows MAVLink framing, not meaning.

    v1   FE len seq sys comp id       payload crc                 8 bytes besides the payload
    v2   FD len incompat compat seq sys comp id×3  payload crc    12, and 13 more if signed
    tlog 8-byte big-endian UNIX µs, then a frame; a stamp may head several frames

The CRC is CRC-16/MCRF4XX over all after the magic up to the payload's end, then one CRC_EXTRA byte.
Source: MAVLink developer guide, serialization and message signing.
"""

import re
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from fastcrc.crc16 import mcrf4xx

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
SIGNED = 0x01  # the only incompatibility flag there is
SIGNATURE_LENGTH = 13
STAMP_LENGTH = 8
LONGEST_RECORD = STAMP_LENGTH + 12 + 255 + SIGNATURE_LENGTH
MAGICS = (MAGIC_V1, MAGIC_V2)
LATEST_STAMP_BYTE = 0x0E  # second byte of a stamp: 0x000E... µs is the year 2095
MAGIC = re.compile(b"[\xfd\xfe]")

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
    UNKNOWN = "unknown_id"  # and what follows is no frame: neither is this one
    UNDECIDED = "undecided"  # unknown id with nothing after it yet: not a fault, a wait


class Walk(NamedTuple):
    """A run of frames, each beginning where the last ended; nothing checked but the outline.

    Attributes
    ----------
    starts : magic byte of each frame.
    bare : which of them (by number) stand in a .tlog without a stamp of their own.
    next : where the next record should begin.
    """

    starts: list[int]
    bare: list[int]
    next: int
    stop: Stop


def walk(data: bytes, at: int, limit: int, stamped: bool) -> Walk:
    """Follow frame after frame from `at`, at most `limit` of them, trusting the lengths."""
    starts: list[int] = []
    bare: list[int] = []
    end = len(data)
    while limit:
        start = _start(data, at, end, stamped)
        if isinstance(start, Stop):
            return Walk(starts, bare, at, start)
        if start + 2 >= end or (after := frame_end(data, start)) > end:
            return Walk(starts, bare, at, Stop.INCOMPLETE)
        if start == at and stamped:
            bare.append(len(starts))
        starts.append(start)
        at = after
        limit -= 1
    return Walk(starts, bare, at, Stop.LIMIT)


def _start(data: bytes, at: int, end: int, stamped: bool) -> int | Stop:
    """Where the frame of the record at `at` begins, behind its stamp if it has one."""
    if at >= end:
        return Stop.INCOMPLETE
    if data[at] in MAGICS:
        return at
    if not stamped or data[at]:
        return Stop.GARBAGE
    if at + STAMP_LENGTH >= end:
        return Stop.INCOMPLETE
    if data[at + 1] > LATEST_STAMP_BYTE or data[at + STAMP_LENGTH] not in MAGICS:
        return Stop.GARBAGE
    return at + STAMP_LENGTH


def frame_end(data: bytes, start: int) -> int:
    """Where the frame that begins at `start` ends, by its header (3 bytes of it must be there)."""
    if data[start] == MAGIC_V1:
        return start + data[start + 1] + 8
    return start + data[start + 1] + (12 + SIGNATURE_LENGTH if data[start + 2] & SIGNED else 12)


def first_fault(
    data: bytes, run: Walk, extra_of: dict[int, int], stamped: bool, final: bool
) -> tuple[int, Fault | None]:
    """Check a run; return how many frames are good before the first that is not, and what ails it."""
    for k, start in enumerate(run.starts):
        fault = check(data, start, extra_of)
        if fault is Fault.UNDECIDED:
            fault = _opaque(data, run, k, stamped, final)
        if fault is not None:
            return k, fault
    return len(run.starts), None


def _opaque(data: bytes, run: Walk, k: int, stamped: bool, final: bool) -> Fault | None:
    """Judge frame k of a run, whose unknown id has no CRC_EXTRA, by its neighbour: an outline must follow."""
    if k + 1 < len(run.starts):
        return None
    follows = walk(data, run.next, 1, stamped) if run.stop is Stop.LIMIT else run
    if follows.stop is Stop.GARBAGE:
        return Fault.UNKNOWN
    return Fault.UNDECIDED if follows.stop is Stop.INCOMPLETE and not final else None


def check(data: bytes, start: int, extra_of: dict[int, int]) -> Fault | None:
    """Check the whole frame at `start`; UNDECIDED for an id whose CRC_EXTRA is not known."""
    if data[start] == MAGIC_V2:
        incompat = data[start + 2]
        if incompat & ~SIGNED:
            return Fault.INCOMPAT
        message = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
        crc_at = start + 10 + data[start + 1]
    else:
        message = data[start + 5]
        crc_at = start + 6 + data[start + 1]
    extra = extra_of.get(message)
    if extra is None:
        return Fault.UNDECIDED
    crc = mcrf4xx(data[start + 1 : crc_at])
    byte = (extra ^ crc) & 0xFF
    byte ^= (byte << 4) & 0xFF
    crc = (crc >> 8) ^ (byte << 8) ^ (byte << 3) ^ (byte >> 4)
    return None if crc & 0xFFFF == data[crc_at] | data[crc_at + 1] << 8 else Fault.CRC


def good_record(data: bytes, at: int, stamped: bool, extra_of: dict[int, int]) -> bool | None:
    """Whether a whole, checked frame stands at `at` (behind its stamp if `stamped`); None = not all there."""
    run = walk(data, at, 1, stamped)
    if not run.starts:
        return None if run.stop is Stop.INCOMPLETE else False
    return check(data, run.starts[0], extra_of) is None


def hunt(data: bytes, at: int, stamped: bool, extra_of: dict[int, int], final: bool) -> tuple[int, bool]:
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


def sequence_faults(sequences: np.ndarray[Any, np.dtype[np.uint8]]) -> tuple[int, int]:
    """Count what one sender's sequence numbers (n,) say: frames lost, frames repeated.

    A step back by less than half the range is a late frame, not 200 lost ones.
    """
    missing = sequences[1:] - sequences[:-1] - np.uint8(1)  # modulo 256, as they are numbered
    odd = missing[missing > 0]
    return int(odd[odd < 0x80].sum()), int(np.count_nonzero(odd == 0xFF))
