"""Compressed files as plain ones, told by their first bytes: gzip, xz, zstd."""

from pathlib import Path
from typing import BinaryIO, cast

from gcs_health.errors import LogError

GZIP, XZ, ZSTD = b"\x1f\x8b", b"\xfd7zXZ\0", b"\x28\xb5\x2f\xfd"
MAGIC = 16  # bytes that tell any format


def first_bytes(path: Path) -> bytes:
    """Return what a plain file begins with."""
    with path.open("rb") as file:
        return file.read(MAGIC)


def is_compressed(path: Path) -> bool:
    """Whether it is a file that `decompressor` unpacks."""
    return first_bytes(path).startswith((GZIP, XZ, ZSTD))


def decompressor(path: Path) -> tuple[BinaryIO, None]:
    """Return a compressed file as a plain one, whose size is not known.

    Raises
    ------
    LogError : the package that reads it is not installed.
    """
    start = first_bytes(path)
    if start.startswith(GZIP):
        import gzip

        return cast(BinaryIO, gzip.open(path)), None
    if start.startswith(XZ):
        import lzma

        return cast(BinaryIO, lzma.open(path)), None
    try:
        import zstandard
    except ModuleNotFoundError:
        raise LogError(f"{path}: a zstd file needs zstandard: pip install 'gcs-health[ulog]'") from None
    return cast(BinaryIO, zstandard.open(path, "rb")), None


def reading_errors() -> tuple[type[Exception], ...]:
    """Return what reading a damaged compressed file raises; loads no decompressor that is not in use."""
    import sys
    import zlib

    errors: list[type[Exception]] = [OSError, EOFError, zlib.error]
    for module, name in (("lzma", "LZMAError"), ("zstandard", "ZstdError"), ("zipfile", "BadZipFile")):
        if module in sys.modules:
            errors.append(getattr(sys.modules[module], name))
    return tuple(errors)
