"""The command line as a user meets it: exit codes, one clear line, nothing heavy for --help."""

import io
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from gcs_health import __version__
from gcs_health.cli import main
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.frames import FrameDecoder

ROOT = Path(__file__).parents[2]
FLIGHT = ROOT / "replay" / "lost_propeller.tlog"
PNG = bytes.fromhex("89504e470d0a1a0a0000000d49484452000000010000000108060000001f15c489")


def gcs(*arguments: str, stdin: bytes = b"") -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-m", "gcs_health", *arguments]
    return subprocess.run(command, input=stdin, capture_output=True, timeout=60, check=False)


@pytest.mark.parametrize("option", ["--help", "--version"])
def test_help_and_version_load_nothing_heavy(option: str) -> None:
    code = (
        "import sys\nfrom gcs_health.cli import main\n"
        f"try:\n    main([{option!r}])\nexcept SystemExit as end:\n    assert end.code == 0\n"
        "heavy = {'numpy', 'pymavlink', 'textual', 'scipy', 'mavsdk', 'rich', 'sqlalchemy'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stderr
    assert ("examples:" if option == "--help" else __version__) in done.stdout


def test_replay_prints_the_verdict_and_ends_with_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(FLIGHT)]) == 0
    shown = capsys.readouterr()
    assert "ROTOR_FAILED raised: motor 3 (front left, CW)" in shown.out
    assert shown.err == ""


def test_replay_fails_on_alert_only_if_asked_and_raised(tmp_path: Path) -> None:
    assert main(["replay", str(FLIGHT), "--fail-on-alert"]) == 3
    healthy = tmp_path / "healthy.tlog"
    healthy.write_bytes(FLIGHT.read_bytes()[:60_000])
    assert main(["replay", str(healthy), "--fail-on-alert"]) == 0


def test_replay_of_standard_input_gives_the_same_lines_as_of_the_file(tmp_path: Path) -> None:
    out = tmp_path / "events.jsonl"
    assert main(["replay", str(FLIGHT), "--jsonl", str(out)]) == 0
    piped = gcs("replay", "-", "--jsonl", "-", stdin=FLIGHT.read_bytes())
    assert piped.returncode == 0
    assert piped.stdout == out.read_bytes()
    assert b"ROTOR_FAILED raised" in piped.stderr  # the text, since the lines have standard output
    assert json.loads(piped.stdout.splitlines()[0])["schema"] == "gcs_health.events/1"


def test_a_raw_stream_without_stamps_replays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    raw = tmp_path / "flight.rlog"
    frames = FrameDecoder(default_dialect(), stamped=True).feed(FLIGHT.read_bytes()).raw()
    raw.write_bytes(b"".join(frame for _, frame in frames))
    assert main(["replay", str(raw), "--fail-on-alert"]) == 3
    assert "motor 3" in capsys.readouterr().out


def test_a_damaged_log_is_read_as_far_as_it_goes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = FLIGHT.read_bytes()
    damaged = tmp_path / "damaged.tlog"
    damaged.write_bytes(PNG + data[:50_000] + b"\xfd\xfe" * 40 + data[50_000:-11])
    assert main(["replay", str(damaged), "--fail-on-alert"]) == 3
    shown = capsys.readouterr().out
    assert "garbage_bytes" in shown
    assert "truncated_bytes" in shown


def _no_vehicle(path: Path) -> None:
    from pymavlink.dialects.v20 import common

    link = common.MAVLink(None, srcSystem=255, srcComponent=190)
    frame = common.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3).pack(link)
    path.write_bytes(b"\x00\x06\x00\x00\x00\x00\x00\x00" + frame)


@pytest.mark.parametrize(
    ("name", "make", "complaint"),
    [
        ("empty.tlog", lambda p: p.write_bytes(b""), "the file is empty"),
        ("folder", lambda p: p.mkdir(), "this is a directory"),
        ("picture.png", lambda p: p.write_bytes(PNG * 20), "no MAVLink in it"),
        ("notes.txt", lambda p: p.write_text("take off at noon\n" * 50), "no MAVLink in it"),
        ("absent.tlog", lambda p: None, "No such file"),
        ("station.tlog", _no_vehicle, "no vehicle in this log; it holds 255.190 (ground station)"),
    ],
)
@pytest.mark.parametrize("command", ["replay", "info"])
def test_unreadable_input_gets_one_line_and_2(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    command: str,
    name: str,
    make: Callable[[Path], object],
    complaint: str,
) -> None:
    path = tmp_path / name
    make(path)
    if command == "info" and name == "station.tlog":
        assert main([command, str(path)]) == 0  # what is in it is what was asked
        assert "255.190 (ground station)" in capsys.readouterr().out
        return
    assert main([command, str(path)]) == 2
    shown = capsys.readouterr()
    assert shown.err.startswith(f"gcs-health: {path}: ")
    assert complaint in shown.err
    assert shown.err.count("\n") == 1


def test_one_bad_file_does_not_stop_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(tmp_path / "absent.tlog"), str(FLIGHT)]) == 2
    shown = capsys.readouterr()
    assert "ROTOR_FAILED raised" in shown.out
    assert "absent.tlog" in shown.err


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--jsonl", "{place}/absent/out.jsonl"], "cannot write there"),
        (["--vehicle", "{place}/absent.toml"], "cannot read the vehicle file"),
        (["--signing-key", "{place}/absent.key"], "cannot read the signing key"),
    ],
)
def test_bad_options_are_told_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], complaint: str
) -> None:
    assert main(["replay", str(FLIGHT), *[o.format(place=tmp_path) for o in options]]) == 2
    shown = capsys.readouterr()
    assert complaint in shown.err
    assert shown.out == ""


def test_a_key_of_the_wrong_length_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    key = tmp_path / "key"
    key.write_text("00" * 31)
    assert main(["replay", str(FLIGHT), "--signing-key", str(key)]) == 2
    assert "expected a signing key of 32 bytes or 64 hex digits" in capsys.readouterr().err
    key.write_text("00" * 32 + "\n")
    assert main(["replay", str(FLIGHT), "--signing-key", str(key)]) == 0


@pytest.mark.parametrize("arguments", [[], ["fly"], ["replay"], ["replay", "x", "--estimate-rate", "0"]])
def test_bad_usage_ends_with_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2


def test_info_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(FLIGHT), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["survey"]
    assert told["vehicles"][0]["vehicle"] == "1.1"
    assert {m["name"] for m in told["systems"][0]["messages"]} >= {"HIGHRES_IMU", "ESC_STATUS", "HEARTBEAT"}


def test_a_reader_that_leaves_early_is_no_error() -> None:
    command = f"{sys.executable} -m gcs_health replay {FLIGHT} --jsonl - 2>/dev/null | head -1"
    done = subprocess.run(
        ["bash", "-c", f"set -o pipefail; {command}"], capture_output=True, timeout=60, check=False
    )
    assert done.returncode == 0
    assert done.stdout.startswith(b'{"schema":')


def test_no_colour_codes_ever(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    main(["replay", str(FLIGHT)])
    assert "\x1b" not in capsys.readouterr().out
    assert os.environ["NO_COLOR"] == "1"
