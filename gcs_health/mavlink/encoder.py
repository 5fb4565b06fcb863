"""Values to MAVLink 2 frames: the other direction of `frames.py`, for one sender."""

import math
import struct
from collections.abc import Sequence
from typing import Any

from fastcrc.crc16 import mcrf4xx

from gcs_health.mavlink.dialect import Dialect, Message
from gcs_health.mavlink.framing import MAGIC_V2

_MAGIC = bytes((MAGIC_V2,))
_HEAD = struct.Struct("<BBBBBBHB")  # length, flags, sequence, sender, message id of three bytes

Field = float | int | bytes | str | Sequence[float] | Sequence[int]


class Encoder:
    """Counts the sequence of one (system, component) and packs its frames.

    Parameters
    ----------
    dialect : what can be sent.
    system, component : the sender.
    """

    def __init__(self, dialect: Dialect, system: int = 1, component: int = 1) -> None:
        self.sequence = 0
        self._of_name = {message.name: message for message in dialect.messages.values()}
        self._sender = (system, component)

    def frame(self, name: str, **fields: Field) -> bytes:
        """Return the next frame; fields left out are 0.

        Raises
        ------
        KeyError : no such message, or no such field in it.
        """
        message = self._of_name[name]
        frame = pack(message, payload_of(message, fields), self.sequence, *self._sender)
        self.sequence = (self.sequence + 1) & 0xFF
        return frame


def payload_of(message: Message, fields: dict[str, Any]) -> bytes:
    """Return the untruncated payload of these fields, wire units; arrays shorter than the message's end in 0."""
    scalars = message.scalars_of_zeros
    if scalars is not None and len(every := scalars | fields) == len(scalars):
        return message.layout.pack(*every.values())
    values: list[Any] = message.layout_of_zeros.copy()
    for name, value in fields.items():
        at, count = message.positions[name]
        if count:
            values[at : at + min(len(value), count)] = value[:count]
        else:
            values[at] = value.encode() if isinstance(value, str) else value
    return message.layout.pack(*values)


def pack(message: Message, payload: bytes, sequence: int, system: int, component: int) -> bytes:
    """Return a MAVLink 2 frame, unsigned; trailing zero bytes are cut as the standard asks, the first kept."""
    payload = payload.rstrip(b"\0") or payload[:1]
    id = message.id
    body = _HEAD.pack(len(payload), 0, 0, sequence, system, component, id & 0xFFFF, id >> 16) + payload
    crc = mcrf4xx(body + message.crc_extra_byte)
    return _MAGIC + body + crc.to_bytes(2, "little")


def pack_v1(message: Message, payload: bytes, like: bytes) -> bytes:
    """Return a MAVLink 1 frame with the header of the frame `like`, whose payload was as long."""
    body = like[1:6] + payload
    return like[:1] + body + mcrf4xx(body + bytes((message.crc_extra,))).to_bytes(2, "little")


def pack_v2(message: Message, payload: bytes, like: bytes) -> bytes:
    """Return an unsigned MAVLink 2 frame with the header of the frame `like`, and this payload, not cut."""
    body = bytes((len(payload), 0)) + like[3:10] + payload
    return like[:1] + body + mcrf4xx(body + bytes((message.crc_extra,))).to_bytes(2, "little")


def clipped(value: float, low: int, high: int) -> int:
    """Return the nearest whole number that the wire field holds; NaN becomes `high`, "not known"."""
    return high if math.isnan(value) else min(max(round(value), low), high)
