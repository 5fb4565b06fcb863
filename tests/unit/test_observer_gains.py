"""The adaptive observer's gains are proven stable again, by eigenvalues alone; its equations against closed forms."""

import math

import numpy as np
import pytest

from gcs_health.airframe import Motor
from gcs_health.errors import AirframeError
from gcs_health.estimators.adaptive_observer import (
    CoupledObserver,
    Gains,
    MotorModel,
    PaperConfig,
    RotorObserver,
)
from gcs_health.estimators.observer_gains import CERTIFIED, CertifiedGain, certifies, least_gain, lyapunov

MODEL = MotorModel(0.01038, 1.9960e-7, 9.4782e-6, 3.9876e-5)  # Table 2, weighted


@pytest.mark.parametrize("gain", CERTIFIED, ids=lambda gain: gain.problem.name)
def test_stored_gains_are_certified_by_eigenvalues(gain: CertifiedGain) -> None:
    assert certifies(gain.problem, np.diag(gain.P), np.diag(gain.K))
    n = len(gain.P)
    P, A, L = np.diag(gain.P), np.diag(gain.problem.poles), np.diag(gain.P) @ np.diag(gain.K)
    corner = A.T @ P + P @ A - L - L.T + gain.problem.alpha * np.eye(n)
    root = math.sqrt(gain.problem.alpha)
    lmi = np.block([[corner, root * P], [root * P, -np.eye(n)]])  # eq. (17)
    assert np.linalg.eigvalsh(lmi)[-1] < 0.0


@pytest.mark.parametrize("gain", CERTIFIED, ids=lambda gain: gain.problem.name)
def test_the_solver_agrees_with_the_closed_form(gain: CertifiedGain) -> None:
    bound = least_gain(gain.problem.alpha, -max(gain.problem.poles))
    assert gain.least == pytest.approx(bound, rel=5e-4)
    n = len(gain.P)
    assert certifies(gain.problem, np.eye(n), 1.0001 * bound * np.eye(n))
    for p in (0.5, 1.0, 2.0):  # no P does with less
        assert not certifies(gain.problem, p * np.eye(n), 0.999 * bound * np.eye(n))


def test_the_thesis_s_figures_give_the_sheet_s_bound() -> None:
    alpha = 2.0 * 800.0 * MODEL.torque / MODEL.inertia
    assert alpha == pytest.approx(8.01, abs=0.005)
    assert least_gain(alpha, MODEL.friction / MODEL.inertia) == pytest.approx(7.77, abs=0.005)
    assert least_gain(alpha, 0.2, P=3.0) > least_gain(alpha, 0.2)


def test_m_of_one_rotor_is_the_scalar_written_out() -> None:
    one = CERTIFIED[0]
    a, p, k = one.problem.poles[0], one.P[0], one.K[0]
    expected = 2.0 * p * (a - k) + one.problem.alpha * (p * p + 1.0)
    assert lyapunov(one.problem, np.diag(one.P), np.diag(one.K))[0, 0] == pytest.approx(expected)


def test_gains_by_the_poles_are_the_sheet_s() -> None:
    bench = MotorModel(0.01038, 2.85e-7, 9.4782e-6, 3.9876e-5)
    gains = Gains(bench, PaperConfig(), 550.0)
    assert gains.gain == pytest.approx(19.2, rel=0.02)
    assert gains.weight == pytest.approx(3.25e4, rel=0.02)


def simulated(eta: float, seconds: float, model: MotorModel = MODEL) -> list[tuple[float, float, float]]:
    """A rotor at 550 rad/s whose propeller has `eta`, held there by a current that swings."""
    out, w, dt = [], 550.0, 0.001
    for k in range(int(seconds / dt)):
        i = (model.torque * 550.0**2 + model.friction * 550.0) / model.torque_constant
        i *= eta * (1.0 + 0.2 * math.sin(3.0 * k * dt))
        rise = model.torque_constant * i - model.torque * eta * w * w - model.friction * w
        w += dt * rise / model.inertia
        if k % 20 == 0:
            out.append((k * dt, w, i))
    return out


@pytest.mark.parametrize("eta", [1.0, 0.7, 0.3])
def test_the_observer_finds_what_is_left(eta: float) -> None:
    config = PaperConfig()
    observer, gains = RotorObserver(MODEL, config), Gains(MODEL, config, 550.0)
    for t, w, i in simulated(eta, 4.0):
        observer.sample(t, w, i, gains)
    assert observer.eta == pytest.approx(eta, abs=0.03)


def test_a_wrong_drag_shows_as_its_inverse() -> None:
    """Appendix D: kappa_tau 10 % high, eta^ ~ .9; 10 % low, ~ 1.1."""
    config = PaperConfig()
    for factor in (0.9, 1.1):
        wrong = MotorModel(MODEL.torque_constant, MODEL.torque * factor, MODEL.friction, MODEL.inertia)
        observer, gains = RotorObserver(wrong, config), Gains(wrong, config, 550.0)
        for t, w, i in simulated(1.0, 4.0):
            observer.sample(t, w, i, gains)
        assert observer.eta == pytest.approx(1.0 / factor, abs=0.03)


def test_one_millisecond_of_integration_is_fine_enough() -> None:
    found = []
    for step in (0.002, 0.0005):
        config = PaperConfig(step=step)
        observer, gains = RotorObserver(MODEL, config), Gains(MODEL, config, 550.0)
        for t, w, i in simulated(0.5, 0.4):
            observer.sample(t, w, i, gains)
        found.append(observer.eta)
    assert found[0] == pytest.approx(found[1], abs=0.01)


def test_coupled_without_body_errors_is_the_decentralised_one() -> None:
    """With rates that the model explains, here none, the coupled observer's rotors do as the single ones."""
    from synthetic_flight import airframe

    craft = airframe(4)
    config = PaperConfig(form="coupled", gain=19.2, weight=3.25e4)
    gains = Gains(MODEL, config, 550.0, 4)
    together, single = CoupledObserver(MODEL, craft, config), RotorObserver(MODEL, config)
    together.rates[:] = 0.0
    for t, w, i in simulated(0.6, 2.0):
        together.sample(t, [w] * 4, [i] * 4, gains)
        single.sample(t, w, i, gains)
    assert together.eta == pytest.approx([single.eta] * 4, abs=1e-6)


def test_coupled_needs_the_effectiveness() -> None:
    from synthetic_flight import airframe

    with pytest.raises(AirframeError, match="roll and pitch"):
        CoupledObserver(MODEL, airframe(4, known=False), PaperConfig(form="coupled"))


def test_constants_come_from_the_vehicle_file() -> None:
    from dataclasses import replace

    from synthetic_flight import airframe

    from gcs_health.estimators.adaptive_observer import motor_model

    craft = airframe(4)
    assert motor_model(craft) == MotorModel(0.01, 3e-7, 1e-5, 4e-5)
    assert motor_model(replace(craft, motor=Motor(torque=3e-7))) is None
