"""The motor observer on the bench of rotors: what it finds, what it refuses, and what it never says."""

import sys
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from motor_bench import TORQUE_CONSTANT, Bench, Telemetry, Trouble, airframe, fly

from gcs_health.airframe import Airframe, Motor
from gcs_health.estimators.contract import Estimate, Quantity, Reason, Status
from gcs_health.estimators.current_timing import Timing
from gcs_health.estimators.motor_observer import MotorObserver, MotorObserverConfig
from gcs_health.estimators.motor_observer_recommended import RecommendedObserver
from gcs_health.samples import CommandReading, RotorReading

AT50 = Telemetry(50.0)
DURATION, AT = 21.0, 17.0
TROUBLES = (
    Trouble(),
    Trouble("ejected"),
    Trouble("partial", 0.7),
    Trouble("undriven"),
)


@lru_cache
def flown(lag: float = 0.0) -> Bench:
    """All flights of these tests: of every trouble one whose ESCs govern speed and one driven by duty."""
    troubles = [trouble for trouble in TROUBLES for _ in range(2)]
    return fly(list(range(20002, 20002 + len(troubles))), DURATION + 7.0, troubles, lag, at=AT)


class Two:
    """The two flights of one trouble."""

    def __init__(self, kind: str, lag: float) -> None:
        self.all = flown(lag)
        self.first = 2 * [trouble.kind for trouble in TROUBLES].index(kind)
        self.rotor = self.all.rotor[self.first : self.first + 2]
        self.truth = {key: value[self.first : self.first + 2] for key, value in self.all.truth.items()}

    def readings(self, flight: int, telemetry: Telemetry):  # type: ignore[no-untyped-def]
        return self.all.readings(self.first + flight, telemetry)

    def airframe(self, flight: int, inertia: float = 1.0, **known: object) -> Airframe:
        return self.all.airframe(self.first + flight, inertia, **known)


def bench(kind: str = "none", lag: float = 0.0) -> Two:
    return Two(kind, lag)


def watch(
    made: Two,
    flight: int,
    telemetry: Telemetry = AT50,
    until: float = DURATION,
    blank: bool = False,
    **known: object,
):  # type: ignore[no-untyped-def]
    """Return the observer after one flight and all that it said on its own."""
    craft = airframe(Motor()) if blank else made.airframe(flight, **known)
    observer = MotorObserver(craft)
    said: list[Estimate] = []
    for reading in made.readings(flight, telemetry):
        if reading.t > until:
            break
        said += observer.feed(reading)
    return observer, said


def failures(said: list[Estimate], quantity: Quantity = Quantity.EFFECTIVENESS) -> list[Estimate]:
    return [e for e in said if e.quantity is quantity and e.failure_probability >= 0.9]


@pytest.mark.parametrize("flight", [0, 1])
@pytest.mark.parametrize(
    ("telemetry", "latest"),
    [(AT50, 0.1), (Telemetry(10.0, "mean"), 0.3), (Telemetry(200.0), 0.06)],
    ids=["50 Hz", "10 Hz averaged", "200 Hz"],
)
def test_a_lost_propeller_is_named_at_once(flight: int, telemetry: Telemetry, latest: float) -> None:
    made = bench("ejected")
    _, said = watch(made, flight, telemetry, until=18.0)
    first = failures(said)[0]
    assert first.rotor == made.rotor[flight]
    assert 0.0 <= first.t - 17.0 < latest
    assert dict(first.evidence)["rule"] == "lost_propeller"
    assert {e.rotor for e in failures(said)} == {made.rotor[flight]}


@pytest.mark.parametrize("blank", [False, True], ids=["constants known", "nothing known"])
def test_a_healthy_flight_is_valid_and_silent(blank: bool) -> None:
    for flight in (0, 1):
        observer, said = watch(bench(), flight, until=24.5, blank=blank)
        assert not failures(said)
        assert not failures(said, Quantity.DRAG)
        for estimate in observer.estimates(24.5):
            assert estimate.status is Status.VALID
            assert estimate.value == pytest.approx(1.0, abs=0.2)
            assert estimate.std < 0.2
            assert 0.1 <= estimate.detectable <= 0.9


def test_the_value_after_a_loss_is_near_nothing() -> None:
    made = bench("ejected")
    observer, _ = watch(made, 0, until=18.0)
    values = {e.rotor: e for e in observer.estimates(18.0) if e.quantity is Quantity.EFFECTIVENESS}
    assert abs(values[int(made.rotor[0])].value) < 0.15
    assert all(e.value > 0.7 for rotor, e in values.items() if rotor != made.rotor[0])


def test_a_partial_loss_is_a_lower_drag_and_not_a_lost_propeller() -> None:
    made = bench("partial")
    for flight in (0, 1):
        observer, said = watch(made, flight, until=20.0)
        first = failures(said, Quantity.DRAG)[0]
        assert first.rotor == made.rotor[flight]
        assert 0.0 < first.t - 17.0 < 0.9
        assert dict(first.evidence)["rule"] == "partial_loss"
        assert not failures(said)
        drag = {e.rotor: e.value for e in observer.estimates(20.0) if e.quantity is Quantity.DRAG}
        assert drag[int(made.rotor[flight])] == pytest.approx(0.7, abs=0.1)


def test_a_motor_that_is_not_driven_has_not_lost_its_propeller() -> None:
    made = bench("undriven")
    for flight in (0, 1):
        observer, said = watch(made, flight, until=19.0)
        first = failures(said)[0]
        assert first.rotor == made.rotor[flight]
        assert first.reasons == (Reason.MOTOR_NOT_DRIVEN,)
        assert not any(dict(e.evidence).get("rule") == "lost_propeller" for e in failures(said))
        assert not any(balance.lost for balance in observer.core.balances)


def test_a_motor_that_is_told_to_idle_is_no_fault() -> None:
    made = bench("undriven")
    rotor = int(made.rotor[0])
    observer = MotorObserver(made.airframe(0))
    said = []
    for reading in made.readings(0, AT50):
        if reading.t > 19.0:
            break
        command = [0.5] * 4
        if reading.t >= 17.0:
            command[rotor] = 0.05
        observer.feed(CommandReading(reading.t, tuple(command)))
        said += observer.feed(reading)
    assert not failures(said)


def test_battery_side_currents_are_recognised_and_converted() -> None:
    telemetry = Telemetry(50.0, side="battery")
    observer, said = watch(bench(), 0, telemetry, until=20.5, current_side=None)
    assert observer.core.measured_on == "battery"
    assert not failures(said)
    for k in range(4):
        ratio = observer.core.identified(k).a * TORQUE_CONSTANT / bench().truth["torque"][0, k]
        assert ratio == pytest.approx(1.0, abs=0.1)  # 3 % of gain error included


def test_battery_side_currents_are_refused_without_the_constants() -> None:
    telemetry = Telemetry(50.0, side="battery")
    observer, said = watch(bench(), 0, telemetry, until=20.5, current_side=None, resistance=None)
    assert not failures(said)
    effectiveness = [e for e in observer.estimates(20.5) if e.quantity is Quantity.EFFECTIVENESS]
    assert all(Reason.CURRENT_OF_BATTERY in e.reasons for e in effectiveness)


def test_a_side_that_the_flight_contradicts_is_doubted() -> None:
    telemetry = Telemetry(50.0, side="battery")
    observer, _ = watch(bench(), 0, telemetry, until=20.5, current_side="motor")
    effectiveness = [e for e in observer.estimates(20.5) if e.quantity is Quantity.EFFECTIVENESS]
    assert all(e.reasons == (Reason.CURRENT_SIDE_CONTRADICTED,) for e in effectiveness)


def test_motor_side_currents_are_recognised() -> None:
    for flight in (0, 1):
        observer, _ = watch(bench(), flight, until=20.5, current_side=None)
        assert observer.core.measured_on == "motor"
        assert observer.core.side.exponent == pytest.approx(1.9, abs=0.15)  # by speed and by duty alike


def test_the_lag_of_the_current_is_found() -> None:
    observer, said = watch(bench(lag=0.04), 1, Telemetry(50.0, lag=0.04), until=20.5)
    timing = observer.core.timing.decided
    assert not timing.mean
    assert 0.02 <= timing.lag <= 0.056
    assert not failures(said)


def test_a_current_of_the_moment_is_not_taken_for_a_lagged_one() -> None:
    for flight in (0, 1):
        observer, _ = watch(bench(), flight, until=20.5)
        assert observer.core.timing.decided == Timing()


@pytest.mark.parametrize("wrong", [0.5, 1.5])
def test_the_inertia_is_learned(wrong: float) -> None:
    observer, said = watch(bench(), 0, until=20.5, inertia=wrong)
    assert not failures(said)
    for k in range(4):
        learned = observer.core.balances[k].constants.c * TORQUE_CONSTANT
        assert learned == pytest.approx(bench().truth["inertia"][0, k], rel=0.25)


def test_three_messages_a_second_are_too_few() -> None:
    observer, said = watch(bench("ejected"), 0, Telemetry(3.0), until=20.5)
    assert not failures(said)
    effectiveness = [e for e in observer.estimates(20.5) if e.quantity is Quantity.EFFECTIVENESS]
    assert all(Reason.RATE_TOO_LOW in e.reasons for e in effectiveness)


def test_without_currents_it_says_so() -> None:
    observer = MotorObserver(bench().airframe(0))
    for reading in bench().readings(0, AT50):
        if isinstance(reading, RotorReading):
            observer.feed(reading._replace(current=(float("nan"),) * 4))
    assert all(e.reasons == (Reason.NO_CURRENTS,) for e in observer.estimates(DURATION))


def test_currents_that_stop_are_stale() -> None:
    observer = MotorObserver(bench().airframe(0))
    for reading in bench().readings(0, AT50):
        if isinstance(reading, RotorReading) and reading.t > 12.0:
            reading = reading._replace(current=(float("nan"),) * 4)
        if reading.t > 15.0:
            break
        observer.feed(reading)
    assert all(e.reasons == (Reason.CURRENT_STALE,) for e in observer.estimates(15.0))
    assert not any(e.status is Status.VALID for e in observer.estimates(15.0))


def test_the_thesis_finds_the_loss_too() -> None:
    made = bench("ejected")
    observer = MotorObserver(made.airframe(0), MotorObserverConfig(mode="paper"))
    said: list[Estimate] = []
    for reading in made.readings(0, AT50):
        if reading.t > 18.0:
            break
        said += observer.feed(reading)
    first = failures(said)[0]
    assert first.rotor == made.rotor[0]
    assert first.t - AT < 0.3


def test_a_verdict_is_taken_back_when_the_propeller_turns_out_whole() -> None:
    """A current that is gone for half a second alarms; when it is back, so is the propeller."""
    observer = MotorObserver(bench().airframe(0))
    assert isinstance(observer.core, RecommendedObserver)
    lost = []
    for reading in bench().readings(0, AT50):
        if isinstance(reading, RotorReading) and 15.0 < reading.t < 15.5:
            reading = reading._replace(current=(0.3, *reading.current[1:]))
        if reading.t > 19.0:
            break
        observer.feed(reading)
        lost.append((reading.t, observer.core.balances[0].lost))
    assert any(state for t, state in lost if 15.0 < t < 15.5)
    assert not lost[-1][1]


def test_mixed_batches_do_not_disturb() -> None:
    """Rotors that report one after another, as serial telemetry does, are judged as well."""
    made = bench("ejected")
    observer = MotorObserver(made.airframe(0))
    said: list[Estimate] = []
    nan = float("nan")
    rng = np.random.default_rng(1)
    for reading in made.readings(0, AT50):
        if reading.t > 18.0:
            break
        if not isinstance(reading, RotorReading):
            said += observer.feed(reading)
            continue
        for k in range(4):
            columns = [tuple(row[j] if j == k else nan for j in range(4)) for row in reading[1:]]
            said += observer.feed(RotorReading(reading.t + 1e-4 * k * rng.random(), *columns))
    assert failures(said)[0].rotor == made.rotor[0]
    assert failures(said)[0].t - 17.0 < 0.1
