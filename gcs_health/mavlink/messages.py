"""Checked frames to samples in SI, in stream order; or to columns of raw wire fields."""

from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from gcs_health.mavlink.batch import FrameBatch, FrameColumns
from gcs_health.mavlink.blocks import rows
from gcs_health.mavlink.dialect import Dialect, Message
from gcs_health.mavlink.framing import Integers
from gcs_health.mavlink.message_table import OTHERS, TABLE, Row
from gcs_health.mavlink.rules import Columns, Integer, Names, Text, compiled
from gcs_health.samples import Other, Sample

_FEW_OF_A_KIND = 6  # of one message: below, frame by frame is faster than by column

# Messages with a vehicle stamp that become `Other`
_BOOT_MS_FIELDS = ("time_boot_ms", "event_time_boot_ms")


class MessageColumns(NamedTuple):
    """All frames of one message in a batch, in order.

    Attributes
    ----------
    at : (n,) number of each frame within the batch.
    receive_us, system, component : (n,) each.
    wire : (n,) structured array of `Message.dtype`, zero-padded, MAVLink's units.
    """

    at: Integers
    receive_us: Integers
    system: np.ndarray[Any, np.dtype[np.uint8]]
    component: np.ndarray[Any, np.dtype[np.uint8]]
    wire: Columns


class MessageDecoder:
    """Turns frames into samples; holds one compiled reader per message, no state of the stream."""

    def __init__(self, dialect: Dialect) -> None:
        self._dialect = dialect
        self._readers: dict[int, _Reader] = {}
        for id, row in TABLE.items():
            self._readers[id] = _SampleReader(dialect.messages[id], row)
        for id in OTHERS:
            if id in dialect.messages:
                self._readers[id] = _OtherReader(dialect.messages[id])

    def samples(self, batch: FrameBatch) -> list[Sample]:
        """Return the samples of a batch in its order; frames that no sample is made of are left out."""
        readers = self._readers
        if batch.few:
            return [
                reader.one(receive_us, system, component, payload)
                for receive_us, system, component, message, _, payload in batch.frames
                if (reader := readers.get(message)) is not None
            ]
        columns = batch.columns
        ordered: list[Sample | None] = [None] * len(batch)
        for id, at in _by_message(columns.message):
            reader = readers.get(id)
            if reader is None:
                continue
            if len(at) < _FEW_OF_A_KIND:
                self._one_by_one(columns, batch.data, at, reader, ordered)
                continue
            gathered = _gather(columns, batch.data, reader.message, at)
            for k, sample in zip(at.tolist(), reader.many(gathered), strict=True):
                ordered[k] = sample
        return [sample for sample in ordered if sample is not None]

    def columns(self, batch: FrameBatch, wanted: frozenset[int] | None = None) -> dict[int, MessageColumns]:
        """Return the wire fields of a batch by message id, of the ids `wanted` (None = all known)."""
        if not len(batch):
            return {}
        columns = batch.columns
        return {
            id: _gather(columns, batch.data, self._dialect.messages[id], at)
            for id, at in _by_message(columns.message)
            if id in self._dialect.messages and (wanted is None or id in wanted)
        }

    def _one_by_one(
        self, columns: FrameColumns, data: bytes, at: Integers, reader: "_Reader", out: list[Sample | None]
    ) -> None:
        for k in at.tolist():
            start = int(columns.payload[k])
            payload = data[start : start + int(columns.length[k])]
            sender = int(columns.system[k]), int(columns.component[k])
            out[k] = reader.one(int(columns.receive_us[k]), *sender, payload)


def _by_message(ids: Integers) -> list[tuple[int, Integers]]:
    small = ids.astype(np.uint16) if ids.max() < 1 << 16 else ids  # radix sort for small integers
    order = np.argsort(small, kind="stable")
    of = ids[order]
    edges = np.flatnonzero(np.diff(of)) + 1
    return [(int(ids[part[0]]), part) for part in np.split(order, edges)]


def _gather(columns: FrameColumns, data: bytes, message: Message, at: Integers) -> MessageColumns:
    """Copy the payloads of frames `at` into one zero-padded structured array."""
    size, start = message.size, columns.payload[at]
    length = columns.length[at]
    if start[-1] + size > len(data):  # the last payload may be shorter than its message
        data = data + bytes(size)
    block = rows(data, start, size)
    least = int(length.min())
    if least < size:  # what was cut off were zeros
        tail = block[:, least:]
        tail[np.arange(least, size) >= length[:, None]] = 0
    return MessageColumns(
        at,
        columns.receive_us[at],
        columns.system[at],
        columns.component[at],
        block.view(message.dtype)[:, 0],
    )


class _Reader:
    """One message's way into samples: one payload at a time, or many."""

    message: Message

    def one(self, receive_us: int, system: int, component: int, payload: bytes) -> Sample:
        raise NotImplementedError

    def many(self, columns: MessageColumns) -> list[Sample]:
        raise NotImplementedError


class _SampleReader(_Reader):
    """A row of the table, compiled."""

    def __init__(self, message: Message, row: Row) -> None:
        self.message = message
        self._type = row.sample
        self._many = [rule.many(message) for rule in row.rules]
        names: Names = {}
        head = ["system", "component", str(message.id), "receive_us"]
        fields = head + [rule.expression(message, names) for rule in row.rules]
        self._one = compiled(fields, names, "system, component, receive_us")
        self._size, self._layout = message.size, message.layout.unpack_from

    def one(self, receive_us: int, system: int, component: int, payload: bytes) -> Sample:
        if len(payload) < self._size:
            payload = payload.ljust(self._size, b"\0")
        # tuple.__new__ skips the NamedTuple's own constructor: a third of the time for 14 fields
        sample: Sample = _new(self._type, self._one(system, component, receive_us, self._layout(payload)))
        return sample

    def many(self, columns: MessageColumns) -> list[Sample]:
        head = (
            columns.system.tolist(),
            columns.component.tolist(),
            repeat(self.message.id),
            columns.receive_us.tolist(),
        )
        fields = zip(*head, *[read(columns.wire) for read in self._many], strict=False)
        return list(map(_new, repeat(self._type), fields))


class _OtherReader(_Reader):
    """A message that no estimator takes: its fields by name."""

    def __init__(self, message: Message) -> None:
        self.message = message
        self._layout = message.layout
        self._names = [name for name, _, _ in message.fields]
        names: Names = {}
        fields = [
            (Text(name) if kind == "char" else Integer(name)).expression(message, names)
            for name, kind, _ in message.fields
        ]
        self._values = compiled(fields, names)
        self._stamp = next((n for n in _BOOT_MS_FIELDS if n in message.positions), None)

    def one(self, receive_us: int, system: int, component: int, payload: bytes) -> Sample:
        raw = self._layout.unpack_from(payload.ljust(self.message.size, b"\0"))
        fields = dict(zip(self._names, self._values(raw), strict=True))
        time_us = fields[self._stamp] * 1000 if self._stamp else None
        return Other(system, component, self.message.id, receive_us, time_us, self.message.name, fields)

    def many(self, columns: MessageColumns) -> list[Sample]:
        flat, size = columns.wire.tobytes(), self.message.size
        heads = zip(
            columns.receive_us.tolist(), columns.system.tolist(), columns.component.tolist(), strict=True
        )
        return [self.one(*head, flat[k * size : (k + 1) * size]) for k, head in enumerate(heads)]


_new = tuple.__new__
