"""A load that is carried and dropped, and the air that a descent churns up, against closed forms."""

import math

import numpy as np
import pytest

from gcs_health.errors import ConfigError
from gcs_health.gate import GRAVITY
from gcs_health.simulate.arithmetic import COLUMNS, FLOATS
from gcs_health.simulate.payload import Load, Payload
from gcs_health.simulate.plant import AIR_DENSITY, Plant
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.vehicle import load_sim_vehicle
from gcs_health.simulate.wake import Wake
from gcs_health.simulate.world import World

STILL = [
    *("physics_rate=500", "wind.turbulence=none", "wind.speed=0", "trajectory.kind=hover"),
    *("trajectory.height=3", "trajectory.lands=false", "spread.rotor=0"),
]
HUNG = ["payload.mass=0.1", "payload.position=[0.03, 0, 0.05]"]


def speeds_at(world: World, t: float) -> np.ndarray:
    """Fly on to `t`; return the rotor speeds."""
    while world.t < t:
        world.step()
    return np.array([rotor.w for rotor in world.plant.rotors])


def test_a_load_moves_the_centre_as_two_bodies_do() -> None:
    plant = Plant(load_sim_vehicle("bebop2"), FLOATS)
    arm = plant.rotors[0].x
    load = Load(Payload(0.1, (0.03, 0.0, 0.06)), plant)
    assert plant.mass == pytest.approx(0.6)
    assert plant.rotors[0].x == pytest.approx(arm - 0.1 / 0.6 * 0.03)
    assert plant.leg == pytest.approx(plant.vehicle.leg - 0.1 / 0.6 * 0.06)
    assert plant.position[2] == pytest.approx(-plant.leg)  # its feet are where they were
    reduced = 0.5 * 0.1 / 0.6
    assert plant.inertia == pytest.approx(
        [
            own + reduced * far
            for own, far in zip(plant.vehicle.inertia, (0.06**2, 0.03**2 + 0.06**2, 0.03**2), strict=True)
        ]
    )
    load.drop()
    assert (plant.mass, plant.inertia) == (0.5, list(plant.vehicle.inertia))
    assert plant.rotors[0].x == pytest.approx(arm)
    assert plant.position == pytest.approx([0.0, 0.0, -plant.vehicle.leg])
    assert plant.lever == pytest.approx((0.0, 0.0, 0.0))


def test_what_lets_go_in_a_turn_keeps_the_speed_of_its_own_centre() -> None:
    """Two bodies that turn about their common centre part with the momentum that each has."""
    plant = Plant(load_sim_vehicle("bebop2"), FLOATS)
    load = Load(Payload(0.1, (0.06, 0.0, 0.0)), plant)
    plant.velocity, plant.rates = [1.0, 0.0, 0.0], [0.0, 0.0, 2.0]
    load.drop()
    # the load, 0.05 m ahead of the common centre, had 2.0 * 0.05 to the right
    assert plant.velocity == pytest.approx([1.0, -0.1 * 0.1 / 0.5, 0.0])


def test_a_dropped_payload_is_carried_before_and_not_after() -> None:
    world = World(load_scenario("healthy_quad", [*STILL, *HUNG, "payload.dropped_at=9"]), [1])
    motor = world.scenario.vehicle.motor
    before = speeds_at(world, 8.9)
    lift = (before**2).sum() * motor.thrust * world.plant.thrust_scale
    assert lift == pytest.approx(world.plant.mass * GRAVITY, rel=0.01)
    heavy, ahead = world.plant.mass, [rotor.x > 0 for rotor in world.plant.rotors]
    # the moments of the load and of the front and rear rotors about the vehicle's own centre
    front, rear = (before[ahead] ** 2).sum(), (before[np.invert(ahead)] ** 2).sum()
    moment = motor.thrust * world.plant.thrust_scale * 0.0875 * (front - rear)
    assert moment == pytest.approx(0.1 * GRAVITY * 0.03, rel=0.03)
    resting = -world.plant.position[2]
    speeds_at(world, 9.3)
    assert -world.plant.position[2] > resting + 0.02  # the autopilot does not know yet
    after = speeds_at(world, 20.0)
    assert world.plant.mass == pytest.approx(heavy - 0.1)
    lift = (after**2).sum() * motor.thrust * world.plant.thrust_scale
    assert lift == pytest.approx(world.plant.mass * GRAVITY, rel=0.01)
    assert np.ptp(after) < 0.02 * after.mean()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("payload.mass=2", ["payload.mass", "lifts up to"]),
        ("payload.position=[1, 2]", ["payload.position", "3 numbers"]),
        ("payload.dropped_at=1", ["payload.dropped_at", "before the vehicle flies"]),
        ("payload.weight=1", ["payload.weight", "unknown key"]),
        ("wind.wake=0.9", ["wind.wake", "up to 0.5"]),
    ],
)
def test_a_bad_payload_gets_one_line(change: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        load_scenario("healthy_quad", [change])
    assert all(word in str(caught.value) for word in words)


def churned(sinking: float, across: float) -> np.ndarray:
    """Factors on thrust, (steps, rotors), of a bebop2 that sinks and drifts at shares of its induced velocity."""
    plant = Plant(load_sim_vehicle("bebop2"), FLOATS)
    area = 4.0 * math.pi * 0.076**2
    induced = math.sqrt(plant.mass * GRAVITY / (2.0 * AIR_DENSITY * area))
    plant.velocity = [across * induced, 0.0, sinking * induced]
    wake = Wake(0.1, plant, FLOATS, [np.random.default_rng(3)], 0.01)
    out = []
    for _ in range(20000):
        wake.step((0.0, 0.0, 0.0))
        out.append([rotor.churn for rotor in plant.rotors])
    return np.array(out)


def test_the_wake_takes_what_it_says_and_only_where_it_is() -> None:
    worst = churned(1.0, 0.0)
    assert worst.mean() == pytest.approx(0.9, abs=0.005)
    assert worst.std(axis=0) == pytest.approx([0.1] * 4, rel=0.1)
    assert np.abs(np.corrcoef(worst.T) - np.eye(4)).max() < 0.1  # each rotor for itself
    later = np.corrcoef(worst[:-20, 0], worst[20:, 0])[0, 1]
    assert later == pytest.approx(math.exp(-1.0), abs=0.1)  # T = .2 s
    assert np.all(churned(0.25, 0.0) == 1.0)
    assert np.all(churned(-1.0, 0.0) == 1.0)
    assert churned(1.0, 1.0).mean() == pytest.approx(1.0 - 0.1 / 4.0, abs=0.003)


def test_descents_go_down_and_up_at_their_speed_through_their_wake() -> None:
    changes = ["trajectory.kind=descents", "trajectory.height=12", "trajectory.speed=5", "trajectory.every=6"]
    scenario = load_scenario("healthy_quad", [*STILL, *changes, "trajectory.duration=30", "wind.wake=0.1"])
    world = World(scenario, [1, 2])
    assert world.ops is COLUMNS
    fastest, lowest, churn = 0.0, 99.0, 1.0
    while world.t < 28.0:
        world.step()
        if world.t > scenario.trajectory.flying_from:
            fastest = max(fastest, float(np.max(world.plant.velocity[2])))
            lowest = min(lowest, float(np.min(-world.plant.position[2])))
            churn = min(churn, float(np.min(world.plant.rotors[0].churn)))
    assert fastest == pytest.approx(5.0, abs=0.5)
    assert lowest == pytest.approx(4.0, abs=0.7)
    assert churn < 0.85
    assert not np.any(world.controller.crashed)


def test_without_wake_and_payload_nothing_is_drawn_and_nothing_changes() -> None:
    world = World(load_scenario("healthy_quad", STILL), [1])
    speeds_at(world, 4.0)
    assert [rotor.churn for rotor in world.plant.rotors] == [1.0] * 4
    assert not world.plant.levered
    assert world.controller.mass == world.plant.mass
