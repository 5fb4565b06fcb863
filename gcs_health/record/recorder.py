"""Flights on disk as they happen: every checked frame in a .tlog, before anything is made of it, and the
events beside it in a .jsonl of the same name.

A flight has a file of its own. The next one begins when a vehicle arms while none is armed and one has
been since the file began: the time on the ground before a flight is in its file, and one vehicle's arming
does not cut another's flight in two. A later file begins with what a vehicle says only once (its
parameters, its version, its last HEARTBEAT), stamped with the file's first stamp, so that it can be read
by itself.
"""

import struct
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from gcs_health.errors import ConfigError
from gcs_health.mavlink.batch import Frame, FrameBatch
from gcs_health.record.append_file import AppendFile
from gcs_health.record.events import Event, to_json

_STAMP = struct.Struct(">Q")
HEARTBEAT, PARAM_VALUE, AUTOPILOT_VERSION = 0, 22, 148
NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID: its arming is no flight
ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED
REMEMBERED_MOST = 50_000  # frames for the heads of later files: some 1,500 a vehicle

Sender = tuple[int, int]


class Recorder:
    """Records a session, flight by flight.

    Parameters
    ----------
    where : FILE.tlog: the first flight's file, the next are FILE-2.tlog, FILE-3.tlog ...; anything else is
        a folder, its files named by their first stamp and number: 20260504T101500Z-1.tlog.
    lines : whether to write the events beside.

    Attributes
    ----------
    flights : the .tlog files of this session, in order.
    notices : what is to be told; whoever tells it empties the list.

    Raises
    ------
    ConfigError : the file exists already, or there can be none.
    """

    def __init__(self, where: str, *, lines: bool = True) -> None:
        self.flights: list[Path] = []
        self._notices: list[str] = []
        self._keep_lines = lines
        self._frames: AppendFile | None = None
        self._lines: AppendFile | None = None
        self._first_line = True
        self._armed: set[Sender] = set()
        self._flown = False
        self._failed = False
        self._remembered: dict[tuple[int, int, int, bytes], bytes] = {}
        self._now_us = 0
        path = Path(where)
        self._file = path if path.suffix == ".tlog" else None
        self._folder = path.parent if self._file else path
        if self._file:
            self._open(self._file)
        else:
            _make_folder(path)

    @property
    def notices(self) -> list[str]:
        """See above: of the files too."""
        for file in (self._frames, self._lines):
            if file is not None and file.notices:
                self._notices += file.notices
                file.notices.clear()
        return self._notices

    def write(self, batch: FrameBatch) -> None:
        """Append frames; the `raw_tap` of a Monitor, called before the frames are decoded."""
        data: list[bytes] = []
        for (stamp, raw), frame in zip(batch.raw(), batch.frames, strict=True):
            self._now_us = stamp
            if self._frames is None and not self._begun(stamp):
                continue
            if frame.message == HEARTBEAT and self._begins_flight(frame):
                self._append(data)
                data = self._next_flight(stamp)
            data += (_STAMP.pack(stamp), raw)
            if frame.message in (HEARTBEAT, PARAM_VALUE, AUTOPILOT_VERSION):
                self._remember(frame, raw)
        self._append(data)

    def take(self, events: Iterable[Event]) -> None:
        """Append events to the lines beside the flight."""
        if self._lines is None:
            return
        text = "".join(to_json(event, self._first_line and k == 0) + "\n" for k, event in enumerate(events))
        if text:
            self._first_line = False
            self._lines.append(text.encode(), self._now_us)

    def poll(self, now_us: int) -> None:
        """Try again what a full disk refused."""
        for file in (self._frames, self._lines):
            if file is not None:
                file.retry(now_us)

    def close(self) -> None:
        """End the session."""
        for file in (self._frames, self._lines):
            if file is not None:
                file.close()
        self.notices  # noqa: B018 (takes over those of the files)
        self._frames = self._lines = None

    def _append(self, data: list[bytes]) -> None:
        if data and self._frames is not None:
            self._frames.append(b"".join(data), self._now_us)

    def _begun(self, stamp: int) -> bool:
        """Open the first file in the folder; a disk that is full by now must not stop the monitor."""
        try:
            self._open(self._name(stamp))
        except ConfigError as error:
            if not self._failed:
                self._notices.append(f"{error}; trying again")
            self._failed = True
            return False
        return True

    def _begins_flight(self, frame: Frame) -> bool:
        """Whether this HEARTBEAT arms the first vehicle of the next flight."""
        payload = frame.payload.ljust(9, b"\0")  # custom_mode(4) type autopilot base_mode status version
        sender = (frame.system, frame.component)
        if payload[5] == NO_AUTOPILOT:
            return False
        if not payload[6] & ARMED:
            self._armed.discard(sender)
            return False
        if sender in self._armed:
            return False
        begins = self._flown and not self._armed
        self._armed.add(sender)
        self._flown = True
        return begins

    def _next_flight(self, stamp: int) -> list[bytes]:
        """Go on in a new file; return its head. Where there can be none, go on in the old one."""
        before = self._frames, self._lines
        try:
            self._open(self._name(stamp))
        except ConfigError as error:
            self._notices.append(f"{error}; the next flight goes on in the file of the last one")
            return []
        for file in before:
            if file is not None:
                file.close()
                self._notices += file.notices
        head = _STAMP.pack(stamp)
        return [part for frame in self._remembered.values() for part in (head, frame)]

    def _remember(self, frame: Frame, raw: bytes) -> None:
        named = frame.payload[8:24] if frame.message == PARAM_VALUE else b""
        key = (frame.system, frame.component, frame.message, named)
        self._remembered.pop(key, None)  # in the order in which they came: signed frames must be
        if len(self._remembered) < REMEMBERED_MOST:
            self._remembered[key] = raw

    def _name(self, stamp: int) -> Path:
        """Return the next flight's path, one that nobody has."""
        when = datetime.fromtimestamp(stamp * 1e-6, UTC)
        number = len(self.flights) + 1
        while True:
            stem = f"{self._file.stem}-{number}" if self._file else f"{when:%Y%m%dT%H%M%SZ}-{number}"
            path = self._folder / f"{stem}.tlog"
            if not path.exists() and not path.with_suffix(".jsonl").exists():
                return path
            number += 1

    def _open(self, path: Path) -> None:
        frames = AppendFile(path)
        try:
            lines = AppendFile(path.with_suffix(".jsonl")) if self._keep_lines else None
        except ConfigError:
            frames.close()
            path.unlink()
            raise
        self._frames, self._lines, self._first_line = frames, lines, True
        self.flights.append(path)


def _make_folder(path: Path) -> None:
    """Make sure that files can be made in the folder before there is anything to put into them."""
    probe = path / ".gcs-health"
    try:
        path.mkdir(parents=True, exist_ok=True)
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise ConfigError(f"{path}: cannot record there: {error.strerror}") from None
