"""All that is known of one rotor."""

import math

from gcs_health.dashboard.snapshot import Level, VehicleShot
from gcs_health.dashboard.view.lines import BLANK, Line, fill, fit, line, title, wrap
from gcs_health.dashboard.view.trace import quarters
from gcs_health.dashboard.words import clock, percent
from gcs_health.fusion.detectable import sentence


def rotor_page(vehicle: VehicleShot, motor: int, cells: int, rows: int) -> list[Line]:
    """Return all that is known of one rotor."""
    rotor = next(
        (r for r in vehicle.rotors if r.motor == motor), vehicle.rotors[0] if vehicle.rotors else None
    )
    if rotor is None:
        return fill([title("rotor", cells), line(("   the airframe is not known yet", "dim"))], rows)
    style = {Level.FAILED: "fail", Level.WARN: "warn", Level.UNKNOWN: "unknown"}.get(rotor.level, "ok")
    lines = [title(f"motor {rotor.motor}   {rotor.seat}", cells)]
    sources = f"  by {', '.join(rotor.sources)}" if rotor.sources else ""
    lines.append(
        line((f"{rotor.state} {percent(rotor.probability)}", style), f"  since {clock(rotor.since)}{sources}")
    )
    if rotor.why:
        lines += wrap(f"why: {rotor.why}", cells, "dim", 5)
    others = sorted(rotor.posterior, key=lambda each: -each[1])[:5]
    lines.append(fit(line(("   ".join(f"{kind} {p:.3f}" for kind, p in others), "dim")), cells))
    lines += [BLANK, _telemetry(rotor.telemetry, rotor.age, rotor.voltage, rotor.temperature_degc)]
    head = f"{'estimator':<15}{'quantity':<18}{'value':>8}{'spread':>8}{'P(fault)':>9}{'seen at':>9}  state"
    lines += [BLANK, fit(line((head, "dim")), cells)]
    for figure in rotor.figures:
        unit = 1e6 if figure.quantity.startswith("unbalance") else 1.0
        cell = [f"{v * unit:.2f}" if v == v else "–" for v in (figure.value, figure.std)]
        detectable = f"{figure.detectable * unit:.2f}" if figure.detectable == figure.detectable else "–"
        p = (
            f"{figure.failure_probability:.3f}"
            if figure.failure_probability == figure.failure_probability
            else "–"
        )
        name = figure.quantity.replace("unbalance_relative", "unbalance, µm").replace("_", " ")
        name = "unbalance, g mm" if figure.quantity == "unbalance" else name
        text = (
            f"{figure.estimator:<15}{name:<18}{cell[0]:>8}{cell[1]:>8}{p:>9}{detectable:>9}  {figure.status}"
        )
        lines.append(fit(line(text), cells))
        if figure.balance:
            lines += wrap(figure.balance, cells, "dim", 0, 4)
        if figure.why:
            lines += wrap(figure.why, cells, "dim", 0, 4)
    seen = sentence((each.estimator, each.quantity, each.detectable) for each in rotor.figures)
    if seen and rotor.level is not Level.FAILED:
        lines.append(fit(line((f"smallest fault seen now: {seen}", "dim")), cells))
    lines += [fit(line((f"all rotors: {said}", "dim")), cells) for said in vehicle.absorbed]
    room = rows - len(lines)
    if room >= 7 and vehicle.rows:
        concerned = vehicle.rotors.index(rotor)
        ends = (vehicle.rows[-1].t - 60.0, vehicle.rows[-1].t)
        lines += [BLANK, *quarters(vehicle.rows, concerned, cells, room - 1, ends, math.nan)]
    return fill(lines, rows)


def _telemetry(state: str, age: float, volts: float, degc: float) -> Line:
    old = f", {age:.1f} s old" if age < 1e6 else ""
    more = "".join(f"   {v:.1f} {unit}" for v, unit in ((volts, "V"), (degc, "°C")) if v == v)
    return line(f"telemetry {state}{old}{more}")
