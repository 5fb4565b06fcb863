"""Events: what the monitor says, one frozen type each, written as JSON lines under one version.

`docs/reference/events.schema.json` describes the lines; fields are only ever added. Every line has
`type`, `t` (vehicle clock, s), `t_unix_us` (stamp of the datum that caused it) and `vehicle`
("sysid.compid"); the first line of a stream says `"schema": "gcs_health.events/1"` besides.
"""

import json
from collections.abc import Iterable, Iterator
from typing import NamedTuple

SCHEMA = "gcs_health.events/1"

Scalar = str | int | float | bool | None
Value = Scalar | tuple["Value", ...] | dict[str, "Value"]


class VehicleEvent(NamedTuple):
    """What is known of a vehicle; said when first seen and whenever it changes.

    Attributes
    ----------
    t, t_unix_us, vehicle : the common head.
    change : what changed: "seen", "identity", "airframe", "flight" (armed or disarmed), "clock", "notice".
    text : the change in one sentence.
    autopilot, vehicle_type : MAV_AUTOPILOT and MAV_TYPE; None if unheard.
    airframe : name, source, metric, rotors and warnings; None while unknown.
    armed : as the last HEARTBEAT said; None if unheard.
    uid : of the autopilot's hardware, hexadecimal, from AUTOPILOT_VERSION; None if unheard.
    """

    t: float
    t_unix_us: int
    vehicle: str
    change: str
    text: str
    autopilot: int | None = None
    vehicle_type: int | None = None
    airframe: dict[str, Value] | None = None
    armed: bool | None = None
    uid: str | None = None


class EstimateEvent(NamedTuple):
    """One estimate of one rotor; `rotor` is its 0-based ESC index, `motor` the autopilot's number.

    `balance_quality` is ISO 21940-11's G of an unbalance [mm/s]; NaN where it cannot be told.
    """

    t: float
    t_unix_us: int
    vehicle: str
    estimator: str
    rotor: int
    motor: int
    quantity: str
    value: float
    std: float
    failure_probability: float
    status: str
    reasons: tuple[str, ...]
    detectable: float
    balance_quality: float = float("nan")


class VerdictEvent(NamedTuple):
    """What is believed of one rotor; said when it changes.

    Attributes
    ----------
    kind, probability : the likeliest state and its probability; `known` = a source that sees thrust spoke lately.
    since : when that state became the likeliest [s].
    sources : who moved it, the strongest first.
    """

    t: float
    t_unix_us: int
    vehicle: str
    rotor: int
    motor: int
    kind: str
    probability: float
    known: bool
    since: float
    sources: tuple[str, ...]


class AutopilotEvent(NamedTuple):
    """The autopilot's own word on motors, and how it stands to our verdicts: agrees, alone or contradicts."""

    t: float
    t_unix_us: int
    vehicle: str
    opinion: str
    motors: tuple[int, ...]
    text: str
    relation: str


class AlertEvent(NamedTuple):
    """One step of an alert: raised, escalated, updated, acknowledged, shelved or cleared; MAV_SEVERITY.

    `rotor` and `motor` are None where it is one of the rotors and which one cannot be told.
    """

    t: float
    t_unix_us: int
    vehicle: str
    id: str
    code: str
    rotor: int | None
    motor: int | None
    state: str
    severity: int
    probability: float
    text: str
    evidence: dict[str, Value]


class ConditionEvent(NamedTuple):
    """What a flight showed of each rotor's condition, by regime; said when it ends. For maintenance, no alarm.

    Attributes
    ----------
    indicators : one object a rotor, quantity and regime, see `condition.indicators.Indicator`.
    """

    t: float
    t_unix_us: int
    vehicle: str
    indicators: tuple[Value, ...]


class SummaryEvent(NamedTuple):
    """One vehicle at the end of the input.

    Attributes
    ----------
    duration : seconds of vehicle time from first to last sample.
    rates : received rate of each message [Hz], by name.
    gaps : count, longest [s] and total [s] of the silences.
    counters : frames and bytes, kept and dropped, by reason (of the whole stream).
    rotors : one object a rotor: rotor, motor, final and worst state.
    alerts : the alerts raised: id, code, motor, t, text, state at the end.
    maintenance : what grew slowly within a flight: those indicators that say so, with the flight's end as `t`.
    """

    t: float
    t_unix_us: int
    vehicle: str
    duration: float
    rates: dict[str, Value]
    gaps: dict[str, Value]
    counters: dict[str, Value]
    notes: tuple[str, ...]
    rotors: tuple[Value, ...]
    alerts: tuple[Value, ...]
    maintenance: tuple[Value, ...] = ()


Event = (
    VehicleEvent | EstimateEvent | VerdictEvent | AutopilotEvent | AlertEvent | ConditionEvent | SummaryEvent
)

_TYPE = {
    VehicleEvent: "vehicle",
    EstimateEvent: "estimate",
    VerdictEvent: "verdict",
    AutopilotEvent: "autopilot",
    AlertEvent: "alert",
    ConditionEvent: "condition",
    SummaryEvent: "summary",
}
EVENT_TYPES = frozenset(_TYPE)
# made once: json.dumps makes a new encoder for every call that departs from its defaults
_encode = json.JSONEncoder(ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode


def to_json(event: Event, first: bool = False) -> str:
    """Return one JSON object without line end; `first` adds the schema's name.

    NaN and infinities become null: JSON has neither. Floats are written by repr, so that equal values
    give equal bytes.
    """
    line = as_object(event)
    return _encode({"schema": SCHEMA, **line} if first else line)


def as_object(event: Event) -> dict[str, object]:
    """Return an event as its JSON line has it."""
    kind = type(event)
    line: dict[str, object] = {"type": _TYPE[kind]}
    for name, value in zip(kind._fields, event, strict=True):
        kept = type(value) is str or type(value) is int or (type(value) is float and value - value == 0.0)
        line[name] = value if kept else plain(value)
    return line


def lines(events: Iterable[Event]) -> Iterator[str]:
    """Yield the JSON lines of a whole stream of events, the first with the schema's name."""
    first = True
    for event in events:
        yield to_json(event, first)
        first = False


def plain(value: object) -> object:
    """Return a value as JSON has it: tuples as lists, NaN and infinities as None."""
    if type(value) is float:
        return value if value - value == 0.0 else None
    if type(value) is dict:
        return {key: plain(item) for key, item in value.items()}
    if type(value) is tuple or type(value) is list:
        return [plain(item) for item in value]
    return plain(float(value)) if isinstance(value, float) else value  # numpy's float has another type
