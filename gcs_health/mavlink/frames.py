"""Bytes to checked frames, in any chunking, sans I/O.

The decoder walks from frame to frame trusting lengths, keeps what checks up to the first fault and finds
its way again behind it. What is dropped is counted by reason. Memory is bounded by the caller's block:
the only thing carried over is the unfinished record.

Three ways with one result, chosen by what measures fastest (benchmarks/decode.py): a stream of good
frames is read in one loop, all in `feed`, because a call more shows in one-frame datagrams; a large
piece of a .tlog by columns (`blocks`); all else record by record (`framing`).
"""

import struct
from collections import Counter
from dataclasses import dataclass, field

import numpy as np
from fastcrc.crc16 import mcrf4xx

from gcs_health.mavlink.batch import FEW, FrameBatch, Head, grouped, rows
from gcs_health.mavlink.blocks import LEAST_BYTES, Records, find
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
_HEADER_V2 = struct.Struct("<BBBxBBBI").unpack_from  # magic len incompat seq sys comp id (and one byte more)


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
    lost: Counter[tuple[int, int]] = field(default_factory=Counter)
    repeated: Counter[tuple[int, int]] = field(default_factory=Counter)

    @property
    def unsigned(self) -> int:
        """Frames kept that carry no signature."""
        return self.frames - self.signed


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
        self._extra_byte = dialect.crc_extra_byte
        self._stamped = stamped
        self._signatures = Signatures(keys) if keys else None
        self._rest = b""
        self._hunting = False
        self._stamp = 0
        self._due: dict[tuple[int, int], int] = {}  # next sequence number of each sender

    def feed(self, data: bytes, receive_us: int = 0) -> FrameBatch:
        """Take bytes; return the frames they complete. `receive_us` [UNIX µs] stamps those of a stream.

        Here good, unsigned, known v2 frames on end of a stream are read, the last perhaps unfinished.
        Anything else is left to `_decode`, from the beginning.
        """
        counters = self.counters
        counters.bytes += len(data)
        if self._rest:
            data = self._rest + data
        if self._stamped or self._hunting:
            return self._decode(data, receive_us, final=False)
        at, left = 0, len(data)
        heads: list[Head] = []
        extra_byte = self._extra_byte
        while left >= 12:
            magic, length, incompat, sequence, system, component, message = _HEADER_V2(data, at)
            if magic != MAGIC_V2 or incompat:
                return self._decode(data, receive_us, final=False)
            left -= length + 12
            if left < 0:
                break
            payload_at, crc_at, message = at + 10, at + 10 + length, message & 0xFFFFFF
            extra = extra_byte.get(message)
            if extra is None or (
                mcrf4xx(data[at + 1 : crc_at] + extra) != data[crc_at] | data[crc_at + 1] << 8
            ):
                return self._decode(data, receive_us, final=False)
            heads.append((receive_us, system, component, message, sequence, data[payload_at:crc_at]))
            at = crc_at + 2
        if left and data[at] != MAGIC_V2:
            return self._decode(data, receive_us, final=False)
        self._rest = data[at:]
        counters.frames += len(heads)
        due = self._due
        for _, system, component, _, sequence, _ in heads:
            sender = system, component
            if due.get(sender) != sequence:
                self._count_gap(sender, sequence)
            due[sender] = sequence + 1 & 0xFF
        return FrameBatch(data, None, None, heads)

    def finish(self) -> FrameBatch:
        """End of input: nothing more will complete the rest."""
        batch = self._decode(self._rest, self._stamp, final=True)
        if self._rest:
            reason = "garbage_bytes" if self._hunting else "truncated_bytes"
            self.counters.dropped[reason] += len(self._rest)
            self._rest = b""
        return batch

    def _decode(self, data: bytes, receive_us: int, final: bool) -> FrameBatch:
        at, count = 0, 0
        many = find(data, self._dialect) if self._stamped and len(data) >= LEAST_BYTES else None
        runs: list[slice] = []  # of the records in `many`
        parts: list[list[int] | Integers] = []  # where all frames start, those of `runs` among them
        bare: list[int] = []  # frames, by number, that stand in a .tlog without a stamp of their own
        while at < len(data):
            if self._hunting:
                at, found = self._hunt(data, at, many, final)
                if not found:
                    break
            if many is not None and (quick := many.run(at)) is not None:
                numbers, at = quick
                runs.append(numbers)
                parts.append(many.places[numbers] + STAMP_LENGTH)
                count += len(parts[-1])
                continue
            run = walk(data, at, RUN if many is None else 1, self._stamped)
            good, fault = first_fault(data, run, self._extra_of, self._stamped, final)
            bare += [count + k for k in run.bare if k < good]
            parts += [run.starts[:good]] if good else []
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
        if many is not None and count >= FEW and len(runs) == len(parts):
            batch = many.batch(data, runs)
            self._stamp = int(batch.stamps[-1])
            return self._admit(batch)
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
        return self._admit(FrameBatch(data, starts, stamps))

    def _admit(self, batch: FrameBatch) -> FrameBatch:
        """Verify the signatures of checked frames, if there are keys, and count."""
        signed = batch.signed()
        if signed and self._signatures:
            batch, signed = self._verified(batch, signed)
        self.counters.frames += len(batch)
        self.counters.signed += len(signed)
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
                self._due[sender] = frame.sequence + 1 & 0xFF
                if frame.message not in self._extra_of:
                    self.counters.unknown[frame.message] += 1
            return
        columns = batch.columns
        order, groups = grouped(columns.system.astype(np.uint16) << 8 | columns.component)
        for key, group in groups:
            sequences = columns.sequence[order[group]]
            sender = (key >> 8, key & 0xFF)
            self._count_gap(sender, int(sequences[0]))
            lost, repeated = sequence_faults(sequences)
            if lost:
                self.counters.lost[sender] += lost
            if repeated:
                self.counters.repeated[sender] += repeated
            self._due[sender] = int(sequences[-1]) + 1 & 0xFF
        for id in columns.message[self._dialect.extras.take(columns.message, mode="clip") < 0].tolist():
            self.counters.unknown[id] += 1

    def _count_gap(self, sender: tuple[int, int], sequence: int) -> None:
        missing = (sequence - self._due.get(sender, sequence)) & 0xFF
        if missing == 0xFF:
            self.counters.repeated[sender] += 1
        elif 0 < missing < 0x80:  # as in sequence_faults: a small step back is a late frame
            self.counters.lost[sender] += missing
