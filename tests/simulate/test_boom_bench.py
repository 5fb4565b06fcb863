"""The boom bench against closed forms: trim, lines, modes, and seeds."""

import math

import numpy as np
import pytest

from gcs_health.estimators.speed_span import steady_speeds
from gcs_health.samples import BoomReading, ImuReading, RotorReading
from gcs_health.simulate.boom_bench import Bench, BenchFlights, Plan, _Structure, airframe, fly_bench
from gcs_health.simulate.booms import modes, participation
from gcs_health.simulate.vehicle import load_sim_vehicle

PLANS = [Plan(1, 5), Plan(1, 6, 0, 0.4), Plan(1, 7, 1, 0.4)]


@pytest.fixture(scope="module")
def flights() -> BenchFlights:
    return fly_bench(PLANS, Bench(gusts=0.5, duration=6.0))


def test_speeds_settle_where_the_balances_say(flights: BenchFlights) -> None:
    speeds = flights.speed[30:].mean(axis=0)
    assert speeds[:, 0].mean() == pytest.approx(flights.hover, rel=0.02)
    # rotor 2 sits beside the pitch axis: the trim moment of 5 m/s moves it less than rotor 1
    expected = steady_speeds(airframe(), 1, 0.4)
    shares = speeds[:, 2] / speeds[:, 2].mean()
    assert shares[1] == pytest.approx(expected[1] / expected.mean(), abs=0.03)
    both = 0.5 * (shares[1] + shares[4])
    assert both == pytest.approx(expected[1] / expected.mean(), abs=0.015)


def test_it_hovers(flights: BenchFlights) -> None:
    assert flights.hub[10_000:, 0].mean(axis=0) == pytest.approx(-9.80665, abs=0.05)
    assert np.abs(flights.hub[10_000:, 1:].mean(axis=0)).max() < 0.05


def test_the_blade_pass_line_is_twice_the_speed(flights: BenchFlights) -> None:
    az = flights.hub[10_000:, 0, 0].astype(float)
    spectrum = np.abs(np.fft.rfft((az - az.mean()) * np.hanning(len(az))))
    loudest = np.argmax(spectrum) * flights.rate / len(az)
    assert loudest == pytest.approx(2.0 * flights.hover / (2.0 * math.pi), rel=0.06)


def test_a_finer_step_is_the_same_vehicle() -> None:
    """The paper's 10 kHz with its low pass, and the third of it: three exact small steps are a large one."""
    small, large = _Structure(1e-4), _Structure(3e-4)
    size = 2 * small.n
    np.testing.assert_allclose(
        np.linalg.matrix_power(small.step[:, :size], 3), large.step[:, :size], rtol=1e-6, atol=1e-7
    )
    coarse, fine = (fly_bench([Plan(1, 5)], Bench(0.5, 0.3, oversample=over)) for over in (1, 3))
    assert fine.rate == pytest.approx(coarse.rate)
    assert fine.hub.shape == coarse.hub.shape


def test_the_modes_weigh_what_the_boom_weighs() -> None:
    """All modes together carry the whole mass; the first carries most of it."""
    boom = load_sim_vehicle("dutta_hexa").boom
    assert boom is not None
    shear, bending = participation(boom)
    whole = boom.line_mass * boom.length + boom.tip_mass
    assert 0.6 * whole < shear[0] ** 2 < whole
    assert (shear**2).sum() < whole
    assert 0.0 < bending[0] < shear[0] * boom.length
    assert modes(boom)[0][0] / (2.0 * math.pi) == pytest.approx(148.0, abs=0.5)


def test_seeds_make_the_flight(flights: BenchFlights) -> None:
    again = fly_bench(PLANS, Bench(gusts=0.5, duration=0.3))
    np.testing.assert_array_equal(
        again.booms[:, :, 0], fly_bench(PLANS, Bench(gusts=0.5, duration=0.3)).booms[:, :, 0]
    )
    assert not np.array_equal(flights.hub[:, 0, 0], flights.hub[:, 0, 1])


def test_readings_come_in_order_of_time(flights: BenchFlights) -> None:
    for streams, kinds in (
        (("hub", "speed", "command"), ImuReading),
        (("boom",), BoomReading),
        (("imu100",), ImuReading),
        (("speed",), RotorReading),
    ):
        read = list(flights.readings(0, streams))
        assert [one.t for one in read] == sorted(one.t for one in read)
        assert any(isinstance(one, kinds) for one in read)
