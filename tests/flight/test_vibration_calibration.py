"""`gcs-health calibrate`, then `replay`: what healthy flights taught of the vibration is what it is judged by."""

import json
import re
from pathlib import Path

import pytest

from gcs_health.cli import main
from gcs_health.estimators.pooled_ar_file import load
from gcs_health.vehicle_file import load_vehicle

HOVER = [
    "vehicle=bebop2",
    "trajectory.kind=hover",
    "trajectory.lands=false",
    "telemetry.rates.HIGHRES_IMU=100",
]
HOVER += ["telemetry.rates.ESC_STATUS=0"]  # the vibration alone answers
HOVER += [f"spread.{name}=0" for name in ("mass", "thrust", "inertia", "rotor")]  # one craft, many days
SLOW = "fault=[{{kind='slow',motor=1,at={at},size={size}}}]"


def fly(out: Path, seed: int, duration: float, *changes: str) -> str:
    sets = [f"seed={seed}", f"trajectory.duration={duration}", *HOVER, *changes]
    assert main(["simulate", "healthy_quad", *[w for c in sets for w in ("--set", c)], "-o", str(out)]) == 0
    return str(out)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four healthy flights, a model trained on two of them and on slow ones, and a vehicle file that names it."""
    folder = tmp_path_factory.mktemp("vibration")
    well = [fly(folder / f"well{seed}.tlog", seed, 45.0) for seed in (1, 2, 3, 4)]
    slow = [
        fly(folder / f"slow{k}.tlog", 10 + k, 23.0, SLOW.format(at=5, size=size))
        for k, size in enumerate((0.95, 0.88, 0.8))
    ]
    assert main(["train", *well[:3], *slow, "-o", str(folder / "quad.npz")]) == 0
    assert main(["calibrate", well[0], "-o", str(folder / "quad.toml")]) == 0
    text = (folder / "quad.toml").read_text("utf-8")
    assert "[vibration]" not in text or "# alarm: no [vibration] models" in text
    text = text.replace("[vibration]\n", "") + '\n[vibration]\nmodels = ["quad.npz"]\n'
    (folder / "quad.toml").write_text(text, encoding="utf-8")
    return folder


def calibrated(folder: Path, name: str, *options: str) -> Path:
    """Return the vehicle file that four healthy flights of it make."""
    out = folder / name
    flights = [str(folder / f"well{seed}.tlog") for seed in (1, 2, 3, 4)]
    assert (
        main(["calibrate", *flights, "--vehicle", str(folder / "quad.toml"), *options, "-o", str(out)]) == 0
    )
    return out


def of_motor_1(folder: Path, flight: str, vehicle: Path) -> list[dict]:
    lines = folder / "events.jsonl"
    main(["replay", flight, "--vehicle", str(vehicle), "--jsonl", str(lines), "--estimators", "pooled_ar"])
    rows = [json.loads(line) for line in lines.read_text("utf-8").splitlines()]
    return [row for row in rows if row["type"] == "estimate" and row["motor"] == 1]


def test_what_was_identified_is_printed_and_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = calibrated(folder, "again.toml", "--false-alarms", "12")
    said = capsys.readouterr().out
    found = re.search(r"vibration.alarm.quad.npz +([0-9.]+) ± .*once in 5 min, extrapolated", said)
    assert found is not None, said
    craft = load_vehicle(out)
    ((name, level),) = craft.vibration_alarms
    assert (name, level.every) == ("quad.npz", 300.0)
    assert level.threshold == pytest.approx(float(found[1]), rel=1e-3)
    assert craft.healthy_vibration is not None
    assert re.search(r"vibration.healthy +[0-9.]+ ± .*orders ax 8", said)


def test_the_monitor_alarms_where_the_vehicles_own_flights_put_it(folder: Path) -> None:
    """What would be seen is the threshold and 1.64 sigma: it moves as far as the threshold did."""
    mine = calibrated(folder, "often.toml", "--false-alarms", "12")  # so few minutes allow no rarer alarms
    flight = fly(folder / "fresh.tlog", 31, 23.0)
    ((_, level),) = load_vehicle(mine).vibration_alarms
    own = load(folder / "quad.npz").threshold
    assert abs(level.threshold - own) > 0.02
    seen = [
        {row["t"]: row["detectable"] for row in of_motor_1(folder, flight, vehicle) if row["detectable"]}
        for vehicle in (folder / "quad.toml", mine)
    ]
    both = sorted(seen[0].keys() & seen[1].keys())
    assert len(both) > 30
    for t in both:
        assert seen[1][t] - seen[0][t] == pytest.approx(level.threshold - own, abs=1e-4)


def test_a_changed_vibration_is_told_and_a_healthy_one_is_not(folder: Path) -> None:
    mine = calibrated(folder, "mine.toml")
    well = of_motor_1(folder, fly(folder / "well.tlog", 41, 30.0), mine)
    told = of_motor_1(folder, fly(folder / "ill.tlog", 42, 30.0, SLOW.format(at=15, size=0.9)), mine)
    assert len(well) > 200
    assert not any("vibration_changed" in row["reasons"] for row in well)
    changed = [row["t"] for row in told if "vibration_changed" in row["reasons"]]
    assert changed
    assert min(changed) > 15.0


def test_models_that_do_not_fit_are_refused_with_the_reason(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    slower = fly(tmp_path / "slower.tlog", 51, 30.0, "telemetry.rates.HIGHRES_IMU=50")
    out = tmp_path / "v.toml"
    assert main(["calibrate", slower, "--vehicle", str(folder / "quad.toml"), "-o", str(out)]) == 0
    said = capsys.readouterr().out
    assert "vibration.alarm.quad.npz   -  it was trained at 100 Hz, these flights have 50 Hz" in said
    assert "vibration.healthy          -  accelerations at 50 Hz, 90 Hz are needed" in said
    (tmp_path / "quad.npz").write_bytes((folder / "quad.npz").read_bytes())
    assert load_vehicle(out).vibration_alarms == ()
