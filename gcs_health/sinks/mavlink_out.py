"""Alerts and rotor health as MAVLink, for other ground stations and companion computers. This transmits.

Each frame is sent with the vehicle's system id and the component id of a companion computer, so that
ground stations show it with the vehicle that it is about. STATUSTEXT is what every station shows;
ROTOR_HEALTH, ROTOR_VERDICT and ROTOR_ALERT (`dialects/gcs_health.xml`) are for programs.
"""

import math
from typing import Any, Self

from gcs_health.errors import ConfigError, EndpointError
from gcs_health.mavlink.dialect import default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.mavlink.endpoints import SerialLink, TcpLink, UdpLink
from gcs_health.mavlink.spellings import Endpoint, parse_endpoint
from gcs_health.record.events import AlertEvent, EstimateEvent, Event, VerdictEvent
from gcs_health.sinks.contract import SinkError

COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER
ONBOARD_CONTROLLER, NO_AUTOPILOT, ACTIVE = 18, 8, 4  # MAV_TYPE, MAV_AUTOPILOT, MAV_STATE
NO_ESC = 255  # esc_index of an alert that names no rotor; its motor is 0
BEAT = 1.0  # s of vehicle time
CHUNK = 50  # characters of one STATUSTEXT
LINKS: dict[str, type[UdpLink] | type[TcpLink] | type[SerialLink]] = {
    "udpout": UdpLink,
    "tcpout": TcpLink,
    "serial": SerialLink,
}
# the enumerations of dialects/gcs_health.xml; 0 is "other": what has no number there yet
QUANTITY = {"effectiveness": 1, "unbalance": 2, "drag": 3, "degradation": 4}
STATUS = {"unobservable": 1, "converging": 2, "valid": 3, "diverged": 4}
STATE = {"raised": 1, "updated": 2, "escalated": 3, "acknowledged": 4, "cleared": 5, "shelved": 6}


class MavlinkOut:
    """Sends to `endpoint`."""

    takes: frozenset[type] = frozenset({EstimateEvent, VerdictEvent, AlertEvent})
    estimate_period = 1.0

    def __init__(self, endpoint: Endpoint) -> None:
        self.name = f"mavlink:{endpoint.text}"
        self._endpoint = endpoint
        self._link: UdpLink | TcpLink | SerialLink | None = None
        self._encoders: dict[int, Encoder] = {}
        self._beaten: dict[int, float] = {}
        self._texts = 0

    @classmethod
    def of(cls, rest: str) -> Self:
        """See `Sink.of`."""
        try:
            endpoint = parse_endpoint(rest)
        except EndpointError as error:
            raise ConfigError(str(error)) from None
        if endpoint.kind not in LINKS:
            raise ConfigError(f"{rest}: cannot be sent to")
        return cls(endpoint)

    def open(self) -> None:
        """See `Sink.open`."""
        self._link = LINKS[self._endpoint.kind](self._endpoint)

    def emit(self, event: Event) -> None:
        """See `Sink.emit`."""
        assert self._link is not None
        system = int(event.vehicle.split(".")[0])
        if system not in self._encoders:
            self._encoders[system] = Encoder(default_dialect(), system, COMPONENT)
        encoder = self._encoders[system]
        frames = []
        if not 0.0 <= event.t - self._beaten.get(system, -BEAT) < BEAT:
            self._beaten[system] = event.t
            frames.append(
                encoder.frame(
                    "HEARTBEAT",
                    type=ONBOARD_CONTROLLER,
                    autopilot=NO_AUTOPILOT,
                    system_status=ACTIVE,
                    mavlink_version=3,
                )
            )
        if isinstance(event, EstimateEvent):
            frames.append(rotor_health(encoder, event))
        elif isinstance(event, VerdictEvent):
            frames.append(rotor_verdict(encoder, event))
        elif isinstance(event, AlertEvent):
            frames += [rotor_alert(encoder, event), *self._status_texts(encoder, event)]
        for frame in frames:
            self._link.send(frame)
        self._link.read()  # nothing is expected; a lost connection is noticed here
        if self._link.lost:
            raise SinkError(f"link lost ({self._link.lost})")

    def close(self) -> None:
        """See `Sink.close`."""
        if self._link is not None:
            self._link.close()
            self._link = None

    def _status_texts(self, encoder: Encoder, event: AlertEvent) -> list[bytes]:
        """Return a STATUSTEXT in as many chunks as it needs; the last is shorter than a whole one."""
        text = f"{event.code} {event.state}: {event.text}".encode("ascii", "replace")
        self._texts = self._texts % 0xFFFF + 1
        parts = [text[at : at + CHUNK] for at in range(0, len(text) + 1, CHUNK)]
        number = self._texts if len(parts) > 1 else 0
        return [
            encoder.frame("STATUSTEXT", severity=event.severity, text=part, id=number, chunk_seq=k)
            for k, part in enumerate(parts)
        ]


def rotor_health(encoder: Encoder, event: EstimateEvent) -> bytes:
    """Return an estimate as ROTOR_HEALTH."""
    return encoder.frame(
        "ROTOR_HEALTH",
        **_head(event),
        quantity=QUANTITY.get(event.quantity, 0),
        status=STATUS.get(event.status, 0),
        value=event.value,
        std=event.std,
        failure_probability=event.failure_probability,
        detectable=event.detectable,
        estimator=event.estimator,
    )


def rotor_verdict(encoder: Encoder, event: VerdictEvent) -> bytes:
    """Return what is believed of a rotor as ROTOR_VERDICT."""
    return encoder.frame(
        "ROTOR_VERDICT",
        **_head(event),
        known=int(event.known),
        probability=event.probability,
        kind=event.kind,
    )


def rotor_alert(encoder: Encoder, event: AlertEvent) -> bytes:
    """Return a step of an alert as ROTOR_ALERT."""
    return encoder.frame(
        "ROTOR_ALERT",
        **_head(event),
        id=int(number) & 0xFFFF if (number := event.id.rpartition("-")[2]).isdecimal() else 0,
        state=STATE.get(event.state, 0),
        severity=event.severity,
        probability=event.probability,
        code=event.code,
    )


def _head(event: EstimateEvent | VerdictEvent | AlertEvent) -> dict[str, Any]:
    time_us = round(event.t * 1e6) if math.isfinite(event.t) else 0
    esc = event.rotor if event.rotor is not None else NO_ESC
    return {"time_usec": max(time_us, 0), "motor": event.motor or 0, "esc_index": esc}
