"""Plots of one flight, as plotly figures in HTML without the library itself (the page has it once)."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np

from gcs_health.flight import Flight
from gcs_health.flight_columns import Columns
from gcs_health.report.spectrum import Array, folded, spectrogram

MOST = 1500  # points of a line: the least and largest of each stretch are kept
# Okabe and Ito's colours, told apart by the colour-blind; lines differ in dashes besides
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DASHES = ("solid", "dash", "dot", "dashdot")
SHADES = ("rgba(0,114,178,0.2)", "rgba(0,158,115,0.2)")
GRID = "rgba(128,128,128,0.3)"
UNITS = {  # quantity -> (title, what it is shown in, SI per shown unit)
    "effectiveness": ("Effectiveness: thrust per squared speed, 1 = healthy", "-", 1.0),
    "unbalance": ("Unbalance", "g mm", 1e-6),
    "unbalance_relative": ("Unbalance over mass", "µm", 1e-6),
    "drag": ("Drag against the healthy propeller's", "-", 1.0),
    "degradation": ("Degradation", "-", 1.0),
}


def style(motor: int) -> dict[str, Any]:
    """Return the line of a motor: the same in every plot."""
    k = motor - 1
    return {"color": COLOURS[k % len(COLOURS)], "dash": DASHES[k // len(COLOURS) % len(DASHES)], "width": 1.5}


def figure(unit: str, height: int = 300, x_title: str = "t [s]") -> Any:
    """Return an empty figure in the house style: transparent, legible on light and dark."""
    import plotly.graph_objects as go

    axis = {"gridcolor": GRID, "zerolinecolor": GRID, "automargin": True}
    return go.Figure(
        layout={
            "height": height,
            "margin": {"l": 10, "r": 10, "t": 20, "b": 10},
            "paper_bgcolor": "rgba(0,0,0,0)",
            "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"color": "#777", "size": 12},
            "legend": {"orientation": "h", "yanchor": "bottom", "y": 1.02, "x": 0},
            "xaxis": {**axis, "title": x_title},
            "yaxis": {**axis, "title": unit},
            "template": "none",
            "hovermode": "x unified",
        }
    )


def html(title: str, fig: Any) -> str:
    """Return a figure as markup, its title as a heading above it."""
    from plotly.io import to_html

    config = {"responsive": True, "displayModeBar": False}  # drag zooms, a double click shows all again
    text: str = to_html(fig, include_plotlyjs=False, full_html=False, config=config)
    return f"<h3>{escape(title)}</h3>{text}"


def thinned(t: Array, y: Array, most: int = MOST) -> tuple[Array, Array]:
    """Return at most `most` points of a line that look the same: of each stretch the least and the largest."""
    known = np.isfinite(y)
    t, y = t[known], y[known]
    if len(t) <= most:
        return t, y
    stretch = -(-len(t) // (most // 2))
    whole = len(t) // stretch * stretch
    blocks = y[:whole].reshape(-1, stretch)
    first = np.arange(len(blocks)) * stretch
    kept = np.unique(np.concatenate([first + blocks.argmin(axis=1), first + blocks.argmax(axis=1)]))
    return t[kept], y[kept]


def line(fig: Any, t: Array, y: Array, name: str, motor: int, **more: Any) -> None:
    """Add a motor's line."""
    x, y = thinned(t, y)
    fig.add_scatter(x=x.round(3), y=y.astype(np.float32), name=name, mode="lines", line=style(motor), **more)


def estimate_plots(flight: Flight, vehicle: str, marks: Sequence[tuple[float, str]]) -> list[str]:
    """Return a plot for each quantity of which anything is known."""
    out = []
    for quantity, (title, unit, scale) in UNITS.items():
        known = [s for s in series(flight, vehicle, quantity) if np.isfinite(s[2]["value"]).any()]
        for estimator in dict.fromkeys(s[1] for s in known):
            fig = figure(unit)
            for motor, _, rows in (s for s in known if s[1] == estimator):
                line(fig, rows["t"], rows["value"] / scale, f"motor {motor}", motor)
            _mark(fig, marks)
            out.append(html(f"{title} ({estimator.replace('_', ' ')})", fig))
    return out


def series(flight: Flight, vehicle: str, quantity: str) -> list[tuple[int, str, Columns]]:
    """Return (motor, estimator, rows) of one quantity."""
    e = flight.estimates
    mine = (e["vehicle"] == vehicle) & (e["quantity"] == quantity)
    keys = sorted(set(zip(e["motor"][mine].tolist(), e["estimator"][mine], strict=True)))
    found = []
    for motor, estimator in keys:
        chosen = mine & (e["motor"] == motor) & (e["estimator"] == estimator)
        found.append((motor, str(estimator), {name: column[chosen] for name, column in e.items()}))
    return found


def speed_plot(flight: Flight, vehicle: str, marks: Sequence[tuple[float, str]]) -> str:
    """Return the rotor speeds; empty if there are none."""
    rotors = flight.columns("rotors", vehicle)
    fig = figure("rad/s")
    for name, column in rotors.items():
        if name.startswith("speed_") and np.isfinite(column).any():
            motor = int(name.removeprefix("speed_"))
            line(fig, rotors["t"], column, f"motor {motor}", motor)
    _mark(fig, marks)
    return html("Rotor speeds", fig) if fig.data else ""


def spectrum_plot(flight: Flight, vehicle: str) -> str:
    """Return the spectrogram of the accelerations with the rotors' lines; empty without accelerations."""
    imu = flight.columns("imu", vehicle)
    acceleration = np.stack([imu["ax"], imu["ay"], imu["az"]], axis=1)
    found = spectrogram(imu["t"], acceleration)
    if found is None:
        return ""
    title = f"Accelerations at {found.rate:.0f} Hz, and each rotor's line (dotted where it aliases)"
    fig = figure("Hz", height=420)
    known = found.level[np.isfinite(found.level)]
    low, high = np.percentile(known, (5, 99.8)) if len(known) else (0.0, 1.0)
    fig.add_heatmap(
        x=found.t.round(2),
        y=found.frequency.round(2),
        z=np.round(found.level, 1).astype(np.float32),
        zmin=low,
        zmax=high,
        colorscale="Cividis",
        colorbar={"title": "dB", "thickness": 10, "outlinewidth": 0},
        hovertemplate="%{x:.1f} s, %{y:.1f} Hz, %{z:.0f} dB<extra></extra>",
    )
    rotors = flight.columns("rotors", vehicle)
    for name, speed in rotors.items():
        if name.startswith("speed_") and np.isfinite(speed).any():
            motor = int(name.removeprefix("speed_"))
            hertz = _at(found.t, rotors["t"], speed) / (2.0 * np.pi)
            _rotor_line(fig, found.t, hertz, found.rate, motor)
    fig.update_layout(hovermode="closest")
    fig.update_yaxes(range=[0.0, 0.5 * found.rate])
    return html(title, fig)


def _at(where: Array, t: Array, y: Array) -> Array:
    known = np.isfinite(y) & (y > 0.0)
    return np.interp(where, t[known], y[known]) if known.any() else np.full(len(where), np.nan)


def _rotor_line(fig: Any, t: Array, hertz: Array, rate: float, motor: int) -> None:
    place, direct = folded(hertz, rate), hertz <= 0.5 * rate
    named = False
    for there, dash in ((direct, "solid"), (~direct, "dot")):
        if there.any():
            fig.add_scatter(
                x=t.round(2),
                y=np.where(there, place, np.nan).round(2),
                mode="lines",
                name=f"motor {motor}",
                legendgroup=str(motor),
                showlegend=not named,
                line={"color": COLOURS[(motor - 1) % len(COLOURS)], "dash": dash, "width": 1.5},
                hoverinfo="name",
            )
            named = True


def alert_plot(flight: Flight, vehicle: str, motor: int, t: float, around: float = 15.0) -> str:
    """Return what was believed of one motor around an alert: effectiveness with two deviations, and P(failed)."""
    fig = figure("-", height=280)
    mine = [s for s in series(flight, vehicle, "effectiveness") if s[0] == motor]
    for number, (_, estimator, rows) in enumerate(mine):
        by = estimator.replace("_", " ")
        near = (np.abs(rows["t"] - t) < around) & np.isfinite(rows["value"])
        if not near.any():
            continue
        x, value, std = rows["t"][near], rows["value"][near], np.nan_to_num(rows["std"][near])
        fig.add_scatter(
            x=np.concatenate([x, x[::-1]]).round(3),
            y=np.concatenate([value + 2 * std, (value - 2 * std)[::-1]]).astype(np.float32),
            fill="toself",
            fillcolor=SHADES[number % 2],
            line={"width": 0},
            hoverinfo="skip",
            name=f"± 2 std ({by})",
        )
        line(fig, x, value, f"effectiveness ({by})", 1 + 2 * number)
        fig.add_scatter(
            x=x.round(3), y=rows["failure_probability"][near], mode="lines", name=f"P(failed) ({by})",
            line={"color": COLOURS[1 + 2 * number], "dash": "dash", "width": 1.5},
        )  # fmt: skip
    _mark(fig, [(t, "alert")])
    return html(f"Motor {motor} around {t:.1f} s", fig) if fig.data else ""


def _mark(fig: Any, marks: Sequence[tuple[float, str]]) -> None:
    for t, text in marks:
        fig.add_vline(
            x=round(t, 3), line={"color": "#D55E00", "width": 1, "dash": "dot"}, annotation_text=text
        )
