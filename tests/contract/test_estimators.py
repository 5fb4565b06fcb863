"""What every estimator of the registry must hold, named `estimator:check`."""

import base64
import inspect
import math
import pickle
import random
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from synthetic_flight import Scenario, airframe, fly

from gcs_health.errors import GcsHealthError
from gcs_health.estimators import REGISTRY, load
from gcs_health.estimators.contract import REASON_TEXT, Estimate, Estimator, Reason, Status
from gcs_health.samples import ImuReading, Reading, RotorReading

Check = Callable[[str], None]
CHECKS: list[Check] = []


def check(function: Check) -> Check:
    """Add a check to the suite."""
    CHECKS.append(function)
    return function


def play(estimator: Estimator, readings: list[Reading], every: int = 50) -> list[Estimate]:
    """Feed readings, asking for estimates now and then; return all that was said."""
    said = []
    for k, reading in enumerate(readings):
        said += list(estimator.feed(reading))
        if k % every == 0 and math.isfinite(reading.t):
            said += estimator.estimates(reading.t)
    return said


def flight(rotors: int = 4, **changes: object) -> list[Reading]:
    return list(fly(Scenario(rotors, **{"duration": 6.0, "at": 5.0, "lost": 1, **changes})))  # type: ignore[arg-type]


def sane(estimates: list[Estimate], rotors: int) -> None:
    """Assert what holds of every estimate."""
    assert estimates
    for estimate in estimates:
        assert 0 <= estimate.rotor < rotors
        assert estimate.estimator in REGISTRY
        assert math.isfinite(estimate.t)
        assert estimate.std >= 0.0 or math.isnan(estimate.std)
        assert 0.0 <= estimate.failure_probability <= 1.0 or math.isnan(estimate.failure_probability)
        assert set(estimate.reasons) <= set(REASON_TEXT)
        if estimate.status is Status.VALID:
            assert math.isfinite(estimate.value)
            assert math.isfinite(estimate.std)
        else:
            assert estimate.reasons


def same(first: list[Estimate], second: list[Estimate]) -> bool:
    """Equal bit for bit; NaN equals NaN."""
    return repr(first) == repr(second)


@check
def irregular_rates(name: str) -> None:
    rng = random.Random(2)
    readings = flight(jitter=0.8)
    for k in range(0, len(readings) - 1, 97):  # duplicates and neighbours out of order
        readings.insert(k, readings[k])
        readings[k + 2], readings[k + 3] = readings[k + 3], readings[k + 2]
    readings = [reading for reading in readings if rng.random() > 0.1 and not 3.0 < reading.t < 3.2]
    estimator = load(name, airframe(4))
    sane(play(estimator, readings), 4)
    assert estimator.late > 0  # type: ignore[attr-defined]


@check
def missing_from_the_start(name: str) -> None:
    for kind, (reason, _) in load(name, airframe(4)).needs.items():
        estimator = load(name, airframe(4))
        said = play(estimator, [r for r in flight() if not isinstance(r, kind)])
        sane(said, 4)
        assert all(reason in estimate.reasons for estimate in estimator.estimates(6.0))
        assert not any(estimate.failure_probability > 0.5 for estimate in said)


@check
def lost_midway(name: str) -> None:
    for kind, (_, reason) in load(name, airframe(4)).needs.items():
        estimator = load(name, airframe(4))
        readings = [r for r in flight(lost=None) if not (isinstance(r, kind) and r.t > 4.0)]
        sane(play(estimator, readings), 4)
        assert all(reason in estimate.reasons for estimate in estimator.estimates(6.0))
        assert all(estimate.status is not Status.VALID for estimate in estimator.estimates(6.0))


@check
def rotors_three_to_twelve(name: str) -> None:
    for rotors in range(1, 14):
        craft = airframe(max(rotors, 3)) if rotors < 3 else airframe(rotors)
        if not 3 <= rotors <= 12:
            from dataclasses import replace

            craft = replace(craft, rotors=craft.rotors[:rotors])
            with pytest.raises(GcsHealthError):
                load(name, craft)
            continue
        estimator = load(name, craft)
        said = play(estimator, flight(rotors, duration=2.5, imu_hz=100.0, esc_hz=50.0))
        sane(said, rotors)
        last = estimator.estimates(2.5)
        kinds = [quantity for quantity in estimator.quantities for _ in range(rotors)]
        assert sorted((e.quantity, e.rotor) for e in last) == sorted(
            (quantity, k % rotors) for k, quantity in enumerate(kinds)
        )


@check
def not_a_number_and_infinity(name: str) -> None:
    bad = (math.nan, math.inf, -math.inf, 1e300)
    readings: list[Reading] = []
    for k, reading in enumerate(flight(lost=None)):
        readings.append(reading)
        if k % 7 == 0 and isinstance(reading, ImuReading):
            readings.append(reading._replace(t=reading.t + 1e-4, **{reading._fields[1 + k % 6]: bad[k % 3]}))
        if k % 11 == 0 and isinstance(reading, RotorReading):
            readings.append(reading._replace(t=reading.t + 1e-4, speed=(bad[k % 3],) * 4))
    readings.insert(50, readings[50]._replace(t=math.nan))
    estimator = load(name, airframe(4))
    said = play(estimator, readings)
    sane(said, 4)
    clean = load(name, airframe(4))
    play(clean, flight(lost=None))
    assert [e.status for e in estimator.estimates(6.0)] == [e.status for e in clean.estimates(6.0)]


@check
def absurd_numbers_never_raise(name: str) -> None:
    rng = random.Random(3)
    estimator = load(name, airframe(4))
    absent = (math.nan,) * 4
    with np.errstate(all="ignore"):
        for k in range(3000):
            big = [rng.choice((0.0, 1.0, -1e6, 1e12, 1e150)) for _ in range(10)]
            estimator.feed(ImuReading(0.01 * k, *big[:6]))
            estimator.feed(RotorReading(0.01 * k, tuple(big[6:]), absent, absent))
        assert len(estimator.estimates(30.0)) == 4 * len(estimator.quantities)
    estimator.feed(RotorReading(31.0, (1.0,), (), ()))  # fewer and more rotors than the airframe has
    estimator.feed(RotorReading(31.1, (1.0,) * 9, (), ()))


@check
def reset_equals_new(name: str) -> None:
    readings = flight()
    used = load(name, airframe(4))
    play(used, readings)
    used.reset()
    assert same(play(used, readings), play(load(name, airframe(4)), readings))


@check
def deterministic_without_clock_and_global_random(name: str) -> None:
    readings = flight()

    def poison(*_: object, **__: object) -> float:
        raise AssertionError("an estimator read a clock or the global random state")

    with pytest.MonkeyPatch.context() as patch:
        for function in ("time", "monotonic", "perf_counter"):
            patch.setattr(time, function, poison)
        patch.setattr(random, "random", poison)
        patch.setattr(np.random, "random", poison)
        first = play(load(name, airframe(4)), readings)
        second = play(load(name, airframe(4)), readings)
    assert same(first, second)


@check
def asking_changes_nothing(name: str) -> None:
    readings = flight()
    often, never = load(name, airframe(4)), load(name, airframe(4))
    for reading in readings:
        told = list(often.feed(reading))
        often.estimates(reading.t)
        assert same(told, list(never.feed(reading)))
    assert same(often.estimates(6.0), never.estimates(6.0))


@check
def state_goes_on_in_a_new_process(name: str) -> None:
    readings = flight()
    middle = len(readings) // 2
    estimator = load(name, airframe(4))
    play(estimator, readings[:middle])
    parcel = base64.b64encode(pickle.dumps((estimator, readings[middle:]))).decode()
    script = (
        "import base64, pickle, sys\n"
        "estimator, readings = pickle.loads(base64.b64decode(sys.stdin.read()))\n"
        "print([e for r in readings for e in estimator.feed(r)], estimator.estimates(6.0))\n"
    )
    other = subprocess.run(
        [sys.executable, "-c", script],
        input=parcel,
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    told = [e for r in readings[middle:] for e in estimator.feed(r)]
    assert other.stdout.strip() == f"{told} {estimator.estimates(6.0)}"


@check
def state_stays_bounded(name: str) -> None:
    estimator = load(name, airframe(4))
    sizes = []
    for lap in range(4):
        for reading in flight(duration=5.0, lost=None, seed=lap):
            estimator.feed(reading._replace(t=reading.t + 5.0 * lap))
        sizes.append(len(pickle.dumps(estimator)))
    assert sizes[-1] < 1.2 * sizes[0] + 2000
    assert sizes[-1] < 200_000


@check
def warms_up_first(name: str) -> None:
    estimator = load(name, airframe(4))
    first = list(fly(Scenario(4, duration=0.1)))
    said = play(estimator, first, every=1)
    assert said[0].status in (Status.CONVERGING, Status.UNOBSERVABLE)
    assert all(estimate.status is not Status.VALID for estimate in said)


@check
def inputs_are_left_alone(name: str) -> None:
    craft = airframe(4)
    readings = flight()
    copies = pickle.dumps((craft, readings))
    play(load(name, craft), readings)
    assert pickle.dumps((craft, readings)) == copies


@check
def the_docstring_is_complete(name: str) -> None:
    kind = type(load(name, airframe(4)))
    text = inspect.getdoc(kind) or ""
    for part in ("Parameters", "Raises", "Examples", "Source:"):
        assert part in text
    for method in ("feed", "estimates", "reset"):
        assert inspect.getdoc(getattr(kind, method))
    assert kind.name == name


@check
def both_modes_are_there(name: str) -> None:
    for mode in ("recommended", "paper"):
        sane(play(load(name, airframe(4), mode), flight()), 4)
    with pytest.raises(GcsHealthError, match="mode"):
        load(name, airframe(4), "best")


@check
def it_is_fed_only_what_it_takes(name: str) -> None:
    """Readings of other kinds, which it is not fed in the pipeline, change nothing where they come."""
    estimator, spared = load(name, airframe(4)), load(name, airframe(4))
    assert set(estimator.needs) <= estimator.takes
    readings = flight()
    play(spared, [reading for reading in readings if type(reading) in estimator.takes])
    play(estimator, readings)
    assert same(estimator.estimates(6.0), spared.estimates(6.0))


def _cases() -> Iterator[object]:
    for name in REGISTRY:
        for function in CHECKS:
            yield pytest.param(name, function, id=f"{name}:{function.__name__}")


@pytest.mark.parametrize(("name", "function"), list(_cases()))
def test_contract(name: str, function: Check) -> None:
    function(name)


def test_every_reason_has_a_sentence() -> None:
    assert set(REASON_TEXT) == set(Reason)


def test_the_registry_is_light() -> None:
    script = "import gcs_health.estimators, sys; print('numpy' in sys.modules)"
    out = subprocess.run(
        [sys.executable, "-c", script],
        capture_output=True,
        text=True,
        check=True,
        cwd=Path(__file__).parents[2],
    )
    assert out.stdout.strip() == "False"
