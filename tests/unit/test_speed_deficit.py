"""Degradation from rotor speeds: the span of the mixer, commands, the onset; and never one of a pair without."""

import math

import numpy as np
import pytest
from synthetic_flight import airframe

from gcs_health.estimators.contract import Estimate, Reason, Status
from gcs_health.estimators.pooled_ar import PooledArConfig, PooledArEstimator
from gcs_health.estimators.speed_deficit import SpeedConfig, SpeedDeficit
from gcs_health.estimators.speed_span import Span, SpeedFacts, mixer_of, steady_speeds
from gcs_health.samples import CommandReading, FlightReading, Reading, RotorReading

HOVER = 600.0
FACTS = SpeedFacts(np.zeros(6), between=0.002, drift=0.001, error=0.003)


def flown(rotors: int, rotor: int, k: float, onset: float = 15.0, seconds: float = 22.0, seed: int = 1,
          commands: bool = False, swing: float = 0.03, scatter: float = 0.0) -> list[Reading]:  # fmt: skip
    """Return speeds at 20 Hz of a vehicle whose mixer swings, and whose controller answers over half a second."""
    rng = np.random.default_rng(seed)
    craft = airframe(rotors)
    M = np.linalg.pinv(mixer_of(craft), rcond=1e-6)
    size = M / np.abs(M).max(axis=0)
    u, own = np.zeros(4), 1.0 + scatter * rng.standard_normal(rotors)
    faulty = steady_speeds(craft, rotor, k)
    left = np.ones(rotors)
    left[rotor] = 1.0 - k
    settled, absent = 0.0, (math.nan,) * rotors
    out: list[Reading] = [FlightReading(0.0, True, False)]
    for step in range(round(20 * seconds)):
        t = 0.05 * step + 0.01
        u = 0.8 * u + swing * rng.standard_normal(4) * 0.6
        if t > onset:
            settled += 0.1 * (1.0 - settled)
        share = left if t > onset else np.ones(rotors)
        command = (
            1.0 + settled * (np.where(share > 0.0, faulty / np.maximum(share, 1e-9), 1.0) - 1.0) + size @ u
        )
        speeds = np.abs(share * command * own * HOVER + 1.5 * rng.standard_normal(rotors))
        if commands:
            out.append(CommandReading(t, tuple((0.5 * command).tolist())))
        out.append(RotorReading(t, tuple(speeds.tolist()), absent, absent))
    return out


def told(rotors: int, stream: list[Reading]) -> list[Estimate]:
    estimator = PooledArEstimator(airframe(rotors))
    for reading in stream:
        estimator.feed(reading)
    return estimator.estimates(stream[-1].t)


def trained(stream: list[Reading]) -> SpeedDeficit:
    speeds = SpeedDeficit(airframe(6), SpeedConfig(), FACTS)
    for reading in stream:
        if isinstance(reading, RotorReading):
            speeds.speeds(reading)
    return speeds


def test_six_rotors_have_the_sheets_deficits() -> None:
    for k, deficit in ((0.2, 0.077), (0.4, 0.18), (0.6, 0.33), (0.8, 0.57)):
        speeds = steady_speeds(airframe(6), 0, k)
        assert 1.0 - speeds[0] / speeds.mean() == pytest.approx(deficit, abs=0.005)
        assert speeds[0] == pytest.approx(speeds[3], abs=1e-6)  # the opposite one has the same family


@pytest.mark.parametrize("rotors", [5, 6, 7, 8, 10, 12])
def test_the_span_gives_k_back(rotors: int) -> None:
    span, craft = Span(airframe(rotors)), airframe(rotors)
    assert span.shows
    for rotor in [i for i in range(rotors) if span.shown[i]]:
        speeds = steady_speeds(craft, rotor, 0.3)
        k = span.degradation(span.outside(speeds), speeds)
        assert k[rotor] == pytest.approx(0.3, abs=0.01)
        innocent = [i for i in range(rotors) if i not in span.alike[rotor]]
        assert np.abs(k[innocent]).max() < 0.15


@pytest.mark.parametrize("rotors", [3, 4])
def test_few_rotors_need_commands(rotors: int) -> None:
    assert not Span(airframe(rotors)).shows
    assert all(Reason.NO_COMMANDS in one.reasons for one in told(rotors, flown(rotors, 0, 0.0)))
    estimates = told(rotors, flown(rotors, 1, 0.3, commands=True))
    assert estimates[1].status is Status.VALID
    assert estimates[1].value == pytest.approx(0.3, abs=0.03)
    assert estimates[1].failure_probability > 0.9
    assert all(one.failure_probability < 0.1 for one in estimates if one.rotor != 1)


def test_commands_tell_opposite_rotors_apart() -> None:
    for rotor in (0, 3):
        estimates = told(6, flown(6, rotor, 0.2, commands=True))
        assert [one.rotor for one in estimates if one.failure_probability > 0.9] == [rotor]
        assert estimates[rotor].value == pytest.approx(0.2, abs=0.02)


@pytest.mark.parametrize("scatter", [0.0, 0.05])
def test_speeds_alone_never_decide_untrained(scatter: float) -> None:
    estimates = told(6, flown(6, 0, 0.5, scatter=scatter))
    assert estimates[0].value == pytest.approx(0.5, abs=0.06)
    assert estimates[0].std > 0.03
    assert max(one.failure_probability for one in estimates) <= 0.5
    assert math.isnan(estimates[0].detectable)


def test_a_healthy_flight_alarms_nobody() -> None:
    for rotors in (4, 6, 8):
        for commands in (False, True):
            stream = flown(rotors, 0, 0.0, seed=rotors, commands=commands, swing=0.06, scatter=0.08)
            estimator = PooledArEstimator(airframe(rotors))
            assert not [
                one for reading in stream for one in estimator.feed(reading) if one.failure_probability > 0.5
            ]


def test_before_it_knows_its_own_speeds_it_says_so() -> None:
    early = told(6, flown(6, 0, 0.0, seconds=5.0))
    assert Reason.SHARE_UNKNOWN in early[0].reasons
    assert early[0].status is Status.CONVERGING
    assert early[0].std > 0.1


def test_the_onset_tells_the_pair_apart_or_nobody_does() -> None:
    named = []
    for seed in range(12):
        rotor = seed % 6
        speeds = trained(flown(6, rotor, 0.3, seed=seed, seconds=17.0))
        named.append((rotor, speeds.named))
    assert sum(1 for rotor, name in named if name == rotor) >= 9
    assert all(name in (None, rotor) for rotor, name in named)
    already = trained(flown(6, 0, 0.3, onset=-10.0))  # degraded since ever: no onset to see
    assert already.named is None


def test_an_onset_seen_by_one_speed_a_block_names_nobody() -> None:
    """At 10 Hz the controller has answered by the first sample after it: either of the pair may have dropped more."""
    for seed in range(6):
        stream = flown(6, seed, 0.3, seed=seed, seconds=17.0)
        seldom = [stream[0], *stream[1::2]]
        speeds = trained(seldom)
        assert speeds.named is None


def test_on_the_ground_nothing_is_learned() -> None:
    estimator = PooledArEstimator(airframe(6), PooledArConfig())
    estimator.feed(FlightReading(0.0, True, True))
    for reading in flown(6, 0, 0.0, seconds=5.0)[1:]:
        estimator.feed(reading)
    assert all(one.reasons[0] is Reason.ON_GROUND for one in estimator.estimates(5.0))
