"""Published baselines, out of the live path: benchmarks and documents compare the estimators with them.

Each is one small class: readings in, verdicts out. A method gives every rotor a score at each of its
steps; a rotor is named when its score has stayed above the threshold for the hold time. What the score
is (a loss, a log odds, an ampere) each method says; `benchmarks/rivals.py` sets all thresholds the same
way, from healthy flights that it does not report. ArduCopter's two checks stand apart in
`ardupilot_checks.py`: no scores, and inputs that no telemetry carries.

`METHODS` names them without importing any; `load` makes one.
"""

from collections import deque
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gcs_health.airframe import Airframe
    from gcs_health.samples import Reading

UNNAMED = -1  # a check that says that something is wrong, not which rotor

METHODS: dict[str, tuple[str, str]] = {
    "two_stage": ("two_stage_kalman", "TwoStageKalman"),
    "multiple_model": ("multiple_model", "MultipleModel"),
    "two_step": ("two_step", "TwoStepInversion"),
    "lms": ("lms", "LmsEffectiveness"),
    "thau_residual": ("thau", "ThauResidual"),
    "thau_fault": ("thau", "ThauFault"),
    "sliding_mode": ("sliding_mode", "SlidingMode"),
    "current_threshold": ("adaptive_threshold", "CurrentThreshold"),
    "px4_1_16": ("px4_motor_check", "UndercurrentCheck"),
    "px4_main": ("px4_motor_check", "ResidualCheck"),
    "rpm_command": ("rpm_command", "RpmAgainstCommand"),
}


class Verdict(NamedTuple):
    """A rotor (index, or `UNNAMED`) is called failed at time `t` [s]."""

    rotor: int
    t: float


class Method(Protocol):
    """What every baseline promises.

    `judge` holds threshold and hold time, and the highest score that was held so far.
    """

    judge: "Judge"

    def feed(self, reading: "Reading") -> Verdict | None:
        """Take one reading in order of arrival; return a verdict with the reading that brings it."""
        ...


class Judge:
    """Names a rotor whose score stays above a threshold for a hold time; of several, the highest.

    Parameters
    ----------
    threshold : in the unit of the scores. hold : [s].

    Attributes
    ----------
    peak : the highest score that any rotor held for that time so far; what calibration asks for.
    """

    def __init__(self, threshold: float, hold: float = 0.02) -> None:
        self.threshold = threshold
        self.hold = hold
        self.peak = float("-inf")
        self._since = float("inf")
        self._recent: deque[tuple[float, Sequence[float]]] = deque()

    def feed(self, t: float, scores: "Sequence[float]") -> Verdict | None:
        """Take the scores of all rotors at t [s]."""
        self._since = min(self._since, t)
        recent = self._recent
        recent.append((t, scores))
        while recent[0][0] < t - self.hold - 1e-9:
            recent.popleft()
        if t - self._since < self.hold - 1e-9:
            return None
        held = [min(column) for column in zip(*[row for _, row in recent], strict=True)]
        best = max(range(len(held)), key=held.__getitem__)
        self.peak = max(self.peak, held[best])
        return Verdict(best, t) if held[best] > self.threshold else None


def towards(old: float, new: float, share: float) -> float:
    """Return a first-order low pass's next value, which starts at what it sees first."""
    return new if old != old else old + share * (new - old)


def load(name: str, airframe: "Airframe", **options: Any) -> Method:
    """Make a baseline by name; `options` are its constructor's.

    Raises
    ------
    KeyError : no such method.
    AirframeError : it cannot work on this airframe.
    """
    module, attribute = METHODS[name]
    made: Method = getattr(import_module(f"{__name__}.{module}"), attribute)(airframe, **options)
    return made
