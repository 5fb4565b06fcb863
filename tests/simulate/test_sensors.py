"""What IMU and ESCs make of the truth: lever arm, lines, filters, clipping; steps, latency, polling, drop-outs."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gcs_health.gate import GRAVITY
from gcs_health.simulate.arithmetic import FLOATS
from gcs_health.simulate.esc_view import EscView
from gcs_health.simulate.plant import Plant
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.sensors import Escs, Imu, SensorConfig
from gcs_health.simulate.vehicle import load_sim_vehicle
from gcs_health.simulate.world import World

CALM = (0.0, 0.0, 0.0)
VEHICLE = load_sim_vehicle("ghalamchi_medium")
MOTOR = VEHICLE.motor
QUIET = SensorConfig(
    accelerometer_noise=0.0,
    gyro_noise=0.0,
    accelerometer_bias=0.0,
    gyro_bias=0.0,
    esc_current_noise=0.0,
    imu_integration_rate=1000.0,
)


def hovering(vehicle=VEHICLE) -> Plant:
    plant = Plant(vehicle, FLOATS)
    plant.position = [0.0, 0.0, -100.0]
    for rotor in plant.rotors:
        rotor.w = vehicle.hover
    return plant


def imu(config: SensorConfig = QUIET, step: float = 1e-3, ardupilot: bool = False) -> Imu:
    return Imu(config, FLOATS, [np.random.default_rng(1)], step, ardupilot)


def read(plant: Plant, config: SensorConfig = QUIET) -> np.ndarray:
    """One raw sample of a plant as it is."""
    sensor = imu(config)
    sensor.sample(1e-3, plant)
    return np.array(sensor.latest.values)


def test_an_imu_off_the_centre_feels_the_rotation() -> None:
    """f + W' x r + W x (W x r)."""
    lever = (0.05, -0.02, 0.03)
    plant = hovering(replace(VEHICLE, lever=lever))
    for rotor in plant.rotors:
        rotor.lift = 0.0  # no blade-pass line
    plant.specific_force = [0.5, -0.25, -GRAVITY]
    plant.rates, plant.turning = [1.0, -2.0, 3.0], [20.0, 10.0, -5.0]
    r, w, turning = np.array(lever), np.array(plant.rates), np.array(plant.turning)
    expected = np.array(plant.specific_force) + np.cross(turning, r) + np.cross(w, np.cross(w, r))
    np.testing.assert_allclose(read(plant)[:3], expected, atol=1e-12)
    np.testing.assert_allclose(read(plant)[3:], w)


def test_the_blades_shake_the_body_at_twice_the_rotors_speed() -> None:
    step = 1e-4
    vehicle = replace(VEHICLE, motor=replace(MOTOR, blade_pass=0.03))
    plant, sensor, seen = hovering(vehicle), imu(replace(QUIET, imu_integration_rate=1e4), step), []
    plant.specific_force, lift = [0.0, 0.0, 0.0], 1.7
    plant.rotors[0].lift = lift
    for k in range(10_000):
        plant.rotors[0].phase += step * vehicle.hover
        sensor.sample(k * step, plant)
        seen.append(sensor.latest.values[2])
    spectrum = 2.0 * np.abs(np.fft.rfft(seen)) / len(seen)
    beat = 2.0 * vehicle.hover / (2.0 * math.pi)
    assert np.argmax(spectrum[1:]) + 1 == pytest.approx(beat, abs=1.5)
    assert math.sqrt(2.0) * np.std(seen) == pytest.approx(0.03 * lift / plant.mass, rel=0.02)


def test_it_clips_at_its_range() -> None:
    plant = hovering()
    plant.specific_force = [200.0, -200.0, -GRAVITY]
    plant.rates = [50.0, 0.0, -50.0]
    seen = read(plant)
    assert (seen[0], seen[1], seen[3], seen[5]) == (157.0, -157.0, 34.9, -34.9)


def test_noise_and_bias_are_as_large_as_told() -> None:
    plant = hovering(replace(VEHICLE, motor=replace(MOTOR, blade_pass=0.0)))
    config = replace(QUIET, accelerometer_noise=0.35, gyro_noise=0.012)
    sensor, seen = imu(config), []
    for k in range(5000):
        sensor.sample(k * 1e-3, plant)
        seen.append(sensor.latest.values)
    np.testing.assert_allclose(np.std(seen, axis=0), [0.35] * 3 + [0.012] * 3, rtol=0.05)
    config = replace(QUIET, accelerometer_bias=0.05, gyro_bias=0.002)
    rngs = (np.random.default_rng(k) for k in range(300))
    biases = [Imu(config, FLOATS, [rng], 1e-3, False)._bias for rng in rngs]
    np.testing.assert_allclose(np.std(biases, axis=0), [0.05] * 3 + [0.002] * 3, rtol=0.15)


def response(frequency: float, *, ardupilot: bool) -> float:
    """Amplitude that is left of a vertical oscillation of 1 m/s² in what the autopilot publishes."""
    step = 2e-4
    config = replace(QUIET, imu_integration_rate=200.0, imu_filter=20.0)
    plant, sensor, seen = (
        hovering(replace(VEHICLE, motor=replace(MOTOR, blade_pass=0.0))),
        imu(config, step, ardupilot),
        [],
    )
    for k in range(10_000):
        t = k * step
        plant.specific_force = [math.sin(2.0 * math.pi * frequency * t), 0.0, -GRAVITY]
        if sensor.sample(t, plant) and t > 0.5:
            seen.append(sensor.latest.values[0])
    return float(math.sqrt(2.0) * np.std(seen))


@pytest.mark.parametrize("frequency", [13.0, 61.0, 152.0])
def test_px4_publishes_the_mean_over_its_integration_interval(frequency: float) -> None:
    """|sin(pi f T) / (pi f T)|, aliases and all: sheet 4 says 29 % of a 152 Hz line at 5 ms."""
    x = math.pi * frequency / 200.0
    assert response(frequency, ardupilot=False) == pytest.approx(abs(math.sin(x) / x), rel=0.02)


def test_px4s_mean_knows_nothing_of_its_own_rate() -> None:
    assert response(200.0, ardupilot=False) < 0.01


@pytest.mark.parametrize("frequency", [5.0, 20.0, 80.0])
def test_ardupilot_publishes_behind_two_butterworth_poles(frequency: float) -> None:
    assert response(frequency, ardupilot=True) == pytest.approx(
        1.0 / math.sqrt(1.0 + (frequency / 20.0) ** 4), rel=0.03
    )


# -- ESCs -----------------------------------------------------------------------------------------------


def polled(seconds: float = 0.5, **changes: object) -> tuple[Escs, Plant]:
    config = replace(QUIET, **changes)  # type: ignore[arg-type]
    plant = hovering()
    escs = Escs(config, FLOATS, [np.random.default_rng(1)], 4)
    for k in range(1, round(seconds / 1e-3) + 1):
        plant.step(1e-3, [VEHICLE.hover] * 4, CALM)
        escs.sample(k * 1e-3, plant)
    return escs, plant


def test_speed_and_current_come_in_steps() -> None:
    escs, plant = polled(esc_rpm_step=50.0, esc_current_step=0.25)
    (sample, *_) = escs.known
    assert sample is not None
    assert sample.rpm % 50.0 == 0.0
    assert sample.rpm == pytest.approx(plant.rotors[0].w * 30.0 / math.pi, abs=25.0 + 1.0)
    assert sample.current % 0.25 == 0.0


def test_current_is_the_motors_or_the_batterys() -> None:
    """Power balance: u_b I_b = R i² + kq w i; sheet 3 item 1."""
    motor, plant = polled(esc_current="motor")
    battery, _ = polled(esc_current="battery")
    i, w = plant.rotors[0].current, plant.rotors[0].w
    assert motor.known[0] is not None
    assert battery.known[0] is not None
    assert motor.known[0].current == pytest.approx(i, abs=0.02)
    side = (MOTOR.resistance * i * i + MOTOR.torque_constant * w * i) / plant.bus
    assert battery.known[0].current == pytest.approx(side, abs=0.02)
    assert side < 0.5 * i


def test_a_sample_arrives_after_the_latency() -> None:
    for latency in (0.006, 0.05):
        plant = hovering()
        escs = Escs(replace(QUIET, esc_latency=latency), FLOATS, [np.random.default_rng(1)], 4)
        ages = []
        for k in range(1, 401):
            before = escs.packets[0]
            escs.sample(k * 1e-3, plant)
            if escs.packets[0] > before:
                ages.append(k * 1e-3 - escs.known[0].t)  # type: ignore[union-attr]
        assert min(ages) == pytest.approx(latency, abs=1.1e-3)
        assert max(ages) == pytest.approx(latency, abs=1.1e-3)


def test_serial_telemetry_reads_one_esc_after_another() -> None:
    """Each as often as told, a quarter of the period apart; else all at one moment."""
    escs, _ = polled(esc_rate=20.0, esc_sequential=True)
    times = sorted(sample.t for sample in escs.known if sample is not None)
    np.testing.assert_allclose(np.diff(times), 0.05 / 4, atol=1.5e-3)
    assert escs.packets == [pytest.approx(10, abs=1)] * 4
    together, _ = polled(esc_rate=20.0)
    assert len({sample.t for sample in together.known if sample is not None}) == 1


def test_an_esc_drops_out_now_and_then_and_comes_back() -> None:
    changes = ["trajectory.duration=12", "trajectory.lands=false", "trajectory.height=3"]
    changes += ["sensors.esc_dropouts=30", "sensors.esc_dropout_length=0.8"]
    world = World(load_scenario("healthy_quad", changes), [2])
    newest, older, seen, seen_by_older = EscView(world, 0.1), EscView(world), [], []
    while world.t < 12.0:
        world.step()
        seen.append(newest.slot(1, world.t))
        seen_by_older.append(older.slot(1, world.t))
    silent = np.array([slot.silent for slot in seen])
    begins = np.flatnonzero((silent[1:] > 0.0) & (silent[:-1] == 0.0))
    assert 2 <= len(begins) <= 12  # six a flight on average
    for begin in begins:
        stretch = [slot for slot in seen[begin + 2 : begin + 60] if slot.silent > 0.0]
        assert all(slot.alive for slot in stretch)  # the newest PX4 still gives the last value ...
        assert len({slot.sample for slot in stretch}) == 1
    assert not any(
        slot.alive for slot in seen if slot.silent > 0.11
    )  # ... and zeros after a tenth of a second
    assert sum(slot.alive for slot in seen) > 0.4 * len(seen)
    assert not any(slot.alive for slot in seen_by_older if slot.silent > 0.0)  # older drivers zero at once
