"""Airframes, estimates, verdicts and alerts as the event schema has them."""

import math
from collections.abc import Mapping
from typing import Any

from gcs_health.airframe import Airframe
from gcs_health.balance import QUALITY, words
from gcs_health.clock import ClockNotice
from gcs_health.clock import Kind as ClockNews
from gcs_health.estimators.contract import REASON_TEXT, Estimate, Quantity
from gcs_health.fusion.alerts import Alert
from gcs_health.fusion.verdicts import Verdict
from gcs_health.record.events import AlertEvent, EstimateEvent, VerdictEvent
from gcs_health.samples import new_tuple


def estimate_event(estimate: Estimate, airframe: Airframe, t_unix_us: int, vehicle: str) -> EstimateEvent:
    """Return an estimate as an event; rotors as the airframe has them."""
    t, estimator, k, quantity, value, std, p, status, reasons, detectable, _ = estimate
    rotor = airframe.rotors[k]
    head = t, t_unix_us, vehicle, estimator, rotor.esc, rotor.motor, quantity.value
    why = tuple([reason.value for reason in reasons])
    said = value, std, p, status.value, why, detectable, balance_quality(estimate)
    return new_tuple(EstimateEvent, (*head, *said))


def balance_quality(estimate: Estimate) -> float:
    """Return ISO 21940-11's G [mm/s] of an estimated unbalance; NaN where it cannot be told."""
    if estimate.quantity is not Quantity.UNBALANCE:
        return math.nan
    return float(dict(estimate.evidence).get(QUALITY, math.nan))


def verdict_event(verdict: Verdict, airframe: Airframe, t_unix_us: int, vehicle: str) -> VerdictEvent:
    """Return a verdict as an event."""
    rotor = airframe.rotors[verdict.rotor]
    return VerdictEvent(
        verdict.t,
        t_unix_us,
        vehicle,
        rotor.esc,
        rotor.motor,
        verdict.state,
        verdict.probability,
        verdict.known,
        verdict.since,
        verdict.sources,
    )


def alert_event(alert: Alert, t_unix_us: int, vehicle: str) -> AlertEvent:
    """Return a step of an alert as an event."""
    return AlertEvent(
        alert.t,
        t_unix_us,
        vehicle,
        f"{vehicle}-{alert.number}",
        alert.kind.code,
        alert.rotor.esc if alert.rotor is not None else None,
        alert.rotor.motor if alert.rotor is not None else None,
        alert.state,
        alert.kind.severity,
        alert.probability,
        alert.text,
        dict(alert.evidence),
    )


CLOCK_TEXT = {
    ClockNews.GAP: "nothing came for {:.1f} s",
    ClockNews.REBOOT: "the vehicle rebooted: its clock went back by {:.1f} s",
    ClockNews.VEHICLE_STEP: "the vehicle's clock was set by {:.1f} s",
    ClockNews.RECEIVE_STEP: "the ground station's clock was set by {:.1f} s",
}


def describe_clock(notice: ClockNotice) -> str:
    """Say what happened to the vehicle's clock."""
    return CLOCK_TEXT[notice.kind].format(abs(notice.size))


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
        "balance_quality": balance_quality(estimate),
        "balance": words(estimate.evidence) if estimate.quantity is Quantity.UNBALANCE else "",
    }


def hardware_uid(fields: Mapping[str, Any]) -> str | None:
    """Return what AUTOPILOT_VERSION tells a vehicle's hardware by, hexadecimal: uid2, else uid; None if zero."""
    long = bytes(fields["uid2"])
    if any(long):
        return long.hex()
    return f"{fields['uid']:016x}" if fields["uid"] else None
