"""Frames in stream order, one by one or as columns: what framing hands to meaning."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from gcs_health.mavlink.framing import MAGIC_V2, SIGNED, Integers, frame_end, message_ids

FEW = 100  # frames below which plain Python beats numpy's fixed costs (benchmarks/decode.py)


class Frame(NamedTuple):
    """One checked frame. `payload` is as sent: v2 senders cut trailing zero bytes."""

    receive_us: int
    system: int
    component: int
    message: int
    sequence: int
    payload: bytes


class FrameBatch:
    """Frames in stream order, as places in `data`; iterable.

    Attributes
    ----------
    data : the bytes.
    starts : (n,) where each frame's magic byte stands.
    stamps : (n,) UNIX µs of each frame.
    listed : the frames one by one, where that has been done; `frames` does it.
    """

    __slots__ = ("_columns", "data", "listed", "stamps", "starts")

    def __init__(
        self,
        data: bytes,
        starts: list[int] | Integers,
        stamps: list[int] | Integers,
        listed: list[Frame] | None = None,
    ) -> None:
        self.data = data
        self.starts = starts
        self.stamps = stamps
        self.listed = listed
        self._columns: FrameColumns | None = None

    def __len__(self) -> int:
        return len(self.starts)

    def __iter__(self) -> Iterator[Frame]:
        return iter(self.frames)

    @property
    def few(self) -> bool:
        """Whether frame by frame is the faster way to read it."""
        return len(self.starts) < FEW

    @property
    def frames(self) -> list[Frame]:
        """The frames one by one."""
        if self.listed is None:
            self.listed = self._list()
        return self.listed

    def _list(self) -> list[Frame]:
        data, out = self.data, []
        for start, stamp in self._places():
            length = data[start + 1]
            if data[start] == MAGIC_V2:
                message = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
                payload = data[start + 10 : start + 10 + length]
                head = (stamp, data[start + 5], data[start + 6], message, data[start + 4])
            else:
                payload = data[start + 6 : start + 6 + length]
                head = (stamp, data[start + 3], data[start + 4], data[start + 5], data[start + 2])
            out.append(Frame(*head, payload))
        return out

    def raw(self) -> Iterator[tuple[int, bytes]]:
        """Yield (stamp, frame as sent), for a recorder."""
        for start, stamp in self._places():
            yield stamp, self.data[start : frame_end(self.data, start)]

    @property
    def columns(self) -> "FrameColumns":
        """The headers as arrays, for many frames at once."""
        if self._columns is None:
            self._columns = self._gather()
        return self._columns

    def _gather(self) -> "FrameColumns":
        raw = np.frombuffer(self.data, np.uint8)
        first = np.asarray(self.starts, dtype=np.int64)
        v2 = raw[first] == MAGIC_V2
        head = first + np.where(v2, 2, 0)
        return FrameColumns(
            receive_us=np.asarray(self.stamps, dtype=np.int64),
            system=raw[head + 3],
            component=raw[head + 4],
            message=message_ids(raw, first, v2),
            sequence=raw[head + 2],
            payload=first + np.where(v2, 10, 6),
            length=raw[first + 1].astype(np.int64),
            signed=v2 & (raw[first + 2] & SIGNED > 0),
        )

    def signed(self) -> list[int]:
        """Return which frames, by number, carry a signature."""
        if not self.few:
            return np.flatnonzero(self.columns.signed).tolist()
        data = self.data
        return [k for k, s in enumerate(self.starts) if data[s] == MAGIC_V2 and data[s + 2] & SIGNED]

    def choose(self, numbers: list[int]) -> "FrameBatch":
        """Return the batch of these frames only."""
        places = list(self._places())
        starts, stamps = [places[k][0] for k in numbers], [places[k][1] for k in numbers]
        return FrameBatch(self.data, starts, stamps)

    def _places(self) -> Iterator[tuple[int, int]]:
        return zip(_listed(self.starts), _listed(self.stamps), strict=True)


class FrameColumns(NamedTuple):
    """Headers of n frames; `payload` is where each payload begins in the data, `length` its length."""

    receive_us: Integers
    system: np.ndarray[Any, np.dtype[np.uint8]]
    component: np.ndarray[Any, np.dtype[np.uint8]]
    message: Integers
    sequence: np.ndarray[Any, np.dtype[np.uint8]]
    payload: Integers
    length: Integers
    signed: np.ndarray[Any, np.dtype[np.bool_]]


def _listed(values: list[int] | Integers) -> list[int]:
    return values if isinstance(values, list) else values.tolist()
