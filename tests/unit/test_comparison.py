"""The published baselines against closed forms, and each on one flight with a fault."""

import math
from collections.abc import Iterable, Iterator
from functools import lru_cache

import numpy as np
import pytest
from synthetic_flight import HOVER, Scenario, airframe, fly

from gcs_health.errors import AirframeError
from gcs_health.estimators import kalman
from gcs_health.estimators.comparison import METHODS, UNNAMED, Judge, Verdict, load
from gcs_health.estimators.comparison.adaptive_threshold import AdaptiveThreshold
from gcs_health.estimators.comparison.ardupilot_checks import (
    ControlReading,
    ThrustLossCheck,
    YawImbalanceCheck,
)
from gcs_health.estimators.comparison.lms import lms
from gcs_health.estimators.comparison.multiple_model import posterior
from gcs_health.estimators.comparison.px4_motor_check import ResidualCheck, UndercurrentCheck, fit
from gcs_health.estimators.comparison.sliding_mode import SlidingMode, injection
from gcs_health.estimators.comparison.thau import ThauFault, gain
from gcs_health.estimators.comparison.two_stage_kalman import TwoStage
from gcs_health.estimators.comparison.two_step import losses
from gcs_health.estimators.comparison.wrench import Wrench, signature, system
from gcs_health.samples import CommandReading, FlightReading, Reading, RotorReading

TOP = 1.6 * HOVER
RNG = np.random.default_rng(5)


def with_commands(readings: Iterable[Reading], stopped_at: float = math.inf) -> Iterator[Reading]:
    """Add what a governed ESC was told: the speed it holds; once its motor has stopped, hover speed."""
    for reading in readings:
        if isinstance(reading, RotorReading):
            told = [HOVER if reading.t >= stopped_at and w < 400.0 else w for w in reading.speed]
            yield CommandReading(reading.t, tuple(w / TOP for w in told))
        if isinstance(reading, FlightReading):
            yield reading
            yield FlightReading(1.0, True, False)  # known ahead: it takes off at 1 s
        else:
            yield reading


@lru_cache
def flown(scenario: Scenario) -> tuple[Reading, ...]:
    return tuple(fly(scenario))


def first(method: object, readings: Iterable[Reading]) -> Verdict | None:
    for reading in readings:
        verdict = method.feed(reading)  # type: ignore[attr-defined]
        if verdict is not None:
            return verdict
    return None


def test_judge_wants_a_score_held_and_takes_the_highest() -> None:
    judge = Judge(0.5, hold=0.1)
    assert judge.feed(0.00, [0.9, 0.0, 0.6]) is None
    assert judge.feed(0.05, [0.9, 1.0, 0.6]) is None  # not yet for the hold time
    assert judge.feed(0.10, [0.4, 1.0, 0.6]) == Verdict(2, 0.10)  # the one that was there throughout
    assert judge.peak == 0.6
    assert judge.feed(0.15, [0.4, 1.0, 0.6]) == Verdict(1, 0.15)
    assert judge.feed(0.20, [0.0, 0.4, 0.5]) is None  # the lowest of the hold time counts
    assert judge.peak == 1.0


def test_two_stage_filter_is_the_joint_filter() -> None:
    m, n = 4, 6
    A = np.eye(m) + 0.05 * RNG.standard_normal((m, m))
    C = RNG.standard_normal((3, m))
    Qx, Qg, R = np.diag([0.1, 0.2, 0.3, 0.4]), 0.02 * np.eye(n), np.diag([0.5, 0.2, 0.3])
    x, Px, gamma, Pg = RNG.standard_normal(m), 2.0 * np.eye(m), 0.1 * RNG.standard_normal(n), np.eye(n)
    two = TwoStage(x, Px, gamma, Pg)
    state = np.concatenate([x, gamma])
    P = np.block([[Px, np.zeros((m, n))], [np.zeros((n, m)), Pg]])
    for _ in range(60):
        Bu = RNG.standard_normal((m, n))
        y = RNG.standard_normal(3)
        two.step(A, Bu, y, C, Qx, Qg, R)
        F = np.block([[A, -Bu], [np.zeros((n, m)), np.eye(n)]])
        Q = np.block([[Qx, np.zeros((m, n))], [np.zeros((n, m)), Qg]])
        before = kalman.predict(state, P, F, Q)
        push = np.concatenate([Bu.sum(axis=1), np.zeros(n)])
        after = kalman.update(before.x + push, before.P, y, np.hstack([C, np.zeros((3, n))]), R)
        state, P = after.x, after.P
    np.testing.assert_allclose(two.state, state[:m], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(two.gamma, state[m:], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(two.Pg, P[m:, m:], rtol=1e-8, atol=1e-9)
    np.testing.assert_allclose(two.Px + two.V @ two.Pg @ two.V.T, P[:m, :m], rtol=1e-7, atol=1e-8)


def test_multiple_model_posterior_is_bayes_rule() -> None:
    S = np.array([0.5, 2.0])
    log_p = np.log([0.5, 0.3, 0.2])
    prior = np.exp(log_p)
    for _ in range(4):
        r = RNG.standard_normal((3, 2))
        prior = prior * np.exp(-0.5 * (r**2 / S).sum(axis=1)) / np.sqrt(np.prod(2.0 * np.pi * S))
        log_p = posterior(log_p, r, S, -1e9)
    np.testing.assert_allclose(np.exp(log_p), prior / prior.sum(), rtol=1e-12)
    floored = posterior(np.log([0.5, 0.5]), np.array([[0.0], [100.0]]), np.array([1.0]), math.log(1e-3))
    np.testing.assert_allclose(np.exp(floored), [1.0 / 1.001, 0.001 / 1.001])


def test_thau_gain_solves_its_equation() -> None:
    A, C, theta = RNG.standard_normal((5, 5)), RNG.standard_normal((3, 5)), 12.0
    P, K = gain(A, C, theta)
    np.testing.assert_allclose(A.T @ P + P @ A - C.T @ C + theta * P, 0.0, atol=1e-12)
    assert np.linalg.eigvalsh(P).min() > 0.0
    np.testing.assert_allclose(P @ K, C.T, atol=1e-12)
    # the error of the observer decays at theta / 2 at least
    assert np.linalg.eigvals(A - K @ C).real.max() <= -theta / 2.0 + 1e-9
    np.testing.assert_allclose(gain(np.zeros((4, 4)), np.eye(4), theta)[1], theta * np.eye(4))


def test_two_step_inversion_recovers_losses() -> None:
    B = system(airframe(4)).B
    u, gamma = np.array([0.8, 1.1, 1.3, 0.9]), np.array([0.0, 0.4, 0.0, 1.0])
    np.testing.assert_allclose(losses(B, u, B @ (u * (1.0 - gamma))), gamma, atol=1e-12)
    with pytest.raises(AirframeError, match="four rotors"):
        load("two_step", airframe(6))


def test_lms_step_of_one_explains_what_it_saw_and_converges() -> None:
    truth, G = RNG.standard_normal((4, 6)), np.zeros((4, 6))
    change = RNG.standard_normal(6)
    np.testing.assert_allclose(lms(G, change, truth @ change, 1.0, 0.0) @ change, truth @ change)
    for _ in range(400):
        change = RNG.standard_normal(6)
        G = lms(G, change, truth @ change, 1.0, 0.0)
    np.testing.assert_allclose(G, truth, atol=1e-9)
    assert (lms(G, np.zeros(6), np.ones(4), 1.0, 1e-6) == G).all()


def test_adaptive_threshold_has_mean_and_std_of_its_window() -> None:
    bound = AdaptiveThreshold(window=2.0, guard=0.5, k1=1.0, k2=3.0, k3=0.1)
    values = RNG.standard_normal(400)
    for k, value in enumerate(values):
        bound.feed(0.01 * k, float(value))
    inside = values[[k for k in range(400) if 0.01 * k + 1e-9 >= 3.99 - 2.0 and 0.01 * k <= 3.49 + 1e-9]]
    middle, width = bound.bounds()
    assert middle == pytest.approx(inside.mean(), abs=0.02)
    assert width == pytest.approx(3.0 * inside.std() + 0.1, abs=0.02)
    bound.feed(4.0, 50.0, frozen=True)
    assert bound.bounds() == (middle, width)


def test_equivalent_injection_is_what_the_model_lacks() -> None:
    np.testing.assert_allclose(
        injection(np.array([10.0, -10.0, 0.0]), 2.0, 1e-6), [2.0, -2.0, 0.0], rtol=1e-5
    )
    method = SlidingMode(airframe(4))
    method._wrench.ready = lambda t: False  # type: ignore[method-assign]
    lack = np.array([0.4, -0.3, 0.1, 0.2])
    method._wrench.feed = lambda k: steady(k, lack)  # type: ignore[assignment, method-assign]
    for k in range(400):
        method.feed(k)  # type: ignore[arg-type]
    np.testing.assert_allclose(method.lack, lack, atol=1e-3)


def steady(k: int, lack: np.ndarray) -> object:
    """The k-th motion of a hover whose acceleration lacks `lack`."""
    from gcs_health.estimators.comparison.wrench import Motion

    hover = system(airframe(4)).B @ np.ones(4)
    return Motion(0.004 * k, 0.004, 0.004 * k * (hover + lack), np.ones(4))


def test_thau_fault_estimate_settles_below_the_loss_by_its_leak() -> None:
    for leak, least in ((0.0, 0.999), (2.0, 0.85)):
        method = ThauFault(airframe(4), sigma_w=leak)
        B = system(airframe(4)).B
        method._observer.wrench.feed = lambda k, B=B: steady(k, -B[:, 2])  # type: ignore[misc, method-assign, assignment]
        for k in range(1500):
            method.feed(k)  # type: ignore[arg-type]
        assert least < method.eta[2] < (1.001 if leak == 0.0 else 0.97)
        assert abs(np.delete(method.eta, 2)).max() < 0.05


def test_signature_names_the_rotor_whose_loss_it_is() -> None:
    for n in (4, 6, 8):
        B, u = system(airframe(n)).B, RNG.uniform(0.7, 1.3, n)
        for i in range(n):
            scores = signature(-0.6 * B[:, i] * u[i], B, u)
            assert scores[i] == pytest.approx(0.6)
            assert np.count_nonzero(scores) == 1


def test_the_wrench_is_silent_on_the_ground() -> None:
    wrench = Wrench(airframe(4))
    flown = [wrench.feed(reading) for reading in fly(Scenario(4, duration=0.9))]
    assert flown == [None] * len(flown)


FROM_MOTION = ["two_stage", "multiple_model", "thau_residual", "thau_fault", "sliding_mode"]
ON_FOUR = ["two_step", "lms"]  # one inverts; the other credits every rotor that moves with the change


@pytest.mark.parametrize(
    ("name", "rotors"),
    [(name, 4) for name in ON_FOUR] + [(name, rotors) for name in FROM_MOTION for rotors in (4, 6)],
)
def test_a_lost_propeller_is_found_from_motion(name: str, rotors: int) -> None:
    flight = flown(Scenario(rotors, duration=7.7, lost=1, imu_hz=125.0))
    options = {"threshold": 0.4} if name == "thau_fault" else {}  # six rotors share what four rows see
    verdict = first(load(name, airframe(rotors), **options), with_commands(flight))
    assert verdict is not None
    assert verdict.rotor == 1
    assert 7.0 < verdict.t < 7.6


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("current_threshold", {}),
        ("px4_1_16", {"c2t": 10.0, "threshold": 0.5}),
        ("px4_main", {"c2t": 27.0, "idle": -5.6, "under": 4.0}),
    ],
)
def test_a_lost_propeller_is_found_from_current(name: str, options: dict[str, float]) -> None:
    verdict = first(
        load(name, airframe(4), **options), with_commands(flown(Scenario(4, duration=9.0, lost=2)))
    )
    assert verdict is not None
    assert verdict.rotor == 2
    assert 7.0 < verdict.t < 8.2


def test_a_stopped_motor_disobeys_its_command() -> None:
    flight = Scenario(4, duration=9.0, stopped=3, seed=4)
    verdict = first(load("rpm_command", airframe(4)), with_commands(fly(flight), 7.0))
    assert verdict is not None
    assert verdict.rotor == 3
    assert 7.0 < verdict.t < 7.4


def test_healthy_flight_brings_no_verdict() -> None:
    craft = airframe(4)
    options = {
        "px4_1_16": {"c2t": 10.0, "threshold": 0.5},
        "px4_main": {"c2t": 27.0, "idle": -5.6, "under": 4.0},
    }
    methods = [load(name, craft, **options.get(name, {})) for name in METHODS]
    for reading in with_commands(fly(Scenario(4, duration=9.0, imu_hz=125.0, seed=9))):
        for name, method in zip(METHODS, methods, strict=True):
            assert method.feed(reading) is None, name


def report(t: float, current: float) -> RotorReading:
    return RotorReading(t, (500.0,) * 4, (5.0, 5.0, current, 5.0), (12.0,) * 4)


def test_px4_undercurrent_times_out_after_a_tenth_of_a_second() -> None:
    check = UndercurrentCheck(airframe(4), c2t=10.0)
    check.feed(FlightReading(0.0, True, False))
    check.feed(CommandReading(0.0, (0.4,) * 4))  # 5 A are above 10 * .4
    assert all(check.feed(report(0.02 * k, 5.0)) is None for k in range(20))
    said = [check.feed(report(0.4 + 0.02 * k, 3.0)) for k in range(6)]
    assert said[:5] == [None] * 5
    assert said[5] == Verdict(2, 0.5)
    check.feed(CommandReading(1.0, (0.19,) * 4))  # below FD_ACT_MOT_THR nothing is judged
    assert all(check.feed(report(1.0 + 0.02 * k, 0.5)) is None for k in range(20))


def test_px4_residual_is_low_passed_at_ten_hertz_and_held() -> None:
    check = ResidualCheck(airframe(4), c2t=10.0, idle=1.0, under=2.0, hold=0.3)
    check.feed(FlightReading(0.0, True, False))
    check.feed(CommandReading(0.0, (0.4,) * 4))
    for k in range(21):
        assert check.feed(report(0.05 * k, 5.0)) is None
    # -4 A from 1 s on: -4 (1 - exp(-k .1 / .2)) is below -2 with the second look, then held for .3 s
    told = [(t, check.feed(report(t, 1.0))) for t in np.arange(1.05, 2.0, 0.05).round(3).tolist()]
    t = next(verdict.t for _, verdict in told if verdict)
    assert t == pytest.approx(1.5)
    check.feed(report(3.0, 1.0))  # a gap starts the filter and the time anew
    assert check.feed(report(3.1, 1.0)) is None


def test_px4_fit_is_the_regression() -> None:
    command = RNG.uniform(0.2, 0.9, 500)
    assert fit(command, 20.0 * command + 1.5) == pytest.approx((20.0, 1.5))
    slope, idle = fit(command, 20.0 * command - 2.0)
    assert idle == 0.0
    assert slope == pytest.approx((command @ (20.0 * command - 2.0)) / (command @ command))


LOW = ControlReading(0.0, 0.1, 0.2, 0.95, False, -0.5, 0.0)


def test_ardupilot_thrust_loss_needs_a_second_of_all_its_conditions() -> None:
    def run(**changes: float) -> Verdict | None:
        check = ThrustLossCheck(airframe(4))
        check.feed(FlightReading(0.0, True, False))
        for k in range(150):
            check.feed(CommandReading(0.01 * k, (0.6, 0.6, 0.9, 0.6)))
            verdict = check.feed(LOW._replace(t=0.01 * k, **changes))
            if verdict:
                return verdict
        return None

    found = run()
    assert found is not None
    assert found.rotor == 2
    assert found.t == pytest.approx(1.0)
    assert run(throttle=0.3, saturated=True) == found
    for broken in (
        {"throttle": 0.89},
        {"throttle": 0.24, "saturated": True},
        {"target_lean": 0.27},
        {"attitude_error": 0.53},
        {"climb_rate": 0.1},
    ):
        assert run(**broken) is None


def test_ardupilot_yaw_imbalance_is_filtered_and_names_nobody() -> None:
    check = YawImbalanceCheck(airframe(4))
    check.feed(FlightReading(0.0, True, False))
    told = []
    for k in range(2500):
        verdict = check.feed(LOW._replace(t=0.01 * k, throttle=0.5, yaw_integral=0.95))
        told += [verdict] if verdict else []
    # 1 - exp(-2 pi .05 t) reaches .75 / .95 at 4.96 s; then again ten seconds later
    assert [verdict.t for verdict in told] == pytest.approx([4.96, 14.96, 24.96], abs=0.1)
    assert {verdict.rotor for verdict in told} == {UNNAMED}
