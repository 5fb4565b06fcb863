"""Scenarios: what is accepted, what is refused and how; and that flights do what they say."""

import json
import math
from pathlib import Path

import pytest

from gcs_health.errors import ConfigError
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, Event, SummaryEvent
from gcs_health.simulate.flight import Flight, record
from gcs_health.simulate.scenario import Scenario, load_scenario, shipped
from gcs_health.simulate.truth import simulated
from gcs_health.simulate.vehicle import load_sim_vehicle
from gcs_health.simulate.vehicle import shipped as vehicles
from gcs_health.simulate.world import World

QUICK = ["trajectory.height=3", "trajectory.duration=14", "trajectory.lands=false"]


def log_of(scenario: Scenario) -> bytes:
    return b"".join(record(stamp, frame) for stamp, frame in Flight(scenario).run())


def events_of(log: bytes) -> list[Event]:
    monitor = Monitor(MonitorConfig(stamped=True))
    return monitor.feed(log) + monitor.finish()


def alerts_of(log: bytes) -> list[AlertEvent]:
    return [event for event in events_of(log) if isinstance(event, AlertEvent)]


@pytest.mark.parametrize("name", shipped())
def test_every_shipped_scenario_is_valid_and_says_what_it_is(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.about.endswith(".")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("vehicle=nothing", ["vehicle 'nothing'", "bebop2"]),
        ("wind.sped=3", ["lost_propeller.toml: wind.sped", "unknown key", "speed"]),
        ("wind.speed=-3", ["wind.speed", "from 0 on"]),
        ("wind.turbulence=hurricane", ["wind.turbulence", "none, low, moderate, severe"]),
        ("trajectory.kind=loop", ["trajectory.kind", "circle"]),
        ("trajectory.duration=5", ["trajectory.duration|fault[0].at", ""]),
        ("fault.0.motor=5", ["fault[0].motor", "motors 1 to 4"]),
        ("fault.0.motor=0", ["fault[0].motor", "from 1 on"]),
        ("fault.0.at=1.0", ["fault[0].at", "before the vehicle flies"]),
        ("fault.0.at=99", ["fault[0].at", "after the flight's end"]),
        ("fault.0.kind=explodes", ["fault[0].kind", "propeller_lost"]),
        ("fault.0.kind=effectiveness", ["fault[0].size", "is missing"]),
        ("fault.0.size=0.5", ["fault[0].size", "has no size"]),
        ("fault.3.at=5", ["fault.3.at", "1 are listed"]),
        ("fault.at=5", ["say which one", "fault.0.at"]),
        ("telemetry.autopilot=betaflight", ["telemetry.autopilot", "ardupilot"]),
        ("telemetry.rates.RAW_IMU=50", ["telemetry.rates.RAW_IMU", "unknown key"]),
        ("sensors.esc_current=both", ["sensors.esc_current", "motor, battery"]),
        ("seed=-1", ["seed", "from 0 on"]),
        ("physics_rate=1e9", ["physics_rate", "up to 20000"]),
        ("trajectory.lands=maybe", ["trajectory.lands", "true or false"]),
        ("sensors.esc_rate=0", ["sensors.esc_rate", "above 0"]),
        ("sensors.imu_integration_rate=0", ["sensors.imu_integration_rate", "above 0"]),
        ("sensors.esc_rpm_step=0", ["sensors.esc_rpm_step", "above 0"]),
        ("link.loss=2", ["link.loss", "up to 1"]),
        ("link.burst=0", ["link.burst", "from 1 on"]),
        ("schema=x", ["schema", "gcs_health.scenario/1"]),
        ("novalue", ["--set novalue", "key=value"]),
    ],
)
def test_a_bad_value_gets_one_line_that_names_it(change: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        load_scenario("lost_propeller", [change])
    line = str(caught.value)
    assert "\n" not in line
    assert any(first in line for first in words[0].split("|"))
    assert all(word in line for word in words[1:])


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (("mass = 0.5", "mass = -0.5"), ["mass", "above 0"]),
        (("thrust = 2.5e-6", "thrust = 2.5e-7"), ["motor.top", "too little to fly"]),
        (("motor = 2", "motor = 3"), ["rotor[1].motor", "expected 2"]),
        (('spin = "ccw"', 'spin = "left"'), ["rotor[0].spin", "ccw, cw"]),
        (("[battery]", "[batery]"), ["battery", ""]),
    ],
)
def test_a_bad_vehicle_gets_one_line_too(tmp_path: Path, edit: tuple[str, str], words: list[str]) -> None:
    import gcs_health.simulate

    good = Path(gcs_health.simulate.__file__).parent / "vehicles" / "bebop2.toml"
    bad = tmp_path / "mine.toml"
    bad.write_text(good.read_text().replace(*edit, 1))
    with pytest.raises(ConfigError, match=r"mine\.toml") as caught:
        load_sim_vehicle(str(bad))
    assert all(word in str(caught.value) for word in words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "schema"),
        ("not toml [", "not valid TOML"),
        ('schema = "gcs_health.scenario/1"', "vehicle: is missing"),
    ],
)
def test_a_broken_file(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "s.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=words):
        load_scenario(str(path))
    with pytest.raises(ConfigError, match="neither a file nor one of"):
        load_scenario("no_such_thing")
    with pytest.raises(ConfigError, match="cannot read"):
        load_scenario(str(tmp_path / "gone.toml"))
    with pytest.raises(ConfigError, match="cannot read"):
        load_scenario(str(tmp_path))


def test_a_scenario_names_a_vehicle_beside_it(tmp_path: Path) -> None:
    import gcs_health.simulate

    folder = Path(gcs_health.simulate.__file__).parent
    mine = (folder / "vehicles" / "bebop2.toml").read_text().replace("mass = 0.5 ", "mass = 0.6 ")
    (tmp_path / "heavy.toml").write_text(mine)
    scenario = (folder / "scenarios" / "demo.toml").read_text().replace('"bebop2"', '"heavy.toml"')
    (tmp_path / "mine.toml").write_text(scenario)
    assert load_scenario(str(tmp_path / "mine.toml")).vehicle.mass == 0.6


def test_the_same_seed_gives_the_same_bytes() -> None:
    changes = [*QUICK, "trajectory.duration=8", "fault.0.at=6"]
    first = log_of(load_scenario("lost_propeller", changes))
    assert first == log_of(load_scenario("lost_propeller", changes))
    assert first != log_of(load_scenario("lost_propeller", [*changes, "seed=2"]))


def test_a_lost_propeller_is_found_and_the_truth_says_so() -> None:
    scenario = load_scenario("lost_propeller")
    log = log_of(scenario)
    told = json.loads(simulated(scenario, "x.tlog", int.from_bytes(log[:8], "big")))["truth"]
    alert, clear = alerts_of(log)
    assert (clear.id, clear.state, clear.code) == (alert.id, "escalated", "PROPELLER_LOST")
    assert (alert.code, alert.motor) == ("ROTOR_FAILED", told["rotor"])
    assert 0.0 < alert.t - told["vehicle_time_s"] < 0.1
    # the truth's UNIX time is that of the log's stamps: the alert's datum is the same moment
    assert 0 < alert.t_unix_us - told["from_unix_us"] < 150_000
    assert told["label_time_s"] == pytest.approx(12.0, abs=0.2)
    healthy = json.loads(simulated(load_scenario("healthy_quad"), "x.tlog", 0))["truth"]
    assert (healthy["condition"], healthy["fault"], healthy["rotor"]) == ("healthy", None, None)


@pytest.mark.parametrize("name", ["ghalamchi_large", "melczer_hexa", "dutta_hexa"])
def test_a_hexacopter_flies_on_without_any_one_rotor(name: str) -> None:
    for motor in range(1, 7):
        changes = [*QUICK, f"fault.0.motor={motor}", "fault.0.at=5", "trajectory.kind=hover"]
        world = World(load_scenario("hexa_flies_on", [*changes, f"vehicle={name}"]), [motor])
        lowest, tilt = math.inf, 0.0
        while world.t < 10.0:
            world.step()
            if world.t > 5.0:
                lowest = min(lowest, -world.plant.position[2])
                _, x, y, _ = world.plant.attitude
                tilt = max(tilt, 2.0 * (x * x + y * y))
        assert lowest > 1.5, motor
        assert tilt < 0.3, motor
        assert -world.plant.position[2] == pytest.approx(3.0, abs=0.5), motor


def test_a_healthy_flight_takes_off_and_lands_without_an_alarm() -> None:
    changes = ["trajectory.height=3", "trajectory.duration=22"]
    flight = Flight(load_scenario("healthy_quad", changes))
    log = b"".join(record(stamp, frame) for stamp, frame in flight.run())
    summary = next(event for event in events_of(log) if isinstance(event, SummaryEvent))
    assert not summary.alerts
    assert -flight.world.plant.position[2] == pytest.approx(flight.scenario.vehicle.leg, abs=0.02)
    assert flight.world.goal.off


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("name", vehicles())
def test_every_vehicle_flies_hard_and_stays_up(name: str, seed: int) -> None:
    changes = [*QUICK, "trajectory.height=6", "trajectory.kind=aggressive", f"vehicle={name}"]
    scenario = load_scenario("healthy_quad", [*changes, "wind.speed=4", "wind.turbulence=moderate"])
    world = World(scenario, [seed])  # floats: two flights as columns cost more
    while world.t < 11.0:
        world.step()
        assert world.t < 6.0 or -world.plant.position[2] > 1.0
    assert not world.controller.crashed


@pytest.mark.parametrize("name", ["bebop2", "ghalamchi_medium", "octocopter"])
@pytest.mark.parametrize("speed", [5.0, 15.0])
def test_forward_flight_reaches_its_speed_and_keeps_its_height(name: str, speed: float) -> None:
    changes = [*QUICK, "trajectory.height=6", "trajectory.kind=forward", f"trajectory.speed={speed}"]
    world = World(load_scenario("healthy_quad", [*changes, f"vehicle={name}", "wind.speed=2"]), [1])
    while world.t < 13.0:
        world.step()
        assert world.t < 6.0 or -world.plant.position[2] > 3.0
    assert world.plant.velocity[0] == pytest.approx(speed, abs=1.0)
    assert -world.plant.position[2] == pytest.approx(6.0, abs=1.0)
