"""A fleet as a page: which aircraft to open, which rotors lead where, what could not be judged."""

from collections import Counter, defaultdict
from datetime import UTC, datetime
from typing import Any

import numpy as np

from gcs_health import __version__
from gcs_health.fleet import OUTCOMES, UNUSABLE
from gcs_health.fleet_statistics import (
    RATE,
    Finding,
    Value,
    growing,
    odd_flights,
    odd_rotors,
    odd_seats,
    values_of,
)
from gcs_health.fleet_store import FleetStore
from gcs_health.flight import NOT_JUDGED
from gcs_health.report import plots
from gcs_health.report.page import render

MOST = 100  # rows of a table; the tables on disk have all
SCALES = {quantity: (unit, scale) for quantity, (_, unit, scale) in plots.UNITS.items()}


def fleet_page(store: FleetStore) -> str:
    """Return the page of a fleet.

    Raises
    ------
    ConfigError : jinja2 or plotly is not installed.
    """
    from markupsafe import Markup

    flights = _rows(store.read("flights"))
    alerts = [e for e in _rows(store.read("events")) if e["type"] == "alert" and e["state"] == "raised"]
    values = values_of(store.read("rotors"))
    logs = {row["log"]: row for row in flights}
    aircraft = sorted({row["aircraft"] for row in flights if row["aircraft"]})
    of_log = {row["log"]: row["aircraft"] for row in flights}
    by_alert = Counter((of_log.get(a["log"]) or a["vehicle"], a["motor"], a["kind"]) for a in alerts)
    unjudged = [row for row in logs.values() if row["outcome"] in (UNUSABLE, NOT_JUDGED)]
    return render(
        "fleet.html",
        {
            "title": f"Fleet of {len(aircraft)} aircraft",
            "counts": [(o, sum(row["outcome"] == o for row in logs.values())) for o in OUTCOMES],
            "flights": len({(row["aircraft"], row["flight"]) for row in flights if row["flight"]}),
            "hours": sum(row["duration"] or 0.0 for row in flights) / 3600.0,
            "alerts": [(*key, count) for key, count in by_alert.most_common(MOST)],
            "rate": RATE,
            "rotors": [_told(f) for f in odd_rotors(values)[:MOST]],
            "seats": [_told(f) for f in odd_seats(values)[:MOST]],
            "odd_flights": [_told(f) for f in odd_flights(values)[:MOST]],
            "growing": [
                {
                    "growth": g,
                    "now": _scaled(g.quantity, g.trend.now),
                    "slope": f"{_scaled(g.quantity, g.trend.slope)} [{_scaled(g.quantity, g.trend.low)}, "
                    f"{_scaled(g.quantity, g.trend.high)}] a day",
                    "due": _date(g.trend.due_us),
                    "between": f"{_date(g.trend.earliest_us)} to {_date(g.trend.latest_us)}",
                }
                for g in growing(values)[:MOST]
            ],
            "plots": [Markup(plot) for plot in _plots(values)],
            "unjudged": [(row["log"], row["outcome"], row["error"] or row["why"]) for row in unjudged[:MOST]],
            "unjudged_more": max(len(unjudged) - MOST, 0),
            "versions": sorted({(row["version"], row["config"]) for row in flights if row["version"]}),
            "written_by": __version__,
        },
    )


def _rows(columns: dict[str, list[Any]]) -> list[dict[str, Any]]:
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _told(f: Finding) -> dict[str, Any]:
    return {
        "finding": f,
        "difference": _scaled(f.quantity, f.difference),
        "interval": f"[{_scaled(f.quantity, f.low)}, {_scaled(f.quantity, f.high)}]",
    }


def _scaled(quantity: str, value: float) -> str:
    unit, scale = SCALES.get(quantity, ("-", 1.0))
    return f"{value / scale:.3g}" + ("" if unit == "-" else f" {unit}")


def _date(us: int | None) -> str:
    return (
        datetime.fromtimestamp(us * 1e-6, UTC).strftime("%Y-%m-%d")
        if us is not None
        else "never at that rate"
    )


def _plots(values: list[Value]) -> list[str]:
    """Return, for each quantity, every rotor's mean over its flights with the spread between them."""
    out = []
    of: dict[tuple[str, str], list[Value]] = defaultdict(list)
    for value in values:
        of[value.quantity, value.estimator].append(value)
    for (quantity, estimator), rows in sorted(of.items()):
        unit, scale = SCALES.get(quantity, ("-", 1.0))
        fig = plots.figure(unit, x_title="aircraft")
        names = sorted({row.aircraft for row in rows})
        for motor in sorted({row.motor for row in rows}):
            own = {
                name: [r.value / scale for r in rows if r.motor == motor and r.aircraft == name]
                for name in names
            }
            there = [name for name in names if own[name]]
            fig.add_scatter(
                x=there,
                y=[float(np.mean(own[name])) for name in there],
                error_y={"array": [float(np.std(own[name])) for name in there], "thickness": 1},
                mode="markers",
                name=f"motor {motor}",
                marker={"color": plots.COLOURS[(motor - 1) % len(plots.COLOURS)], "symbol": (motor - 1) % 20},
            )
        fig.update_xaxes(type="category")
        fig.update_layout(hovermode="closest")
        title = plots.UNITS.get(quantity, (quantity, "", 1.0))[0]
        out.append(plots.html(f"{title} ({estimator.replace('_', ' ')})", fig))
    return out
