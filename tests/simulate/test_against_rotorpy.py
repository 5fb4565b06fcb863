"""RotorPy as an independent plant: hover, a motor's step, and a second of free flight agree.

RotorPy's motors are first-order and its rotors have no inertia; ours are made so for the comparison:
no drag torque or friction leaves J w' = J (w* - w) / tau. Its axes are x forward, y left, z up.
"""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from gcs_health.simulate.arithmetic import FLOATS
from gcs_health.simulate.plant import Plant
from gcs_health.simulate.vehicle import load_sim_vehicle

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from rotorpy.vehicles.multirotor import Multirotor

STEP, TAU = 0.001, 0.025


def pair() -> tuple[Plant, Multirotor, dict[str, np.ndarray]]:
    """The same vehicle twice, hovering."""
    vehicle = load_sim_vehicle("bebop2")
    motor = replace(
        vehicle.motor, torque=1e-14, friction=0.0, inertia=1e-9, bandwidth=1 / TAU, inflow=0.0, drag=0.0
    )
    vehicle = replace(vehicle, motor=motor, drag_area=0.0)
    plant = Plant(vehicle, FLOATS)
    plant.position = [0.0, 0.0, -50.0]
    for rotor in plant.rotors:
        rotor.w = vehicle.hover
    places = {f"r{k}": np.array([r.position[0], -r.position[1], 0.0]) for k, r in enumerate(vehicle.rotors)}
    start = {
        "x": np.array([0.0, 0.0, 50.0]),
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.zeros(3),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, vehicle.hover),
    }
    other = Multirotor(
        {
            "mass": vehicle.mass,
            "Ixx": vehicle.inertia[0],
            "Iyy": vehicle.inertia[1],
            "Izz": vehicle.inertia[2],
            "Ixy": 0.0,
            "Ixz": 0.0,
            "Iyz": 0.0,
            "num_rotors": 4,
            "rotor_pos": places,
            "rotor_directions": np.array([1, 1, -1, -1]),
            "rotor_speed_min": 0.0,
            "rotor_speed_max": motor.top,
            "k_eta": motor.thrust,
            "k_m": motor.torque,
            "tau_m": TAU,
        },
        initial_state=start,
        aero=False,
    )
    return plant, other, start


def fly(seconds: float, factors: list[float]) -> tuple[Plant, dict[str, np.ndarray]]:
    plant, other, state = pair()
    wanted = [plant.vehicle.hover * factor for factor in factors]
    for _ in range(round(seconds / STEP)):
        plant.step(STEP, wanted, (0.0, 0.0, 0.0))
        state = other.step(state, {"cmd_motor_speeds": np.array(wanted)}, STEP)
    return plant, state


def test_hover() -> None:
    plant, state = fly(1.0, [1.0] * 4)
    # RotorPy's g is 9.81, ours 9.80665: 1.7 mm in a second
    assert -plant.position[2] == pytest.approx(state["x"][2], abs=0.01)


def test_a_motors_step() -> None:
    plant, state = fly(0.05, [1.1, 1.0, 0.9, 1.0])
    np.testing.assert_allclose([rotor.w for rotor in plant.rotors], state["rotor_speeds"], rtol=1e-3)


def test_free_flight() -> None:
    plant, state = fly(0.8, [1.004, 1.0, 0.998, 1.001])
    x, y, z = state["x"]
    p, q, _ = state["w"]
    np.testing.assert_allclose(plant.position, [x, -y, -z], rtol=0.02, atol=0.01)
    np.testing.assert_allclose(plant.velocity[:2], [state["v"][0], -state["v"][1]], rtol=0.02, atol=0.01)
    np.testing.assert_allclose(plant.rates[:2], [p, -q], rtol=0.01)
    assert abs(plant.rates[0]) + abs(plant.rates[1]) > 0.3  # it did turn
