"""Bytes to checked frames, in any chunking, sans I/O.

The decoder walks from frame to frame trusting lengths, keeps what checks up to the first fault and finds
its way again behind it. What is dropped is counted by reason. Memory is bounded by the caller's block:
the only thing carried over is the unfinished record.

Three ways with one result, chosen by what measures fastest (benchmarks/decode.py): a stream of good
frames is read in one loop; a large piece of a .tlog by columns (`blocks`); all else record by record
(`framing`).
"""

import struct
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from fastcrc.crc16 import mcrf4xx

from gcs_health.mavlink.batch import FEW, Frame, FrameBatch
from gcs_health.mavlink.blocks import LEAST_BYTES, Records, find, rows
from gcs_health.mavlink.dialect import Dialect
from gcs_health.mavlink.framing import (
    MAGIC_V2,
    STAMP_LENGTH,
    Fault,
    Integers,
    Stop,
    first_fault,
    frame_end,
    good_record,
    hunt,
    sequence_faults,
    walk,
)
from gcs_health.mavlink.signing import Signatures

RUN = 32  # frames walked before they are checked
_HEADER_V2 = struct.Struct("<BBBBBBBHB").unpack_from  # magic len incompat compat seq sys comp id(2+1)
_new = tuple.__new__


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
        self._extra_of = dialect.crc_extra
        self._extra_byte = {id: bytes([extra]) for id, extra in dialect.crc_extra.items()}
        self._stamped = stamped
        self._signatures = Signatures(keys) if keys else None
        self._rest = b""
        self._hunting = False
        self._stamp = 0
        self._sequence: dict[tuple[int, int], int] = {}

    def feed(self, data: bytes, receive_us: int = 0) -> FrameBatch:
        """Take bytes; return the frames they complete. `receive_us` [UNIX µs] stamps those of a stream."""
        self.counters.bytes += len(data)
        if self._rest:
            data = self._rest + data
        if not (self._stamped or self._hunting):
            batch = self._stream(data, receive_us)
            if batch is not None:
                return batch
        return self._decode(data, receive_us, final=False)

    def finish(self) -> FrameBatch:
        """End of input: nothing more will complete the rest."""
        batch = self._decode(self._rest, self._stamp, final=True)
        if self._rest:
            reason = "garbage_bytes" if self._hunting else "truncated_bytes"
            self.counters.dropped[reason] += len(self._rest)
            self._rest = b""
        return batch

    def _stream(self, data: bytes, receive_us: int) -> FrameBatch | None:
        """Read good, unsigned, known v2 frames on end, the last perhaps unfinished.

        None, and nothing done, for anything else: that is `_decode`'s.
        """
        at, end = 0, len(data)
        frames: list[Frame] = []
        starts: list[int] = []
        extra_byte = self._extra_byte
        while at < end:
            if end - at < 12:
                if data[at] != MAGIC_V2:
                    return None
                break
            magic, length, incompat, _, sequence, system, component, low, high = _HEADER_V2(data, at)
            if magic != MAGIC_V2 or incompat:
                return None
            crc_at = at + 10 + length
            if crc_at + 2 > end:
                break
            message = low | high << 16
            extra = extra_byte.get(message)
            if extra is None or (
                mcrf4xx(data[at + 1 : crc_at] + extra) != data[crc_at] | data[crc_at + 1] << 8
            ):
                return None
            frames.append(
                _new(Frame, (receive_us, system, component, message, sequence, data[at + 10 : crc_at]))
            )
            starts.append(at)
            at = crc_at + 2
        self._rest = data[at:]
        count = len(frames)
        counters, last = self.counters, self._sequence
        counters.frames += count
        counters.unsigned += count
        for _, system, component, _, sequence, _ in frames:
            sender = (system, component)
            if last.get(sender, sequence - 1) + 1 & 0xFF != sequence:
                self._count_gap(sender, sequence)
            last[sender] = sequence
        return FrameBatch(data, starts, [receive_us] * count, frames)

    def _decode(self, data: bytes, receive_us: int, final: bool) -> FrameBatch:
        at, count = 0, 0
        many = find(data, self._dialect) if self._stamped and len(data) >= LEAST_BYTES else None
        parts: list[list[int] | Integers] = []
        bare: list[int] = []  # frames, by number, that stand in a .tlog without a stamp of their own
        while at < len(data):
            if self._hunting:
                at, found = self._hunt(data, at, many, final)
                if not found:
                    break
            quick = many.run(at) if many is not None else None
            if quick is not None:
                parts.append(quick[0] + STAMP_LENGTH)
                count += len(quick[0])
                at = quick[1]
                continue
            run = walk(data, at, RUN if many is None else 1, self._stamped)
            good, fault = first_fault(data, run, self._extra_of, self._stamped, final)
            bare += [count + k for k in run.bare if k < good]
            parts.append(run.starts[:good])
            count += good
            if fault is None:
                at = run.next
                if run.stop is Stop.INCOMPLETE and not (final and self._record_inside(data, at)):
                    break
                self._hunting = run.stop is not Stop.LIMIT
            else:
                at = frame_end(data, run.starts[good - 1]) if good else at
                moved = self._pass_over(data, at, frame_end(data, run.starts[good]), fault, final)
                if moved is None:
                    break
                at = moved
        self._rest = data[at:]
        if count < FEW:
            return self._keep(data, [int(s) for part in parts for s in part], bare, receive_us)
        joined = np.concatenate([np.asarray(part, dtype=np.int64) for part in parts])
        return self._keep(data, joined, bare, receive_us)

    def _hunt(self, data: bytes, at: int, many: Records | None, final: bool) -> tuple[int, bool]:
        if many is not None:
            place, found = many.hunt(at, len(data), final)
        else:
            place, found = hunt(data, at, self._stamped, self._extra_of, final)
        self.counters.dropped["garbage_bytes"] += place - at
        self._hunting = not found
        return place, found

    def _record_inside(self, data: bytes, at: int) -> bool:
        """Whether the unfinished end holds a whole record after all, under a length that lied."""
        return hunt(data, at, self._stamped, self._extra_of, final=True)[1]

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
            follows = good_record(data, after, self._stamped, self._extra_of)
        if follows is None and not final:
            return None
        self.counters.dropped[fault.value] += 1
        if follows:
            return after
        self._hunting = True
        self.counters.dropped["garbage_bytes"] += 1
        return at + 1

    def _keep(
        self, data: bytes, starts: list[int] | Integers, bare: list[int], receive_us: int
    ) -> FrameBatch:
        if not len(starts):
            return FrameBatch(data, [], [])
        stamps = self._stamps(data, starts, bare) if self._stamped else [receive_us] * len(starts)
        batch = FrameBatch(data, starts, stamps)
        signed = batch.signed()
        if signed and self._signatures:
            batch, signed = self._verified(batch, signed)
        self.counters.frames += len(batch)
        self.counters.signed += len(signed)
        self.counters.unsigned += len(batch) - len(signed)
        self._count(batch)
        return batch

    def _stamps(self, data: bytes, starts: list[int] | Integers, bare: list[int]) -> list[int] | Integers:
        stamps: list[int] | Integers
        if isinstance(starts, list):
            stamps = [int.from_bytes(data[s - STAMP_LENGTH : s], "big") for s in starts]
        else:
            shifted = np.maximum(starts - STAMP_LENGTH, 0)  # only a bare frame can stand so near the start
            stamps = rows(data, shifted, STAMP_LENGTH).view(">u8")[:, 0].astype(np.int64)
        for k in bare:
            stamps[k] = stamps[k - 1] if k else self._stamp
        self._stamp = int(stamps[-1])
        return stamps

    def _verified(self, batch: FrameBatch, signed: list[int]) -> tuple[FrameBatch, list[int]]:
        assert self._signatures is not None
        drop = set()
        for k in signed:
            start = int(batch.starts[k])
            verdict = self._signatures.verify(batch.data[start : frame_end(batch.data, start)])
            if verdict is not None:
                drop.add(k)
                self.counters.dropped[verdict] += 1
        kept = [k for k in range(len(batch)) if k not in drop]
        return batch.choose(kept), [k for k in signed if k not in drop]

    def _count(self, batch: FrameBatch) -> None:
        if batch.few:
            for frame in batch.frames:
                sender = (frame.system, frame.component)
                self._count_gap(sender, frame.sequence)
                self._sequence[sender] = frame.sequence
                if frame.message not in self._extra_of:
                    self.counters.unknown[frame.message] += 1
            return
        columns = batch.columns
        senders = columns.system.astype(np.int64) << 8 | columns.component
        for key in np.flatnonzero(np.bincount(senders)).tolist():
            sequences = columns.sequence[senders == key].astype(np.int64)
            sender = (key >> 8, key & 0xFF)
            self._count_gap(sender, int(sequences[0]))
            lost, repeated = sequence_faults(sequences)
            if lost:
                self.counters.lost[sender] += lost
            if repeated:
                self.counters.repeated[sender] += repeated
            self._sequence[sender] = int(sequences[-1])
        for id in np.flatnonzero(np.bincount(columns.message)).tolist():
            if id not in self._extra_of:
                self.counters.unknown[id] += int(np.count_nonzero(columns.message == id))

    def _count_gap(self, sender: tuple[int, int], sequence: int) -> None:
        missing = (sequence - self._sequence.get(sender, sequence - 1) - 1) & 0xFF
        if missing == 0xFF:
            self.counters.repeated[sender] += 1
        elif 0 < missing < 0x80:  # as in sequence_faults: a small step back is a late frame
            self.counters.lost[sender] += missing
