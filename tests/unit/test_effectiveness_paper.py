"""Paper-exact mode: the authors' rules, piece by piece."""

import math

import numpy as np
import pytest
from scipy.stats import chi2
from synthetic_flight import Scenario, airframe, fly

from gcs_health.estimators.effectiveness import EffectivenessConfig, EffectivenessEstimator
from gcs_health.estimators.effectiveness_paper import LowPass, PaperConfig, PaperFilter, parameter_sets
from gcs_health.samples import ImuReading, RotorReading

NAN4 = (math.nan,) * 4


def test_there_are_nineteen_parameter_sets_that_differ_by_one_value() -> None:
    sets = parameter_sets()
    base = sets["base"]
    assert len(sets) == 19
    assert (base.roll, base.pitch, base.thrust) == (100e-6, 100e-6, 5e-6)
    assert (base.Q, base.R, base.k_threshold, base.p_threshold) == (0.01, 1.0, 0.25, 0.9)
    names = ("roll", "pitch", "thrust", "Q", "k_threshold", "p_threshold")
    for name, other in sets.items():
        changed = [field for field in names if getattr(other, field) != getattr(base, field)]
        assert len(changed) == (0 if name == "base" else 1)


def test_the_low_pass_is_exact_for_a_held_input() -> None:
    wn, zeta, dt = 50.0, 0.55, 0.002
    low = LowPass(1, wn, zeta)
    low.feed([0.0], dt)
    steps = [low.feed([1.0], dt)[0] for _ in range(200)]
    t = dt * np.arange(1, 201)
    w = wn * math.sqrt(1.0 - zeta**2)
    truth = 1.0 - np.exp(-zeta * wn * t) * (np.cos(w * t) + zeta * wn / w * np.sin(w * t))
    np.testing.assert_allclose(steps, truth, atol=1e-12)


def test_failure_probability_is_the_left_tail() -> None:
    paper = PaperFilter(airframe(4), PaperConfig())
    paper.x = [0.25, 0.0, 1.0, 0.5]
    for i, sigma in enumerate((0.1, 0.1, 0.1, 0.25)):
        paper.P[i][i] = sigma**2
    assert paper.failure_probability(0) == pytest.approx(0.5)
    assert paper.failure_probability(1) == pytest.approx(0.99379, abs=1e-5)
    assert paper.failure_probability(2) < 1e-10
    assert paper.failure_probability(3) == pytest.approx(0.158655, abs=1e-6)


def test_it_is_armed_by_mean_speed_and_starts_at_one_with_three() -> None:
    paper = PaperFilter(airframe(4), PaperConfig())
    for k in range(200):
        paper.imu(ImuReading(0.002 * k, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0))
        paper.rotor_speeds(RotorReading(0.002 * k, (690.0,) * 4, NAN4, NAN4))
    assert not paper.armed
    assert paper.x == [1.0] * 4
    assert [paper.P[i][i] for i in range(4)] == [3.0] * 4
    for k in range(200, 400):
        paper.imu(ImuReading(0.002 * k, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0))
        paper.rotor_speeds(RotorReading(0.002 * k, (720.0,) * 4, NAN4, NAN4))
    assert paper.armed
    assert all(0.0 <= x <= 1.5 for x in paper.x)


def test_speeds_of_the_same_stamp_belong_to_the_message() -> None:
    paper = PaperFilter(airframe(4), PaperConfig(arm_speed=0.0))
    paper.rotor_speeds(RotorReading(0.0, (700.0,) * 4, NAN4, NAN4))
    paper.imu(ImuReading(0.002, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0))
    assert paper.steps == 0  # waits
    paper.rotor_speeds(RotorReading(0.002, (710.0,) * 4, NAN4, NAN4))
    assert paper.steps == 1
    paper.imu(ImuReading(0.004, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0))
    paper.imu(ImuReading(0.006, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0))
    assert paper.steps == 2  # but no longer than the next message


def test_it_finds_a_lost_propeller_and_clears_by_its_own_rule() -> None:
    config = EffectivenessConfig(mode="paper", paper=PaperConfig(arm_speed=500.0))
    estimator = EffectivenessEstimator(airframe(4), config)
    told = []
    flight = Scenario(4, duration=7.4, lost=2, imu_hz=500.0, esc_hz=500.0, noise=(0.003, 0.3))
    for reading in fly(flight):
        told += [(reading.t, e) for e in estimator.feed(reading)]
    assert told
    first_t, first = told[0]
    assert first.rotor == 2
    assert first.failure_probability > 0.9
    assert 7.0 < first_t < 7.25


def test_the_filter_is_consistent_on_data_of_its_own_model() -> None:
    """Mean NEES and NIS of many runs lie in their 95 % bands; the clamp is off, it has no place in the model."""
    runs, steps, n = 100, 80, 4
    config = PaperConfig(Q=2e-4, P0=0.1, clamp=(-math.inf, math.inf))
    rng = np.random.default_rng(2023)
    nees, nis = np.zeros((runs, steps)), np.zeros((runs, steps))
    for run in range(runs):
        paper = PaperFilter(airframe(n), config)
        truth = 1.0 + math.sqrt(config.P0) * rng.standard_normal(n)
        for k in range(steps):
            truth = truth + math.sqrt(config.Q) * rng.standard_normal(n)
            speeds = (600.0 * rng.uniform(0.8, 1.2, n)).tolist()
            H = np.array(paper._rows(speeds))
            z = H @ truth + math.sqrt(config.R) * rng.standard_normal(3)
            S = H @ (np.array(paper.P) + config.Q * np.eye(n)) @ H.T + config.R * np.eye(3)
            innovation = z - H @ paper.x
            nis[run, k] = innovation @ np.linalg.solve(S, innovation)
            paper._update(speeds, tuple(z.tolist()), config.Q)
            error = truth - paper.x
            nees[run, k] = error @ np.linalg.solve(np.array(paper.P), error)
    for values, degrees in ((nees, n), (nis, 3)):
        low, high = chi2.ppf([0.025, 0.975], degrees * runs) / runs
        means = values.mean(axis=0)
        # successive NEES are correlated, so the share of steps inside scatters about .95
        assert np.mean((means > low) & (means < high)) > 0.88
        whole = values[:, ::20].mean()
        assert low < whole < high


def test_the_variance_cap_keeps_correlations() -> None:
    paper = PaperFilter(airframe(4), PaperConfig(variance_cap=0.05))
    for _ in range(500):
        paper._update([600.0] * 4, (0.0, 0.0, -9.8), 0.01)
    P = np.array(paper.P)
    assert P.diagonal().max() == pytest.approx(0.05)
    free = PaperFilter(airframe(4), PaperConfig())
    for _ in range(500):
        free._update([600.0] * 4, (0.0, 0.0, -9.8), 0.01)
    assert np.array(free.P).diagonal().max() > 1.0  # the null direction grows
    correlation = P / np.sqrt(np.outer(P.diagonal(), P.diagonal()))
    assert np.linalg.eigvalsh(correlation).min() > -1e-9


def test_the_single_fault_check_names_the_rotor_and_not_its_diagonal() -> None:
    paper = PaperFilter(airframe(4), PaperConfig(single_fault_check=True))
    speeds = [580.0, 640.0, 600.0, 620.0]
    H = np.array(paper._rows(speeds))
    for lost in range(4):
        k = np.ones(4)
        k[lost] = 0.3
        assert paper._single_fault(speeds, tuple((H @ k).tolist())) == lost
