"""Events to put through sinks."""

import math

from gcs_health.record.events import AlertEvent, EstimateEvent, VerdictEvent

START_US = 1_700_000_000_000_000


def alert(number: int = 1, state: str = "raised", code: str = "ROTOR_FAILED", t: float = 17.04) -> AlertEvent:
    text = "motor 3 (front left, CW): rotor lost its thrust, 99 % sure"
    stamp = START_US + int(t * 1e6)
    evidence = {"log_likelihood_ratio": 9.5}
    return AlertEvent(t, stamp, "7.1", f"7.1-{number}", code, 2, 3, state, 1, 0.99, text, evidence)


def estimate(t: float, motor: int = 3, value: float = 0.25, status: str = "valid") -> EstimateEvent:
    return EstimateEvent(
        t, START_US + int(t * 1e6), "7.1", "effectiveness", motor - 1, motor, "effectiveness", value, 0.05,
        0.9, status, (), math.nan,
    )  # fmt: skip


def verdict(t: float = 17.0, kind: str = "healthy", known: bool = True) -> VerdictEvent:
    return VerdictEvent(t, START_US + int(t * 1e6), "7.1", 2, 3, kind, 0.75, known, t, ("effectiveness",))
