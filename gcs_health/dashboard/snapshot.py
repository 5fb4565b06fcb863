"""What the screen is a function of: frozen values, made by `model`, ten a second.

Times `t` are the vehicle's clock [s], `us` UNIX µs of receipt. What is not known is NaN or None. Units are SI.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

NAN = float("nan")
SILENT = 1.0  # s without a byte after which nothing is known now
TRAIL = 60  # s of the sparklines, one value a second


class Level(IntEnum):
    """How bad: orders what is shown first."""

    OK = 0
    UNKNOWN = 1
    WARN = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class Figure:
    """One quantity of one rotor; `why` says what stands against it, empty where nothing does.

    Attributes
    ----------
    estimator, quantity, status : as in `estimators.contract`.
    together : motors that cannot be told apart, this one among them; empty if it can.
    trend : change a minute [unit of the quantity].
    balance : of a propeller, in a workshop's words; empty where it is not known.
    """

    estimator: str
    quantity: str
    value: float
    std: float
    failure_probability: float
    status: str
    why: str
    detectable: float
    together: tuple[int, ...] = ()
    trend: float = NAN
    balance: str = ""

    @property
    def known(self) -> bool:
        """Whether there is a value."""
        return self.value == self.value


@dataclass(frozen=True, slots=True)
class RotorShot:
    """One rotor now.

    Attributes
    ----------
    state : the verdict's kind in words, "unknown" among them. why : what keeps it unknown, or the evidence's sources.
    age : of its telemetry [s]. telemetry : `RotorState` in words.
    trail : (TRAIL,) probability of failure, the most of each second, oldest first; NaN where nothing was known.
    """

    motor: int
    seat: str
    position: tuple[float, float, float]
    spin: int
    level: Level
    state: str
    probability: float
    since: float
    why: str
    sources: tuple[str, ...]
    posterior: tuple[tuple[str, float], ...]
    figures: tuple[Figure, ...]
    speed: float
    current: float
    voltage: float
    temperature_degc: float
    telemetry: str
    age: float
    trail: tuple[float, ...]

    def figure(self, *quantities: str) -> Figure | None:
        """Return the first estimate of these quantities that has a value, else the first at all."""
        found = [figure for figure in self.figures if figure.quantity in quantities]
        return next((figure for figure in found if figure.known), found[0] if found else None)


class Row(NamedTuple):
    """One moment of a vehicle, ten a second: what the plots are drawn from.

    Attributes
    ----------
    failed, effectiveness, speed, current : by rotor.
    lift, expected : upward specific force, measured and as healthy rotors would give it [m/s²].
    """

    t: float
    failed: tuple[float, ...]
    effectiveness: tuple[float, ...]
    speed: tuple[float, ...]
    current: tuple[float, ...]
    lift: float
    expected: float


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of the list of alerts: an episode, the autopilot's word or a notice.

    Attributes
    ----------
    key : unique; an alert's is its id.
    kind : "alert", "autopilot" or "notice". code : an alert's; else what changed.
    open : not cleared. steps : (t, what happened) of an episode, oldest first.
    figures : the numbers behind it. words : what the autopilot said about then.
    trace : the seconds around it.
    """

    key: str
    vehicle: str
    t: float
    us: int
    kind: str
    severity: int
    code: str
    text: str
    motor: int = 0
    level: Level = Level.OK
    probability: float = NAN
    open: bool = False
    acknowledged: bool = False
    shelved_until: float = NAN
    steps: tuple[tuple[float, str], ...] = ()
    figures: tuple[tuple[str, str], ...] = ()
    advice: str = ""
    words: tuple[tuple[float, str], ...] = ()
    trace: tuple[Row, ...] = ()

    def shelved(self, t: float) -> bool:
        """Whether the operator wants silence on it at vehicle time `t` [s]."""
        return t < self.shelved_until


class NeedShot(NamedTuple):
    """One input of one estimator: received and wanted rate [Hz], and what would mend it."""

    estimator: str
    input: str
    rate: float
    wanted: float
    met: bool
    remedy: str


@dataclass(frozen=True, slots=True)
class VehicleShot:
    """One vehicle now.

    Attributes
    ----------
    name : "sysid.compid". title : autopilot and frame in words.
    t : its clock [s]. silent : since the last byte of it [s].
    since : when it took off or armed [s]; NaN on the ground.
    unusable : why nothing can be estimated at all.
    absorbed : what all rotors do alike and is no rotor's fault.
    sources : links that speak for it at the same time: more than one is a duplicate system id.
    requests : what `r` would send, in words; empty for nothing.
    messages : (name, Hz, loss) received in the last second or so.
    loss : of its frames [-] in the last seconds.
    blind : rotor speeds [rad/s] of the blind-band map, and the part of the line that is left there [-].
    rows : the last 62 s.
    """

    name: str
    title: str
    mode: str
    armed: bool | None
    landed: bool | None
    t: float
    us: int
    silent: float
    since: float
    rotors: tuple[RotorShot, ...]
    unusable: str = ""
    airframe: str = ""
    warnings: tuple[str, ...] = ()
    absorbed: tuple[str, ...] = ()
    clock: tuple[str, ...] = ()
    imu: str = ""
    imu_rate: float = NAN
    telemetry: tuple[str, ...] = ()
    needs: tuple[NeedShot, ...] = ()
    refused: tuple[tuple[str, str], ...] = ()
    sources: tuple[str, ...] = ()
    requests: str = ""
    messages: tuple[tuple[str, float], ...] = ()
    loss: float = NAN
    blind: tuple[tuple[float, float], ...] = ()
    rows: tuple[Row, ...] = ()

    @property
    def stale(self) -> bool:
        """Whether it has been silent for so long that nothing of it is known now."""
        return self.silent > SILENT


@dataclass(frozen=True, slots=True)
class LinkShot:
    """What comes in, over all vehicles. `recording` : paths and bytes; `counters` : of frames and bytes by name."""

    counters: tuple[tuple[str, int], ...] = ()
    recording: tuple[str, ...] = ()
    recorded: int = 0
    endpoints: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ReplayShot:
    """Where a replay stands. `marks` : (UNIX µs, severity) of alerts; `armings` of arming and disarming.

    `scanned` is the part [0..1] that the forerunner has seen; `end_us` is known to that point alone.
    """

    name: str
    start_us: int
    end_us: int
    at_us: int
    playing: bool
    backwards: bool
    speed: float
    scanned: float
    marks: tuple[tuple[int, int], ...] = ()
    armings: tuple[tuple[int, bool], ...] = ()


@dataclass(frozen=True, slots=True)
class Snapshot:
    """All that the screen shows. `ended` : why nothing more will come; empty while it may."""

    us: int
    vehicles: tuple[VehicleShot, ...] = ()
    entries: tuple[Entry, ...] = ()  # newest first
    link: LinkShot = LinkShot()
    replay: ReplayShot | None = None
    ended: str = ""
    waiting: str = "starting"

    def vehicle(self, name: str) -> VehicleShot | None:
        """Return the vehicle of this name, else the first."""
        return next((v for v in self.vehicles if v.name == name), self.vehicles[0] if self.vehicles else None)


EMPTY = Snapshot(0)
