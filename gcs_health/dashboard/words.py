"""The words and numbers of the screen: vehicle time, modes, names, figures in fixed widths."""

import math

UNIX = 1e9  # s; vehicle times above are UNIX time
SEVERITY = ("EMERGENCY", "ALERT", "CRITICAL", "ERROR", "WARNING", "notice", "info", "debug")
AUTOPILOT = {3: "ArduPilot", 12: "PX4"}
RPM = 30.0 / math.pi

# what the table says of a rotor's state, at most eleven columns
SHORT = {
    "healthy": "ok",
    "unknown": "unknown",
    "propeller lost": "LOST",
    "thrust partly lost": "PART LOST",
    "motor stopped": "STOPPED",
    "motor stuck": "STUCK",
    "propeller slipping": "SLIPPING",
    "rotor failed": "FAILED",
    "propeller unbalanced": "unbalanced",
    "drag risen": "drag risen",
    "ESC telemetry lost or frozen": "ESC silent",
    "ESC reports a fault": "ESC fault",
    "ESC overheating": "ESC hot",
    "telemetry of another motor": "wrong ESC",
    "motors in the wrong order": "wrong order",
}

# PX4 px4_custom_mode.h: main mode, then AUTO's sub modes; ArduPilot ArduCopter/mode.h
_PX4 = ("", "MANUAL", "ALTCTL", "POSCTL", "AUTO", "ACRO", "OFFBOARD", "STABILIZED", "RATTITUDE", "SIMPLE")
_PX4_AUTO = ("", "READY", "TAKEOFF", "LOITER", "MISSION", "RTL", "LAND", "", "FOLLOW", "PRECLAND")
_COPTER = {
    **dict(enumerate(("STABILIZE", "ACRO", "ALT_HOLD", "AUTO", "GUIDED", "LOITER", "RTL", "CIRCLE"))),
    **dict(enumerate(("LAND", "", "DRIFT", "", "SPORT", "FLIP", "AUTOTUNE", "POSHOLD", "BRAKE"), 9)),
    **dict(enumerate(("THROW", "AVOID_ADSB", "GUIDED_NOGPS", "SMART_RTL", "FLOWHOLD", "FOLLOW"), 18)),
    **dict(enumerate(("ZIGZAG", "SYSTEMID", "AUTOROTATE", "AUTO_RTL", "TURTLE"), 24)),
}


def mode_name(autopilot: int | None, custom_mode: int | None) -> str:
    """Return HEARTBEAT's custom_mode in the autopilot's own word; its number where that is not known."""
    if custom_mode is None:
        return ""
    if autopilot == 12:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        if main == 4 and 0 < sub < len(_PX4_AUTO) and _PX4_AUTO[sub]:
            return _PX4_AUTO[sub]
        if 0 < main < len(_PX4):
            return _PX4[main]
        return ""
    if autopilot == 3 and _COPTER.get(custom_mode):
        return _COPTER[custom_mode]
    return f"mode {custom_mode}"


def clock(t: float, digits: int = 1) -> str:
    """Render a vehicle time as mm:ss.s since boot, or hh:mm:ss.s UTC for UNIX time."""
    if not math.isfinite(t):
        return "--:--"
    ticks = round((t % 86400.0 if t > UNIX else t) * 10**digits)
    whole, rest = divmod(ticks, 10**digits)
    fraction = f".{rest:0{digits}d}" if digits else ""
    if t > UNIX:
        return f"{whole // 3600:02d}:{whole // 60 % 60:02d}:{whole % 60:02d}{fraction}"
    return f"{whole // 60:02d}:{whole % 60:02d}{fraction}"


def span(seconds: float) -> str:
    """Render a length of time as m:ss."""
    whole = max(int(seconds), 0) if math.isfinite(seconds) else 0
    return f"{whole // 60:02d}:{whole % 60:02d}"


def ratio(value: float, std: float) -> str:
    """Render a value near 1 and its spread in 8 columns: "1.02±.03"; a dash where there is none."""
    if value != value:
        return "–"
    shown = f"{value:.2f}"
    shown = shown[1:] if shown.startswith("0.") else shown
    if std != std:
        return shown
    return f"{shown}±{min(std, 0.99):.2f}".replace("±0.", "±.")


def percent(p: float) -> str:
    """Render a probability: never 100, which nobody can be."""
    return "–" if p != p else f"{min(99, math.floor(100.0 * p))} %"


def size(count: float) -> str:
    """Render a number of bytes."""
    for unit in ("B", "kB", "MB"):
        if count < 1000.0:
            return f"{count:.0f} {unit}"
        count /= 1000.0
    return f"{count:.1f} GB"


def number(value: float, digits: int = 0) -> str:
    """Render a number, or a dash."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "–"
