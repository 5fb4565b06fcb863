"""The autopilot's own words on its motors: STATUSTEXT and EVENT of several generations to one second opinion.

A text may come in chunks (same `id`, rising `chunk_seq`), with a trailing tab, or behind a pre-arm prefix. EVENT
carries the 24-bit FNV-1a hash of the check's name, and for health checks its arguments behind a mode mask (u32) and
a component index (u8).

Sources: mavlink.md section 8 (escCheck.cpp, crash_check.cpp); PX4 platforms/common/include/px4_platform_common/
events.h (ids) and src/modules/commander/HealthAndArmingChecks/Common.hpp (arguments).
"""

import re
from dataclasses import dataclass
from enum import StrEnum

from gcs_health.samples import Other, Sample, StatusText

CHUNK = 50  # characters; a shorter chunk is a text's last
PREFIX = re.compile(r"^(?:Preflight Fail: |PreArm: |Arm: )")
AUTOPILOT_EVENT = 1 << 24
ARGUMENTS_AT = 5  # bytes of mode mask and component index before a health check's own arguments


class Opinion(StrEnum):
    """What the autopilot says of a motor."""

    THRUST_LOSS = "thrust loss"
    MOTOR_FAILURE = "motor failure"
    MOTOR_STALL = "motor stalled"
    UNDERCURRENT = "motor undercurrent"
    OVERCURRENT = "motor overcurrent"
    OVERHEATING = "overheating"
    ESC_FAILURE = "ESC failure"
    ESC_OFFLINE = "ESC offline"
    UNBALANCE = "propeller unbalanced"
    YAW_IMBALANCE = "yaw imbalance"
    CRASH = "crash"


@dataclass(frozen=True, slots=True)
class AutopilotWord:
    """One statement.

    Attributes
    ----------
    opinion : what it says.
    motors : numbers as the autopilot counts them, from 1; empty where it names none.
    text : its own words.
    before_arming : said in a check before flight.
    """

    opinion: Opinion
    motors: tuple[int, ...]
    text: str
    before_arming: bool = False


# PX4's `ESCn: reason. Advice`, by its reason
_ESC_REASONS = (
    ("motor stall", Opinion.MOTOR_STALL),
    ("temperature", Opinion.OVERHEATING),
    ("over current", Opinion.OVERCURRENT),
    ("", Opinion.ESC_FAILURE),  # over voltage, over RPM, control failure, hardware failure
)
_SENTENCES: tuple[tuple[re.Pattern[str], Opinion], ...] = tuple(
    (re.compile(pattern, re.IGNORECASE), opinion)
    for pattern, opinion in (
        (r"^Potential Thrust Loss \((?P<motor>\d+)\)", Opinion.THRUST_LOSS),
        (r"^Yaw Imbalance \d+%", Opinion.YAW_IMBALANCE),
        (r"^Crash: Disarming", Opinion.CRASH),
        (r"^(?:ESC ?\d+ )+offline", Opinion.ESC_OFFLINE),
        (r"^Motor failure: Motor (?P<motor>\d+) undercurrent", Opinion.UNDERCURRENT),
        (r"^Motor failure: Motor (?P<motor>\d+) overcurrent", Opinion.OVERCURRENT),
        (r"^Motor (?:(?P<motor>\d+) )?failure detected", Opinion.MOTOR_FAILURE),
        (r"^ESC failure", Opinion.ESC_FAILURE),
        (r"^ESC telemetry missing", Opinion.ESC_OFFLINE),
        (r"^Imbalanced propeller detected", Opinion.UNBALANCE),
    )
)
_ESC_TEXT = re.compile(r"^ESC ?(?P<motor>\d+): (?P<reason>.+)", re.IGNORECASE)
_ESC_NUMBERS = re.compile(r"ESC ?(\d+)")

# PX4's health checks by the name that their EVENT id is the hash of
EVENT_NAMES = {
    "check_escs_offline": Opinion.ESC_OFFLINE,
    "check_failure_detector_arm_esc": Opinion.ESC_FAILURE,
    "check_failure_detector_motor": Opinion.MOTOR_FAILURE,
    "check_failure_detector_imbalanced_prop": Opinion.UNBALANCE,
}
_WITH_MOTOR = frozenset({"check_escs_offline"})  # their own first argument is a motor's number


def event_id(name: str) -> int:
    """Return the EVENT id of a check's name: 24 bits of FNV-1a, and the autopilot's component."""
    value = 0x811C9DC5
    for byte in name.encode("ascii"):
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return AUTOPILOT_EVENT | value & 0xFFFFFF


_BY_ID = {event_id(name): name for name in EVENT_NAMES}


def understood(text: str) -> AutopilotWord | None:
    """Return what a whole text says of motors; None if nothing."""
    said = text.strip()
    bare = PREFIX.sub("", said)
    before_arming = bare != said
    esc = _ESC_TEXT.match(bare)
    if esc is not None:
        reason = esc["reason"].lower()
        opinion = next(opinion for words, opinion in _ESC_REASONS if words in reason)
        return AutopilotWord(opinion, (int(esc["motor"]),), said, before_arming)
    for pattern, opinion in _SENTENCES:
        match = pattern.match(bare)
        if match is None:
            continue
        motor = match.groupdict().get("motor")
        if opinion is Opinion.ESC_OFFLINE:
            motors = tuple(int(number) for number in _ESC_NUMBERS.findall(bare))
        else:
            motors = (int(motor),) if motor else ()
        return AutopilotWord(opinion, motors, said, before_arming)
    return None


class AutopilotWords:
    """Joins chunks and understands texts and events of one vehicle."""

    def __init__(self) -> None:
        self._chunks: dict[int, list[str]] = {}

    def feed(self, sample: Sample) -> AutopilotWord | None:
        """Take a STATUSTEXT or an EVENT; return what it says of motors, if anything."""
        if isinstance(sample, StatusText):
            text = self._whole(sample)
            return understood(text) if text is not None else None
        if isinstance(sample, Other) and sample.name == "EVENT":
            return _event(sample)
        return None

    def _whole(self, sample: StatusText) -> str | None:
        """Return the text that this chunk completes."""
        if sample.chunk_of == 0:
            return sample.text
        if sample.chunk == 0 or len(self._chunks) > 8:
            self._chunks.clear()  # the autopilot sends one long text at a time
        parts = self._chunks.setdefault(sample.chunk_of, [])
        if len(parts) != sample.chunk:  # one was lost: the rest makes no sentence
            self._chunks.pop(sample.chunk_of)
            return None
        parts.append(sample.text)
        if len(sample.text) >= CHUNK:
            return None
        return "".join(self._chunks.pop(sample.chunk_of))


def _event(sample: Other) -> AutopilotWord | None:
    number = sample.fields.get("id")
    name = _BY_ID.get(number) if isinstance(number, int) else None
    if name is None:
        return None
    arguments = sample.fields.get("arguments")
    motors: tuple[int, ...] = ()
    if name in _WITH_MOTOR and isinstance(arguments, list | tuple | bytes) and len(arguments) > ARGUMENTS_AT:
        motor = int(arguments[ARGUMENTS_AT])
        motors = (motor,) if motor else ()
    return AutopilotWord(EVENT_NAMES[name], motors, name.replace("_", " "))
