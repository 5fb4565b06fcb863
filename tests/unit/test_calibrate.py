"""What healthy flights teach, against simulated flights whose truth is known, and the file that is written."""

import math
import subprocess
import sys
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from synthetic_flight import HOVER, Scenario, airframe, fly

from gcs_health.airframe import Airframe, Motor
from gcs_health.calibration.columns import columns
from gcs_health.calibration.control_gains import control_gains
from gcs_health.calibration.findings import Finding, missing, pool
from gcs_health.calibration.hover import hover
from gcs_health.calibration.vehicle_text import vehicle_text
from gcs_health.errors import AirframeError
from gcs_health.estimators.healthy_baseline import healthy_baseline
from gcs_health.estimators.unbalance import UnbalanceEstimator
from gcs_health.samples import CommandReading, Reading, RotorReading
from gcs_health.simulate.batch import fly_many
from gcs_health.simulate.scenario import load_scenario
from gcs_health.vehicle_file import load_vehicle

ROOT = Path(__file__).parents[2]


def found(readings: list[Reading], craft: Airframe) -> dict[str, Finding]:
    flight = columns("flight", readings, len(craft.rotors))
    return {f.key: f for f in [*control_gains(flight, craft), *hover(flight, craft)]}


def healthy(rotors: int = 4, **changes: object) -> list[Reading]:
    return list(fly(Scenario(rotors, **{"duration": 30.0, "at": 99.0, **changes})))  # type: ignore[arg-type]


@pytest.mark.parametrize("rotors", [3, 4, 6, 8])
def test_gains_come_out_within_their_spread(rotors: int) -> None:
    craft = airframe(rotors)
    got = found(healthy(rotors), craft)
    truth = {"thrust": craft.effectiveness.thrust, "roll": craft.effectiveness.roll}
    truth |= {"pitch": craft.effectiveness.pitch}
    for key, value in truth.items():
        assert value is not None
        (learned,), (spread,) = got[key].values, got[key].stds
        assert learned == pytest.approx(value, rel=0.15), key
        assert abs(learned - value) < 3.0 * spread, key
        assert spread < 0.15 * value, key


def test_late_rotor_speeds_are_seen_as_late() -> None:
    readings = [r._replace(t=r.t + 0.02) if isinstance(r, RotorReading) else r for r in healthy()]
    readings.sort(key=lambda reading: reading.t)
    (shift,) = found(readings, airframe(4))["rotor_delay"].values
    assert shift == pytest.approx(-0.02, abs=0.004)
    (none,) = found(healthy(), airframe(4))["rotor_delay"].values
    assert abs(none) <= 0.004


def test_hover_speeds_and_commands_are_the_baseline() -> None:
    readings: list[Reading] = []
    for reading in healthy():
        readings.append(reading)
        if isinstance(reading, RotorReading):
            readings.append(CommandReading(reading.t, tuple(w / (2.0 * HOVER) for w in reading.speed)))
    got = found(readings, airframe(4))
    assert got["hover_speed"].values == pytest.approx([HOVER] * 4, rel=0.05)
    assert got["hover_command"].values == pytest.approx([0.5] * 4, rel=0.05)
    assert got["weight_offset"].values == pytest.approx((0.0, 0.0), abs=0.01)


def test_what_is_not_in_the_flight_is_said_with_its_reason() -> None:
    got = found([r for r in healthy() if not isinstance(r, RotorReading)], airframe(4))
    assert not got["thrust"].found
    assert got["thrust"].why == "no rotor speeds"
    assert not found(healthy(duration=3.0), airframe(4))["roll"].found
    assert not found([], airframe(4))["thrust"].found


def test_pooling_weighs_by_spread_and_never_hides_that_flights_differ() -> None:
    def one(value: float, std: float) -> Finding:
        return Finding("effectiveness", "roll", (value,), (std,), "")

    assert pool([one(1.0, 0.1), one(1.1, 0.1)]).values == pytest.approx((1.05,))
    assert pool([one(1.0, 0.1), one(1.1, 0.1)]).stds[0] == pytest.approx(0.1 / math.sqrt(2.0))
    assert pool([one(1.0, 0.001), one(2.0, 0.001)]).stds[0] == pytest.approx(0.5, rel=0.01)
    assert pool([missing("a", "b", "why"), one(1.0, 0.1)]).values == (1.0,)
    assert pool([missing("a", "b", "why")] * 2).why == "why"


def test_the_written_file_is_read_back_as_it_was_meant(tmp_path: Path) -> None:
    craft = airframe(4)
    flight = columns("flight", healthy(), 4)
    findings = [*control_gains(flight, craft), *hover(flight, craft)]
    path = tmp_path / "quad.toml"
    path.write_text(vehicle_text(craft, findings, "made by a test"), encoding="utf-8")
    again = load_vehicle(path)
    assert again.rotors == craft.rotors
    assert again.mass == craft.mass
    assert again.motor == craft.motor
    got = {finding.key: finding for finding in findings}
    assert again.effectiveness.roll == pytest.approx(got["roll"].values[0], rel=1e-3)
    assert again.baseline.hover_speed == pytest.approx(got["hover_speed"].values, rel=1e-3)
    assert again.baseline.spread("hover_speed") == pytest.approx(got["hover_speed"].stds, rel=1e-3)
    assert "hover_command: no motor commands" in path.read_text("utf-8")


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "gcs_health", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, cwd=ROOT)


def test_the_command_finds_a_simulated_vehicles_gains(tmp_path: Path) -> None:
    """The geometry comes from the log's parameters; the simulator's own G is the truth."""
    flight, out = tmp_path / "flight.tlog", tmp_path / "vehicle.toml"
    changes = ["trajectory.kind=aggressive", "trajectory.duration=40", "telemetry.rates.HIGHRES_IMU=250"]
    made = run("simulate", "healthy_quad", *(w for c in changes for w in ("--set", c)), "-o", str(flight))
    assert made.returncode == 0, made.stderr
    done = run("calibrate", str(flight), "-o", str(out))
    assert done.returncode == 0, done.stderr
    table = tomllib.loads(out.read_text("utf-8"))
    truth = load_scenario("healthy_quad", changes).vehicle.airframe().effectiveness
    for key, tolerance in (("thrust", 0.05), ("roll", 0.25), ("pitch", 0.25), ("yaw", 0.4)):
        assert table["effectiveness"][key] == pytest.approx(getattr(truth, key), rel=tolerance), key
    assert run("replay", str(flight), "--vehicle", str(out)).returncode == 0


def test_a_flight_with_a_fault_teaches_nothing(tmp_path: Path) -> None:
    refused = run("calibrate", "replay/lost_propeller.tlog", "-o", str(tmp_path / "x.toml"))
    assert refused.returncode == 2
    assert "not a healthy flight: motor 3" in refused.stderr
    assert not (tmp_path / "x.toml").exists()


@pytest.mark.parametrize(
    ("row", "complaint"),
    [
        ("[baseline]\nhover_speed = [1, 2]", "baseline.hover_speed: expected 4 numbers"),
        ("[baseline.std]\nhover_spede = 1", "did you mean 'hover_speed'?"),
        ("[telemetry]\nrotor_delay = 'x'", "telemetry.rotor_delay: expected a number"),
        ("[motor]\ncurrent_side = 'esc'", "motor.current_side: expected 'motor' or 'battery', got 'esc'"),
    ],
)
def test_a_wrong_table_names_its_key(tmp_path: Path, row: str, complaint: str) -> None:
    path = tmp_path / "quad.toml"
    path.write_text(vehicle_text(airframe(4, known=False), [], "x") + row + "\n", encoding="utf-8")
    with pytest.raises(AirframeError) as error:
        load_vehicle(path)
    assert complaint in str(error.value)


REAL = ROOT.parent / "shared" / "data"


@pytest.mark.skipif(not REAL.is_dir(), reason="the recorded flights are not beside the checkout")
@pytest.mark.parametrize(
    ("flights", "vehicle"),
    [
        (("indiflight_00267", "indiflight_00341"), "indiflight"),
        (("nanodrone_square_run1", "nanodrone_square_run3"), "nanodrone"),
    ],
)
def test_two_flights_of_one_real_craft_teach_the_same(
    flights: tuple[str, str], vehicle: str, tmp_path: Path
) -> None:
    """Within a tenth, though the rotor speeds of one nanodrone flight are late by 30 ms and not the other's."""
    learned = []
    for flight in flights:
        out = tmp_path / f"{flight}.toml"
        geometry = str(REAL / "vehicles" / f"{vehicle}.toml")
        done = run("calibrate", str(REAL / f"{flight}.tlog"), "--vehicle", geometry, "-o", str(out))
        assert done.returncode == 0, done.stderr
        learned.append(load_vehicle(out).effectiveness)
    first, second = learned
    for key in ("thrust", "roll"):
        assert getattr(second, key) == pytest.approx(getattr(first, key), rel=0.1), key


def test_the_motors_constants_come_out_of_a_flight_with_currents() -> None:
    scenario = load_scenario("healthy_quad", ["trajectory.kind=random", "trajectory.duration=40"])
    flown = fly_many(scenario, [5], 250.0, 50.0)
    truth = scenario.vehicle.motor
    bare = replace(scenario.vehicle.airframe(), motor=Motor(torque_constant=truth.torque_constant))
    got = {f.key: f for f in healthy_baseline(flown.readings(0), bare) if f.table == "motor"}
    assert got["current_side"].word == "motor"
    assert got["torque"].values[0] == pytest.approx(truth.torque, rel=0.1)
    unknown = {f.key: f for f in healthy_baseline(flown.readings(0), replace(bare, motor=Motor()))}
    assert not unknown["torque"].found
    assert "torque_constant" in unknown["torque"].why


def test_a_calibrated_unbalance_is_read_back(tmp_path: Path) -> None:
    craft = airframe(4)
    finding = Finding("baseline", "unbalance", (1e-6, 2e-6, 3e-6, 4e-6), (1e-7,) * 4, "order tracking")
    side = Finding("motor", "current_side", (), (), "why", "battery")
    path = tmp_path / "mine.toml"
    path.write_text(vehicle_text(craft, [finding, side], "here"))
    again = load_vehicle(str(path))
    assert again.baseline.unbalance == finding.values
    assert again.motor.current_side == "battery"
    baseline = UnbalanceEstimator(again).config.baseline
    assert baseline is not None
    assert baseline.unbalance == finding.values
