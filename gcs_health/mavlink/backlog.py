"""What was received and is not worked off yet, so that a slow moment loses nothing.

The kernel holds some hundred datagrams (200 kB on a common Linux): at 8,000 a second as much as comes in a thirtieth
of a second. So links are emptied every `FETCH_EVERY` even while there is work, and what waits, waits here.
"""

from collections import deque
from typing import NamedTuple

FETCH_EVERY = 0.01  # s
LATE = 2.0  # s of delay from which it is told
MOST = 256 << 20  # bytes that may wait; beyond, links are left to the kernel


class Packet(NamedTuple):
    """Bytes of one source (an endpoint, or one peer of it), received at UNIX µs; empty = time went by."""

    source: str
    data: bytes
    receive_us: int


class Backlog:
    """Packets in the order in which they came; `notices` that fall due are given once."""

    def __init__(self) -> None:
        self._packets: deque[Packet] = deque()
        self._bytes = 0
        self._late_told = self._full_told = False

    def __bool__(self) -> bool:
        return bool(self._packets)

    @property
    def full(self) -> bool:
        """Whether so much waits that no more is taken in."""
        return self._bytes >= MOST

    @property
    def since_us(self) -> int:
        """When the first that waits was received [UNIX µs]."""
        return self._packets[0].receive_us

    def add(self, packet: Packet) -> None:
        """Take one in."""
        self._packets.append(packet)
        self._bytes += len(packet.data)

    def take(self) -> Packet:
        """Give the first one out."""
        packet = self._packets.popleft()
        self._bytes -= len(packet.data)
        return packet

    def notice(self, now_us: int) -> str:
        """Return what is to be told of it now; mostly nothing."""
        if self.full and not self._full_told:
            self._full_told = True
            return f"more than {MOST >> 20} MB wait: what exceeds the kernel's receive buffer is lost"
        if not self._packets or self._late_told or now_us - self.since_us < LATE * 1e6:
            return ""
        self._late_told = True
        return (
            "this computer does not keep up with what comes: what is said is late; nothing is lost, it is "
            "recorded as it is worked off"
        )
