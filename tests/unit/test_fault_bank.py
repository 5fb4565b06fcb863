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


@pytest.mark.parametrize(("tick", "least"), [(0.004, 6), (0.008, 3), (0.01, 3), (0.02, 2), (0.04, 2)])
def test_the_shortest_window_is_one_of_time_and_never_of_one_tick(tick: float, least: int) -> None:
    bank = FaultBank(ROTORS, 3, BankConfig())
    for count, one in enumerate(ticks(8, lost=1, seed=2), 1):
        bank.add_final(one, -2.4)
        assert bank.judge(tick, 5.0, 1.0).passes is (count >= least)
