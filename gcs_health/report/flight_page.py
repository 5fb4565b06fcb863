"""One flight as a page: the verdict first, then what it rests on, then what could not be said and why."""

import math
import platform
from collections import Counter
from importlib import metadata
from typing import Any

import numpy as np

from gcs_health import __version__
from gcs_health.estimators.contract import REASON_TEXT, Reason
from gcs_health.flight import FINDINGS, HEALTHY, Flight
from gcs_health.fusion.alert_table import CATALOGUE
from gcs_health.fusion.detectable import sentence
from gcs_health.record.events import AlertEvent, SummaryEvent, VehicleEvent
from gcs_health.report import plots
from gcs_health.report.drawing import airframe_svg
from gcs_health.report.page import render

AUTOPILOTS = {3: "ArduPilot", 12: "PX4"}
SHOWN = {"effectiveness": (1.0, 2), "unbalance": (1e-6, 1), "unbalance_relative": (1e-6, 1), "drag": (1.0, 2)}
PACKAGES = ("numpy", "scipy", "pymavlink", "fastcrc")
_UNIX = 1e9  # s; vehicle times above are UNIX time


def flight_page(flight: Flight) -> str:
    """Return the page of one flight.

    Raises
    ------
    ConfigError : jinja2 or plotly is not installed.
    """
    return render(
        "flight.html",
        {
            "title": flight.log.rsplit("/", 1)[-1],
            "outcome": flight.outcome,
            "vehicles": [_vehicle(flight, summary) for summary in flight.summaries],
            "configuration": _configuration(flight),
            "versions": _versions(),
        },
    )


def _vehicle(flight: Flight, summary: SummaryEvent) -> dict[str, Any]:
    from markupsafe import Markup

    vehicle = summary.vehicle
    about = [e for e in flight.events if isinstance(e, VehicleEvent) and e.vehicle == vehicle]
    airframe = next((e.airframe for e in reversed(about) if e.airframe), None)
    steps = [alert for alert in flight.alerts if alert.vehicle == vehicle]
    episodes = _episodes(steps)
    states = _states(summary, steps)
    first = summary.t - summary.duration
    marks = [(episode["first"].t, episode["first"].code) for episode in episodes]
    known = [e for e in about if e.autopilot is not None]
    return {
        "name": vehicle,
        "autopilot": AUTOPILOTS.get(known[-1].autopilot or -1, "unknown autopilot") if known else "unheard",
        "airframe": airframe,
        "drawing": Markup(airframe_svg(airframe, states)) if airframe else "",
        "sentences": _sentences(flight, summary, episodes, states),
        "rotors": [_rotor(rotor, states) for rotor in _dicts(summary.rotors)],
        "alerts": [_alert(flight, vehicle, episode, first) for episode in episodes],
        "autopilot_words": [
            e for e in flight.events if type(e).__name__ == "AutopilotEvent" and e.vehicle == vehicle
        ],
        "plots": [
            Markup(plot)
            for plot in (
                *plots.estimate_plots(flight, vehicle, marks),
                plots.speed_plot(flight, vehicle, marks),
                plots.spectrum_plot(flight, vehicle),
            )
            if plot
        ],
        "not_estimated": _not_estimated(flight, vehicle),
        "needs": _needs(flight, vehicle),
        "summary": summary,
        "rates": sorted(
            (n, r) for n, r in summary.rates.items() if isinstance(r, float) and math.isfinite(r)
        ),
        "notices": [e for e in about if e.change in ("clock", "notice")],
        "clock": lambda t: clock(t, first),
    }


def clock(t: float, first: float) -> str:
    """Render a vehicle time; UNIX times count from the flight's start."""
    seconds = t - first if t > _UNIX else t
    return f"{int(seconds // 60)}:{seconds % 60:06.3f}" if math.isfinite(seconds) else "-"


def _episodes(steps: list[AlertEvent]) -> list[dict[str, Any]]:
    """Return each alert with its first and last step."""
    of: dict[str, list[AlertEvent]] = {}
    for step in steps:
        of.setdefault(step.id, []).append(step)
    return [{"first": s[0], "last": s[-1], "steps": s} for s in of.values()]


def _states(summary: SummaryEvent, steps: list[AlertEvent]) -> dict[int, str]:
    """Return the state of each motor: fault if alerted, healthy if something valid was known of it, else unknown."""
    faults = {step.motor for step in steps if step.motor is not None}
    states = {}
    for rotor in _dicts(summary.rotors):
        known = any(
            e["final"]["status"] == "valid" or e["worst"]["status"] == "valid" for e in rotor["estimates"]
        )
        states[rotor["motor"]] = "fault" if rotor["motor"] in faults else "healthy" if known else "unknown"
    return states


def _sentences(
    flight: Flight, summary: SummaryEvent, episodes: list[dict[str, Any]], states: dict[int, str]
) -> list[str]:
    """Return the verdict in words."""
    if episodes:
        return [episode["last"].text for episode in episodes]
    unknown = [motor for motor, state in states.items() if state == "unknown"]
    if flight.outcome == HEALTHY or (states and not unknown):
        said = [f"No fault found in any of {len(states)} rotors."]
        seen = sentence(each for rotor in _dicts(summary.rotors) for each in _detectable(rotor))
        if seen:
            said.append(f"The smallest fault of a rotor that would have been seen: {seen}.")
        return said
    if unknown and len(unknown) < len(states):
        return [
            f"Nothing valid is known of motor {', '.join(map(str, unknown))}; no fault found in the others."
        ]
    return ["This flight could not be judged; below is what was missing."]


def _detectable(rotor: dict[str, Any]) -> list[tuple[str, str, float]]:
    """Return what would be seen of each quantity, at the end and at its worst."""
    return [
        (e["estimator"], e["quantity"], state["detectable"])
        for e in rotor["estimates"]
        for state in (e["final"], e["worst"])
    ]


def _rotor(rotor: dict[str, Any], states: dict[int, str]) -> dict[str, Any]:
    values, balance = {}, ""
    for quantity, (scale, digits) in SHOWN.items():
        for estimate in (e for e in rotor["estimates"] if e["quantity"] == quantity):
            state = estimate["final"] if _finite(estimate["final"]["value"]) else estimate["worst"]
            if _finite(state["value"]) and quantity not in values:
                spread = f" ± {state['std'] / scale:.{digits}f}" if _finite(state["std"]) else ""
                values[quantity] = f"{state['value'] / scale:.{digits}f}{spread}"
                balance = state["balance"] or balance
    final = rotor["final"]
    return {
        "motor": rotor["motor"],
        "seat": rotor["seat"],
        "state": states[rotor["motor"]],
        "values": values,
        "balance": balance,
        "detectable": sentence(_detectable(rotor)),
        "telemetry": rotor["telemetry"],
        "worst": rotor["worst"]["failure_probability"],
        "status": final["status"] + (f": {final['why']}" if final["why"] else ""),
    }


def _alert(flight: Flight, vehicle: str, episode: dict[str, Any], first: float) -> dict[str, Any]:
    from markupsafe import Markup

    begun: AlertEvent = episode["first"]
    return {
        "event": begun,
        "steps": [(clock(step.t, first), step.state, step.text) for step in episode["steps"]],
        "code": episode["last"].code,  # what it became known as
        "motor": episode["last"].motor,
        "advice": CATALOGUE[episode["last"].code].advice if episode["last"].code in CATALOGUE else "",
        "plot": Markup(plots.alert_plot(flight, vehicle, begun.motor or 0, begun.t)),
        "evidence": [(name, _shown(value)) for name, value in sorted(begun.evidence.items())],
    }


def _not_estimated(flight: Flight, vehicle: str) -> list[dict[str, Any]]:
    """Return, for each estimator and the rotors of which it never gave a valid value, its reasons and their share."""
    e = flight.estimates
    mine = e["vehicle"] == vehicle
    out = []
    for estimator, quantity in sorted(set(zip(e["estimator"][mine], e["quantity"][mine], strict=True))):
        chosen = mine & (e["estimator"] == estimator) & (e["quantity"] == quantity)
        known = set(e["motor"][chosen & (e["status"] == "valid")].tolist())
        chosen &= ~np.isin(e["motor"], list(known))
        motors = sorted(set(e["motor"][chosen].tolist()))
        if not motors:
            continue
        said = Counter(reason for row in e["reasons"][chosen] for reason in filter(None, row.split(", ")))
        why = [
            f"{REASON_TEXT[Reason(reason)]} ({100 * count / chosen.sum():.0f} % of the time)"
            for reason, count in said.most_common()
        ]
        out.append(
            {"estimator": estimator, "quantity": quantity, "motors": ", ".join(map(str, motors)), "why": why}
        )
    return out


def _needs(flight: Flight, vehicle: str) -> list[dict[str, Any]]:
    """Return what the estimators need and the log lacks, each remedy once."""
    found: dict[str, dict[str, Any]] = {}
    for survey in flight.survey.vehicles:
        if survey.vehicle != vehicle:
            continue
        for estimator, needs in survey.needs.items():
            for need in needs:
                if not need.met:
                    row = found.setdefault(
                        need.input.value, {"input": need.input.value, "remedy": need.remedy, "of": []}
                    )
                    row["of"].append(estimator.replace("_", " "))
    return list(found.values())


def _configuration(flight: Flight) -> list[tuple[str, str]]:
    config = flight.config
    return [
        ("log", flight.log),
        ("airframe", config.airframe.name if config.airframe is not None else "from the log"),
        ("estimators", ", ".join(config.estimators)),
        ("mode", config.mode),
        (
            "alert rules",
            f"{len(config.rules.changes)} changed" if config.rules.changes else "the catalogue's",
        ),
        ("estimates", f"up to {config.estimate_rate:g} a second and rotor"),
        ("outcome", {FINDINGS: "findings", HEALTHY: "healthy"}.get(flight.outcome, "not judged")),
    ]


def _versions() -> list[tuple[str, str]]:
    own = [("gcs_health", __version__), ("python", platform.python_version())]
    return own + [(name, metadata.version(name)) for name in PACKAGES]


def _shown(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.4g}" if math.isfinite(value) else "-"
    return str(value)


def _dicts(rows: Any) -> list[dict[str, Any]]:
    return list(rows)


def _finite(value: Any) -> bool:
    return isinstance(value, int | float) and math.isfinite(value)
