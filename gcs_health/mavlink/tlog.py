"""Log files as blocks of bytes: .tlog with stamps, or a raw stream without, told by their content.

Autopilots' own logs (`ulog`, `dataflash`) come as the .tlog that they would have been; compressed files
(`compressed`) as what is in them.
"""

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import BinaryIO, Self

from gcs_health.errors import LogError
from gcs_health.mavlink import dataflash, ulog
from gcs_health.mavlink.compressed import MAGIC, decompressor, first_bytes, is_compressed, reading_errors
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.framing import hunt
from gcs_health.mavlink.tlog_sets import is_zip, open_folder, open_zip

BLOCK = 1 << 19  # bytes; memory is bounded by it, whatever the log's length (benchmarks/decode.py)
# A log of ours holds a checked frame within its first MiB however damaged; what does not is no log
SEARCHED = 1 << 20


class Log:
    """An open log: iterate `blocks`, once.

    Attributes
    ----------
    name : as given, "-" is standard input.
    stamped : whether each frame has a receive stamp before it (.tlog), or not (.tlog.raw, .rlog).
    size : bytes, None where it cannot be known.
    """

    def __init__(self, name: str, file: BinaryIO, size: int | None) -> None:
        self.name = name
        self.size = size
        self._file = file
        self._start = self._fill(SEARCHED)
        if not self._start:
            raise LogError(f"{name}: the file is empty; expected a MAVLink log (.tlog)")
        self.stamped = self._detect()

    def blocks(self, size: int = BLOCK) -> Iterator[bytes]:
        """Yield the whole log in blocks of at most `size` bytes."""
        for at in range(0, len(self._start), size):
            yield self._start[at : at + size]
        self._start = b""
        while block := self._read(size):
            yield block

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _read(self, size: int) -> bytes:
        try:
            return self._file.read(size)
        except reading_errors() as error:
            raise LogError(f"{self.name}: cannot read on: {error}") from None

    def _fill(self, size: int) -> bytes:
        """Read up to `size` bytes; a pipe gives fewer at a time."""
        parts, missing = [], size
        while missing and (part := self._read(missing)):
            parts.append(part)
            missing -= len(part)
        return b"".join(parts)

    def _detect(self) -> bool:
        """Tell stamps from none by which reading finds its first frame sooner.

        Raises
        ------
        LogError : neither reading finds any.
        """
        extra_of = default_dialect().crc_extra
        record, stamped = hunt(self._start, 0, True, extra_of, final=True)
        frame, raw = hunt(self._start, 0, False, extra_of, final=True)
        if not stamped and not raw:
            raise LogError(f"{self.name}: no MAVLink in it; expected a telemetry log (.tlog)")
        # the raw reading finds a stamped record's frame too, 8 bytes behind its stamp
        return stamped and record <= frame


def open_log(name: str) -> Log:
    """Open a log by name: a file, compressed or not, a .zip with one in it, a folder of them; "-" is standard input.

    Raises
    ------
    LogError : there is no such file, it cannot be read, it is empty, or holds no MAVLink.
    """
    if name == "-":
        return Log("standard input", sys.stdin.buffer, None)
    file, size = _open(Path(name))
    try:
        return Log(name, file, size)
    except LogError:
        file.close()
        raise


def _open(path: Path) -> tuple[BinaryIO, int | None]:
    if path.is_dir():
        return open_folder(path)
    if is_zip(path):
        return _unpacked(path, open_zip)
    try:
        if is_compressed(path):
            return _unpacked(path, decompressor)
        start = first_bytes(path)
        if start.startswith(ulog.MAGIC):
            return ulog.open_ulog(str(path), path.open("rb")), None
        if start.startswith(dataflash.MAGIC):
            return dataflash.open_dataflash(str(path), path), None
        return path.open("rb"), path.stat().st_size
    except OSError as error:
        raise LogError(f"{path}: cannot read it: {error.strerror or error}") from None


def _unpacked(
    path: Path, unpack: Callable[[Path], tuple[BinaryIO, int | None]]
) -> tuple[BinaryIO, int | None]:
    """Return a compressed log as what is in it; an autopilot's own is unpacked first, its readers seek in it."""
    plain, _ = unpack(path)
    try:
        start = plain.read(MAGIC)
        if not start.startswith((ulog.MAGIC, dataflash.MAGIC)):
            plain.close()
            return unpack(path)  # not every decompressor goes back to the start
        with tempfile.NamedTemporaryFile(suffix=".log") as whole:
            whole.write(start)
            shutil.copyfileobj(plain, whole)
            whole.flush()
            plain.close()
            if start.startswith(ulog.MAGIC):
                return ulog.open_ulog(str(path), open(whole.name, "rb")), None
            return dataflash.open_dataflash(str(path), Path(whole.name)), None
    except reading_errors() as error:
        raise LogError(f"{path}: cannot unpack it: {error}") from None
