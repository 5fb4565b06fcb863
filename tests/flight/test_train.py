"""`gcs-health train`: flights of known degradation to a model that the vehicle file names and the monitor uses."""

import json
import zipfile
from pathlib import Path

import pytest

from gcs_health.cli import main
from gcs_health.vehicle_file import load_vehicle

HOVER = ["vehicle=bebop2", "trajectory.kind=hover", "trajectory.duration=23", "trajectory.lands=false"]
HOVER += ["telemetry.rates.HIGHRES_IMU=100"]
SLOW = "fault=[{{kind='slow',motor=1,at=5,size={size}}}]"


def fly(out: Path, seed: int, *changes: str) -> None:
    sets = [part for change in (*HOVER, f"seed={seed}", *changes) for part in ("--set", change)]
    assert main(["simulate", "healthy_quad", *sets, "-o", str(out)]) == 0


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with flights, the model trained on them, and a vehicle file that names it."""
    folder = tmp_path_factory.mktemp("train")
    for seed in (1, 2, 3):
        fly(folder / f"well{seed}.tlog", seed)
    for k, size in enumerate((0.95, 0.88, 0.8)):
        fly(folder / f"slow{k}.tlog", 10 + k, SLOW.format(size=size))
    flights = sorted(map(str, folder.glob("*.tlog")))
    assert main(["train", *flights, "--regime", "light air", "-o", str(folder / "quad.npz")]) == 0
    assert main(["calibrate", str(folder / "well1.tlog"), "-o", str(folder / "quad.toml")]) == 0
    with (folder / "quad.toml").open("a") as file:
        file.write('\n[vibration]\nmodels = ["quad.npz"]\n')
    return folder


def by_vibration(lines: Path) -> list[bool]:
    """Whether each estimate of motor 1's degradation in flight had a model."""
    rows = [json.loads(line) for line in lines.read_text().splitlines()]
    rows = [row for row in rows if row["type"] == "estimate" and row["estimator"] == "pooled_ar"]
    return ["no_model" not in row["reasons"] for row in rows if row["motor"] == 1 and row["t"] > 17.0]


def test_the_monitor_uses_the_model_that_the_vehicle_file_names(trained: Path) -> None:
    flight, lines = str(trained / "slow1.tlog"), trained / "events.jsonl"
    main(["replay", flight, "--jsonl", str(lines), "--estimators", "pooled_ar"])
    without = by_vibration(lines)
    main(["replay", flight, "--jsonl", str(lines), "--vehicle", str(trained / "quad.toml")])
    assert len(without) > 30
    assert all(by_vibration(lines))


def test_what_the_model_can_do_is_told(trained: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flights = sorted(map(str, trained.glob("*.tlog")))
    assert main(["train", *flights, "--channels", "az,p,q", "-o", str(trained / "again.npz")]) == 0
    said = capsys.readouterr().out
    assert "6 flights: " in said
    assert "levels 0, 0.05, 0.2 fitted" in said
    assert "the model does not know them" in said  # motors 2 to 4 were never slow
    assert "more would make it surer" in said


def test_a_calibration_goes_on_naming_the_model(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flight, vehicle, out = trained / "well2.tlog", trained / "quad.toml", tmp_path / "again.toml"
    assert main(["calibrate", str(flight), "--vehicle", str(vehicle), "-o", str(out)]) == 0
    assert f"copy {trained / 'quad.npz'} beside {out}" in capsys.readouterr().out
    (tmp_path / "quad.npz").write_bytes((trained / "quad.npz").read_bytes())
    assert load_vehicle(out).vibration_models == (str(tmp_path / "quad.npz"),)


def test_an_evidence_packet_holds_the_model(trained: Path) -> None:
    lost = trained / "lost"
    lost.mkdir()
    fly(lost / "lost.tlog", 7, "fault=[{kind='propeller_lost',motor=3,at=12}]")
    vehicle = str(trained / "quad.toml")
    main(["replay", str(lost / "lost.tlog"), "--vehicle", vehicle, "--evidence", str(lost / "e")])
    packet = next((lost / "e").iterdir())
    with zipfile.ZipFile(packet) as inside:
        assert inside.read("quad.npz") == (trained / "quad.npz").read_bytes()
        alert = json.loads(inside.read("packet.json"))["alert"]
    lines = lost / "again.jsonl"
    assert main(["replay", str(packet), "--jsonl", str(lines)]) == 0
    assert alert in map(json.loads, lines.read_text().splitlines())


@pytest.mark.parametrize(
    ("truth", "complaint"),
    [
        (None, "No such file"),
        ("{}", "got 'truth'"),
        ('{"truth": {"condition": "fault", "faults": [{"kind": "slow"}]}}', "got 'rotor'"),
        (
            '{"truth": {"condition": "fault", "faults": [{"kind": "propeller_lost", "rotor": 1, "size": 0.5, '
            '"vehicle_time_s": 9}]}}',
            "got 'propeller_lost' of motor 1",
        ),
    ],
)
def test_a_flight_without_a_usable_truth_is_told(
    trained: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], truth: str | None, complaint: str
) -> None:
    flight = tmp_path / "odd.tlog"
    flight.write_bytes((trained / "well1.tlog").read_bytes())
    if truth is not None:
        (tmp_path / "odd.truth.json").write_text(truth)
    assert main(["train", str(flight), "-o", str(tmp_path / "m.npz")]) == 2
    said = capsys.readouterr().err
    assert "odd.truth.json: expected the truth of the flight" in said
    assert complaint in said
    assert not (tmp_path / "m.npz").exists()


def test_a_model_that_is_not_there_is_told_with_file_and_key(
    trained: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = trained / "wrong.toml"
    wrong.write_text((trained / "quad.toml").read_text().replace("quad.npz", "../quad.npz"))
    assert main(["replay", str(trained / "well1.tlog"), "--vehicle", str(wrong)]) == 2
    assert (
        "wrong.toml: vibration.models: expected the names of files beside this one" in capsys.readouterr().err
    )
