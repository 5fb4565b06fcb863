"""The logs that an autopilot keeps on board, fetched through MAVSDK (LOG_REQUEST_LIST, LOG_REQUEST_DATA).

This transmits: the vehicle is asked for its logs and sends them over the same link as its telemetry.
"""

import queue
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from gcs_health.errors import EndpointError
from gcs_health.mavlink.mavsdk_link import PATIENCE, open_station
from gcs_health.mavlink.spellings import Endpoint

LOOK = 0.5  # s
STALLED = 30.0  # s without a byte: MAVSDK asks again by itself, but for ever
NO_DATE = "1970"


class OnboardLog(NamedTuple):
    """One log on the vehicle: its number there, when it began (ISO 8601 UTC, empty if not known), bytes."""

    id: int
    date: str
    size: int


class OnboardLogs:
    """The logs of the first autopilot heard at an endpoint.

    Attributes
    ----------
    suffix : of the autopilot's logs, ".bin" for ArduPilot's, ".ulg" for others.

    Raises
    ------
    EndpointError : MAVSDK is not there, the endpoint cannot be opened, or no autopilot was heard for `patience` s.
    """

    def __init__(self, endpoint: Endpoint, patience: float = PATIENCE) -> None:
        self._endpoint = endpoint
        self._station = open_station([endpoint])
        try:
            system = self._first_autopilot(patience)
            if system is None:
                raise EndpointError(
                    f"{endpoint.text}: MAVSDK heard no autopilot for {patience:g} s; does the vehicle send its "
                    "HEARTBEAT there, and does no other program hold the port?"
                )
            from mavsdk import Autopilot
            from mavsdk.plugins.log_files import LogFiles

            self.suffix = ".bin" if system.autopilot_type() == Autopilot.ARDUPILOT else ".ulg"
            self._files = LogFiles(system)
            self._entries: dict[int, Any] = {}
        except BaseException:
            self._station.destroy()
            raise

    def __enter__(self) -> "OnboardLogs":
        return self

    def __exit__(self, *_: object) -> None:
        self._station.destroy()

    def _first_autopilot(self, patience: float) -> Any:
        """Wait a little at a time: MAVSDK waits in C, where Ctrl-C is not heard."""
        for _ in range(max(1, round(patience / LOOK))):
            system = self._station.first_autopilot(LOOK)
            if system is not None:
                return system
        return None

    def list(self) -> list[OnboardLog]:
        """Return the logs in the order of their numbers.

        Raises
        ------
        EndpointError : the vehicle does not answer.
        """
        from mavsdk.plugins.log_files import LogFilesError, LogFilesResult

        try:
            entries = self._files.get_entries()
        except LogFilesError as error:
            if error.result == LogFilesResult.NO_LOGFILES:
                return []
            raise self._failed("did not list its logs", error.result) from None
        self._entries = {entry.id: entry for entry in entries}
        return [
            OnboardLog(entry.id, "" if entry.date.startswith(NO_DATE) else entry.date, entry.size_bytes)
            for _, entry in sorted(self._entries.items())
        ]

    def fetch(self, log: OnboardLog, path: Path, tell: Callable[[float], None]) -> None:
        """Write a listed log to `path`, under another name until it is whole; `tell` gets the share so far.

        Raises
        ------
        EndpointError : the vehicle stops sending, or the file cannot be written.
        """
        from mavsdk.plugins.log_files import LogFilesResult

        part = path.with_name(path.name + ".part")
        came: queue.SimpleQueue[tuple[Any, float]] = queue.SimpleQueue()
        try:
            part.unlink(missing_ok=True)  # MAVSDK opens no file that is there
            if not log.size:
                part.touch()  # MAVSDK refuses an empty one
            else:
                self._files.download_log_file_async(
                    self._entries[log.id],
                    str(part),
                    lambda result, data, _: came.put((result, data.progress)),
                )
                while True:
                    result, share = came.get(timeout=STALLED)
                    if result == LogFilesResult.SUCCESS:
                        break
                    if result != LogFilesResult.NEXT:
                        raise self._failed(f"did not send log {log.id}", result)
                    tell(share)
            part.rename(path)
        except queue.Empty:
            raise EndpointError(
                f"{self._endpoint.text}: log {log.id} stopped coming for {STALLED:g} s; fetch it again"
            ) from None
        except OSError as error:
            raise EndpointError(f"{error.filename}: cannot write: {error.strerror}") from None
        finally:
            if part.exists():
                part.unlink()

    def _failed(self, what: str, result: Any) -> EndpointError:
        why = result.name.lower().replace("_", " ")
        return EndpointError(f"{self._endpoint.text}: the vehicle {what}: {why}")
