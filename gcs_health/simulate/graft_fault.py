"""A fault to be put into a recorded flight, as the user writes it: "rotor=3 effectiveness=0.6 at=120".

| key | what it does | honest because |
|---|---|---|
| effectiveness=.3 .. 1 | thrust lost, and the controller's answer to it | small losses act linearly |
| unbalance=g mm | a force turning with the rotor | it adds to what was there |
| drag=factor | current raised | the same speed costs more torque |
| telemetry=lost, frozen | that ESC's telemetry ends, or repeats | exact |
| telemetry=swapped with=M | two ESCs exchanged | exact |

`at`, `until` in seconds after the flight's first datum; `ramp` in seconds; `loop` is the time of the rate loop
that answers a loss. A larger loss changes the whole flight: attitude, path, every later command. It is refused.
"""

import difflib
import math
from dataclasses import dataclass
from typing import NoReturn

from gcs_health.errors import ConfigError

LEAST_EFFECTIVENESS = 0.3
RATE_LOOP = 0.12  # s, that of the simulator's controller
LOOPS = (0.03, 0.5)  # s
EFFECTS = ("effectiveness", "unbalance", "drag", "telemetry")
TELEMETRY = ("lost", "frozen", "swapped")
KEYS = ("rotor", *EFFECTS, "with", "at", "until", "ramp", "loop")


@dataclass(frozen=True, slots=True)
class GraftFault:
    """One fault; `motor` and `other` are numbers as the autopilot counts them, from 1.

    effect : of `EFFECTS`. size : what is left [-], unbalance [kg m] or factor on current [-]; NaN for
    telemetry, whose `how` is of `TELEMETRY`. at, until : [s] after the flight's first datum. ramp : [s] over
    which it grows. loop : [s] time of the rate loop.
    """

    motor: int
    effect: str
    at: float
    size: float = math.nan
    how: str = ""
    other: int = 0
    ramp: float = 0.0
    until: float = math.inf
    loop: float = RATE_LOOP

    def grown(self, since: float) -> float:
        """Return the share of the fault that is there `since` seconds after it began, 0 .. 1."""
        if not 0.0 <= since < self.until - self.at:
            return 0.0
        return min(since / self.ramp, 1.0) if self.ramp else 1.0


def parse_fault(text: str) -> GraftFault:
    """Read a fault.

    Raises
    ------
    ConfigError : one line that names the key and says what would be right.
    """
    values = _split(text)
    for needed in ("rotor", "at"):
        if needed not in values:
            _fail(text, needed, "is missing")
    chosen = [effect for effect in EFFECTS if effect in values]
    if len(chosen) != 1:
        _fail(text, "effect", f"expected one of {', '.join(EFFECTS)}, got {', '.join(chosen) or 'none'}")
    effect = chosen[0]
    motor = _whole(text, "rotor", values["rotor"])
    at = _number(text, "at", values["at"], 0.0)
    ramp = _number(text, "ramp", values.get("ramp", "0"), 0.0)
    until = _until(text, values, at)
    loop = _loop(text, values, effect)
    if effect == "telemetry":
        return _telemetry(text, values, motor, at, until)
    if "with" in values:
        _fail(text, "with", "only telemetry=swapped has another motor")
    size = _number(text, effect, values[effect], 0.0)
    if effect == "effectiveness" and not LEAST_EFFECTIVENESS <= size <= 1.0:
        why = "a loss that large changes the whole flight: gcs-health simulate can fly it"
        _fail(text, effect, f"expected what is left, from {LEAST_EFFECTIVENESS:g} to 1, got {size:g}; {why}")
    if effect == "drag" and not 1.0 <= size <= 10.0:
        _fail(text, effect, f"expected a factor on the current from 1 to 10, got {size:g}")
    size = size * 1e-6 if effect == "unbalance" else size
    return GraftFault(motor, effect, at, size, ramp=ramp, until=until, loop=loop)


def _split(text: str) -> dict[str, str]:
    values: dict[str, str] = {}
    for part in text.split():
        key, equals, value = part.partition("=")
        if not equals or not value:
            _fail(text, part, 'expected key=value, as in "rotor=3 effectiveness=0.6 at=120"')
        if key not in KEYS:
            near = difflib.get_close_matches(key, KEYS, 1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(KEYS)}"
            _fail(text, key, f"unknown key; {hint}")
        if key in values:
            _fail(text, key, "given twice")
        values[key] = value
    return values


def _telemetry(text: str, values: dict[str, str], motor: int, at: float, until: float) -> GraftFault:
    how = values["telemetry"]
    if how not in TELEMETRY:
        _fail(text, "telemetry", f"expected one of {', '.join(TELEMETRY)}, got {how}")
    if "ramp" in values:
        _fail(text, "ramp", "telemetry is there or it is not")
    other = 0
    if how == "swapped":
        if "with" not in values:
            _fail(text, "with", "is missing: swapped with which motor?")
        other = _whole(text, "with", values["with"])
        if other == motor:
            _fail(text, "with", f"motor {motor} cannot be swapped with itself")
    elif "with" in values:
        _fail(text, "with", "only telemetry=swapped has another motor")
    return GraftFault(motor, "telemetry", at, how=how, other=other, until=until)


def _until(text: str, values: dict[str, str], at: float) -> float:
    if "until" not in values:
        return math.inf
    until = _number(text, "until", values["until"], 0.0)
    if until <= at:
        _fail(text, "until", f"expected a time after at={at:g}, got {until:g}")
    return until


def _loop(text: str, values: dict[str, str], effect: str) -> float:
    if "loop" not in values:
        return RATE_LOOP
    if effect != "effectiveness":
        _fail(text, "loop", "only a loss of effectiveness is answered by the rate loop")
    loop = _number(text, "loop", values["loop"], 0.0)
    if not LOOPS[0] <= loop <= LOOPS[1]:
        _fail(
            text, "loop", f"expected the rate loop's time from {LOOPS[0]:g} to {LOOPS[1]:g} s, got {loop:g}"
        )
    return loop


def _number(text: str, key: str, value: str, least: float) -> float:
    try:
        number = float(value)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number >= least):
        _fail(text, key, f"expected a number from {least:g} on, got {value}")
    return number


def _whole(text: str, key: str, value: str) -> int:
    if not value.isdigit() or int(value) < 1:
        _fail(text, key, f"expected a motor number from 1 on, as the autopilot counts, got {value}")
    return int(value)


def _fail(text: str, key: str, what: str) -> NoReturn:
    raise ConfigError(f'--fault "{text}": {key}: {what}')
