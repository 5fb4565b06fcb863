"""What the operator wants of the pipeline: values that the screen puts into its mailbox."""

from dataclasses import dataclass

SHELVE_FOR = 600.0  # s


@dataclass(frozen=True, slots=True)
class Acknowledge:
    """The operator has seen the alert of this id, "sysid.compid-number"."""

    alert: str


@dataclass(frozen=True, slots=True)
class Shelve:
    """Silence on the alert of this id for so long [s]; 0 ends it."""

    alert: str
    seconds: float


@dataclass(frozen=True, slots=True)
class RequestRates:
    """Send to this vehicle what was shown and confirmed."""

    vehicle: str


@dataclass(frozen=True, slots=True)
class Pause:
    """Stop a replay, or let it go on."""


@dataclass(frozen=True, slots=True)
class Reverse:
    """Play the other way."""


@dataclass(frozen=True, slots=True)
class Step:
    """Show the picture so many before or after this one, a tenth of a second each."""

    count: int


@dataclass(frozen=True, slots=True)
class Speed:
    """One step faster (+1) or slower (-1)."""

    change: int


@dataclass(frozen=True, slots=True)
class Seek:
    """Go to UNIX µs `us`."""

    us: int


Command = Acknowledge | Shelve | RequestRates | Pause | Reverse | Step | Speed | Seek
