"""Checked frames to samples in SI, in stream order; or to columns of raw wire fields."""

from itertools import repeat
from typing import Any, NamedTuple

import numpy as np

from gcs_health.mavlink.batch import FEW, FrameBatch, grouped, items
from gcs_health.mavlink.dialect import Dialect, Message
from gcs_health.mavlink.framing import Integers
from gcs_health.mavlink.message_table import OTHERS, TABLE, Row
from gcs_health.mavlink.rules import Columns, Integer, Names, One, Text, compiled, compiled_sample
from gcs_health.samples import Other, Sample, new_tuple

_FEW_OF_A_KIND = 20  # of one message: below, one by one is faster than by column (benchmarks/decode.py)

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
        self._readers: dict[int, _SampleReader | _OtherReader] = {}
        for id, row in TABLE.items():
            self._readers[id] = _SampleReader(dialect.messages[id], row)
        for id in OTHERS:
            if id in dialect.messages:
                self._readers[id] = _OtherReader(dialect.messages[id])
        self._one: dict[int, One] = {id: reader.one for id, reader in self._readers.items()}

    def samples(self, batch: FrameBatch) -> list[Sample]:
        """Return the samples of a batch in its order; frames that no sample is made of are left out."""
        samples: list[Sample] = []
        heads = batch.listed
        if heads is None and len(batch) < FEW:
            heads = batch.heads
        if heads is not None:
            one_of = self._one
            for receive_us, system, component, message, _, payload in heads:
                one = one_of.get(message)
                if one is not None:
                    samples.append(one(receive_us, system, component, payload))
            return samples
        kinds = _Sorted(batch)
        rank = np.full(len(batch), -1)  # of each frame's sample
        for id, group in kinds.groups:
            reader = self._readers.get(id)
            if reader is not None:
                rank[kinds.order[group]] = np.arange(len(samples), len(samples) + group.stop - group.start)
                samples += reader.many(kinds.gather(reader.message, group))
        return list(map(samples.__getitem__, rank[rank >= 0].tolist()))

    def columns(self, batch: FrameBatch, wanted: frozenset[int] | None = None) -> dict[int, MessageColumns]:
        """Return the wire fields of a batch by message id, of the ids `wanted` (None = all known)."""
        if not len(batch):
            return {}
        kinds = _Sorted(batch)
        return {
            id: kinds.gather(self._dialect.messages[id], group)
            for id, group in kinds.groups
            if id in self._dialect.messages and (wanted is None or id in wanted)
        }


class _Sorted:
    """The frames of a batch, those of one message on end.

    Attributes
    ----------
    order : (n,) number of each frame within the batch.
    groups : each message id and where its frames stand in that order.
    """

    def __init__(self, batch: FrameBatch) -> None:
        columns = batch.columns
        self.order, self.groups = grouped(columns.message)
        self._data = batch.data + bytes(255)  # a payload may be shorter than its message
        self._payload, self._length = columns.payload[self.order], columns.length[self.order]
        self._receive_us = columns.receive_us[self.order]
        self._system, self._component = columns.system[self.order], columns.component[self.order]

    def gather(self, message: Message, group: slice) -> MessageColumns:
        """Copy the payloads of one message into one zero-padded structured array."""
        wire = items(self._data, self._payload[group], message.size)
        length = self._length[group]
        if length.min() < message.size:  # what was cut off were zeros
            flat = wire.view(np.uint8)
            flat &= message.kept.take(length, mode="clip").view(np.uint8)
        return MessageColumns(
            self.order[group],
            self._receive_us[group],
            self._system[group],
            self._component[group],
            wire.view(message.dtype),
        )


class _SampleReader:
    """A row of the table, compiled: one message's way into samples, one payload at a time or many."""

    def __init__(self, message: Message, row: Row) -> None:
        self.message = message
        self._type = row.sample
        self._many = [rule.many(message) for rule in row.rules]
        names: Names = {}
        fields = [rule.expression(message, names) for rule in row.rules]
        self.one = compiled_sample(message, row.sample, fields, names)

    def many(self, columns: MessageColumns) -> list[Sample]:
        if len(columns.at) < _FEW_OF_A_KIND:
            return _singly(self.one, columns)
        head = (
            columns.system.tolist(),
            columns.component.tolist(),
            repeat(self.message.id),
            columns.receive_us.tolist(),
        )
        fields = zip(*head, *[read(columns.wire) for read in self._many], strict=False)
        return list(map(new_tuple, repeat(self._type), fields))


class _OtherReader:
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
        self._values = compiled(message, fields, names)
        self._stamp = next((n for n in _BOOT_MS_FIELDS if n in message.positions), None)

    def one(self, receive_us: int, system: int, component: int, payload: bytes) -> Sample:
        raw = self._layout.unpack_from(payload.ljust(self.message.size, b"\0"))
        fields = dict(zip(self._names, self._values(raw), strict=True))
        time_us = fields[self._stamp] * 1000 if self._stamp else None
        return Other(system, component, self.message.id, receive_us, time_us, self.message.name, fields)

    def many(self, columns: MessageColumns) -> list[Sample]:
        return _singly(self.one, columns)


def _singly(one: One, columns: MessageColumns) -> list[Sample]:
    payloads = columns.wire.view(f"V{columns.wire.itemsize}").tolist()
    return list(
        map(one, columns.receive_us.tolist(), columns.system.tolist(), columns.component.tolist(), payloads)
    )
