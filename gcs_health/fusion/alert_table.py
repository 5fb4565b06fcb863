"""The catalogue of alerts: every fact about a code stands here and nowhere else.

Codes are public and stable. Severities are MAV_SEVERITY numbers (0 emergency ... 7 debug).
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AlertKind:
    """One row of the catalogue.

    Attributes
    ----------
    code : public name.
    severity : MAV_SEVERITY number.
    text : one line of at most 80 columns; `{motor}`, `{seat}` and `{percent}` are filled in.
    advice : what to do.
    raise_at, clear_at : failure probability at which it is raised, and below which it may clear.
    clear_after : for how long [s, vehicle clock] it must stay below.
    """

    code: str
    severity: int
    text: str
    advice: str
    raise_at: float
    clear_at: float
    clear_after: float


# 0.9 is the paper's P_thr (Strack van Schijndel 2023, Table II), as is clearing on P(healthy) > 0.9
# (its authors' released rules); the hold of 2 s keeps a tumbling vehicle from clearing its own alarm.
ROTOR_FAILED = AlertKind(
    code="ROTOR_FAILED",
    severity=1,
    text="motor {motor} ({seat}): {what}, {percent} % sure",
    advice="Land at once if control allows; do not take off again before the rotor is inspected.",
    raise_at=0.9,
    clear_at=0.1,
    clear_after=2.0,
)

CATALOGUE = {kind.code: kind for kind in (ROTOR_FAILED,)}
