"""Evidence packets: what an alert rests on, in one .zip that replays to the same alert.

An estimator answers from all that it has seen, so a packet holds every frame from the session's first to
`AFTER` seconds behind the alert, not a window around it. Only where the flights before the alert's own are
more than `EARLIER_MOST` bytes are the earliest left out, and the manifest says so.

    flight.tlog     the frames
    packet.json     the alert, its further steps, configuration, versions
    vehicle.toml    and whatever other file the configuration names, trained models too
"""

import json
import zipfile
from collections.abc import Callable, Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from gcs_health.errors import ConfigError, LogError
from gcs_health.mavlink.tlog_sets import is_zip
from gcs_health.record.events import AlertEvent, Event, as_object

SCHEMA = "gcs_health.evidence/1"
AFTER = 10.0  # s behind the alert
EARLIER_MOST = 256 << 20  # bytes of flights before the alert's own
MEMBER_MOST = 16 << 20  # bytes of any but the flight
MANIFEST, FLIGHT = "packet.json", "flight.tlog"
_COPY = 1 << 20


@dataclass
class _Open:
    """A packet that waits for what follows its alert."""

    steps: list[AlertEvent]
    due_t: float
    due_us: int = field(init=False)

    def __post_init__(self) -> None:
        self.due_us = self.steps[0].t_unix_us + int(AFTER * 1e6)


class EvidenceWriter:
    """Saves a packet for every alert raised.

    Parameters
    ----------
    folder : where packets go; made if it is not there.
    flights : gives the .tlog files of the session so far, in order (`Recorder.flights`).
    stem : what the packets' names begin with; None = with the flight's.
    members : further files of a packet, name -> content. configuration : as JSON has it. versions : likewise.

    Attributes
    ----------
    notices : what is to be told; whoever tells it empties the list.
    written : packets so far.

    Raises
    ------
    ConfigError : the folder cannot be made.
    """

    def __init__(
        self,
        folder: Path,
        flights: Callable[[], list[Path]],
        stem: str | None,
        configuration: Mapping[str, Any],
        members: Mapping[str, bytes],
        versions: Mapping[str, str],
    ) -> None:
        self.notices: list[str] = []
        self.written: list[Path] = []
        self._folder, self._flights, self._stem = folder, flights, stem
        self._about = {"configuration": dict(configuration), "versions": dict(versions)}
        self._members = dict(members)
        self._open: dict[str, _Open] = {}
        self._writing: list[Future[Path]] = []
        # copying takes a second a hundred megabytes: not in the way of the estimators
        self._writer = ThreadPoolExecutor(1, "evidence")
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(f"{folder}: cannot save evidence there: {error.strerror}") from None

    def take(self, events: Iterable[Event]) -> None:
        """Open a packet at an alert's first step, write it when what follows has been seen."""
        for event in events:
            if isinstance(event, AlertEvent):
                if event.id in self._open:
                    self._open[event.id].steps.append(event)
                elif event.state == "raised":
                    self._open[event.id] = _Open([event], event.t + AFTER)
            elif self._open:
                self._write_due(partial(_seen_enough, event))

    def poll(self, now_us: int) -> None:
        """Write what is due although the vehicle has gone silent."""
        if self._open:
            self._write_due(lambda waiting: now_us >= waiting.due_us)
        self._hear()

    def close(self) -> None:
        """Write all that is open; the flight's file must be closed or written through by now."""
        self._write_due(lambda _: True)
        self._writer.shutdown(wait=True)
        self._hear()

    def _write_due(self, due: Callable[[_Open], bool]) -> None:
        for id in [id for id, waiting in self._open.items() if due(waiting)]:
            steps = self._open.pop(id).steps
            # as they are now: bytes that follow are not of this packet. A file that is gone has none
            flights = [(path, path.stat().st_size) for path in self._flights() if path.exists()]
            self._writing.append(self._writer.submit(self._write, steps, flights))

    def _hear(self) -> None:
        for done in [future for future in self._writing if future.done()]:
            self._writing.remove(done)
            try:
                self.written.append(done.result())
            except OSError as error:
                self.notices.append(f"{self._folder}: evidence was not saved: {error.strerror}")

    def _write(self, steps: list[AlertEvent], flights: list[tuple[Path, int]]) -> Path:
        kept, left_out = _affordable(flights)
        stem = self._stem or flights[-1][0].stem
        first = steps[0]
        path = self._free(f"{stem}-{first.code}-motor{first.motor or 'unnamed'}-{first.id}")
        manifest = {
            "schema": SCHEMA,
            "alert": as_object(first),
            "steps": [as_object(step) for step in steps],
            "flights": [each.name for each, _ in kept],
            "left_out": [each.name for each, _ in left_out],
            **self._about,
        }
        part = path.with_suffix(".part")
        try:
            with zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packet:
                packet.writestr(MANIFEST, json.dumps(manifest, indent=1, allow_nan=False) + "\n")
                for name, content in self._members.items():
                    packet.writestr(name, content)
                with packet.open(FLIGHT, "w", force_zip64=True) as out:
                    for each, size in kept:
                        _copy(each, size, out.write)
            part.rename(path)
        except OSError:
            part.unlink(missing_ok=True)
            raise
        return path

    def _free(self, stem: str) -> Path:
        path, number = self._folder / f"{stem}.zip", 1
        while path.exists():
            number += 1
            path = self._folder / f"{stem}-{number}.zip"
        return path


def _seen_enough(event: Event, waiting: _Open) -> bool:
    return waiting.steps[0].vehicle == event.vehicle and event.t >= waiting.due_t


def _affordable(flights: list[tuple[Path, int]]) -> tuple[list[tuple[Path, int]], list[tuple[Path, int]]]:
    """Split into the flights kept and the earliest ones left out."""
    first, total = len(flights) - 1, 0
    while first > 0 and total + flights[first - 1][1] <= EARLIER_MOST:
        first -= 1
        total += flights[first][1]
    return flights[max(first, 0) :], flights[: max(first, 0)]


def _copy(path: Path, size: int, write: Callable[[bytes], object]) -> None:
    with path.open("rb") as file:
        while size and (block := file.read(min(size, _COPY))):
            write(block)
            size -= len(block)


class Packet:
    """A packet to be replayed: a .zip as written, or a folder that one was unpacked into.

    Attributes
    ----------
    manifest : what `packet.json` says.

    Raises
    ------
    LogError : it is no packet of a kind that is known here.
    """

    def __init__(self, name: str) -> None:
        self._path = Path(name)
        try:
            self.manifest: dict[str, Any] = json.loads(self.read(MANIFEST) or b"")
        except ValueError:
            raise LogError(f"{name}: {MANIFEST} in it is no JSON") from None
        schema = self.manifest.get("schema") if isinstance(self.manifest, dict) else None
        if schema != SCHEMA:
            raise LogError(f"{name}: {MANIFEST}: schema: expected {SCHEMA!r}, got {schema!r}")

    def read(self, member: str) -> bytes | None:
        """Return a member, None if it is not there; never more than `MEMBER_MOST` of it."""
        try:
            if self._path.is_dir():
                with (self._path / member).open("rb") as file:
                    return file.read(MEMBER_MOST)
            with zipfile.ZipFile(self._path) as packet, packet.open(member) as inside:
                return inside.read(MEMBER_MOST)
        except (KeyError, FileNotFoundError):
            return None
        except (OSError, zipfile.BadZipFile) as error:
            raise LogError(f"{self._path}: {member} in it cannot be read: {error}") from None


def is_packet(name: str) -> bool:
    """Whether a packet has this name; any other log is none."""
    path = Path(name)
    if path.is_dir():
        return (path / MANIFEST).is_file()
    if not is_zip(path):
        return False
    with zipfile.ZipFile(path) as packet:
        return MANIFEST in packet.namelist()
