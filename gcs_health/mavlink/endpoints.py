"""Links: UDP, TCP and serial, several read as one.

The one module that opens a link or reads a clock. It gives (source, bytes, receive time) and sends only
what it is told to.
"""

import contextlib
import os
import selectors
import socket
import time
from collections.abc import Iterator
from typing import Any, Protocol

from gcs_health.errors import EndpointError
from gcs_health.mavlink.backlog import FETCH_EVERY, Backlog, Packet
from gcs_health.mavlink.spellings import Endpoint

RECEIVE_BUFFER = 4 << 20  # bytes in the kernel: a slow moment must not lose datagrams
CHUNK = 1 << 16
AT_ONCE, READS = 256, 16  # datagrams read in one go, and goes before another link has its turn
RETRY = 1.0  # s between attempts to get a lost link back


def now_us() -> int:
    """Return the UNIX time [µs]."""
    return time.time_ns() // 1000


class Link(Protocol):
    """One open endpoint."""

    text: str
    lost: str  # why it is down; empty while it is up

    def fileno(self) -> int:
        """Return what a selector can wait for; -1 while down or where waiting makes no sense."""
        ...

    def read(self) -> list[tuple[str, bytes]]:
        """Return (source, bytes) that are there."""
        ...

    def send(self, data: bytes) -> None:
        """Send to whoever is at the other end, if known."""
        ...

    def reopen(self) -> bool:
        """Try to get a lost link back; return whether it is up."""
        ...

    def close(self) -> None:
        """Let go of it."""
        ...


class UdpLink:
    """A UDP socket: bound and answering its last peer (udpin), or talking to one (udpout)."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.text, self.lost = endpoint.text, ""
        family, address = _resolve(endpoint, socket.SOCK_DGRAM)
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        self._socket.setblocking(False)
        self._peer: Any = None
        try:
            if endpoint.kind == "udpin":
                self._socket.bind(address)
            else:
                self._peer = address
        except OSError as error:
            self._socket.close()
            raise EndpointError(_reason(endpoint, error)) from None

    def fileno(self) -> int:
        """See `Link.fileno`."""
        return self._socket.fileno()

    def read(self) -> list[tuple[str, bytes]]:
        """See `Link.read`: one entry a datagram, each peer a source of its own."""
        got: list[tuple[str, bytes]] = []
        while len(got) < AT_ONCE:
            try:
                data, peer = self._socket.recvfrom(CHUNK)
            except BlockingIOError:
                break
            except OSError:  # an earlier datagram was refused by its host: nothing to read
                continue
            self._peer = peer
            got.append((f"{self.text} {peer[0]}:{peer[1]}", data))
        return got

    def send(self, data: bytes) -> None:
        """See `Link.send`."""
        if self._peer is not None:
            with contextlib.suppress(OSError):
                self._socket.sendto(data, self._peer)

    def reopen(self) -> bool:
        """See `Link.reopen`: UDP knows no loss."""
        return True

    def close(self) -> None:
        """See `Link.close`."""
        self._socket.close()


class TcpLink:
    """A TCP connection made (tcpout) or waited for (tcpin, one peer at a time)."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.text, self.lost = endpoint.text, ""
        self._endpoint = endpoint
        self._connections = 0
        self._stream: socket.socket | None = None
        self._server: socket.socket | None = None
        family, address = _resolve(endpoint, socket.SOCK_STREAM)
        try:
            if endpoint.kind == "tcpin":
                self._server = socket.create_server(address[:2], family=family)
                self._server.setblocking(False)
            else:
                self._connect()
        except OSError as error:
            raise EndpointError(_reason(endpoint, error)) from None

    def _connect(self) -> None:
        self._stream = socket.create_connection((self._endpoint.host, self._endpoint.port), timeout=3.0)
        self._stream.setblocking(False)
        self._connections += 1

    def fileno(self) -> int:
        """See `Link.fileno`."""
        current = self._stream or self._server
        return current.fileno() if current is not None else -1

    def read(self) -> list[tuple[str, bytes]]:
        """See `Link.read`: each connection is a source of its own."""
        if self._stream is None:
            if self._server is not None:
                with contextlib.suppress(OSError):
                    self._stream, _ = self._server.accept()
                    self._stream.setblocking(False)
                    self._connections += 1
                    self.lost = ""
            return []
        try:
            data = self._stream.recv(CHUNK)
        except BlockingIOError:
            return []
        except OSError as error:
            data, reason = b"", error.strerror or "broken"
        else:
            reason = "closed by the other end"
        if not data:
            self._stream.close()
            self._stream = None
            self.lost = reason
            return []
        return [(f"{self.text} {self._connections}", data)]

    def send(self, data: bytes) -> None:
        """See `Link.send`."""
        if self._stream is not None:
            with contextlib.suppress(OSError):
                self._stream.sendall(data)

    def reopen(self) -> bool:
        """See `Link.reopen`."""
        if self._server is None and self._stream is None:
            with contextlib.suppress(OSError):
                self._connect()
                self.lost = ""
        return not self.lost

    def close(self) -> None:
        """See `Link.close`."""
        for open_socket in (self._stream, self._server):
            if open_socket is not None:
                open_socket.close()


class SerialLink:
    """A serial port, through pyserial."""

    def __init__(self, endpoint: Endpoint) -> None:
        self.text, self.lost = endpoint.text, ""
        self._endpoint = endpoint
        self._port: Any = None
        self._openings = 0
        try:
            import serial
        except ImportError:
            raise EndpointError(
                f"{endpoint.text}: serial ports need pyserial: pip install 'gcs-health[serial]'"
            ) from None
        self._serial = serial
        try:
            self._open()
        except (OSError, ValueError) as error:
            number = getattr(error, "errno", None)
            why = os.strerror(number) if number else str(error)
            raise EndpointError(f"{endpoint.text}: cannot open {endpoint.host}: {why}") from None

    def _open(self) -> None:
        self._port = self._serial.Serial(self._endpoint.host, self._endpoint.port, timeout=0)
        self._openings += 1

    def fileno(self) -> int:
        """See `Link.fileno`."""
        try:
            return int(self._port.fileno())
        except (OSError, AttributeError):  # down, or a system whose ports a selector cannot wait for
            return -1

    def read(self) -> list[tuple[str, bytes]]:
        """See `Link.read`."""
        if self._port is None:
            return []
        try:
            data = self._port.read(CHUNK)
        except OSError as error:
            self.close()
            self.lost = str(error)
            return []
        return [(f"{self.text} {self._openings}", data)] if data else []

    def send(self, data: bytes) -> None:
        """See `Link.send`."""
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.write(data)

    def reopen(self) -> bool:
        """See `Link.reopen`."""
        if self._port is None:
            with contextlib.suppress(OSError, ValueError):
                self._open()
                self.lost = ""
        return not self.lost

    def close(self) -> None:
        """See `Link.close`."""
        if self._port is not None:
            with contextlib.suppress(OSError):
                self._port.close()
            self._port = None


_LINKS: dict[str, Any] = {
    "udpin": UdpLink,
    "udpout": UdpLink,
    "tcpin": TcpLink,
    "tcpout": TcpLink,
    "serial": SerialLink,
}


class Links:
    """Several open endpoints read as one; a context manager.

    `notices` collects what is to be told: links lost and back, and that the reader is slow, each once.
    """

    def __init__(self, endpoints: list[Endpoint]) -> None:
        self.notices: list[str] = []
        self._links: list[Link] = []
        self._down: set[str] = set()
        self._next_try = 0.0
        self._backlog = Backlog()
        self._selector = selectors.DefaultSelector()  # made once: at a thousand datagrams a second it is felt
        self._watched: list[int] = []
        self._watched_of_all: list[int] = []
        try:
            for endpoint in endpoints:
                self._links.append(_LINKS[endpoint.kind](endpoint))
        except EndpointError:
            self.close()
            raise

    def __enter__(self) -> "Links":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def packets(self, tick: float = 0.2) -> Iterator[Packet]:
        """Yield what arrives, and an empty packet at least every `tick` seconds; for ever."""
        while True:
            self._mend()
            fetched = self._fetch(tick)
            told = fetched
            while self._backlog and fetched - told < tick:
                yield self._backlog.take()
                if time.monotonic() - fetched > FETCH_EVERY:
                    fetched = self._fetch(0.0)
            yield Packet("", b"", self._backlog.since_us if self._backlog else now_us())

    def rest(self) -> Iterator[Packet]:
        """Yield what was received before and not given yet; nothing new."""
        while self._backlog:
            yield self._backlog.take()

    def send(self, data: bytes) -> None:
        """Send on every link that knows whom to."""
        for link in self._links:
            link.send(data)

    def close(self) -> None:
        """Let go of all links."""
        self._selector.close()
        for link in self._links:
            link.close()

    def _fetch(self, wait: float) -> float:
        """Take in what is there, waiting at most so long [s] for the first; return when that was [s]."""
        if not self._backlog.full:
            for link in self._ready(wait):
                for _ in range(READS):
                    got = link.read()
                    now = now_us()
                    for source, data in got:
                        self._backlog.add(Packet(source, data, now))
                    if len(got) < AT_ONCE:
                        break
        notice = self._backlog.notice(now_us())
        if notice:
            self.notices.append(notice)
        return time.monotonic()

    def _ready(self, tick: float) -> list[Link]:
        blind = [link for link in self._links if link.fileno() < 0 and not link.lost]
        self._watch()
        if not self._watched:
            time.sleep(min(0.01, tick) if blind else tick)
            return blind  # cannot be waited for: looked at every 10 ms
        ready = self._selector.select(min(0.01, tick) if blind else tick)
        return [key.data for key, _ in ready] + blind

    def _watch(self) -> None:
        """Wait for the links that are up, as they are now."""
        now = [link.fileno() for link in self._links]
        if now == self._watched_of_all:
            return
        self._watched_of_all = now
        self._selector.close()
        self._selector = selectors.DefaultSelector()
        self._watched = [number for number in now if number >= 0]
        for link, number in zip(self._links, now, strict=True):
            if number >= 0:
                self._selector.register(number, selectors.EVENT_READ, link)

    def _mend(self) -> None:
        for link in self._links:
            if link.lost and link.text not in self._down:
                self._down.add(link.text)
                self.notices.append(f"{link.text}: link lost ({link.lost}); trying to get it back")
        if not self._down or time.monotonic() < self._next_try:
            return
        self._next_try = time.monotonic() + RETRY
        for link in self._links:
            if link.text in self._down and link.reopen():
                self._down.discard(link.text)
                self._watched_of_all = []  # it may have the number of the one that was closed
                self.notices.append(f"{link.text}: link is back")


def _resolve(endpoint: Endpoint, kind: socket.SocketKind) -> tuple[socket.AddressFamily, Any]:
    try:
        found = socket.getaddrinfo(endpoint.host, endpoint.port, type=kind)
    except OSError:
        raise EndpointError(f"{endpoint.text}: the host {endpoint.host!r} is not known") from None
    return found[0][0], found[0][4]


def _reason(endpoint: Endpoint, error: OSError) -> str:
    import errno

    if error.errno == errno.EADDRINUSE:
        return (
            f"{endpoint.text}: port {endpoint.port} is in use by another program, perhaps another ground "
            "station; close it or choose another port"
        )
    return f"{endpoint.text}: cannot open: {error.strerror or error}"
