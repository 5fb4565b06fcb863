"""The airframe as an SVG from above, each rotor with its number, its turn and its state in colour, sign and word."""

from collections.abc import Mapping
from html import escape
from typing import Any

SIZE = 260.0
SIGN = {"fault": "✕", "healthy": "✓", "unknown": "?"}


def airframe_svg(airframe: Mapping[str, Any], states: Mapping[int, str]) -> str:
    """Return the drawing; `states` of each motor: fault, healthy or unknown (also the CSS class)."""
    rotors = airframe["rotors"]
    reach = max((max(abs(r["position"][0]), abs(r["position"][1])) for r in rotors), default=1.0) or 1.0
    scale = 0.33 * SIZE / reach
    radius = min(34.0, 110.0 / len(rotors) ** 0.5)
    middle = SIZE / 2
    lines, discs = [], []
    taken: dict[tuple[int, int], int] = {}
    for rotor in rotors:
        x, y = middle + rotor["position"][1] * scale, middle - rotor["position"][0] * scale
        place = (round(x), round(y))  # the lower of a coaxial pair is drawn beside the upper
        taken[place] = taken.get(place, 0) + 1
        x += (taken[place] - 1) * radius * 0.8
        y += (taken[place] - 1) * radius * 0.8
        state = states.get(rotor["motor"], "unknown")
        turn = {"ccw": "↺", "cw": "↻"}.get(rotor["spin"], "")
        lines.append(f'<line x1="{middle}" y1="{middle}" x2="{x:.0f}" y2="{y:.0f}"/>')
        discs.append(
            f'<g class="{state}"><title>motor {rotor["motor"]}, {escape(rotor["seat"])}: {state}</title>'
            f'<circle cx="{x:.0f}" cy="{y:.0f}" r="{radius:.0f}"/>'
            f'<text x="{x:.0f}" y="{y:.0f}">{rotor["motor"]}{turn}</text>'
            f'<text x="{x:.0f}" y="{y + 0.55 * radius:.0f}" class="sign">{SIGN[state]} {state}</text></g>'
        )
    arrow = f'<path class="nose" d="M{middle} {middle - 16} l9 20 h-18 z"/>'
    label = f"airframe {escape(str(airframe['name']))} from above, nose up"
    body = "".join(lines + discs)
    return f'<svg viewBox="0 0 {SIZE:.0f} {SIZE:.0f}" role="img" aria-label="{label}">{body}{arrow}</svg>'
