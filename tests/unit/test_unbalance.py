"""Which rotor is unbalanced and by how much, what cannot be told, and what is said then."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear
from synthetic_flight import HOVER, MASS, RADIUS, airframe

from gcs_health.airframe import Airframe, AirframeSource
from gcs_health.errors import AirframeError, ConfigError
from gcs_health.estimators.bounded_fit import fit
from gcs_health.estimators.contract import Estimate, Quantity, Reason, Status
from gcs_health.estimators.unbalance import Baseline, UnbalanceConfig, UnbalanceEstimator
from gcs_health.estimators.unbalance_verdict import Finding, chance_of_outlier, judge, outlier_ratio
from gcs_health.samples import (
    CommandReading,
    FlightReading,
    ImuFilterReading,
    ImuReading,
    Reading,
    RotorReading,
    VibrationReading,
)

NAN = math.nan
DAMAGE = 5e-6  # kg m: 1.2 m/s² at hover


def flight(
    craft: Airframe,
    unbalance: list[float],
    seconds: float = 14.0,
    spread: float = 0.03,
    wander: float = 0.04,
    seed: int = 1,
    imu_hz: float = 125.0,
    esc_hz: float = 50.0,
    cutoff: float = NAN,
    speeds: bool = True,
    hz: float = HOVER / (2.0 * math.pi),
    before: tuple[float, list[float]] = (0.0, []),
) -> Iterator[Reading]:
    """Yield a flight whose rotor speeds differ by `spread` and wander by `wander`; no vehicle, just its shaking."""
    rng = np.random.default_rng(seed)
    n = len(craft.rotors)
    dt = 1e-3
    t = np.arange(round(seconds / dt)) * dt
    usual = 2.0 * math.pi * hz * (1.0 + spread * np.linspace(-1.0, 1.0, n)[rng.permutation(n)])
    knots = np.arange(0.0, seconds + 0.5, 0.5)
    moves = np.column_stack([np.interp(t, knots, rng.normal(0.0, wander, len(knots))) for _ in range(n)])
    w = usual * (1.0 + moves)
    phase = np.cumsum(w, axis=0) * dt + rng.uniform(0.0, 6.28, n)
    spin = np.array([rotor.spin for rotor in craft.rotors])
    until, other = before  # until when the unbalance was another one
    each = np.where((t < until)[:, None], other or unbalance, unbalance)
    a = (each / MASS * w**2 * np.exp(-1j * spin * phase)).sum(axis=1)
    if cutoff == cutoff:
        a = a / math.hypot(1.0, (HOVER / (2.0 * math.pi * cutoff)) ** 2)
    a = a + 0.5 * (rng.standard_normal(len(t)) + 1j * rng.standard_normal(len(t)))
    yield FlightReading(0.0, True, False)
    yield ImuFilterReading(0.0, NAN, cutoff, "test")
    absent = (NAN,) * n
    every, esc_every = round(1.0 / (imu_hz * dt)), round(1.0 / (esc_hz * dt))
    for k in range(1, len(t)):
        if k % esc_every == 0 and speeds:
            yield RotorReading(t[k], tuple(w[k].tolist()), absent, absent)
        if k % every == 0:
            yield ImuReading(t[k], a[k].real, a[k].imag, -9.81, 0.0, 0.0, 0.0)


def judged(
    craft: Airframe, readings: Iterator[Reading], config: UnbalanceConfig | None = None
) -> list[Estimate]:
    """Feed everything; return the last estimates."""
    estimator = UnbalanceEstimator(craft, config or UnbalanceConfig(damage=DAMAGE))
    t = 0.0
    for reading in readings:
        estimator.feed(reading)
        t = reading.t
    return estimator.estimates(t)


@pytest.mark.parametrize(("rotors", "cut"), [(3, 1), (4, 2), (6, 5), (8, 0)])
def test_the_cut_propeller_is_named_and_measured(rotors: int, cut: int) -> None:
    craft = airframe(rotors)
    unbalance = [0.05 * DAMAGE] * rotors
    unbalance[cut] = DAMAGE
    said = judged(craft, flight(craft, unbalance, spread=0.05, seed=rotors))
    for estimate in said:
        assert estimate.status is Status.VALID
        assert estimate.quantity is Quantity.UNBALANCE
        assert (estimate.failure_probability > 0.9) == (estimate.rotor == cut)
        assert estimate.detectable < DAMAGE
    found = said[cut]
    assert found.value == pytest.approx(DAMAGE, rel=0.1)
    assert found.std < 0.2 * DAMAGE
    evidence = dict(found.evidence)
    assert evidence["tip_mass_mg"] == pytest.approx(found.value / RADIUS * 1e6)
    assert evidence["unbalance_g_mm"] == pytest.approx(found.value * 1e6)
    assert evidence["balance_grade_lacks"] == "the propeller's mass"
    assert evidence["largest"] == str(craft.rotors[cut].motor)
    assert evidence["filter"] == "test"


def test_healthy_propellers_are_said_to_be_so() -> None:
    craft = airframe(4)
    for estimate in judged(craft, flight(craft, [0.1 * DAMAGE, 0.0, 0.05 * DAMAGE, 0.1 * DAMAGE])):
        assert estimate.status is Status.VALID
        assert estimate.failure_probability < 0.1
        assert estimate.value < 0.25 * DAMAGE


def test_without_known_damage_an_outlier_is_named_and_a_healthy_spread_is_not() -> None:
    craft = airframe(4)
    config = UnbalanceConfig()
    cut = judged(craft, flight(craft, [0.05 * DAMAGE, DAMAGE, 0.03 * DAMAGE, 0.08 * DAMAGE]), config)
    assert [e.failure_probability > 0.9 for e in cut] == [False, True, False, False]
    rough = judged(craft, flight(craft, [0.3 * DAMAGE, DAMAGE, 0.2 * DAMAGE, 0.5 * DAMAGE]), config)
    assert not any(e.failure_probability > 0.5 for e in rough)
    baseline = Baseline(
        unbalance=tuple(u / MASS for u in (0.3 * DAMAGE, 0.3 * DAMAGE, 0.2 * DAMAGE, 0.5 * DAMAGE))
    )
    told = judged(
        craft,
        flight(craft, [0.3 * DAMAGE, DAMAGE, 0.2 * DAMAGE, 0.5 * DAMAGE]),
        UnbalanceConfig(baseline=baseline),
    )
    assert [e.failure_probability > 0.9 for e in told] == [False, True, False, False]


def test_damage_that_came_in_the_flight_needs_to_stand_out_less() -> None:
    craft, unbalance = airframe(4), [0.25 * DAMAGE, DAMAGE, 0.1 * DAMAGE, 0.0]
    always = judged(craft, flight(craft, unbalance, 40.0), UnbalanceConfig())
    assert not any(e.failure_probability > 0.9 for e in always)  # four times the next is no outlier
    healthy = [0.25 * DAMAGE, 0.1 * DAMAGE, 0.1 * DAMAGE, 0.0]
    came = judged(craft, flight(craft, unbalance, 40.0, before=(15.0, healthy)), UnbalanceConfig())
    assert [e.failure_probability > 0.9 for e in came] == [False, True, False, False]
    grown = [4.0 * u for u in healthy]  # all of them: none stands out
    shaken = judged(craft, flight(craft, grown, 40.0, before=(15.0, healthy)), UnbalanceConfig())
    assert not any(e.failure_probability > 0.9 for e in shaken)


def test_spins_told_the_wrong_way_round_are_found_out() -> None:
    craft = airframe(4)
    wrong = replace(craft, rotors=tuple(replace(r, spin=-r.spin) for r in craft.rotors))  # type: ignore[arg-type]
    said = judged(wrong, flight(craft, [0.0, 0.0, DAMAGE, 0.0], spread=0.06))
    assert [e.failure_probability > 0.9 for e in said] == [False, False, True, False]
    assert dict(said[2].evidence)["spins"] == "opposite to the airframe's"


@pytest.mark.parametrize("seed", [0, 3])
def test_pieces_that_the_wrong_spins_find_on_several_rotors_do_not_outweigh_the_right_one(seed: int) -> None:
    craft = airframe(4)
    # all nearly at one speed: the sum that the wrong spins find is larger, its largest is not
    unbalance = [0.05 * DAMAGE, 0.0, DAMAGE, 0.03 * DAMAGE]
    readings = flight(craft, unbalance, seconds=12.0, spread=0.008, wander=0.003, seed=seed, imu_hz=200.0)
    assert [e.failure_probability > 0.9 for e in judged(craft, readings)] == [False, False, True, False]


def test_an_assumed_geometry_names_nobody_before_its_spins_are_seen_to_be_right() -> None:
    craft = airframe(4)
    guessed = replace(craft, source=AirframeSource.ASSUMED)
    said = judged(guessed, flight(craft, [0.0, 0.0, DAMAGE, 0.0], spread=0.06))
    assert said[2].failure_probability > 0.9  # it was seen
    # all at one speed: either sign explains it as well
    said = judged(guessed, flight(craft, [0.0, 0.0, DAMAGE, 0.0], spread=0.0, wander=0.0))
    assert not any(e.failure_probability > 0.9 for e in said)


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_rotors_of_one_speed_and_spin_are_not_told_apart(seed: int) -> None:
    craft = airframe(4)
    said = judged(craft, flight(craft, [DAMAGE, 0.0, 0.0, 0.0], spread=0.0, wander=0.0, seed=seed))
    assert not any(e.failure_probability > 0.6 for e in said)
    assert Reason.NOT_IDENTIFIABLE in said[0].reasons
    assert Reason.NOT_IDENTIFIABLE in said[2].reasons  # the other one that spins this way
    assert sum(e.failure_probability for e in said) > 0.9
    assert dict(said[0].evidence)["one_of_motors"] == "1 3"


def test_without_a_mass_the_estimate_is_relative_to_it() -> None:
    craft = replace(airframe(4), mass=None)
    said = judged(craft, flight(craft, [0.0, DAMAGE, 0.0, 0.0]), UnbalanceConfig(damage=DAMAGE / MASS))
    assert said[1].quantity is Quantity.UNBALANCE_RELATIVE
    assert said[1].value == pytest.approx(DAMAGE / MASS, rel=0.1)
    assert "tip_mass_mg" not in dict(said[1].evidence)


def test_behind_a_low_pass_the_line_is_given_back_its_size_or_called_blind() -> None:
    craft = airframe(4)
    said = judged(craft, flight(craft, [0.0, 40.0 * DAMAGE, 0.0, 0.0], imu_hz=250.0, cutoff=30.0))
    assert said[1].value == pytest.approx(40.0 * DAMAGE, rel=0.1)
    said = judged(craft, flight(craft, [0.0, DAMAGE, 0.0, 0.0], imu_hz=250.0, cutoff=12.0))
    assert all(e.reasons == (Reason.LINE_NOT_IN_TELEMETRY,) for e in said)
    assert all(math.isnan(e.value) for e in said)


def test_a_line_at_the_sampling_rate_is_blind_too() -> None:
    craft = airframe(4)
    said = judged(
        craft, flight(craft, [0.0, DAMAGE, 0.0, 0.0], spread=0.0, wander=0.0, imu_hz=100.0, hz=100.0)
    )
    assert all(e.reasons == (Reason.LINE_NOT_IN_TELEMETRY,) for e in said)


def test_damage_in_flight_is_named_before_the_long_window_is_full_of_it() -> None:
    craft = airframe(4)
    before = list(flight(craft, [0.0] * 4, seconds=22.0, seed=4))
    after = list(flight(craft, [0.0, DAMAGE, 0.0, 0.0], seconds=13.0, seed=5))
    estimator = UnbalanceEstimator(craft, UnbalanceConfig(damage=DAMAGE))
    named = []
    for reading in [*before, *[r._replace(t=r.t + 22.0) for r in after[2:]]]:
        named += [e for e in estimator.feed(reading) if e.failure_probability > 0.9]
    assert {e.rotor for e in named} == {1}
    assert 24.0 < named[0].t < 33.0


def test_without_speeds_only_a_baseline_tells_and_no_rotor_is_named() -> None:
    craft = airframe(4)
    quiet, loud = [0.1 * DAMAGE] * 4, [0.1 * DAMAGE, DAMAGE, 0.1 * DAMAGE, 0.1 * DAMAGE]
    estimator = UnbalanceEstimator(craft)
    for reading in flight(craft, quiet, seconds=20.0, imu_hz=250.0, speeds=False):
        estimator.feed(reading)
    first = estimator.estimates(19.9)
    assert all(e.reasons[-1] is Reason.NO_BASELINE and math.isnan(e.failure_probability) for e in first)
    config = UnbalanceConfig(baseline=estimator.baseline())
    for unbalance, high in ((quiet, False), (loud, True)):
        said = judged(craft, flight(craft, unbalance, 20.0, seed=7, imu_hz=250.0, speeds=False), config)
        assert all(Reason.NOT_IDENTIFIABLE in e.reasons for e in said)
        assert len({e.failure_probability for e in said}) == 1
        assert (sum(e.failure_probability for e in said) > 0.9) is high


def test_a_baseline_of_another_configuration_is_not_compared_with() -> None:
    estimator = UnbalanceEstimator(
        airframe(4), UnbalanceConfig(baseline=Baseline(vibration=5.0, command=0.5))
    )
    estimator.feed(FlightReading(0.0, True, False))
    for command, known in ((0.52, True), (0.7, False)):
        estimator.reset()
        for k in range(2000):
            t = 0.02 * k
            estimator.feed(CommandReading(t, (command,) * 4))
            estimator.feed(ImuReading(t, 0.0, 0.0, -9.8, 0.0, 0.0, 0.0))
            estimator.feed(VibrationReading(t, 20.0, 15.0, 9.0))
        said = estimator.estimates(40.0)
        assert (Reason.NO_BASELINE not in said[0].reasons) is known
        assert (sum(e.failure_probability for e in said) > 0.9) is known


def test_the_rotor_whose_command_moves_with_the_line_is_named_without_speeds() -> None:
    craft = airframe(4)
    rng = np.random.default_rng(3)
    estimator = UnbalanceEstimator(craft, UnbalanceConfig(baseline=Baseline(level=0.5)))
    estimator.feed(FlightReading(0.0, True, False))
    phase, level = 0.0, np.full(4, 0.6)
    for k in range(250 * 40):
        if k % 500 == 0:
            level = 0.6 + rng.normal(0.0, 0.04, 4)
        if k % 5 == 0:
            estimator.feed(CommandReading(k / 250.0, tuple(level.tolist())))
        phase += 800.0 * level[1] / 250.0
        noise = rng.normal(0.0, 0.3, 2)
        a = (2.0 * math.cos(phase) + noise[0], 2.0 * math.sin(phase) + noise[1])
        estimator.feed(ImuReading(k / 250.0, *map(float, a), -9.8, 0.0, 0.0, 0.0))
    said = estimator.estimates(40.0)
    assert [e.failure_probability > 0.9 for e in said] == [False, True, False, False]
    assert dict(said[1].evidence)["line_follows_r"] > 0.7


def test_a_silent_esc_keeps_all_from_being_judged_and_each_is_told_why() -> None:
    craft = airframe(4)
    readings = [
        r._replace(speed=(NAN, *r.speed[1:])) if isinstance(r, RotorReading) else r
        for r in flight(craft, [DAMAGE, 0.0, 0.0, 0.0])
    ]
    said = judged(craft, iter(readings))
    assert [e.reasons for e in said] == [
        (Reason.ROTOR_NOT_REPORTED,),
        *[(Reason.ROTOR_SPEEDS_INCOMPLETE,)] * 3,
    ]


def test_what_cannot_be_used_is_refused() -> None:
    craft = airframe(4)
    unknown = replace(craft, rotors=(replace(craft.rotors[0], spin=0), *craft.rotors[1:]))
    with pytest.raises(AirframeError, match="spins"):
        UnbalanceEstimator(unknown)
    with pytest.raises(ConfigError, match="damage"):
        UnbalanceEstimator(craft, UnbalanceConfig(damage=-1.0))
    with pytest.raises(ConfigError, match="baseline"):
        UnbalanceEstimator(craft, UnbalanceConfig(baseline=Baseline(unbalance=(1e-6,) * 6)))


def test_the_chance_of_an_outlier_is_that_of_exponential_powers() -> None:
    rng = np.random.default_rng(1)
    drawn = np.sort(rng.exponential(size=(200_000, 4)), axis=1)
    for c in (4.0, 9.0):
        assert np.mean(drawn[:, 3] > c * drawn[:, 2]) == pytest.approx(chance_of_outlier(4, c), rel=0.05)
    assert chance_of_outlier(4, outlier_ratio(4, 1e-4, 1.0)) == pytest.approx(1e-4, rel=1e-6)
    assert outlier_ratio(12, 0.002, 5.0) == 25.0


def test_a_rotor_in_whose_place_another_leaves_next_to_nothing_is_not_named() -> None:
    rng = np.random.default_rng(4)
    mix = rng.exponential(0.2, (4000, 3))
    mix[:, 1] = 0.9 * mix[:, 0] + 0.1 * mix[:, 1]  # two rotors at nearly one speed
    noise = np.full(4000, 0.1)
    power = (mix @ np.array([2.0, 0.0, 0.0]) + noise) * rng.exponential(1.0, 4000)
    found = fit(power, mix, noise, list(range(0, 4000, 12)))
    assert found is not None
    bounds = np.full(3, 0.1), np.full(3, 1.0)
    sheet, ours = judge(found, *bounds, 16.0), judge(found, *bounds, 16.0, own_error=0.07)
    assert 16.0 < sheet.alone < 0.07 * sheet.present
    assert (sheet.finding, sheet.rotor) == (Finding.ROTOR, 0)
    assert (ours.finding, ours.rotor) == (Finding.PRESENT, -1)
    assert ours.probability[0] == ours.probability[1] > 0.45 > ours.probability[2]


def test_bounded_fits_agree_with_a_bounded_solver() -> None:
    rng = np.random.default_rng(4)
    true = np.array([2.0, 0.1, 0.0, 0.4])
    mix = rng.exponential(0.2, (240, 4)) + 4.0 * (np.arange(240)[:, None] % 4 == np.arange(4))
    noise = np.full(240, 0.1)
    power = (mix @ true + 0.5 * noise) * rng.exponential(1.0, 240)
    found = fit(power, mix, noise, list(range(0, 240, 12)))
    assert found is not None
    assert found.s == pytest.approx(true, abs=1.0)
    triangle = np.linalg.cholesky(found._gram).T
    target = np.linalg.solve(triangle.T, found._gram @ found._x - found._slope)
    least = float(np.sum((triangle @ found._x - target) ** 2))
    for low, high in (((0.0,) * 4, (0.5,) * 4), ((0.0, 1.0, 0.0, 0.0), (9.0, 9.0, 9.0, 9.0))):
        scaled = (found._scale, np.array([*low, 0.0]), np.array([*high, np.inf]))
        solved = lsq_linear(triangle, target, (scaled[1] / scaled[0], scaled[2] / scaled[0]))
        expected = (2.0 * solved.cost - least) / found._kappa
        assert found.cost(np.array(low), np.array(high)) == pytest.approx(expected, rel=1e-6, abs=1e-6)
    assert found.cost(np.zeros(4), np.full(4, np.inf)) == pytest.approx(0.0, abs=1e-6)
