"""`gcs-health convert`: a log of any format that is read, as .tlog or raw MAVLink, compressed or not."""

import argparse
import gzip
import lzma
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO, cast

from gcs_health.cli import DONE
from gcs_health.errors import ConfigError, LogError
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.tlog import Log, open_log


def run(options: argparse.Namespace) -> int:
    """Write the log anew; bytes of a .tlog stay what they were."""
    target = Path(options.output)
    suffixes = [suffix for suffix in target.suffixes if suffix not in (".gz", ".xz")]
    kind = suffixes[-1] if suffixes else ""
    if kind not in (".tlog", ".rlog", ".raw"):
        raise ConfigError(
            f"{target}: expected a name that ends in .tlog, .rlog or .raw, or .gz, .xz of those"
        )
    with open_log(options.file) as log:
        if kind == ".tlog" and not log.stamped:
            raise LogError(f"{log.name}: raw MAVLink has no receive stamps: it cannot become a .tlog")
        blocks = log.blocks() if (kind == ".tlog") is log.stamped else _frames(log)
        written = 0
        try:
            with _create(target) as file:
                for block in blocks:
                    file.write(block)
                    written += len(block)
        except OSError as error:
            raise ConfigError(f"{target}: cannot write: {error.strerror or error}") from None
    print(f"{target}: {written} bytes")
    return DONE


def _create(target: Path) -> BinaryIO:
    if target.suffix == ".gz":
        return cast(BinaryIO, gzip.open(target, "wb"))
    return cast(BinaryIO, lzma.open(target, "wb")) if target.suffix == ".xz" else target.open("wb")


def _frames(log: Log) -> Iterator[bytes]:
    """Yield the frames without their stamps."""
    decoder = FrameDecoder(default_dialect(), stamped=True)
    for block in log.blocks():
        yield b"".join(frame for _, frame in decoder.feed(block).raw())
    yield b"".join(frame for _, frame in decoder.finish().raw())
