"""The paper's filter: its equations by finite differences and by drawing, its behaviour on a made flight."""

import math

import numpy as np
import pytest
from synthetic_flight import airframe

from gcs_health.estimators.amplitude_model import HighPass, ImuFilter, highpass_gain
from gcs_health.estimators.unbalance_config import PaperConfig
from gcs_health.estimators.unbalance_paper import PaperUnbalance, measurement
from gcs_health.samples import ImuFilterReading

# the medium quadrotor of Table I
MASS, KAPPA, RADIUS = 0.69, 764e-8, 0.1
HOVER = math.sqrt(MASS * 9.80665 / 4.0 / KAPPA)


def test_the_jacobian_is_that_of_h() -> None:
    rng = np.random.default_rng(1)
    x = rng.normal(0.0, 0.5, 5)
    start = rng.uniform(0.2, 1.5, 5) ** 2
    _, H, _ = measurement(x, start)
    for i in range(5):
        step = np.zeros(5)
        step[i] = 1e-5
        up, down = measurement(x + step, start)[0], measurement(x - step, start)[0]
        assert H[i] == pytest.approx((up - down) / 2e-5, rel=1e-6)


def test_the_variance_is_that_of_the_power() -> None:
    rng = np.random.default_rng(2)
    x = np.array([0.3, -0.4, 0.1, 0.0, 0.2])
    amplitude = np.array([1.2, 0.9, 0.4, 0.7])
    mean, _, variance = measurement(x, np.append(amplitude**2, 2.0 * 0.8**2))
    size = amplitude * np.exp(x[:4])
    phase = rng.uniform(0.0, 2.0 * math.pi, (400_000, 4))
    noise = 0.8 * math.exp(x[4]) * rng.standard_normal((400_000, 2))
    a = (size * np.exp(1j * phase)).sum(axis=1) + noise @ np.array([1.0, 1j])
    z = np.abs(a) ** 2
    b, s = size**2, (0.8 * math.exp(x[4])) ** 2
    printed = 4 * s * s + b.sum() ** 2 - (b * b).sum() + 4 * s * b.sum()  # (22) as in the paper
    assert variance == pytest.approx(printed, rel=1e-12)
    assert mean == pytest.approx(z.mean(), rel=0.01)
    assert variance == pytest.approx(z.var(), rel=0.02)


def made_flight(seconds: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return speeds (k, 4) and accelerations (k,) at 500 Hz: forces that vary by 25 %, rotor 2 cut by 40 mg."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(500 * seconds)) / 500.0
    knots = np.arange(0.0, seconds + 0.5, 0.5)
    force = 1.0 + np.column_stack([np.interp(t, knots, rng.normal(0.0, 0.3, len(knots))) for _ in range(4)])
    speed = HOVER * np.sqrt(np.clip(force, 0.2, 2.0))
    size = np.array([2.0, 3.0, 40.0, 1.0]) * 1e-6 * RADIUS / MASS * speed**2
    phase = np.cumsum(speed * (1.0 + 0.003 * rng.standard_normal(speed.shape)), axis=0) / 500.0
    a = (size * np.exp(1j * np.array([1, 1, -1, -1]) * phase)).sum(axis=1)
    return speed, a + 0.8 * (rng.standard_normal(len(t)) + 1j * rng.standard_normal(len(t)))


@pytest.mark.parametrize(("extra", "separates"), [(100.0, True), (1e4, False)])
def test_it_finds_the_cut_propeller_with_a_variance_of_100_not_with_a_deviation(
    extra: float, separates: bool
) -> None:
    filter_ = PaperUnbalance(airframe(4), PaperConfig(start=20e-6 * RADIUS / MASS, extra=extra))
    speed, a = made_flight(30.0, 3)
    for k, value in enumerate(a.tolist()):
        if k % 5 == 0:
            filter_.speeds(speed[k])
        filter_.imu(k / 500.0, value.real, value.imag, True)
    mg = filter_.unbalance() * MASS / RADIUS * 1e6
    assert (mg[2] > 1.5 * np.delete(mg, 2).max()) == separates
    assert not separates or 25.0 < mg[2] < 44.0  # still on its way from 20 to 40


def test_commands_stand_in_for_speeds_through_the_motors_lag() -> None:
    filter_ = PaperUnbalance(airframe(4), PaperConfig())
    measured = PaperUnbalance(airframe(4), PaperConfig())
    filter_.commands(np.full(4, 0.5))
    for k in range(1000):
        filter_.imu(k / 500.0, 0.1, 0.0, True)
        measured.speeds(np.full(4, 600.0))  # the airframe's hover speed
        measured.imu(k / 500.0, 0.1, 0.0, True)
    assert filter_.flown > 1.9
    assert filter_.unbalance() == pytest.approx(measured.unbalance(), rel=1e-3)
    filter_.commands(np.full(4, 0.6))
    for k in range(1000, 1008):  # 16 ms, about one time constant
        filter_.imu(k / 500.0, 0.1, 0.0, True)
    lagged = 0.5 + 0.1 * (1.0 - math.exp(-16.0 / 15.0))
    assert filter_._lag == pytest.approx(np.full(4, lagged), rel=1e-6)


def test_the_high_pass_has_the_gain_that_the_model_gives_it() -> None:
    for hertz, rate in ((75.0, 100.0), (75.0, 200.0), (3.0, 100.0), (120.0, 100.0)):
        highpass = HighPass(2.0)
        t = np.arange(4000) / rate
        out = np.array([highpass.feed(1.0 / rate, math.cos(2 * math.pi * hertz * x), 0.0).real for x in t])
        rms = math.sqrt(2.0 * float(np.mean(out[2000:] ** 2)))
        expected = float(highpass_gain(np.array(2 * math.pi * hertz), 2.0, 1.0 / rate))
        assert rms == pytest.approx(expected, rel=0.02)


def test_the_filters_on_board() -> None:
    omega = np.array([2.0 * math.pi * 75.0, 2.0 * math.pi * 200.0])
    mean = ImuFilter.told(ImuFilterReading(0.0, 0.005, math.nan, "IMU_INTEG_RATE"))
    assert mean.gain(omega) == pytest.approx([0.784, 0.0], abs=1e-3)
    both = ImuFilter(0.005, 30.0, "test")
    assert both.gain(omega)[0] == pytest.approx(0.124, abs=1e-3)
    poles = ImuFilter(math.nan, 20.0, "INS_ACCEL_FILTER")
    assert poles.gain(omega)[0] == pytest.approx(0.071, abs=1e-3)
    assert ImuFilter.told(ImuFilterReading(0.0, -1.0, 0.0, "odd")).gain(omega) == pytest.approx([1.0, 1.0])
