"""What flights teach: gains, residual noise by age, time shift, and whether the geometry holds."""

import math
from dataclasses import replace

import numpy as np
import pytest
from synthetic_flight import Scenario, airframe, fly

from gcs_health.airframe import Airframe, AirframeSource, Effectiveness, Rotor
from gcs_health.calibration.control_effectiveness import (
    ControlEffectiveness,
    EffectivenessPrior,
    Level,
    MomentRegression,
)
from gcs_health.calibration.geometry_check import AxisFit, GeometryConfig, contradicted, doubtful, fit_axis
from gcs_health.calibration.residual_noise import NoiseConfig, ResidualNoise
from gcs_health.calibration.time_shift import TimeShift
from gcs_health.estimators.effectiveness import EffectivenessEstimator
from gcs_health.samples import RotorReading
from gcs_health.simulate.vehicle import load_sim_vehicle

GRAVITY = 9.80665


def test_gains_of_the_file_are_signed_by_the_geometry() -> None:
    rotors = (
        Rotor(1, 0, (0.1, 0.2, 0.0), 1),
        Rotor(2, 1, (-0.1, -0.2, 0.0), 1),
        Rotor(3, 2, (0.05, -0.1, 0.0), -1),
        Rotor(4, 3, (-0.1, 0.2, 0.0), -1),
    )
    craft = Airframe(
        "x", rotors, AirframeSource.FILE, effectiveness=Effectiveness(2e-5, 1e-5, 3e-6, 1e-3, 5e-7)
    )
    gains = ControlEffectiveness(craft)
    assert gains.roll == pytest.approx([-2e-5, 2e-5, 1e-5, -2e-5])
    assert gains.pitch == pytest.approx([1e-5, -1e-5, 0.5e-5, -1e-5])
    assert gains.yaw == pytest.approx([3e-6, 3e-6, -3e-6, -3e-6])
    assert gains.known
    assert not gains.learns


def test_priors_come_from_inertia_else_from_the_arm() -> None:
    craft = replace(airframe(4, known=False), mass=1.0, inertia=(0.01, 0.02, 0.03))
    gains = ControlEffectiveness(craft)
    reach = max(abs(rotor.position[1]) for rotor in craft.rotors)
    gains._level.thrust = gains.thrust = 1e-6
    gains._apply()
    hover_u = GRAVITY / 4e-6
    assert max(gains.roll) * hover_u == pytest.approx(GRAVITY / 4 * reach / 0.01)
    assert max(gains.pitch) * hover_u == pytest.approx(GRAVITY / 4 * reach / 0.02)
    loose = ControlEffectiveness(airframe(4, known=False))
    loose.thrust = 1e-6
    loose._apply()
    arm = max(np.hypot(*rotor.position[:2]) for rotor in craft.rotors)
    assert max(loose.roll) * hover_u == pytest.approx(GRAVITY * reach / (1.1 * arm**2))


@pytest.mark.parametrize(
    "name", ["bebop2", "dutta_hexa", "ghalamchi_large", "ghalamchi_small", "melczer_hexa", "octocopter"]
)
def test_the_prior_is_within_what_it_says_of_every_craft_in_the_papers(name: str) -> None:
    vehicle = load_sim_vehicle(name)
    craft = replace(vehicle.airframe(), effectiveness=Effectiveness(), mass=None, inertia=None)
    gains = ControlEffectiveness(craft)
    for axis, prior in enumerate(gains._in_hover):
        reach = max(abs(rotor.position[1 - axis]) for rotor in craft.rotors)
        true = vehicle.mass * GRAVITY / len(craft.rotors) * reach / vehicle.inertia[axis]
        assert abs(np.log(true / prior)) < gains.prior.spread


def test_the_level_is_believed_in_the_air_only() -> None:
    truth = GRAVITY / 4 / 600.0**2
    rng = np.random.default_rng(2)
    level = Level(EffectivenessPrior())
    for _ in range(3000):  # idle on the ground
        level.feed(0.01, -GRAVITY + rng.normal(0.0, 0.2), 4 * (150.0 + rng.normal(0.0, 2.0)) ** 2, False)
    assert level.thrust == 0.0
    for k in range(1500):  # spin-up, then flight that climbs and sinks
        speed = min(150.0 + 4.5 * k, 600.0 + 30.0 * math.sin(0.02 * k))
        az = -max(GRAVITY, 4 * truth * speed**2) if k < 100 else -4 * truth * speed**2
        level.feed(0.01, az + rng.normal(0.0, 0.5), 4 * speed**2, False)
    assert level.thrust == pytest.approx(truth, rel=0.03)


def test_the_word_of_the_autopilot_is_enough() -> None:
    level = Level(EffectivenessPrior())
    for _ in range(300):
        level.feed(0.01, -GRAVITY, 4 * 600.0**2, True)
    assert level.thrust == pytest.approx(GRAVITY / 4 / 600.0**2, rel=1e-6)


def teach(noise: ResidualNoise, e: np.ndarray, dt: float = 0.008, at_once: int = 25) -> None:
    """Teach residuals (k, 4) from 1 s after the opening on, some at once."""
    for k in range(0, len(e), at_once):
        some = e[k : k + at_once]
        noise.learn(some, np.full(len(some), dt), np.ones(len(some)), 1.0 + dt * k)


@pytest.mark.parametrize("at_once", [1, 25])
def test_noise_learns_offset_and_spread_and_freezes_out_outliers(at_once: int) -> None:
    rng = np.random.default_rng(1)
    noise = ResidualNoise(NoiseConfig())
    e = rng.normal((3.0, 0.0, 0.0, 0.5), (2.0, 8.0, 0.0, 0.5), (4000, 4))
    e[::50, 0] = 1e6
    teach(noise, e, at_once=at_once)
    assert noise.offset[0] == pytest.approx(3.0, abs=0.8)
    assert noise.offset[3] == pytest.approx(0.5, abs=0.2)
    assert noise.variances(0)[1] == pytest.approx(64.0, rel=0.5)
    assert noise.variances(0)[0] < 12.0


def test_slow_tones_are_called_coherent() -> None:
    tone = 6.0 * np.sin(0.3 * np.arange(4000))[:, None] * np.ones(4)
    white = np.random.default_rng(3).normal(0.0, 4.2, (4000, 4))
    of_tone, of_white = ResidualNoise(NoiseConfig()), ResidualNoise(NoiseConfig())
    teach(of_tone, tone)
    teach(of_white, white)
    for heard, noise in zip(of_tone.variances(0), of_white.variances(0), strict=True):
        assert heard > 1.7 * noise


def test_an_old_speed_is_never_trusted_more_than_a_young_one() -> None:
    noise = ResidualNoise(NoiseConfig())
    one = np.ones(25)
    for _ in range(120):
        noise.learn_aged([3] * 25, np.zeros((25, 4)), 0.008 * one, one, 10.0)
        noise.learn(np.tile((0.0, 20.0, 0.0, 1.0), (25, 1)), 0.008 * one, one, 10.0)
    fresh = noise.variances(0)
    for age in (1, 3, 12, 40):
        assert all(old >= new for old, new in zip(noise.variances(age), fresh, strict=True))
    assert noise.growth(0.0) == 1.0
    assert noise.growth(0.05) == pytest.approx(2.5)


@pytest.mark.parametrize("late", [-2, 0, 3])
def test_a_time_shift_is_found_in_both_directions(late: int) -> None:
    rng = np.random.default_rng(8)
    kernel = np.ones(8) / 8.0
    truth = np.convolve(rng.normal(0.0, 30.0, (3000,)), kernel, "same")
    other = np.convolve(rng.normal(0.0, 30.0, (3000,)), kernel, "same")
    shift = TimeShift()
    both = np.stack((truth, other), axis=1)
    for k in range(20, 2980, 20):
        y = both[k - late : k - late + 20] + rng.normal(0.0, 2.0, (20, 2))
        if shift.feed(np.full(20, 0.01), both[k : k + 20], y):
            break
    assert shift.shift == pytest.approx(0.01 * late, abs=0.004)


def test_no_shift_is_seen_where_nothing_moves() -> None:
    rng = np.random.default_rng(9)
    shift = TimeShift()
    for _ in range(200):
        shift.feed(np.full(20, 0.01), rng.normal(0.0, 1.0, (20, 2)), rng.normal(0.0, 5.0, (20, 2)))
    assert shift.shift == 0.0


def test_a_stream_with_late_rotor_speeds_gets_its_shift() -> None:
    estimator = EffectivenessEstimator(airframe(4))
    for reading in fly(Scenario(4, duration=12.0, imu_hz=125.0, esc_hz=125.0)):
        if isinstance(reading, RotorReading):
            reading = reading._replace(t=reading.t + 0.03)
        estimator.feed(reading)
    assert estimator.bank is not None
    assert estimator.bank.shift.shift == pytest.approx(-0.03, abs=0.008)


@pytest.mark.parametrize(
    ("order", "wrong"), [((0, 1, 2, 3), False), ((1, 0, 2, 3), True), ((3, 2, 1, 0), True)]
)
def test_the_geometry_check_sees_a_renumbered_file(order: tuple[int, ...], wrong: bool) -> None:
    rng = np.random.default_rng(7)
    craft = airframe(4)
    truth = ControlEffectiveness(craft)
    regression = MomentRegression(4)
    for _ in range(75):
        squares = (600.0 + rng.normal(0.0, 30.0, (20, 4))) ** 2
        measured = squares @ truth.matrix[:2].T + rng.normal(0.0, 5.0, (20, 2))
        regression.feed(np.full(20, 0.01), squares, measured)
    claimed = ControlEffectiveness(replace(craft, rotors=tuple(craft.rotors[i] for i in order)))
    fits = [fit_axis(regression, 0, claimed.roll, 0.02), fit_axis(regression, 1, claimed.pitch, 0.02)]
    assert all(fit is not None for fit in fits)
    assert contradicted([fit for fit in fits if fit is not None], GeometryConfig()) is wrong


@pytest.mark.parametrize(("assumed", "wrong"), [(0.9589, False), (0.9419, True), (0.0, True)])
def test_a_cosine_alone_contradicts_no_geometry(assumed: float, wrong: bool) -> None:
    # one brisk manoeuvre: all speeds move along one direction, the free coefficients are anything that agrees with it
    fit = AxisFit(free=0.9629, assumed=assumed, cos=0.19, f=1687.0, samples=264.0)
    assert doubtful([fit], GeometryConfig()) is wrong
