"""Unbalance as a workshop speaks of it: g mm, milligrams at the tip, and the balance quality grade G.

    e = U / m           specific unbalance [m] of what was balanced, U = m_u r_u [kg m], m its mass [kg]
    G = 1000 e omega    balance quality [mm/s] at the speed [rad/s] at which it is used

A grade is named by the largest G that it bears. The mass is the propeller's, with whatever is balanced together with
it; for the mass of the vehicle there is no grade.

Source: ISO 21940-11:2016, Mechanical vibration - Rotor balancing - Procedures and tolerances for rotors with rigid
behaviour, Table 1 (grades 2.5 apart; fans and propellers of such size are usually asked G 6.3).
"""

import math
from collections.abc import Iterable

GRADES = (0.4, 1.0, 2.5, 6.3, 16.0, 40.0, 100.0, 250.0, 630.0, 1600.0, 4000.0)  # mm/s
NAN = math.nan
# names in the evidence
G_MM, TIP_MASS, QUALITY, GRADE = "unbalance_g_mm", "tip_mass_mg", "balance_quality_mm_s", "balance_grade"
AT_RPM, LACKS = "balance_at_rpm", "balance_grade_lacks"
Figures = tuple[tuple[str, float | str], ...]


def figures(
    unbalance: float, radius: float | None = None, mass: float | None = None, speed: float = NAN
) -> Figures:
    """Return what is known of the balance of one propeller, by name, as an estimate's evidence carries it.

    Parameters
    ----------
    unbalance : m_u r_u [kg m].
    radius : of the propeller [m]. mass : of what is balanced [kg]. speed : usual [rad/s]. None, NaN = not known.
    """
    said: Figures = ((G_MM, unbalance * 1e6),)
    if radius:
        said += ((TIP_MASS, unbalance / radius * 1e6),)
    if mass and speed == speed:
        quality = 1e3 * unbalance / mass * speed
        return (*said, (QUALITY, quality), (GRADE, grade(quality)), (AT_RPM, speed * 30.0 / math.pi))
    needed = (("the propeller's mass", bool(mass)), ("a usual speed", speed == speed))
    return (*said, (LACKS, " and ".join(what for what, known in needed if not known)))


def words(evidence: Iterable[tuple[str, float | str]]) -> str:
    """Return in one line what evidence says of the balance; empty if nothing.

    Examples
    --------
    >>> words(figures(4e-5, radius=0.25, mass=0.02, speed=545.0))
    '40 g mm (160 mg at the tip), G 1600 at 5204 rpm'
    >>> words(figures(4e-5))
    "40 g mm, no grade without the propeller's mass and a usual speed"
    """
    known = dict(evidence)
    said = amount(evidence)
    if TIP_MASS in known:
        said += f" ({_plain(known[TIP_MASS])} mg at the tip)"
    if not said:
        return ""
    if GRADE in known:
        return f"{said}, {known[GRADE]} at {known[AT_RPM]:.0f} rpm"
    return f"{said}, no grade without {known[LACKS]}"


def amount(evidence: Iterable[tuple[str, float | str]], source: str = "") -> str:
    """Return the residual unbalance in words, "12.3 g mm"; empty if not known. `source` is before the names."""
    size = dict(evidence).get(source + G_MM)
    return f"{_plain(size)} g mm" if isinstance(size, float) else ""


def grade(quality: float) -> str:
    """Return the ISO 21940-11 grade that holds a balance quality [mm/s]: "G 6.3"."""
    limit = next((each for each in GRADES if quality <= each), None)
    return f"G {limit:g}" if limit is not None else f"beyond G {GRADES[-1]:g}"


def _plain(value: float | str) -> str:
    return f"{float(value):.3g}" if float(value) < 99.5 else f"{float(value):.0f}"
