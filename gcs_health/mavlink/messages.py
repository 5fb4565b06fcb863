"""Checked frames to samples in SI, in stream order; or to columns of raw wire fields."""

import operator
from collections.abc import Callable
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from gcs_health.mavlink.dialect import Dialect, Message
from gcs_health.mavlink.frames import FrameBatch, FrameColumns
from gcs_health.mavlink.framing import FEW, Integers, rows
from gcs_health.mavlink.message_table import OTHERS, TABLE, Row
from gcs_health.mavlink.rules import Columns
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
        if len(batch) < FEW:
            readers = self._readers
            return [
                reader.one(f.receive_us, f.system, f.component, f.payload)
                for f in batch
                if (reader := readers.get(f.message)) is not None
            ]
        columns = batch.columns
        ordered: list[Sample | None] = [None] * len(batch)
        for id, at in _by_message(columns.message):
            reader = self._readers.get(id)
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
    order = np.argsort(ids, kind="stable")
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
    short = length < size
    if short.any():
        block[short[:, None] & (np.arange(size) >= length[:, None])] = 0
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

    def _unpack(self, payload: bytes) -> tuple[Any, ...]:
        size = self.message.size
        if len(payload) < size:
            payload = payload + bytes(size - len(payload))
        return self.message.layout.unpack_from(payload)


class _SampleReader(_Reader):
    """A row of the table, compiled."""

    def __init__(self, message: Message, row: Row) -> None:
        self.message = message
        self._type = row.sample
        self._ones = [rule.one(message) for rule in row.rules]
        self._many = [rule.many(message) for rule in row.rules]

    def one(self, receive_us: int, system: int, component: int, payload: bytes) -> Sample:
        raw = self._unpack(payload)
        head = [system, component, self.message.id, receive_us]
        sample: Sample = tuple.__new__(self._type, head + [read(raw) for read in self._ones])
        return sample

    def many(self, columns: MessageColumns) -> list[Sample]:
        head = (
            columns.system.tolist(),
            columns.component.tolist(),
            repeat(self.message.id),
            columns.receive_us.tolist(),
        )
        fields = zip(*head, *[read(columns.wire) for read in self._many], strict=False)
        # tuple.__new__ skips the NamedTuple's own constructor: a third of the time for 14 fields
        return list(map(tuple.__new__, repeat(self._type), fields))


class _OtherReader(_Reader):
    """A message that no estimator takes: its fields by name."""

    def __init__(self, message: Message) -> None:
        self.message = message
        self._fields: list[tuple[str, Callable[..., Any]]] = []
        for name, kind, _ in message.fields:
            at, count = message.positions[name]
            pick = operator.itemgetter(slice(at, at + count) if count else at)
            self._fields.append((name, _text(pick) if kind == "char" else pick))
        self._stamp = next((n for n in _BOOT_MS_FIELDS if n in message.positions), None)

    def one(self, receive_us: int, system: int, component: int, payload: bytes) -> Sample:
        raw = self._unpack(payload)
        fields = {name: pick(raw) for name, pick in self._fields}
        time_us = fields[self._stamp] * 1000 if self._stamp else None
        return Other(system, component, self.message.id, receive_us, time_us, self.message.name, fields)

    def many(self, columns: MessageColumns) -> list[Sample]:
        flat, size = columns.wire.tobytes(), self.message.size
        heads = zip(
            columns.receive_us.tolist(), columns.system.tolist(), columns.component.tolist(), strict=True
        )
        return [self.one(*head, flat[k * size : (k + 1) * size]) for k, head in enumerate(heads)]


def _text(pick: Callable[..., Any]) -> Callable[..., str]:
    return lambda raw: pick(raw).split(b"\0", 1)[0].decode("utf-8", "replace")
