"""Each kind of fault shows its physics on the plant, and its words in the truth."""

import math

import pytest

from gcs_health.simulate.arithmetic import FLOATS
from gcs_health.simulate.faults import BLADES, FAILURE_TYPE, KINDS, TIP_MASS, Fault, PlantFaults, described
from gcs_health.simulate.plant import Plant
from gcs_health.simulate.scenario import load_scenario
from gcs_health.simulate.vehicle import load_sim_vehicle
from gcs_health.simulate.world import World

CALM = (0.0, 0.0, 0.0)
STEP = 0.001
PROPELLER_MASS = 0.01  # kg
VEHICLE = load_sim_vehicle("ghalamchi_medium")
MOTOR = VEHICLE.motor
AT = 0.1  # s


def struck(*faults: Fault, seconds: float = 0.5, command: float = VEHICLE.hover) -> Plant:
    """A hovering plant high up, all rotors commanded alike, so long after its start."""
    plant = Plant(VEHICLE, FLOATS)
    plant.position = [0.0, 0.0, -100.0]
    for rotor in plant.rotors:
        rotor.w = VEHICLE.hover
    breaks = PlantFaults(list(faults), FLOATS, PROPELLER_MASS)
    for k in range(round(seconds / STEP)):
        breaks.apply(plant, k * STEP)
        plant.step(STEP, [command] * 4, CALM)
    return plant


def test_an_ejected_propeller_takes_thrust_drag_and_inertia_and_the_motor_is_still_driven() -> None:
    plant = struck(Fault("propeller_lost", 2, AT))
    lost, whole = plant.rotors[2], plant.rotors[0]
    assert lost.lift == 0.0
    assert lost.inertia == pytest.approx(MOTOR.bare_inertia * MOTOR.inertia)
    # the speed loop feeds the drag of a propeller that is not there: kf w + kq (i0 - i) = 0 at the new speed
    hold = MOTOR.inertia * MOTOR.bandwidth
    fed = MOTOR.torque * VEHICLE.hover**2 + MOTOR.friction * VEHICLE.hover + hold * VEHICLE.hover
    assert lost.w == pytest.approx(fed / (MOTOR.friction + hold), rel=0.01)
    assert lost.w > 1.05 * whole.w
    assert lost.current < 0.1 * whole.current
    # with less inertia, the same torque turns it up as much faster
    first = struck(Fault("propeller_lost", 2, AT), seconds=AT + 2 * STEP).rotors[2].acceleration
    torque = MOTOR.torque * VEHICLE.hover**2
    assert first == pytest.approx(torque / (MOTOR.bare_inertia * MOTOR.inertia), rel=0.25)


@pytest.mark.parametrize("left", [0.8, 0.4])
def test_a_partial_loss_scales_lift_and_drag_torque(left: float) -> None:
    plant = struck(Fault("effectiveness", 1, AT, left), seconds=AT + 2 * STEP)
    weak, whole = plant.rotors[1], plant.rotors[0]
    assert weak.lift / weak.w**2 == pytest.approx(left * whole.lift / whole.w**2, rel=0.01)
    torque = MOTOR.torque * VEHICLE.hover**2
    assert weak.acceleration == pytest.approx((1.0 - left) * torque / MOTOR.inertia, rel=0.1)


def test_a_slow_rotor_follows_a_share_of_its_command() -> None:
    plant = struck(Fault("slow", 0, AT, 0.7))
    assert plant.rotors[0].w == pytest.approx(0.7 * VEHICLE.hover, rel=0.002)
    assert plant.rotors[1].w == pytest.approx(VEHICLE.hover, rel=0.002)


def test_a_stopped_motor_coasts_down_by_its_drag() -> None:
    """J w' = -kt w² - kf w, in closed form; no current."""
    after = 0.4
    w = struck(Fault("motor_stopped", 3, AT), seconds=AT + after).rotors[3].w
    a, b = MOTOR.torque / MOTOR.inertia, MOTOR.friction / MOTOR.inertia
    decay = math.exp(-b * after)
    expected = b * VEHICLE.hover * decay / (b + a * VEHICLE.hover * (1.0 - decay))
    assert w == pytest.approx(expected, rel=0.01)
    stopped = struck(Fault("motor_stopped", 3, AT), seconds=AT + after).rotors[3]
    assert stopped.current == 0.0
    assert stopped.inertia == MOTOR.inertia  # the propeller is still there


def test_a_stuck_motor_stands_at_once_and_its_momentum_goes_into_the_body() -> None:
    plant = struck(Fault("motor_stuck", 3, AT), seconds=AT + 2 * STEP)
    stuck = plant.rotors[3]
    assert (stuck.w, stuck.lift) == (0.0, 0.0)
    assert stuck.current > 1.0  # blocked, and still driven
    before = struck(seconds=AT + 2 * STEP)
    # what J w was about z, with the rotor's spin, the body has now
    kick = plant.inertia[2] * (plant.rates[2] - before.rates[2])
    assert kick == pytest.approx(-VEHICLE.rotors[3].spin * MOTOR.inertia * VEHICLE.hover, rel=0.15)


def test_a_cut_blade_loses_lift_torque_and_balance() -> None:
    size = 0.2
    rotor = struck(Fault("blade_cut", 0, AT, size)).rotors[0]
    # lift goes with r² dr, drag torque with r³ dr along one of the blades
    assert rotor.eta_t == pytest.approx(1.0 - (1.0 - 0.8**3) / BLADES)
    assert rotor.eta_q == pytest.approx(1.0 - (1.0 - 0.8**4) / BLADES)
    mass = PROPELLER_MASS / BLADES * TIP_MASS * size
    assert rotor.imbalance == pytest.approx(mass * 0.9 * VEHICLE.rotors[0].radius)


def test_an_unbalance_may_be_there_from_the_start() -> None:
    change = "fault=[{kind='unbalance', motor=2, at=0.0, size=4.0}]"
    world = World(load_scenario("healthy_quad", ["vehicle=ghalamchi_medium", change]), [1])
    world.step()
    assert world.plant.rotors[1].imbalance == pytest.approx(4.0e-6)  # g mm to kg m


def test_a_worn_bearing_asks_for_current_and_wears_slowly() -> None:
    """kq i = kt w² + c kf w at the speed that the loop holds a little lower."""

    def balance(factor: float, ramp: float, seconds: float) -> tuple[float, float]:
        rotor = struck(Fault("bearing", 1, AT, factor, ramp), seconds=seconds).rotors[1]
        return rotor.friction, rotor.w

    assert balance(50.0, 0.0, 0.6)[0] == 50.0
    friction, w = balance(50.0, 2.0, AT + 1.0)
    assert friction == pytest.approx(1.0 + 49.0 * 0.5, rel=0.05)
    worn = struck(Fault("bearing", 1, AT, 50.0), seconds=1.0).rotors[1]
    torque = MOTOR.torque * worn.eta_q * worn.w**2 + 50.0 * MOTOR.friction * worn.w
    assert MOTOR.torque_constant * worn.current == pytest.approx(torque, rel=0.01)
    assert worn.current > 1.5 * struck(seconds=1.0).rotors[1].current
    assert w < VEHICLE.hover


def test_a_ramp_grows_a_loss() -> None:
    rotor = struck(Fault("effectiveness", 0, AT, 0.5, ramp=0.4), seconds=AT + 0.2 + STEP).rotors[0]
    assert rotor.eta_t == pytest.approx(0.75, abs=0.03)
    assert struck(Fault("effectiveness", 0, AT, 0.5, ramp=0.4), seconds=0.7).rotors[0].eta_t == 0.5


def test_several_rotors_fail_each_in_its_own_way_and_at_its_own_time() -> None:
    faults = Fault("effectiveness", 0, AT, 0.5), Fault("slow", 1, 0.3, 0.8), Fault("unbalance", 0, 0.0, 3.0)
    early, late = struck(*faults, seconds=0.2), struck(*faults)
    assert (early.rotors[0].eta_t, early.rotors[1].slowed) == (0.5, 1.0)
    assert (late.rotors[0].eta_t, late.rotors[1].slowed) == (0.5, 0.8)
    assert late.rotors[0].imbalance == pytest.approx(3.0e-6)
    assert (late.rotors[2].eta_t, late.rotors[3].eta_t) == (1.0, 1.0)


def test_the_truth_uses_mavlinks_words_where_they_fit() -> None:
    from pymavlink.dialects.v20 import all as stock

    from gcs_health.mavlink.generated import esc

    words = {entry.name for source in (esc, stock) for entry in source.enums.get("FAILURE_TYPE", {}).values()}
    assert set(FAILURE_TYPE.values()) <= words
    assert set(FAILURE_TYPE) <= set(KINDS)
    assert described(Fault("slow", 0, 1.0, 0.7))["failure_type"] == "FAILURE_TYPE_SLOW"
    assert "failure_type" not in described(Fault("blade_cut", 0, 1.0, 0.1))
