"""The fault bank: a lost rotor named, nobody else; and what waits changes nothing."""

import random

import numpy as np
import pytest

from gcs_health.estimators.fault_bank import BankConfig, FaultBank, Verdict
from gcs_health.estimators.residual_model import Evidence, contributions

ROTORS, TICK = 4, 0.008
GAINS = np.array([[-6.0, 6.0, 6.0, -6.0], [6.0, -6.0, 6.0, -6.0], [0.0] * 4, [-2.4] * 4]) / 250_000.0


def ticks(count: int, lost: int | None = None, seed: int = 1) -> list[Evidence]:
    """Ticks of hover at 500 rad/s, of unit noise; what rotor `lost` should add is missing."""
    rng = random.Random(seed)
    out = []
    for _ in range(count):
        w0, w1 = ([500.0 + rng.gauss(0, 5) for _ in range(ROTORS)] for _ in range(2))
        r = [rng.gauss(0.0, 1.0) for _ in range(4)]
        if lost is not None:
            r = [value - 250_000.0 * float(GAINS[row, lost]) for row, value in enumerate(r)]
        r[2] = 0.0  # no yaw model
        out.append(Evidence(tuple(r), [0.0] * 4, [1.0] * 4, 1.0, w0, w1, GAINS))
    return out


def judged(bank: FaultBank) -> Verdict:
    return bank.judge(TICK, 5.0, 1.0)


@pytest.mark.parametrize("rotor", range(ROTORS))
def test_a_lost_rotor_is_named_with_its_loss(rotor: int) -> None:
    bank = FaultBank(ROTORS, 3, BankConfig())
    for tick in ticks(20):
        bank.add_final(tick, 0.0)
    assert not judged(bank).passes
    for tick in ticks(6, lost=rotor, seed=2):
        bank.add_final(tick, -2.4)
    verdict = judged(bank)
    assert verdict.passes
    assert verdict.rotor == rotor
    assert verdict.theta == pytest.approx(1.0, abs=0.2)


def test_one_contribution_worked_by_hand() -> None:
    """e - b = (1, 0, 0, 0) of variance .5 x 2, rotor speeds steady at 500 rad/s, no model error."""
    tick = Evidence(
        (3.0, 0.0, 0.0, 0.0), [2.0, 0.0, 0.0, 0.0], [0.5] * 4, 2.0, [500.0] * 4, [500.0] * 4, GAINS
    )
    (row,) = contributions([tick], (0.0, 0.0))
    np.testing.assert_allclose(row[:4], [6.0, -6.0, -6.0, 6.0])  # n = -h' R^-1 r
    np.testing.assert_allclose(row[4:8], [36.0 + 36.0 + 2.4**2] * 4)  # d = h' R^-1 h
    assert row[8] == 1.0  # q = r' R^-1 r


def test_how_often_one_asks_changes_nothing() -> None:
    """Asked after every tick, or only at the end, the bank says the same to the last bit."""
    asked, left = (FaultBank(ROTORS, 3, BankConfig()) for _ in range(2))
    said = NotImplemented
    for tick in ticks(150) + ticks(5, lost=1, seed=3):
        asked.add_final(tick, 0.0)
        left.add_final(tick, 0.0)
        said = judged(asked)
    assert said == judged(left)
    assert asked.standing(TICK) == left.standing(TICK)


def test_provisional_ticks_are_taken_back() -> None:
    bank, reference = (FaultBank(ROTORS, 3, BankConfig()) for _ in range(2))
    final, wrong = ticks(40), ticks(40, lost=2, seed=4)
    for k, tick in enumerate(final):
        reference.add_final(tick, 0.0)
        bank.add_final(tick, 0.0)
        bank.add_provisional(wrong[k], -2.4)
        bank.add_provisional(wrong[k - 1], -2.4)
        if k % 3 == 0:
            judged(bank)
        bank.drop_provisional()
        assert bank.ticks == reference.ticks
    assert judged(bank) == judged(reference)
    for tick in wrong[:4]:
        bank.add_provisional(tick, -2.4)
    assert judged(bank).rotor == 2


def test_cleared_it_knows_nothing() -> None:
    bank = FaultBank(ROTORS, 3, BankConfig())
    for tick in ticks(8, lost=0):
        bank.add_final(tick, -2.4)
    bank.clear()
    assert bank.ticks == 0
    assert not judged(bank).passes
    assert bank.standing(TICK) == ([0.0] * ROTORS, [0.0] * ROTORS)


def turning(count: int, gain: float, doubt: float) -> list[Evidence]:
    """Ticks of a hard roll that rotor 1's low speed makes alone; the roll gain is `gain` times the believed one."""
    rng = random.Random(5)
    w = [500.0, 300.0, 500.0, 500.0]
    pushed = [sum(float(g) * speed**2 for g, speed in zip(row, w, strict=True)) for row in GAINS]
    out = []
    for _ in range(count):
        r = [(gain - 1.0) * push * (row < 2) + rng.gauss(0.0, 0.5) for row, push in enumerate(pushed)]
        r[2] = 0.0
        out.append(Evidence(tuple(r), [0.0] * 4, [0.25] * 4, 1.0, w, w, GAINS, (doubt, doubt)))
    return out


@pytest.mark.parametrize("gain", [0.5, 1.75, 2.3])
def test_gains_not_yet_learned_name_nobody(gain: float) -> None:
    """Their error is one and the same in all ticks: with the doubt as each tick's noise alone somebody is named."""
    wrong, sure = (FaultBank(ROTORS, 3, BankConfig()) for _ in range(2))
    for tick in turning(20, gain, 0.5):
        wrong.add_final(tick, -1.0)
    for tick in turning(20, gain, 0.0):
        sure.add_final(tick, -1.0)
    assert not judged(wrong).passes
    assert judged(wrong).lead < 0.0
    assert judged(sure).lead > 0.0  # who believes in his gains has no other explanation


@pytest.mark.parametrize("rotor", range(ROTORS))
def test_a_lost_rotor_is_named_on_gains_not_yet_learned_too(rotor: int) -> None:
    bank = FaultBank(ROTORS, 3, BankConfig())
    for tick in ticks(20) + ticks(6, lost=rotor, seed=2):
        bank.add_final(tick._replace(doubt=(0.5, 0.5)), -1.0)
    verdict = judged(bank)
    assert verdict.passes
    assert verdict.rotor == rotor


@pytest.mark.parametrize(
    ("doubt", "slower", "passes"), [(0.0, 10.0, True), (0.5, 0.0, True), (0.5, 10.0, False)]
)
def test_a_part_missing_from_a_rotor_that_is_slowed_waits_for_learned_gains(
    doubt: float, slower: float, passes: bool
) -> None:
    bank = FaultBank(ROTORS, 3, BankConfig())
    for k in range(12):
        w = [500.0] * ROTORS
        w[2] -= slower * k
        r = [-0.58 * w[2] ** 2 * float(row[2]) for row in GAINS]
        r[2] = 0.0
        bank.add_final(Evidence(tuple(r), [0.0] * 4, [0.3] * 4, 1.0, w, w, GAINS, (doubt, doubt)), -1.4)
    verdict = judged(bank)
    assert verdict.rotor == 2
    assert verdict.theta == pytest.approx(0.58, abs=0.05)
    assert verdict.passes is passes


def exchanged(count: int, one: int, other: int, doubt: float) -> list[Evidence]:
    """Ticks of a manoeuvre whose two rotors sit in each other's seats."""
    rng = random.Random(7)
    w = [500.0] * ROTORS
    w[one], w[other] = 560.0, 420.0
    out = []
    for _ in range(count):
        away = w[one] ** 2 - w[other] ** 2
        r = [float(row[other] - row[one]) * away + rng.gauss(0.0, 0.5) for row in GAINS]
        r[2] = 0.0
        out.append(Evidence(tuple(r), [0.0] * 4, [0.25] * 4, 1.0, w, w, GAINS, (doubt, doubt)))
    return out


def test_while_gains_are_not_learned_rotors_in_each_others_seats_name_nobody() -> None:
    wrong, sure = (FaultBank(ROTORS, 3, BankConfig()) for _ in range(2))
    for tick in exchanged(20, 0, 1, 0.5):
        wrong.add_final(tick, -1.0)
    for tick in exchanged(20, 0, 1, 0.0):
        sure.add_final(tick, -1.0)
    assert judged(sure).passes  # who believes in his geometry has no other explanation
    assert not judged(wrong).passes


def test_an_exchange_that_the_flight_before_refuted_explains_nothing() -> None:
    bank = FaultBank(ROTORS, 3, BankConfig())
    for tick in exchanged(20, 0, 1, 0.03):
        bank.add_final(tick, -1.0)
    assert not judged(bank).passes
    bank.exchange_cost = np.full(ROTORS * (ROTORS - 1) // 2, 1e6)
    assert judged(bank).passes


@pytest.mark.parametrize(("tick", "least"), [(0.004, 6), (0.008, 3), (0.01, 3), (0.02, 2), (0.04, 2)])
def test_the_shortest_window_is_one_of_time_and_never_of_one_tick(tick: float, least: int) -> None:
    bank = FaultBank(ROTORS, 3, BankConfig())
    for count, one in enumerate(ticks(8, lost=1, seed=2), 1):
        bank.add_final(one, -2.4)
        assert bank.judge(tick, 5.0, 1.0).passes is (count >= least)
