"""The plant against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from gcs_health.gate import GRAVITY
from gcs_health.simulate.arithmetic import COLUMNS, FLOATS
from gcs_health.simulate.booms import Booms, modes
from gcs_health.simulate.plant import Plant
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.sensors import Imu, SensorConfig
from gcs_health.simulate.vehicle import SimVehicle, load_sim_vehicle, shipped
from gcs_health.simulate.wind import GRADES, Dryden, scales
from gcs_health.simulate.world import World

CALM = (0.0, 0.0, 0.0)
QUIET = SensorConfig(
    accelerometer_noise=0.0, gyro_noise=0.0, accelerometer_bias=0.0, gyro_bias=0.0, residual_unbalance=0.0
)


def flying(vehicle: SimVehicle, ops=FLOATS) -> Plant:
    """A plant high up with its rotors at hover speed."""
    plant = Plant(vehicle, ops)
    plant.position = [0.0, 0.0, -100.0]
    for rotor in plant.rotors:
        rotor.w = vehicle.hover
    return plant


def in_vacuum(name: str, **changes: float) -> SimVehicle:
    """A shipped vehicle without air's drag and inflow."""
    vehicle = load_sim_vehicle(name)
    return replace(vehicle, drag_area=0.0, motor=replace(vehicle.motor, inflow=0.0, drag=0.0, **changes))


@pytest.mark.parametrize("name", shipped())
def test_hover_speed_holds_the_height(name: str) -> None:
    vehicle = in_vacuum(name)
    plant = flying(vehicle)
    for _ in range(1000):
        plant.step(0.001, [vehicle.hover] * len(vehicle.rotors), CALM)
    expected = math.sqrt(vehicle.mass * GRAVITY / (len(vehicle.rotors) * vehicle.motor.thrust))
    assert plant.rotors[0].w == pytest.approx(expected, rel=1e-3)
    assert plant.velocity[2] == pytest.approx(0.0, abs=0.03)
    assert plant.specific_force[2] == pytest.approx(-GRAVITY, rel=2e-3)


def test_a_motors_step_response_is_that_of_its_equation() -> None:
    """J w' = kq i - kt w² - kf w with i from the ESC's loop, against scipy's integrator."""
    from scipy.integrate import solve_ivp

    vehicle = in_vacuum("bebop2")
    m = vehicle.motor
    plant = flying(vehicle)
    goal = 900.0

    def slope(_t: float, w: np.ndarray) -> np.ndarray:
        hold = m.inertia * m.bandwidth
        current = (m.torque * goal**2 + m.friction * goal + hold * (goal - w)) / m.torque_constant
        current = np.minimum(current, m.current_limit)
        return (m.torque_constant * current - m.torque * w**2 - m.friction * w) / m.inertia

    times = np.arange(1, 151) * 1e-3
    truth = solve_ivp(slope, (0, 0.15), [vehicle.hover], t_eval=times, rtol=1e-9, atol=1e-9).y[0]
    mine = []
    for _ in times:
        plant.step(0.001, [goal] * 4, CALM)
        mine.append(plant.rotors[0].w)
    np.testing.assert_allclose(mine, truth, rtol=0.006)
    assert mine[-1] == pytest.approx(goal, rel=1e-3)


def test_free_fall() -> None:
    vehicle = in_vacuum("octocopter")
    plant = flying(vehicle)
    for rotor in plant.rotors:
        rotor.w, rotor.driven = 0.0, 0.0
    for _ in range(2000):
        plant.step(0.001, [0.0] * 8, CALM)
    assert plant.velocity[2] == pytest.approx(GRAVITY * 2.0, rel=1e-9)
    assert plant.position[2] == pytest.approx(-100.0 + 0.5 * GRAVITY * 4.0, abs=0.02)
    assert plant.specific_force == [0.0, 0.0, 0.0]


def spinning(rates: list[float], dt: float) -> Plant:
    """A body without torques: rotors stand still, no air."""
    plant = flying(in_vacuum("bebop2"))
    plant.inertia = [0.02, 0.03, 0.045]
    plant.rates = list(rates)
    for rotor in plant.rotors:
        rotor.w, rotor.driven = 0.0, 0.0
    for _ in range(round(1.0 / dt)):
        plant.step(dt, [0.0] * 4, CALM)
    return plant


def test_a_torque_free_body_keeps_energy_and_angular_momentum() -> None:
    start = [1.0, 4.0, 0.5]
    plant = spinning(start, 1e-4)
    inertia = np.array(plant.inertia)
    before, after = np.array(start), np.array(plant.rates)
    assert 0.5 * inertia @ after**2 == pytest.approx(0.5 * inertia @ before**2, rel=2e-3)
    assert np.linalg.norm(inertia * after) == pytest.approx(np.linalg.norm(inertia * before), rel=1e-3)


def test_a_symmetric_body_precesses_at_its_rate() -> None:
    """Transverse rates turn at (Iz - Ix) / Ix times the spin."""
    plant = flying(in_vacuum("bebop2"))
    plant.inertia = [0.02, 0.02, 0.03]
    plant.rates = [0.5, 0.0, 6.0]
    for rotor in plant.rotors:
        rotor.w, rotor.driven = 0.0, 0.0
    for _ in range(5000):
        plant.step(1e-4, [0.0] * 4, CALM)
    angle = (0.03 - 0.02) / 0.02 * 6.0 * 0.5
    assert math.atan2(plant.rates[1], plant.rates[0]) == pytest.approx(
        math.remainder(angle, 2 * math.pi), abs=2e-3
    )
    assert plant.rates[2] == pytest.approx(6.0)


def test_spinning_rotors_turn_the_body_as_a_gyroscope() -> None:
    """All rotors one way: a pitch rate makes a roll moment q H, H = -s J w about z."""
    vehicle = in_vacuum("bebop2")
    plant = flying(vehicle)
    for rotor in plant.rotors:
        rotor.spin = 1.0
    plant.rates = [0.0, 1.0, 0.0]
    plant.step(0.001, [vehicle.hover] * 4, CALM)
    momentum = -4 * vehicle.motor.inertia * vehicle.hover
    assert plant.turning[0] * vehicle.inertia[0] == pytest.approx(-1.0 * momentum, rel=0.01)


@pytest.mark.parametrize("spin", [1, -1])
def test_a_faster_rotor_yaws_the_body_against_its_spin(spin: int) -> None:
    vehicle = in_vacuum("bebop2")
    plant = flying(vehicle)
    wanted = [vehicle.hover * (1.1 if rotor.spin == spin else 1.0) for rotor in vehicle.rotors]
    for _ in range(50):
        plant.step(0.001, wanted, CALM)
    assert math.copysign(1, plant.rates[2]) == spin  # counter-clockwise rotors push the nose right


def test_the_bank_of_a_steady_circle() -> None:
    changes = [
        "trajectory.kind='circle'",
        "trajectory.radius=6",
        "trajectory.speed=5",
        "trajectory.lands=false",
    ]
    changes += ["wind.speed=0", "wind.turbulence='none'", "trajectory.duration=25", "spread.mass=0"]
    scenario = load_scenario("healthy_quad", changes)
    scenario = replace(scenario, vehicle=replace(scenario.vehicle, drag_area=0.0), sensors=QUIET)
    world = World(scenario, [1])
    banks = []
    while world.t < 25.0:
        world.step()
        if world.t > 18.0:
            _, x, y, _ = world.plant.attitude
            banks.append(math.acos(1 - 2 * (x * x + y * y)))
    speed = math.hypot(*world.plant.velocity[:2])
    radius = math.hypot(world.plant.position[0], world.plant.position[1] - 6.0)
    assert np.mean(banks) == pytest.approx(math.atan(speed**2 / (radius * GRAVITY)), rel=0.03)


def test_an_unbalance_shakes_by_m_r_w2_over_m() -> None:
    vehicle = in_vacuum("ghalamchi_medium", blade_pass=0.0)
    plant = flying(vehicle)
    plant.rotors[1].imbalance = 40e-6 * 0.1  # 40 mg at the tip: 1.284 m/s² says sheet 2 section 1
    raw = replace(QUIET, imu_integration_rate=1e4)
    imu = Imu(raw, FLOATS, [np.random.default_rng(1)], 1e-4, ardupilot=False)
    seen = []
    for k in range(3000):
        plant.step(1e-4, [vehicle.hover] * 4, CALM)
        imu.sample(k * 1e-4, plant)
        seen.append(imu.latest.values[:2])
    amplitude = np.sqrt(2.0) * np.std(np.array(seen), axis=0)
    np.testing.assert_allclose(amplitude, 1.284, rtol=0.02)


@pytest.mark.parametrize(("grade", "height", "speed"), [("moderate", 15.0, 8.0), ("severe", 40.0, 12.0)])
def test_gusts_have_drydens_spectra(grade: str, height: float, speed: float) -> None:
    step = 0.02
    gusts = Dryden([np.random.default_rng(3)], step, height, speed, GRADES[grade]).series(200_000)
    f, power = welch(gusts, fs=1.0 / step, nperseg=4096, axis=0)
    w = 2.0 * math.pi * f
    (sigma_u, length_u), (sigma_w, length_w) = scales(height, GRADES[grade])
    u = sigma_u**2 * 4.0 * length_u / speed / (1.0 + (length_u * w / speed) ** 2)
    lateral = [
        sigma**2
        * 2.0
        * length
        / speed
        * (1 + 3 * (length * w / speed) ** 2)
        / (1 + (length * w / speed) ** 2) ** 2
        for sigma, length in ((sigma_u, length_u), (sigma_w, length_w))
    ]
    for column, definition in zip(power.T, [u, *lateral], strict=True):
        for low, high in ((0.05, 0.2), (0.2, 1.0), (1.0, 5.0)):
            band = (f > low) & (f < high)
            ratio = 10.0 * math.log10(column[band].mean() / definition[band].mean())
            assert abs(ratio) < 1.0, (low, high, ratio)


def test_booms_ring_at_the_sheets_frequencies() -> None:
    boom = load_sim_vehicle("dutta_hexa").boom
    assert boom is not None
    hertz = modes(boom)[0] / (2.0 * math.pi)
    np.testing.assert_allclose(hertz, [148.0, 1187.0], atol=0.5)
    bare = modes(replace(boom, tip_mass=1e-9))[0] / (2.0 * math.pi)
    np.testing.assert_allclose(bare, [244.0, 1529.0], rtol=1e-3)
    booms = Booms(boom, 1, 1e-4)
    booms.step(np.array([5.0]))
    tips = [float(booms.step(np.array([5.0 + (k == 10)]))[0]) for k in range(20_000)]
    f, power = welch(np.diff(tips), fs=1e4, nperseg=8192)
    assert f[np.argmax(power * (f < 500))] == pytest.approx(148.0, abs=2.0)
    assert f[np.argmax(power * (f > 800))] == pytest.approx(1187.0, abs=3.0)


def test_it_rests_on_the_ground_and_reads_gravity() -> None:
    vehicle = load_sim_vehicle("melczer_hexa")
    plant = Plant(vehicle, FLOATS)
    plant.position[2] -= 0.1  # dropped from 10 cm
    for _ in range(3000):
        plant.step(0.001, [0.0] * 6, CALM)
    assert -plant.position[2] == pytest.approx(vehicle.leg, abs=0.006)
    assert plant.specific_force[2] == pytest.approx(-GRAVITY, rel=1e-3)
    assert max(map(abs, plant.rates)) < 1e-3


def test_the_battery_sags_and_empties() -> None:
    vehicle = load_sim_vehicle("bebop2")
    plant = flying(vehicle)
    for _ in range(2000):
        plant.step(0.001, [vehicle.hover] * 4, CALM)
    power = sum(
        rotor.current * (vehicle.motor.resistance * rotor.current + vehicle.motor.torque_constant * rotor.w)
        for rotor in plant.rotors
    )
    assert plant.bus * plant.battery_current == pytest.approx(power, rel=0.02)
    assert plant.bus < vehicle.battery.voltage - 0.9 * vehicle.battery.resistance * plant.battery_current
    assert plant.used == pytest.approx(plant.battery_current * 2.0 / 3600.0, rel=0.05)


def test_columns_fly_as_single_flights_do() -> None:
    scenario = load_scenario("demo")
    many = World(scenario, [4, 5, 6])
    single = World(scenario, [5])
    for _ in range(5000):
        many.step()
        single.step()
    np.testing.assert_allclose([v[1] for v in many.plant.position], single.plant.position, atol=1e-6)
    np.testing.assert_allclose(
        [r.w[1] for r in many.plant.rotors], [r.w for r in single.plant.rotors], rtol=1e-6
    )
    assert many.ops is COLUMNS
