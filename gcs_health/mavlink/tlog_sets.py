"""Several bytes as one log: the one inside a .zip, or the .tlog of a folder in order of their names."""

import zipfile
from pathlib import Path
from typing import BinaryIO, cast

from gcs_health.errors import LogError

LOGS = (".tlog", ".tlog.raw", ".rlog", ".ulg", ".bin")  # what a log in a .zip is called


class Chain:
    """Files read one after another, as one: `read` and `close` of a binary file."""

    def __init__(self, paths: list[Path]) -> None:
        self._paths = list(reversed(paths))
        self._file: BinaryIO | None = None

    def read(self, size: int) -> bytes:
        """Return up to `size` bytes, none at the end of the last file."""
        while self._file is not None or self._paths:
            if self._file is None:
                self._file = self._paths.pop().open("rb")
            if block := self._file.read(size):
                return block
            self.close()
        return b""

    def close(self) -> None:
        """Close the file that is open."""
        if self._file is not None:
            self._file.close()
            self._file = None


def is_zip(path: Path) -> bool:
    """Whether it is a .zip from its first byte on: a log may hold bytes that end like one."""
    try:
        with path.open("rb") as file:
            return file.read(4) == b"PK\3\4" and zipfile.is_zipfile(path)
    except OSError:
        return False


def open_folder(path: Path) -> tuple[BinaryIO, int]:
    """Return a folder's .tlog files as one file, and its size.

    Raises
    ------
    LogError : there is none in it.
    """
    paths = sorted(path.glob("*.tlog"))
    if not paths:
        raise LogError(f"{path}: this is a directory without a MAVLink log (.tlog) in it")
    return cast(BinaryIO, Chain(paths)), sum(each.stat().st_size for each in paths)


def open_zip(path: Path) -> tuple[BinaryIO, int]:
    """Return the log inside a .zip, and its size.

    Raises
    ------
    LogError : there is none in it, or several.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            logs = [member for member in archive.infolist() if member.filename.lower().endswith(LOGS)]
            if len(logs) != 1:
                raise LogError(f"{path}: expected one log ({', '.join(LOGS)}) in it, found {len(logs)}")
            # the archive stays open for the member until that is closed
            return cast(BinaryIO, archive.open(logs[0])), logs[0].file_size
    except (OSError, zipfile.BadZipFile, NotImplementedError, RuntimeError) as error:
        raise LogError(f"{path}: cannot unpack it: {error}") from None
