"""PX4's .ulg, ArduPilot's .bin and compressed logs: the same samples and the same verdict as the .tlog."""

import gzip
import io
import lzma
import zipfile
from pathlib import Path

import numpy as np
import pytest
import zstandard
from log_writers import as_dataflash, as_ulog, samples_of

from gcs_health import Flight, MonitorConfig, replay
from gcs_health.errors import LogError
from gcs_health.mavlink.tlog import open_log
from gcs_health.samples import EscStatus, EscTelemetry, Heartbeat, Imu, LandedState, Parameter, Sample

FLIGHT = Path(__file__).parents[2] / "replay" / "lost_propeller.tlog"
ARDUPILOT = {
    "FRAME_CLASS": 1.0,
    "FRAME_TYPE": 1.0,
    "INS_ACCEL_FILTER": 0.0,
    "SERVO1_FUNCTION": 33.0,
    "SERVO2_FUNCTION": 34.0,
    "SERVO3_FUNCTION": 35.0,
    "SERVO4_FUNCTION": 36.0,
}


@pytest.fixture(scope="module")
def samples() -> list[Sample]:
    return samples_of(FLIGHT.read_bytes())


@pytest.fixture(scope="module")
def reference() -> Flight:
    return quickly(FLIGHT)


def quickly(log: Path) -> Flight:
    return replay(log, MonitorConfig(estimators=("effectiveness",)))


def read_back(path: Path) -> list[Sample]:
    with open_log(str(path)) as log:
        assert log.stamped
        return samples_of(b"".join(log.blocks()))


def of(kind: type, samples: list[Sample]) -> list[tuple[object, ...]]:
    """Samples of one type without who sent them and when they arrived."""
    return [(s.message, s.time_us, *s[5:]) for s in samples if type(s) is kind]


def test_a_ulog_gives_the_samples_of_the_tlog(samples: list[Sample], tmp_path: Path) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(as_ulog(samples))
    read = read_back(path)
    for kind in (Imu, EscStatus):
        got, wanted = of(kind, read), of(kind, samples)
        if kind is Imu:  # a temperature is not in that topic
            got, wanted = [row[:-1] for row in got], [row[:-1] for row in wanted]
        assert got == wanted
    told = {s.name: s.number for s in read if isinstance(s, Parameter)}
    assert told == {s.name: s.number for s in samples if isinstance(s, Parameter)}
    assert {s.autopilot for s in read if isinstance(s, Heartbeat)} == {12}
    assert {s.landed_state for s in read if isinstance(s, LandedState)} == {1, 2}
    stamps = [s.receive_us for s in read]
    assert stamps == sorted(stamps)


@pytest.mark.parametrize(("imu", "motors"), [("sensor_combined", True), ("vehicle_imu", False)])
def test_a_ulog_gives_the_verdict_of_the_tlog(
    imu: str, motors: bool, samples: list[Sample], reference: Flight, tmp_path: Path
) -> None:
    path = tmp_path / "flight.ulg"
    path.write_bytes(as_ulog(samples, imu=imu, motors=motors))
    flight = quickly(path)
    alert, wanted = flight.alerts[0], reference.alerts[0]
    assert flight.records[0].uid == "000600000000333233343436000000000001"
    assert (alert.code, alert.motor) == (wanted.code, wanted.motor) == ("ROTOR_FAILED", 3)
    assert alert.t == pytest.approx(wanted.t, abs=0.05)
    imu_columns, expected = flight.columns("imu"), reference.columns("imu")
    np.testing.assert_allclose(imu_columns["az"], expected["az"], rtol=1e-6)
    speeds, expected = flight.columns("rotors"), reference.columns("rotors")
    before = len(speeds["t"]) - len(expected["t"])  # the parameters came later over the link
    np.testing.assert_array_equal(speeds["speed_3"][before:], expected["speed_3"])


def test_a_dataflash_log_gives_the_verdict_of_the_tlog(
    samples: list[Sample], reference: Flight, tmp_path: Path
) -> None:
    path = tmp_path / "flight.bin"
    path.write_bytes(as_dataflash(samples, ARDUPILOT))
    read = read_back(path)
    assert [row[1:8] for row in of(Imu, read)] == [row[1:8] for row in of(Imu, samples)]
    got = np.array([s.speed for s in read if isinstance(s, EscTelemetry)])
    wanted = np.array([s.speed for s in samples if isinstance(s, EscStatus)])
    np.testing.assert_allclose(got[-len(wanted) + 5 :], wanted[5:], atol=0.06)  # whole rpm
    flight = quickly(path)
    assert flight.records[0].uid == "0036003c3230510a34303433000000000000"
    assert [(a.code, a.motor) for a in flight.alerts] == [("ROTOR_FAILED", 3), ("PROPELLER_LOST", 3)]
    assert flight.alerts[0].t == pytest.approx(reference.alerts[0].t, abs=0.1)
    assert "ArduPilot ESC_TELEMETRY" in " ".join(flight.summaries[0].notes)


def zipped(data: bytes) -> bytes:
    whole = io.BytesIO()
    kind = "ulg" if data.startswith(b"ULog") else "bin" if data.startswith(b"\xa3\x95") else "tlog"
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("notes.txt", "not a log")
        archive.writestr(f"flights/FLIGHT.{kind.upper()}", data)
    return whole.getvalue()


@pytest.mark.parametrize("pack", [gzip.compress, lzma.compress, zstandard.ZstdCompressor().compress, zipped])
def test_compressed_logs_are_read_as_what_is_in_them(pack, samples: list[Sample], tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    plain = FLIGHT.read_bytes()
    packed = tmp_path / "flight.packed"  # told by content
    packed.write_bytes(pack(plain))
    with open_log(str(packed)) as log:
        assert b"".join(log.blocks()) == plain
    packed.write_bytes(pack(as_ulog(samples)))
    assert of(EscStatus, read_back(packed)) == of(EscStatus, samples)
    packed.write_bytes(pack(as_dataflash(samples, ARDUPILOT)))
    assert len(of(EscTelemetry, read_back(packed))) >= len(of(EscStatus, samples))


def test_a_damaged_compressed_log_is_one_clear_line(tmp_path: Path) -> None:
    packed = tmp_path / "flight.tlog.gz"
    packed.write_bytes(gzip.compress(FLIGHT.read_bytes())[:-40])
    with pytest.raises(LogError, match="cannot read on"), open_log(str(packed)) as log:
        list(log.blocks())


@pytest.mark.parametrize("start", [b"ULog\x01\x12\x35\x01" + bytes(40), b"\xa3\x95\x80" + bytes(200)])
def test_an_autopilots_log_with_nothing_in_it_is_an_error(start: bytes, tmp_path: Path) -> None:
    path = tmp_path / "flight.log"
    path.write_bytes(start)
    with pytest.raises(LogError, match=r"flight\.log: "):
        open_log(str(path))
