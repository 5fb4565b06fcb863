"""Airframes and estimates as the event schema has them."""

from collections.abc import Mapping
from typing import Any

from gcs_health.airframe import Airframe
from gcs_health.estimators.contract import REASON_TEXT, Estimate


def describe_airframe(airframe: Airframe) -> dict[str, Any]:
    """Return the airframe as the event schema has it."""
    return {
        "name": airframe.name,
        "source": airframe.source.value,
        "metric": airframe.metric,
        "warnings": airframe.warnings,
        "rotors": tuple(
            {
                "motor": rotor.motor,
                "rotor": rotor.esc,
                "position": rotor.position,
                "spin": {1: "ccw", -1: "cw", 0: None}[rotor.spin],
                "seat": airframe.seat(k),
            }
            for k, rotor in enumerate(airframe.rotors)
        ),
    }


def describe_state(estimate: Estimate) -> dict[str, Any]:
    """Return one rotor's state as the summary has it."""
    return {
        "t": estimate.t,
        "value": estimate.value,
        "std": estimate.std,
        "failure_probability": estimate.failure_probability,
        "status": estimate.status.value,
        "reasons": tuple(reason.value for reason in estimate.reasons),
        "why": "; ".join(REASON_TEXT[reason] for reason in estimate.reasons),
        "detectable": estimate.detectable,
    }


def hardware_uid(fields: Mapping[str, Any]) -> str | None:
    """Return what AUTOPILOT_VERSION tells a vehicle's hardware by, hexadecimal: uid2, else uid; None if zero."""
    long = bytes(fields["uid2"])
    if any(long):
        return long.hex()
    return f"{fields['uid']:016x}" if fields["uid"] else None
