"""Frames in stream order, one by one or as columns: what framing hands to meaning."""

from collections.abc import Iterator
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np

from gcs_health.mavlink.framing import MAGIC_V2, SIGNED, STAMP_LENGTH, Integers, frame_end

Bytes = np.ndarray[Any, np.dtype[np.uint8]]

FEW = 100  # frames below which plain Python beats numpy's fixed costs (benchmarks/decode.py)


class Frame(NamedTuple):
    """One checked frame. `payload` is as sent: v2 senders cut trailing zero bytes."""

    receive_us: int
    system: int
    component: int
    message: int
    sequence: int
    payload: bytes


Head = tuple[int, int, int, int, int, bytes]  # a Frame's fields: plain tuples are quicker to make


class FrameBatch:
    """Frames in stream order, as places in `data`; iterable.

    Parameters
    ----------
    data : the bytes.
    starts : (n,) where each frame's magic byte stands; None = v2 frames, unsigned, on end from the first on.
    stamps : (n,) UNIX µs of each frame; None = as `heads` say.
    heads : the frames one by one, where that has been done.
    columns : their headers, where they have been read.

    Attributes
    ----------
    listed : the frames one by one, None where that has not been done: `heads` does it.
    """

    __slots__ = ("_columns", "_stamps", "_starts", "data", "listed")

    def __init__(
        self,
        data: bytes,
        starts: list[int] | Integers | None,
        stamps: list[int] | Integers | None = None,
        heads: list[Head] | None = None,
        columns: "FrameColumns | None" = None,
    ) -> None:
        self.data = data
        self._starts = starts
        self._stamps = stamps
        self.listed = heads
        self._columns = columns

    def __len__(self) -> int:
        return len(self.heads) if self._starts is None else len(self._starts)

    def __iter__(self) -> Iterator[Frame]:
        return map(Frame._make, self.heads)

    @property
    def frames(self) -> list[Frame]:
        """The frames one by one."""
        return list(self)

    @property
    def few(self) -> bool:
        """Whether frame by frame is the faster way to read it."""
        return len(self) < FEW

    @property
    def starts(self) -> list[int] | Integers:
        """Where each frame's magic byte stands."""
        if self._starts is None:
            ends = accumulate(12 + len(head[-1]) for head in self.heads)
            self._starts = [0, *ends][:-1]
        return self._starts

    @property
    def stamps(self) -> list[int] | Integers:
        """UNIX µs of each frame."""
        if self._stamps is None:
            self._stamps = [head[0] for head in self.heads]
        return self._stamps

    @property
    def heads(self) -> list[Head]:
        """The fields of the frames one by one, as plain tuples."""
        if self.listed is None:
            self.listed = self._list()
        return self.listed

    def _list(self) -> list[Head]:
        data, out = self.data, []
        for start, stamp in self._places():
            length = data[start + 1]
            if data[start] == MAGIC_V2:
                message = data[start + 7] | data[start + 8] << 8 | data[start + 9] << 16
                payload = data[start + 10 : start + 10 + length]
                out.append((stamp, data[start + 5], data[start + 6], message, data[start + 4], payload))
            else:
                payload = data[start + 6 : start + 6 + length]
                out.append(
                    (stamp, data[start + 3], data[start + 4], data[start + 5], data[start + 2], payload)
                )
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
        starts = np.asarray(self.starts, dtype=np.int64)
        margin = bytes(_HEAD.itemsize)
        columns = headers(b"".join((margin, self.data, margin)), len(margin), starts)
        return columns._replace(receive_us=np.asarray(self.stamps, dtype=np.int64))

    def signed(self) -> list[int]:
        """Return which frames, by number, carry a signature."""
        if not self.few:
            return np.flatnonzero(self.columns.flags & SIGNED).tolist()
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
    """Headers of n frames; `payload` is where each payload begins in the data, `length` its length.

    `flags` are v2's incompatibility flags, 0 in v1.
    """

    receive_us: Integers
    system: Bytes
    component: Bytes
    message: np.ndarray[Any, np.dtype[np.uint32]]
    sequence: Bytes
    payload: Integers
    length: Bytes
    flags: Bytes

    def choose(self, which: Any) -> "FrameColumns":
        """Return the columns of these frames only: a slice, numbers or a mask."""
        return FrameColumns._make(column[which] for column in self)


# A stamp and a header: v2, and where v1 has another thing there
_HEAD = np.dtype(
    {
        "names": [
            *("stamp", "magic", "length", "flags", "sequence", "system", "component", "message"),
            *("sequence1", "system1", "component1", "message1"),
        ],
        "formats": [">u8", *["u1"] * 6, "<u4", *["u1"] * 4],
        "offsets": [0, 8, 9, 10, 12, 13, 14, 15, 10, 11, 12, 13],
        "itemsize": 19,
    }
)


def headers(wide: bytes, margin: int, starts: Integers) -> FrameColumns:
    """Read the headers of frames from `wide`: the data with margins, one of `margin` bytes before it.

    The stamps are those 8 bytes before each frame, whether they are any or not.
    """
    head = items(wide, starts + (margin - STAMP_LENGTH), _HEAD.itemsize).view(_HEAD)
    v2 = head["magic"] == MAGIC_V2
    all_v2 = bool(v2.all())

    def column(name: str) -> Any:
        return head[name].copy() if all_v2 else np.where(v2, head[name], head[name + "1"])

    return FrameColumns(
        receive_us=head["stamp"].astype(np.int64),
        system=column("system"),
        component=column("component"),
        message=column("message") & 0xFFFFFF,
        sequence=column("sequence"),
        payload=starts + (10 if all_v2 else np.where(v2, 10, 6)),
        length=head["length"].copy(),
        flags=head["flags"].copy() if all_v2 else np.where(v2, head["flags"], 0).astype(np.uint8),
    )


def grouped(keys: np.ndarray[Any, Any]) -> tuple[Integers, list[tuple[int, slice]]]:
    """Sort equal `keys` (n,) together, else in order.

    Returns
    -------
    order : (n,) numbers of the keys, equal ones on end.
    groups : each key and where it stands in `order`.
    """
    small = keys.astype(np.uint16) if keys.max() < 1 << 16 else keys  # radix sort for small integers
    order = small.argsort(kind="stable")
    of = small[order]
    edges = [0, *((of[1:] != of[:-1]).nonzero()[0] + 1).tolist(), len(of)]
    return order, [(int(of[a]), slice(a, b)) for a, b in pairwise(edges)]


def rows(data: bytes, at: Integers, width: int) -> Bytes:
    """Gather `width` bytes from each of the places `at`: (n, width), a copy; `data` must reach so far."""
    return items(data, at, width).view(np.uint8).reshape(len(at), width)


def items(data: bytes, at: Integers, width: int) -> np.ndarray[Any, Any]:
    """Do as `rows` does: (n,), one opaque item a row, copied whole: 20 times as fast as byte by byte."""
    windows: np.ndarray[Any, Any] = np.ndarray(
        (len(data) - width + 1,), dtype=f"V{width}", buffer=data, strides=(1,)
    )
    return windows[at]


def _listed(values: list[int] | Integers) -> list[int]:
    return values if isinstance(values, list) else values.tolist()
