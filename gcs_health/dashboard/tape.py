"""A recorded flight as bytes that can be read up to any moment: where its frames and their stamps lie."""

from gcs_health.mavlink.framing import STAMP_LENGTH

MAGIC_V1, MAGIC_V2 = 0xFE, 0xFD
LONGEST = STAMP_LENGTH + 280 + 13  # bytes of a record
DAY_US = 86_400_000_000
BLIND_PIECE = 512  # bytes read at once where no stamps tell the time


class Tape:
    """The whole flight in memory.

    Parameters
    ----------
    stamped : a .tlog; a raw stream has no stamps, its time is found by reading it.

    Attributes
    ----------
    start_us, end_us : stamps of the first and the last record [UNIX µs]; 0 without stamps.
    """

    def __init__(self, data: bytes, stamped: bool) -> None:
        self.data, self.stamped = data, stamped
        self.start_us = self.end_us = 0
        if stamped:
            first = self._next_record(0, None)
            self.start_us = self._stamp(first) if first >= 0 else 0
            self.end_us = self._last_stamp()

    def until(self, at: int, us: int, most: int) -> tuple[int, int]:
        """Return where reading from `at` must stop so that nothing later than `us` is read, and the next stamp.

        At most so many bytes. What is no record (damage) belongs to what comes before it. The next stamp is 0 where
        there is none.
        """
        if not self.stamped:
            return min(at + min(BLIND_PIECE, most), len(self.data)), 0
        end, limit = at, min(at + most, len(self.data))
        while end < len(self.data):
            length = self._length(end)
            if length == 0 or not self._plausible(end):
                found = self._next_record(end + 1, end + 1 + 4 * LONGEST)
                end = found if found >= 0 else min(end + 4 * LONGEST, len(self.data))
                continue
            stamp = self._stamp(end)
            if stamp > us or end >= limit:
                return end, stamp
            end = min(end + length, len(self.data))
        return end, 0

    def _length(self, at: int) -> int:
        """Return the length of the record at a place; 0 where none begins."""
        head = self.data[at + STAMP_LENGTH : at + STAMP_LENGTH + 3]
        if len(head) < 3:
            return 0
        if head[0] == MAGIC_V2:
            return STAMP_LENGTH + head[1] + 12 + 13 * (head[2] & 1)
        return STAMP_LENGTH + head[1] + 8 if head[0] == MAGIC_V1 else 0

    def _stamp(self, at: int) -> int:
        return int.from_bytes(self.data[at : at + STAMP_LENGTH], "big")

    def _plausible(self, at: int) -> bool:
        return not self.start_us or abs(self._stamp(at) - self.start_us) < 30 * DAY_US

    def _next_record(self, at: int, end: int | None) -> int:
        """Return where the next record begins that another follows; -1 where none does."""
        for place in range(at, min(len(self.data), end if end is not None else len(self.data))):
            length = self._length(place)
            if length and self._plausible(place):
                after = place + length
                if after == len(self.data) or self._length(after):
                    return place
        return -1

    def _last_stamp(self) -> int:
        """Return the stamp of the last record."""
        back = LONGEST
        while back < 64 * LONGEST:
            at = self._next_record(max(len(self.data) - back, 0), None)
            last = 0
            while 0 <= at < len(self.data):
                last = max(last, self._stamp(at))
                at = self._next_record(at + self._length(at), None)
            if last:
                return last
            back *= 2
        return self.start_us
