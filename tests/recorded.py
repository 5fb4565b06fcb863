"""The shipped flight as records, and a session of two flights made of it."""

from collections.abc import Iterable
from pathlib import Path

from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.pipeline import Monitor, MonitorConfig
from gcs_health.record.events import AlertEvent, Event

FLIGHT = Path(__file__).parents[1] / "replay" / "lost_propeller.tlog"
PARAM_VALUE = 22
Record = tuple[int, bytes]


def records(data: bytes) -> list[Record]:
    """(stamp, frame) of a .tlog."""
    return list(FrameDecoder(default_dialect(), stamped=True).feed(data).raw())


def two_flights() -> list[Record]:
    """Nine healthy seconds, a landing, and after a reboot a flight that loses a propeller.

    The second flight's parameters are not sent again: as when a ground station fetched them before the first.
    """
    first = records(FLIGHT.read_bytes())
    start = first[0][0]
    healthy = [r for r in first if r[0] - start < 9_000_000]
    encoder = Encoder(default_dialect())
    landed = [
        (
            start + 9_000_000 + k * 1_000_000,
            encoder.frame("HEARTBEAT", type=2, autopilot=12, mavlink_version=3),
        )
        for k in range(10)
    ]
    later = 20_000_000
    second = [(stamp + later, frame) for stamp, frame in first if frame[7] != PARAM_VALUE]
    return healthy + landed + second


def feed(frames: Iterable[Record], config: MonitorConfig) -> list[Event]:
    """What a Monitor says of frames that come one by one."""
    monitor = Monitor(config)
    events = [event for stamp, frame in frames for event in monitor.feed(frame, stamp, "udp")]
    return events + monitor.finish()


def alerts(events: Iterable[Event]) -> list[AlertEvent]:
    """The alerts among them."""
    return [event for event in events if isinstance(event, AlertEvent)]
