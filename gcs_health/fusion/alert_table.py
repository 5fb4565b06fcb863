"""The catalogue of alerts: every fact about a code stands here and nowhere else.

Codes are public and stable. Severities are MAV_SEVERITY numbers (0 emergency ... 7 debug). A text has at most 80
columns with the longest seat; `{percent}` is how sure the verdict is, `{amount}` how large the fault, if known.
"""

from dataclasses import dataclass

from gcs_health.fusion.kinds import Kind


@dataclass(frozen=True, slots=True)
class AlertKind:
    """One row of the catalogue.

    Attributes
    ----------
    code : public name.
    severity : MAV_SEVERITY number.
    text : one line of at most 80 columns; `{motor}`, `{seat}`, `{percent}` and `{amount}` are filled in.
    unnamed : likewise where it is one of the rotors, but which one cannot be told; empty = then nothing is told.
    advice : what to do.
    raise_at, clear_at : probability at which it is raised, and below which it may clear.
    clear_after : for how long [s, vehicle clock] it must stay below.
    hold : for how long [s] the probability must have been above `raise_at`.
    proven : the rotor's own current or speed shows it, not only how the vehicle turns.
    latched : stays for the flight: what broke in the air does not mend there.
    enabled : whether it is told at all.
    """

    code: str
    severity: int
    text: str
    advice: str
    raise_at: float = 0.9
    clear_at: float = 0.1
    clear_after: float = 2.0
    hold: float = 0.0
    latched: bool = False
    enabled: bool = True
    unnamed: str = ""
    proven: bool = False


_LAND = "Land at once if control allows; do not take off again before the rotor is inspected."
_INSPECT = "Land soon and inspect the propeller, its hub and the motor's bearing."
_SERVICE = "Finish the flight calmly; before the next one, "

# 0.9 is the paper's P_thr (Strack van Schijndel 2023, Table II), as is clearing on P(healthy) > 0.9
# (its authors' released rules); the hold of 2 s keeps a tumbling vehicle from clearing its own alarm.
ROTOR_FAILED = AlertKind("ROTOR_FAILED", 1, "motor {motor} ({seat}): rotor failed, {percent} % sure", _LAND)

OF_KIND: dict[Kind, AlertKind] = {
    Kind.PROPELLER_LOST: AlertKind(
        "PROPELLER_LOST", 1, "motor {motor} ({seat}): propeller lost, {percent} % sure", _LAND, proven=True
    ),
    Kind.MOTOR_STOPPED: AlertKind(
        "MOTOR_STOPPED", 1, "motor {motor} ({seat}): motor stopped, {percent} % sure", _LAND, proven=True
    ),
    Kind.MOTOR_STUCK: AlertKind(
        "MOTOR_STUCK",
        1,
        "motor {motor} ({seat}): motor blocked under current, {percent} % sure",
        _LAND,
        proven=True,
    ),
    Kind.THRUST_LOSS: AlertKind(
        "THRUST_LOSS", 2, "motor {motor} ({seat}): thrust partly lost, {percent} % sure", _INSPECT
    ),
    Kind.PROPELLER_SLIPPING: AlertKind(
        "PROPELLER_SLIPPING",
        2,
        "motor {motor} ({seat}): turns, but gives little thrust, {percent} % sure",
        _INSPECT,
    ),
    Kind.PROPELLER_UNBALANCED: AlertKind(
        "PROPELLER_UNBALANCED",
        4,
        "motor {motor} ({seat}): propeller unbalanced{amount}, {percent} % sure",
        _SERVICE + "balance or change the propeller.",
        clear_after=60.0,  # it does not heal in the air: what hides it for a while is the flight
        unnamed="a propeller is unbalanced, which one cannot be told, {percent} % sure",
    ),
    Kind.DRAG_RISEN: AlertKind(
        "DRAG_RISEN",
        4,
        "motor {motor} ({seat}): turns harder than it did, {percent} % sure",
        _SERVICE + "check the bearing and whether anything rubs.",
        clear_after=10.0,
    ),
    Kind.ESC_TELEMETRY_LOST: AlertKind(
        "ESC_TELEMETRY_LOST",
        4,
        "motor {motor} ({seat}): no ESC telemetry: rotor not watched",
        "The rotor may be well, but nothing would tell if not. Check the ESC's telemetry wire and settings.",
        hold=1.0,
    ),
    Kind.ESC_FAULT_REPORTED: AlertKind(
        "ESC_FAULT_REPORTED",
        2,
        "motor {motor} ({seat}): its ESC reports a fault",
        "Land soon; read the ESC's own log before the next flight.",
        clear_after=5.0,
    ),
    Kind.ESC_OVERHEATING: AlertKind(
        "ESC_OVERHEATING",
        3,
        "motor {motor} ({seat}): its ESC or motor overheats",
        "Reduce the load and land soon; check cooling, propeller size and bearing.",
        clear_after=5.0,
    ),
    Kind.ESC_MISATTRIBUTED: AlertKind(
        "ESC_MISATTRIBUTED",
        4,
        "motor {motor} ({seat}): its telemetry is another motor's, {percent} % sure",
        "Do not trust verdicts on single motors; check which ESC telemetry is wired to which motor.",
        clear_after=10.0,
        hold=4.0,  # longer than one jolt stays in the correlations
    ),
    Kind.MOTOR_ORDER_WRONG: AlertKind(
        "MOTOR_ORDER_WRONG",
        2,
        "motor {motor} ({seat}): answers where another motor should sit",
        "Land; check the order of the motors and the geometry before the next flight.",
        clear_after=10.0,
        hold=1.0,
    ),
}

CATALOGUE = {kind.code: kind for kind in (ROTOR_FAILED, *OF_KIND.values())}
