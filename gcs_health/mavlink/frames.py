"""Bytes to checked frames, in any chunking, sans I/O.

The decoder walks from frame to frame trusting lengths, checks all CRCs of the walk, keeps what stands
before the first fault and finds its way again behind it. What is dropped is counted by reason. Memory
is bounded by the caller's block: the only thing carried over is the unfinished record.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from gcs_health.mavlink.dialect import Dialect
from gcs_health.mavlink.framing import (
    FEW,
    MAGIC_V2,
    SIGNED,
    STAMP_LENGTH,
    Fault,
    Integers,
    Stop,
    first_fault,
    frame_end,
    good_record,
    hunt,
    message_ids,
    rows,
    sequence_faults,
    walk,
)
from gcs_health.mavlink.signing import Signatures

FIRST_RUN, LONGEST_RUN = 32, 4096  # frames walked before they are checked; grows while all is well


class Frame(NamedTuple):
    """One checked frame. `payload` is as sent: v2 senders cut trailing zero bytes."""

    receive_us: int
    system: int
    component: int
    message: int
    sequence: int
    payload: bytes


@dataclass(frozen=True)
class FrameBatch:
    """Frames in stream order, as places in `data`.

    Attributes
    ----------
    data : the bytes.
    starts : (n,) where each frame's magic byte stands.
    stamps : (n,) UNIX µs of each frame.
    """

    data: bytes
    starts: list[int]
    stamps: list[int]

    def __len__(self) -> int:
        return len(self.starts)

    def __iter__(self) -> Iterator[Frame]:
        data = self.data
        for start, stamp in zip(self.starts, self.stamps, strict=True):
            length = data[start + 1]
            if data[start] == MAGIC_V2:
                message = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
                payload = data[start + 10 : start + 10 + length]
                yield Frame(stamp, data[start + 5], data[start + 6], message, data[start + 4], payload)
            else:
                payload = data[start + 6 : start + 6 + length]
                yield Frame(
                    stamp, data[start + 3], data[start + 4], data[start + 5], data[start + 2], payload
                )

    def raw(self) -> Iterator[tuple[int, bytes]]:
        """Yield (stamp, frame as sent), for a recorder."""
        for start, stamp in zip(self.starts, self.stamps, strict=True):
            yield stamp, self.data[start : frame_end(self.data, start)]

    @cached_property
    def columns(self) -> "FrameColumns":
        """The headers as arrays, for many frames at once."""
        raw = np.frombuffer(self.data, np.uint8)
        first = np.array(self.starts, dtype=np.int64)
        v2 = raw[first] == MAGIC_V2
        shift = np.where(v2, 2, 0)
        return FrameColumns(
            raw=raw,
            receive_us=np.array(self.stamps, dtype=np.int64),
            system=raw[first + 3 + shift],
            component=raw[first + 4 + shift],
            message=message_ids(raw, first, v2),
            sequence=raw[first + 2 + shift],
            payload=first + np.where(v2, 10, 6),
            length=raw[first + 1].astype(np.int64),
            signed=v2 & (raw[first + 2] & SIGNED > 0),
        )

    def signed(self) -> list[int]:
        """Return which frames, by number, carry a signature."""
        if len(self) >= FEW:
            return np.flatnonzero(self.columns.signed).tolist()
        data = self.data
        return [k for k, s in enumerate(self.starts) if data[s] == MAGIC_V2 and data[s + 2] & SIGNED]

    def choose(self, numbers: list[int]) -> "FrameBatch":
        """Return the batch of these frames only."""
        return FrameBatch(self.data, [self.starts[k] for k in numbers], [self.stamps[k] for k in numbers])


class FrameColumns(NamedTuple):
    """Headers of n frames; `payload` is where each payload begins in `raw`, `length` its length."""

    raw: np.ndarray[Any, np.dtype[np.uint8]]
    receive_us: Integers
    system: np.ndarray[Any, np.dtype[np.uint8]]
    component: np.ndarray[Any, np.dtype[np.uint8]]
    message: Integers
    sequence: np.ndarray[Any, np.dtype[np.uint8]]
    payload: Integers
    length: Integers
    signed: np.ndarray[Any, np.dtype[np.bool_]]


@dataclass
class FrameCounters:
    """What came and what was dropped.

    Attributes
    ----------
    bytes, frames : received; kept.
    dropped : frames and bytes not kept, by reason: bad_crc, unknown_incompat, bad_signature, replayed
        (frames); garbage_bytes, truncated_bytes (bytes).
    unknown : kept unchecked, by message id that no dialect here knows.
    signed, unsigned : frames kept.
    lost, repeated : by sequence number, of each (system, component).
    """

    bytes: int = 0
    frames: int = 0
    dropped: Counter[str] = field(default_factory=Counter)
    unknown: Counter[int] = field(default_factory=Counter)
    signed: int = 0
    unsigned: int = 0
    lost: Counter[tuple[int, int]] = field(default_factory=Counter)
    repeated: Counter[tuple[int, int]] = field(default_factory=Counter)


class FrameDecoder:
    """Bytes in any chunking to checked frames.

    Parameters
    ----------
    dialect : what can be checked.
    stamped : the bytes are a .tlog; else a stream whose frames are stamped with `receive_us`.
    keys : 32-byte signing keys; with any given, frames signed wrongly or replayed are dropped.
    """

    def __init__(self, dialect: Dialect, *, stamped: bool, keys: tuple[bytes, ...] = ()) -> None:
        self.counters = FrameCounters()
        self._dialect = dialect
        self._stamped = stamped
        self._signatures = Signatures(keys) if keys else None
        self._rest = b""
        self._hunting = False
        self._stamp = 0
        self._sequence: dict[tuple[int, int], int] = {}

    def feed(self, data: bytes, receive_us: int = 0) -> FrameBatch:
        """Take bytes; return the frames they complete. `receive_us` [UNIX µs] stamps those of a stream."""
        self.counters.bytes += len(data)
        return self._decode(self._rest + data if self._rest else data, receive_us, final=False)

    def finish(self) -> FrameBatch:
        """End of input: nothing more will complete the rest."""
        batch = self._decode(self._rest, self._stamp, final=True)
        if self._rest:
            reason = "garbage_bytes" if self._hunting else "truncated_bytes"
            self.counters.dropped[reason] += len(self._rest)
            self._rest = b""
        return batch

    def _decode(self, data: bytes, receive_us: int, final: bool) -> FrameBatch:
        at, limit = 0, FIRST_RUN
        starts: list[int] = []
        bare: list[int] = []
        while at < len(data):
            if self._hunting:
                at, found = self._hunt(data, at, final)
                if not found:
                    break
            run = walk(data, at, limit, self._stamped)
            good, fault = first_fault(data, run, self._dialect, final) if run.starts else (0, None)
            bare += [len(starts) + k for k in run.bare if k < good]
            starts += run.starts[:good]
            if fault is None:
                at = run.next
                limit = min(2 * limit, LONGEST_RUN)
                if run.stop is Stop.INCOMPLETE and not (final and self._record_inside(data, at)):
                    break
                self._hunting = run.stop is not Stop.LIMIT
            else:
                at = frame_end(data, run.starts[good - 1]) if good else at
                limit = FIRST_RUN
                moved = self._pass_over(data, at, frame_end(data, run.starts[good]), fault, final)
                if moved is None:
                    break
                at = moved
        self._rest = data[at:]
        return self._keep(data, starts, bare, receive_us)

    def _hunt(self, data: bytes, at: int, final: bool) -> tuple[int, bool]:
        place, found = hunt(data, at, self._stamped, self._dialect.crc_extra, final)
        self.counters.dropped["garbage_bytes"] += place - at
        self._hunting = not found
        return place, found

    def _record_inside(self, data: bytes, at: int) -> bool:
        """Whether the unfinished end holds a whole record after all, under a length that lied."""
        return hunt(data, at, self._stamped, self._dialect.crc_extra, final=True)[1]

    def _pass_over(self, data: bytes, at: int, after: int, fault: Fault, final: bool) -> int | None:
        """Go past a faulty frame; return where to go on, None = wait for more bytes.

        If a good record follows it was the frame that was damaged, not its length: what its payload
        holds is never taken for a frame. Else its length is not to be trusted: hunt within it.
        """
        if fault is Fault.UNDECIDED:
            follows: bool | None = None
        elif after == len(data):
            follows = True if final else None
        else:
            follows = good_record(data, after, self._stamped, self._dialect.crc_extra)
        if follows is None and not final:
            return None
        self.counters.dropped[fault.value] += 1
        if follows:
            return after
        self._hunting = True
        self.counters.dropped["garbage_bytes"] += 1
        return at + 1

    def _keep(self, data: bytes, starts: list[int], bare: list[int], receive_us: int) -> FrameBatch:
        stamps = self._stamps(data, starts, bare) if self._stamped else [receive_us] * len(starts)
        batch = FrameBatch(data, starts, stamps)
        if not starts:
            return batch
        signed = batch.signed()
        if signed and self._signatures:
            batch, signed = self._verified(batch, signed)
        self.counters.frames += len(batch)
        self.counters.signed += len(signed)
        self.counters.unsigned += len(batch) - len(signed)
        self._count(batch)
        return batch

    def _stamps(self, data: bytes, starts: list[int], bare: list[int]) -> list[int]:
        if len(starts) < FEW:
            stamps = [int.from_bytes(data[s - STAMP_LENGTH : s], "big") for s in starts]
        else:
            stamps = rows(data, np.array(starts) - STAMP_LENGTH, STAMP_LENGTH).view(">u8")[:, 0].tolist()
        for k in bare:
            stamps[k] = stamps[k - 1] if k else self._stamp
        if stamps:
            self._stamp = stamps[-1]
        return stamps

    def _verified(self, batch: FrameBatch, signed: list[int]) -> tuple[FrameBatch, list[int]]:
        assert self._signatures is not None
        drop = set()
        for k in signed:
            start = batch.starts[k]
            verdict = self._signatures.verify(batch.data[start : frame_end(batch.data, start)])
            if verdict is not None:
                drop.add(k)
                self.counters.dropped[verdict] += 1
        return batch.choose([k for k in range(len(batch)) if k not in drop]), [
            k for k in signed if k not in drop
        ]

    def _count(self, batch: FrameBatch) -> None:
        if len(batch) < FEW:
            for frame in batch:
                self._count_sender((frame.system, frame.component), frame.sequence)
                if frame.message not in self._dialect.messages:
                    self.counters.unknown[frame.message] += 1
            return
        columns = batch.columns
        senders = columns.system.astype(np.int64) << 8 | columns.component
        for sender in np.unique(senders).tolist():
            sequences = columns.sequence[senders == sender].astype(np.int64)
            key = (sender >> 8, sender & 0xFF)
            self._count_sender(key, int(sequences[0]))
            lost, repeated = sequence_faults(sequences)
            if lost:
                self.counters.lost[key] += lost
            if repeated:
                self.counters.repeated[key] += repeated
            self._sequence[key] = int(sequences[-1])
        strange = columns.message[~np.isin(columns.message, self._dialect.known_ids)]
        self.counters.unknown.update(strange.tolist())

    def _count_sender(self, sender: tuple[int, int], sequence: int) -> None:
        missing = (sequence - self._sequence.get(sender, sequence - 1) - 1) & 0xFF
        if missing == 0xFF:
            self.counters.repeated[sender] += 1
        elif 0 < missing < 0x80:  # as in sequence_faults: a small step back is a late frame
            self.counters.lost[sender] += missing
        self._sequence[sender] = sequence
