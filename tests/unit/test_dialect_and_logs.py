"""The generated dialect, and what a file is told to be."""

import importlib.util
import io
import sys
from pathlib import Path
from types import ModuleType

import pytest

from gcs_health.errors import LogError
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.tlog import open_log

ROOT = Path(__file__).parents[2]
FLIGHT = ROOT / "replay" / "lost_propeller.tlog"


def regenerate() -> ModuleType:
    spec = importlib.util.spec_from_file_location("regenerate", ROOT / "dialects" / "regenerate.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["esc", "gcs_health"])
def test_regeneration_gives_the_same_bytes(name: str) -> None:
    module = regenerate()
    assert name in module.NAMES
    assert module.generate(name) == (module.TARGET / f"{name}.py").read_text()


def test_our_own_messages_lie_in_no_other_dialect_s_block() -> None:
    """mavlink's blocks: common 300-10000 and those of vendors (message_definitions/v1.0/all.xml)."""
    from pymavlink.dialects.v20 import all as stock

    from gcs_health.mavlink.generated import gcs_health

    assert set(gcs_health.mavlink_map) == {53500, 53501, 53502}
    assert not set(stock.mavlink_map) & set(range(53500, 53520))


def test_the_messages_no_release_has_carry_their_published_crc_extra() -> None:
    messages = default_dialect().messages
    told = {id: (messages[id].name, messages[id].crc_extra, messages[id].size) for id in (290, 291, 410)}
    assert told == {290: ("ESC_INFO", 251, 46), 291: ("ESC_STATUS", 10, 57), 410: ("EVENT", 160, 53)}
    assert len(messages) > 300


@pytest.mark.parametrize("id", [0, 22, 30, 105, 147, 226, 241, 245, 253, 339, 375, 11030, 11044])
def test_layouts_are_those_of_the_release(id: int) -> None:
    from pymavlink.dialects.v20 import all as stock

    message = default_dialect().messages[id]
    assert message.layout.size == message.dtype.itemsize == stock.mavlink_map[id].unpacker.size
    assert [name for name, _, _ in message.fields] == stock.mavlink_map[id].ordered_fieldnames


def test_a_tlog_and_a_raw_stream_are_told_apart(tmp_path: Path) -> None:
    from gcs_health.mavlink.frames import FrameDecoder

    with open_log(str(FLIGHT)) as log:
        assert log.stamped
        assert log.size == FLIGHT.stat().st_size
        data = b"".join(log.blocks(1000))
    assert data == FLIGHT.read_bytes()
    raw = tmp_path / "flight.raw"
    frames = FrameDecoder(default_dialect(), stamped=True).feed(data[:20_000]).raw()
    raw.write_bytes(b"".join(frame for _, frame in frames))
    with open_log(str(raw)) as log:
        assert not log.stamped


def test_a_log_that_begins_with_damage_is_still_a_log(tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.tlog"
    damaged.write_bytes(b"\xfd\x00\x00" * 1000 + FLIGHT.read_bytes()[:5000])
    with open_log(str(damaged)) as log:
        assert log.stamped


def test_standard_input_may_come_in_small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    class Pipe(io.BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            return super().read(min(size or 0, 333) if size and size > 0 else size)

    class Stdin:
        buffer = Pipe(FLIGHT.read_bytes())

    monkeypatch.setattr(sys, "stdin", Stdin())
    log = open_log("-")
    assert log.size is None
    assert b"".join(log.blocks()) == FLIGHT.read_bytes()


@pytest.mark.parametrize(
    ("name", "content", "complaint"), [("a", b"", "empty"), ("b", b"hello " * 99, "no MAVLink")]
)
def test_what_is_no_log_is_told(tmp_path: Path, name: str, content: bytes, complaint: str) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(LogError, match=complaint):
        open_log(str(path))
