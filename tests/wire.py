"""MAVLink frames and logs made by hand, for the tests of the decoder."""

import hashlib
import struct
from collections.abc import Iterable
from typing import Any

from pymavlink.dialects.v20 import all as stock

from gcs_health.mavlink.batch import Frame
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameCounters, FrameDecoder
from gcs_health.mavlink.generated import esc, gcs_health

DIALECT = default_dialect()
START_US = 1_700_000_000_000_000
UNKNOWN = 987_654  # an id that no dialect has
KEY = b"k" * 32


def crc(data: bytes, extra: int) -> bytes:
    """CRC-16/MCRF4XX bit by bit: not the decoder's own."""
    value = 0xFFFF
    for byte in (*data, extra):
        value ^= byte
        for _ in range(8):
            value = value >> 1 ^ 0x8408 if value & 1 else value >> 1
    return value.to_bytes(2, "little")


def v2(message: int, payload: bytes, seq: int = 0, system: int = 1, flags: int = 0, compat: int = 0) -> bytes:
    """A MAVLink 2 frame, its payload as given."""
    body = bytes([len(payload), flags, compat, seq, system, 1]) + message.to_bytes(3, "little") + payload
    return b"\xfd" + body + crc(body, DIALECT.crc_extra.get(message, 0))


def v1(message: int, payload: bytes, seq: int = 0, system: int = 1) -> bytes:
    """A MAVLink 1 frame."""
    body = bytes([len(payload), seq, system, 1, message]) + payload
    return b"\xfe" + body + crc(body, DIALECT.crc_extra[message])


def sign(message: int, payload: bytes, seq: int, stamp: int, key: bytes = KEY, link: int = 0) -> bytes:
    """A signed MAVLink 2 frame."""
    said = v2(message, payload, seq, flags=1) + bytes([link]) + stamp.to_bytes(6, "little")
    return said + hashlib.sha256(key + said).digest()[:6]


def record(frame: bytes, stamp: int = START_US) -> bytes:
    """One record of a .tlog."""
    return stamp.to_bytes(8, "big") + frame


def log(frames: Iterable[bytes], start: int = START_US) -> bytes:
    """A .tlog, a record a millisecond."""
    return b"".join(record(frame, start + 1000 * k) for k, frame in enumerate(frames))


def attitude(number: int) -> bytes:
    """An ATTITUDE payload that carries a number (its time_boot_ms)."""
    return DIALECT.messages[30].layout.pack(number, 0.5, 0, 0, 0, 0, 0.25)


def attitudes(count: int, first: int = 0) -> list[bytes]:
    """Good frames numbered from `first`."""
    return [v2(30, attitude(first + k), first + k & 0xFF) for k in range(count)]


def numbers(frames: Iterable[Frame]) -> list[int]:
    """The numbers of the ATTITUDEs."""
    return [struct.unpack_from("<I", frame.payload)[0] for frame in frames if frame.message == 30]


def decode(
    data: bytes, chunk: int = 1 << 18, *, stamped: bool = True, keys: tuple[bytes, ...] = ()
) -> tuple[list[Frame], FrameCounters]:
    """All frames of some bytes, fed `chunk` at a time."""
    decoder = FrameDecoder(DIALECT, stamped=stamped, keys=keys)
    frames = [f for at in range(0, len(data), chunk) for f in decoder.feed(data[at : at + chunk], START_US)]
    return frames + list(decoder.finish()), decoder.counters


def pymavlinks(message: int) -> Any:
    """The pymavlink module that knows a message: one of ours that its generator made, or its own."""
    return next((own for own in (esc, gcs_health) if message in own.mavlink_map), stock)
