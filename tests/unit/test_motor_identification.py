"""Constants from a staircase and from flight, sides of the current, lags: against values known beforehand."""

import math

import numpy as np
import pytest

from gcs_health.estimators.current_side import CurrentSide, SideConfig, battery_witness, motor_current
from gcs_health.estimators.current_timing import Lag, quantum
from gcs_health.estimators.motor_identification import (
    FlightIdentification,
    IdentificationConfig,
    staircase,
)
from gcs_health.estimators.torque_balance import BalanceConfig, Constants, RotorBalance

KQ, R, VOLTS = 0.01038, 0.19, 12.4
A, F, C = 2.746e-5, 9.13e-4, 3.84e-3


def rows(spread: float, swing: float, count: int = 600) -> list[tuple[float, ...]]:
    """Intervals of a flight whose speed spreads about 550 rad/s and whose acceleration swings."""
    rng = np.random.default_rng(1)
    w = 550.0 * (1.0 + spread * rng.uniform(-1.0, 1.0, count))
    rise = swing * rng.standard_normal(count)
    i = A * w * w + F * w + C * rise + rng.normal(0.0, 0.1, count)
    return [(x * x, x, y, z, 1.0, 0.02) for x, y, z in zip(w, rise, i, strict=True)]


def test_flight_teaches_all_three_where_the_speed_spreads() -> None:
    fit = FlightIdentification(Constants(1.05 * A, 0.7 * F, 0.5 * C), IdentificationConfig())
    fit.take(rows(0.7, 500.0, 6000), 0.0, True)
    found = fit.solve(550.0)
    assert found is not None
    assert found.a == pytest.approx(A, rel=0.015)
    assert found.c == pytest.approx(C, rel=0.05)
    hover = FlightIdentification(Constants(A, F, C), IdentificationConfig())
    hover.take(rows(0.05, 500.0, 6000), 0.0, True)
    other = hover.solve(550.0)
    assert other is not None
    assert other.separable < 0.1 * found.separable


def test_where_nothing_accelerates_the_inertia_keeps_to_its_prior() -> None:
    fit = FlightIdentification(Constants(A, F, C), IdentificationConfig())
    fit.take(rows(0.02, 3.0), 25.0, True)  # far more noise in the speeds than there is
    found = fit.solve(550.0)
    assert found is not None
    assert 0.4 * C <= found.c <= 2.5 * C
    assert found.a == pytest.approx(A, rel=0.03)


def test_the_noise_of_the_acceleration_does_not_bias_the_inertia() -> None:
    rng = np.random.default_rng(2)
    noisy = [
        (s, w, rise + rng.normal(0.0, 300.0), i, 0.1, dt) for s, w, rise, i, _, dt in rows(0.5, 500.0, 6000)
    ]
    variance = (300.0 * 0.02) ** 2 / 2.0
    with_it = FlightIdentification(Constants(A, F, 0.0), IdentificationConfig())
    with_it.take(noisy, variance, True)
    without = FlightIdentification(Constants(A, F, 0.0), IdentificationConfig())
    without.take(noisy, 0.0, True)
    kept, lost = with_it.solve(550.0), without.solve(550.0)
    assert kept is not None
    assert lost is not None
    assert kept.c == pytest.approx(C, rel=0.1)
    assert lost.c < 0.8 * C


def test_the_staircase_gives_back_its_own_constants() -> None:
    edges = 3.0 * np.arange(6)
    t = np.arange(0.0, 15.0, 0.01)
    goal = 200.0 + 120.0 * np.floor(t / 3.0)
    w = np.empty_like(t)
    speed = 200.0
    for k, target in enumerate(goal):
        speed += (target - speed) * 0.08
        w[k] = speed
    rise = np.gradient(w, t)
    bare = t, w, F * w
    loaded = t, w, A * w * w + F * w + C * rise
    found = staircase(bare, loaded, edges, KQ)
    assert found.friction == pytest.approx(F * KQ, rel=0.01)
    assert found.torque == pytest.approx(A * KQ, rel=0.01)
    assert found.inertia == pytest.approx(C * KQ, rel=0.05)
    assert abs(found.schedule[1]) * 500.0 < 0.01 * A * KQ


@pytest.mark.parametrize("w", [200.0, 550.0, 800.0])
@pytest.mark.parametrize("i", [0.0, 0.5, 8.0, 25.0])
def test_the_battery_s_current_converts_back(w: float, i: float) -> None:
    battery = i * (R * i + KQ * w) / VOLTS
    assert motor_current(w, battery, VOLTS, KQ, R) == pytest.approx(i, abs=1e-9)


def test_a_current_no_real_motor_could_have_is_none() -> None:
    assert motor_current(300.0, -50.0, VOLTS, KQ, R) == 0.0


@pytest.mark.parametrize("side", ["motor", "battery"])
def test_the_side_is_told_from_idle_to_hover_but_not_in_hover(side: str) -> None:
    def current(w: float) -> float:
        i = A * w * w + F * w
        return i if side == "motor" else i * (R * i + KQ * w) / VOLTS

    rng = np.random.default_rng(3)
    known, hover = CurrentSide(SideConfig()), CurrentSide(SideConfig())
    for _ in range(300):
        for w in (150.0, 480.0, 550.0, 640.0):
            w *= 1.0 + 0.05 * rng.standard_normal()
            known.note(w, current(w) + rng.normal(0.0, 0.2))
        w = 550.0 * (1.0 + 0.01 * rng.standard_normal())
        hover.note(w, current(w) + rng.normal(0.0, 0.2))
    assert known.decide() == side
    assert hover.decide() is None


def test_the_battery_s_sensor_is_a_witness_that_may_be_unusable() -> None:
    config = SideConfig()
    assert battery_witness(27.0, 27.5, config) == "battery"
    assert battery_witness(40.0, 24.0, config) == "motor"
    assert battery_witness(27.0, 54.0, config) == "unusable"  # sheet 5: 48-59 A against 27 A
    assert battery_witness(4.0, math.nan, config) == "unusable"


def test_the_lag_is_exact_on_a_ramp_of_irregular_steps() -> None:
    tau, slope = 0.04, 300.0
    lag = Lag(tau, 0.0, 0.0)
    t = 0.0
    for dt in (0.003, 0.011, 0.02, 0.007, 0.05):
        t += dt
        y, z = lag.step(dt, slope * t, 2.0 * slope * t)
        assert y == pytest.approx(slope * (t - tau * (1.0 - math.exp(-t / tau))))
        assert z == pytest.approx(2.0 * y)


def test_the_step_of_the_telemetry_is_found() -> None:
    rng = np.random.default_rng(4)
    w = 550.0 + 20.0 * rng.standard_normal(200)
    step = 10.0 * math.pi / 30.0
    assert quantum(np.round(w / step) * step) == pytest.approx(step)
    assert quantum(w) < 0.01


def test_the_balance_closes_through_a_manoeuvre() -> None:
    """Speed and current of the model itself: eta stays 1 whatever the rotor does."""
    balance = RotorBalance(BalanceConfig(), Constants(A, F, C))
    w, t = 550.0, 0.0
    for k in range(8000):
        t += 0.001
        i = 10.0 + 5.0 * math.sin(6.0 * t)
        w += 0.001 / C * (i - A * w * w - F * w)
        if k % 10 == 0:
            balance.sample(t, w, w * w, i, True)
    assert balance.eta == pytest.approx(1.0, abs=0.01)
    assert not balance.lost
    assert balance.llr == 0.0
    assert 0.5 <= balance.detectable(0.01) <= 0.9


@pytest.mark.parametrize("proven", [False, True])
def test_an_inertia_that_no_flight_has_proven_is_not_held_against_the_propeller(proven: bool) -> None:
    balance = RotorBalance(BalanceConfig(), Constants(A, F, 0.5 * C))
    if proven:
        balance.inertia_error = balance.config.inertia_error
    w, highest = 550.0, 0.0
    for k in range(2000):
        i = 9.3 if k % 400 < 310 else -8.0  # braked now and then
        w += 0.001 / C * (i - A * w * w - F * w)
        if k % 20 == 0:
            balance.sample(0.001 * k, w, w * w, i, True)
            highest = max(highest, balance.llr)
    assert highest > 8.0 if proven else highest < 2.0  # 10 is an alarm


def test_thresholds_run_straight_between_rates() -> None:
    config = BalanceConfig()
    assert config.threshold(0.002) == 7.0
    assert config.threshold(0.02) == 10.0
    assert config.threshold(0.015) == pytest.approx(8.5)
    assert config.threshold(0.3) == 5.0
