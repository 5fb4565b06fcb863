"""Paper-exact mode: the authors' rules, piece by piece."""

import math

import numpy as np
import pytest
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
