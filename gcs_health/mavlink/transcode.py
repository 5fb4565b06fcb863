"""What another log format holds, as the .tlog that a ground station would have written of it.

So the decoder, the clock and everything behind them meet a flight log of an autopilot as they meet any
other flight, a recorder or an evidence packet can keep it, and `gcs-health convert` has nothing left to do.
Frames are made by columns, a block at a time: the CRC over all rows at once, then each into its place.
"""

from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO, NamedTuple, cast

import numpy as np

from gcs_health.mavlink.crc import WORD, crc_of_rows
from gcs_health.mavlink.dialect import Message, default_dialect
from gcs_health.mavlink.framing import MAGIC_V2

Times = np.ndarray[Any, np.dtype[np.int64]]
Rows = np.ndarray[Any, np.dtype[Any]]

BLOCK = 8192  # frames
STAMP, HEADER, CRC = 8, 10, 2  # bytes
TEXT = 50  # bytes of one STATUSTEXT


class Stream(NamedTuple):
    """All frames of one message.

    Attributes
    ----------
    t_us : (n,) since boot, not decreasing.
    wire : (n,) structured array of the message's dtype, wire units.
    """

    message: Message
    t_us: Times
    wire: Rows


def stream(name: str, t_us: Any, **fields: Any) -> Stream:
    """Return a message's frames, sorted by time; fields left out are 0.

    Raises
    ------
    KeyError : no such message. ValueError : no such field.
    """
    message = _by_name()[name]
    t_us = np.atleast_1d(np.asarray(t_us, np.int64))
    wire = np.zeros(len(t_us), message.dtype)
    for field, value in fields.items():
        column = wire[field]
        value = np.asarray(value)
        if column.ndim == 2 and value.ndim and value.shape[-1] < column.shape[1]:
            column = column[:, : value.shape[-1]]
        column[...] = value
    order = np.argsort(t_us, kind="stable")
    return Stream(message, t_us[order], wire[order])


def texts(said: Sequence[tuple[int, int, str]]) -> Stream:
    """Return STATUSTEXT of (t_us, MAV_SEVERITY, text), long ones in chunks."""
    rows: list[tuple[int, int, bytes, int, int]] = []
    for number, (t_us, severity, text) in enumerate(said):
        data = text.encode("utf-8", "replace")
        parts = [data[k : k + TEXT] for k in range(0, max(len(data), 1), TEXT)]
        many = len(parts) > 1
        rows += [
            (t_us, severity, part, (number % 65535) + 1 if many else 0, k) for k, part in enumerate(parts)
        ]
    columns: list[Any] = [list(column) for column in zip(*rows, strict=True)] or [[]] * 5
    at, levels, part, id, seq = columns
    return stream("STATUSTEXT", at, severity=levels, text=np.array(part, f"S{TEXT}"), id=id, chunk_seq=seq)


def parameters(t_us: Any, names: Sequence[str], values: Any, kinds: Any) -> Stream:
    """Return PARAM_VALUE; `values` as the float32 that is sent, `kinds` MAV_PARAM_TYPE."""
    count = len(names)
    return stream(
        "PARAM_VALUE",
        t_us,
        param_id=np.array([name.encode() for name in names], "S16"),
        param_value=np.asarray(values, np.float32),
        param_type=kinds,
        param_index=np.minimum(np.arange(count), 65535),
        param_count=count,
    )


def heartbeats(t_us: Times, mav_type: int, autopilot: int, changes: Sequence[tuple[int, bool]]) -> Stream:
    """Return HEARTBEAT once a second over the span of `t_us`, and whenever (t_us, armed) changes."""
    at = np.sort(np.concatenate([_every_second(t_us), [t for t, _ in changes]]).astype(np.int64))
    armed = held(at, changes)
    return stream(
        "HEARTBEAT",
        at,
        type=mav_type,
        autopilot=autopilot,
        base_mode=np.where(armed, 129, 1),
        system_status=np.where(armed, 4, 3),
        mavlink_version=3,
    )


def landed_states(t_us: Times, changes: Sequence[tuple[int, bool]]) -> Stream:
    """Return EXTENDED_SYS_STATE once a second over the span of `t_us`, and whenever (t_us, landed) changes."""
    at = np.sort(np.concatenate([_every_second(t_us), [t for t, _ in changes]]).astype(np.int64))
    return stream("EXTENDED_SYS_STATE", at, landed_state=np.where(held(at, changes), 1, 2))


def hardware(t_us: int, uid: bytes) -> list[Stream]:
    """Return AUTOPILOT_VERSION with the hardware's uid; nothing if that is not known."""
    if not any(uid):
        return []
    return [stream("AUTOPILOT_VERSION", t_us, uid2=np.frombuffer(uid[:18].ljust(18, b"\0"), np.uint8))]


def held(at: Times, changes: Sequence[tuple[int, bool]]) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Return the state at each time; before the first change, what that one changed from."""
    times = np.array([t for t, _ in changes], np.int64)
    states = np.array([not changes[0][1], *(state for _, state in changes)], bool)
    found: np.ndarray[Any, np.dtype[np.bool_]] = states[np.searchsorted(times, at, side="right")]
    return found


def as_tlog(streams: Sequence[Stream], unix_us: int) -> BinaryIO:
    """Return the streams in order of time as a file of .tlog records; `unix_us` is the time of boot, 0 = unknown."""
    return cast(BinaryIO, _Generated(_blocks([s for s in streams if len(s.t_us)], unix_us)))


def _every_second(t_us: Times) -> Times:
    return np.arange(t_us.min(), t_us.max() + 1, 1_000_000)


def _by_name() -> dict[str, Message]:
    return {message.name: message for message in default_dialect().messages.values()}


def _blocks(streams: list[Stream], unix_us: int) -> Iterator[bytes]:
    """Yield the records of all streams, in order of time; of the same time in the order of `streams`."""
    t_us = np.concatenate([s.t_us for s in streams])
    which = np.repeat(np.arange(len(streams), dtype=np.int32), [len(s.t_us) for s in streams])
    order = np.argsort(t_us, kind="stable")
    t_us, which = t_us[order], which[order]
    lengths = np.array([STAMP + HEADER + s.message.size + CRC for s in streams])
    done = [0] * len(streams)
    for start in range(0, len(order), BLOCK):
        here = which[start : start + BLOCK]
        ends = np.cumsum(lengths[here])
        out = np.zeros(int(ends[-1]), np.uint8)
        for k, each in enumerate(streams):
            at = np.flatnonzero(here == k)
            if not len(at):
                continue
            rows = slice(done[k], done[k] + len(at))
            done[k] += len(at)
            records = _records(each.message, each.t_us[rows] + unix_us, each.wire[rows], start + at)
            out[(ends[at] - lengths[k])[:, None] + np.arange(lengths[k])] = records
        yield out.tobytes()


def _records(
    message: Message, stamp: Times, wire: Rows, number: np.ndarray[Any, Any]
) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return one record a row: stamp, MAVLink 2 frame of system 1, component 1, its payload not cut."""
    n, size = len(stamp), message.size
    id = message.id
    out = np.zeros((n, STAMP + HEADER + size + CRC), np.uint8)
    out[:, :STAMP] = stamp.astype(">u8").view(np.uint8).reshape(n, STAMP)
    out[:, STAMP : STAMP + HEADER] = (MAGIC_V2, size, 0, 0, 0, 1, 1, id & 0xFF, id >> 8 & 0xFF, id >> 16)
    out[:, STAMP + 4] = number & 0xFF
    out[:, STAMP + HEADER : -CRC] = np.ascontiguousarray(wire).view(np.uint8).reshape(n, size)
    checked = HEADER - 1 + size + 1  # from behind the magic byte on, and CRC_EXTRA
    block = np.zeros((n, -(-checked // WORD) * WORD), np.uint8)
    block[:, -checked:-1] = out[:, STAMP + 1 : -CRC]
    block[:, -1] = message.crc_extra
    crc = crc_of_rows(block, np.full(n, checked, np.intp))
    out[:, -CRC:] = crc.astype("<u2").view(np.uint8).reshape(n, CRC)
    return out


class _Generated:
    """Blocks that are made as they are read: `read` and `close` of a binary file."""

    def __init__(self, blocks: Iterator[bytes]) -> None:
        self._blocks = blocks
        self._rest = b""

    def read(self, size: int) -> bytes:
        """Return up to `size` bytes, none at the end."""
        if not self._rest:
            self._rest = next(self._blocks, b"")
        out, self._rest = self._rest[:size], self._rest[size:]
        return out

    def close(self) -> None:
        """Let go of what is left."""
        self._blocks, self._rest = iter(()), b""
