"""Joining batches of four ESCs: complete ones at once, lost ones late but not never."""

from functools import reduce

from gcs_health.esc_batches import MISSED, BatchJoin, Known


def batch(first: int, speed: float = 100.0) -> Known:
    return Known.of([(k, speed, 0.0, 0.0) for k in range(first, first + 4)])


def joined(*batches: Known) -> Known:
    return reduce(Known.and_these, batches)


def learned() -> BatchJoin:
    join = BatchJoin()
    for first in (0, 4, 8):
        join.feed(0.0, first, batch(first))
    return join


def test_a_vehicle_of_one_batch_never_waits() -> None:
    join = BatchJoin()
    for k in range(5):
        assert join.feed(0.1 * k, 0, batch(0)) == (0.1 * k, batch(0))


def test_batches_of_one_moment_are_joined() -> None:
    join = learned()
    assert join.feed(1.0, 0, batch(0)) is None
    assert join.feed(1.0005, 4, batch(4)) is None
    assert join.feed(1.001, 8, batch(8)) == (1.0, joined(batch(0), batch(4), batch(8)))


def test_a_lost_batch_delays_the_others_by_one_moment() -> None:
    join = learned()
    assert join.feed(1.0, 0, batch(0, 1.0)) is None
    assert join.feed(1.0, 4, batch(4, 1.0)) is None
    assert join.feed(2.0, 0, batch(0, 2.0)) == (1.0, joined(batch(0, 1.0), batch(4, 1.0)))
    assert join.feed(2.0, 4, batch(4, 2.0)) is None
    assert join.feed(2.0, 8, batch(8, 2.0)) == (2.0, joined(batch(0, 2.0), batch(4, 2.0), batch(8, 2.0)))


def test_a_last_batch_alone_is_not_held() -> None:
    join = learned()
    assert join.feed(3.0, 8, batch(8)) == (3.0, batch(8))


def test_a_batch_that_stays_away_is_no_longer_waited_for_and_is_when_it_is_back() -> None:
    join = BatchJoin()
    for k in range(3):
        join.feed(float(k), 0, batch(0))
        join.feed(float(k), 4, batch(4))
    given = [join.feed(10.0 + k, 0, batch(0)) for k in range(MISSED + 3)]
    assert given[0] is None
    assert given[-1] == (10.0 + MISSED + 2, batch(0))
    assert given[-2] == (10.0 + MISSED + 1, batch(0))
    assert join.feed(20.0, 4, batch(4)) == (20.0, batch(4))
    assert join.feed(21.0, 0, batch(0)) is None
    assert join.feed(21.0, 4, batch(4)) == (21.0, joined(batch(0), batch(4)))
