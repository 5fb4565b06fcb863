"""A .tlog that survives: stamp and frame appended, on disk within half a second of being received."""

import struct
from collections.abc import Iterable
from pathlib import Path

from gcs_health.errors import ConfigError

FLUSH_US = 500_000  # a killed process loses at most this much
_STAMP = struct.Struct(">Q")


class Recorder:
    """Appends frames to a new .tlog.

    Attributes
    ----------
    failed : why recording stopped, empty while it goes on. A full disk never stops the monitor.
    written : bytes so far.

    Raises
    ------
    ConfigError : the file exists already or cannot be made: a recording is never overwritten.
    """

    def __init__(self, path: str) -> None:
        self.failed = ""
        self.written = 0
        self._flushed_us = 0
        try:
            self._file = Path(path).open("xb")  # noqa: SIM115 (for the session)
        except FileExistsError:
            raise ConfigError(f"{path}: exists already; a recording is never overwritten") from None
        except OSError as error:
            raise ConfigError(f"{path}: cannot record there: {error.strerror}") from None
        self._path = path

    def write(self, frames: Iterable[tuple[int, bytes]], now_us: int) -> None:
        """Append (stamp [UNIX µs], frame); flushed when the last time was long enough ago."""
        if self.failed:
            return
        data = b"".join(_STAMP.pack(stamp) + frame for stamp, frame in frames)
        try:
            self._file.write(data)
            self.written += len(data)
            if now_us - self._flushed_us >= FLUSH_US or now_us < self._flushed_us:
                self._file.flush()
                self._flushed_us = now_us
        except OSError as error:
            self.failed = f"{self._path}: recording stopped: {error.strerror}"

    def close(self) -> None:
        """Flush and close."""
        try:
            self._file.close()
        except OSError as error:
            self.failed = self.failed or f"{self._path}: recording stopped: {error.strerror}"
