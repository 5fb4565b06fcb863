"""A file that only grows, and survives: written at once, kept in memory while the disk is full, never torn.

Every append is one `write` of the system, so that a killed process loses nothing that was appended. What
the disk refuses waits in memory and is tried again each second, from the very byte where it was refused:
the file has no hole while the memory lasts, and whole appends are left out when it does not.
"""

from pathlib import Path

from gcs_health.errors import ConfigError

RETRY_US = 1_000_000
WAITING_MOST = 16 << 20  # bytes kept while the disk is full: some ten minutes of one vehicle


class AppendFile:
    """A new file at `path`, or with `overwrite` one begun anew.

    Attributes
    ----------
    written : bytes on the file so far. waiting : bytes that the disk has refused so far.
    lost : bytes left out since the memory for waiting ones was full.
    notices : what is to be told, each once; whoever tells it empties the list.

    Raises
    ------
    ConfigError : the file exists already, or cannot be made.
    """

    def __init__(self, path: Path, *, overwrite: bool = False) -> None:
        self.path = path
        self.written = self.lost = 0
        self.notices: list[str] = []
        self._waiting = bytearray()
        self._refused = False
        self._tried_us = 0
        try:
            self._file = path.open("wb" if overwrite else "xb", buffering=0)
        except FileExistsError:
            raise ConfigError(f"{path}: exists already; a recording is never overwritten") from None
        except OSError as error:
            raise ConfigError(f"{path}: cannot write there: {error.strerror}") from None

    @property
    def waiting(self) -> int:
        """See above."""
        return len(self._waiting)

    def append(self, data: bytes, now_us: int) -> None:
        """Put `data` at the end, all of it or none; `now_us` [UNIX µs] paces the attempts on a full disk."""
        if self._refused and len(self._waiting) + len(data) > WAITING_MOST:
            self.lost += len(data)
        else:
            self._waiting += data
        self.retry(now_us)

    def retry(self, now_us: int) -> None:
        """Write what waits, unless that was tried less than a second ago."""
        if not self._waiting or (self._refused and 0 <= now_us - self._tried_us < RETRY_US):
            return
        self._tried_us = now_us
        self._write()

    def close(self) -> None:
        """Write what waits if the disk lets us, and close."""
        if self._waiting:
            self._write()
        if self._waiting or self.lost:
            self.notices.append(f"{self.path}: {len(self._waiting) + self.lost} bytes were not written")
        self._file.close()

    def _write(self) -> None:
        try:
            while self._waiting:
                count = self._file.write(self._waiting) or 0
                del self._waiting[:count]
                self.written += count
        except OSError as error:
            if not self._refused:
                self.notices.append(f"{self.path}: cannot write: {error.strerror}; trying again")
            self._refused = True
            return
        if self._refused:
            self._refused = False
            self.notices.append(f"{self.path}: written again, {self.lost} bytes lost")
