"""MAVSDK as a second way in: its MavlinkDirect messages turned back into frames.

The same `Monitor` takes them, so that decoding, recording and alerts are those of the direct path. What
MAVSDK does not tell is lost: the sequence numbers are counted anew here, signatures and damage unseen.

MAVSDK is a ground station of its own: it sends heartbeats and asks for the autopilot's version, whatever
we do. It is imported when a link is opened, not before.
"""

import json
import queue
import struct
import threading
import time
from collections.abc import Iterator
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any

from gcs_health.errors import EndpointError
from gcs_health.mavlink.backlog import Packet
from gcs_health.mavlink.dialect import Dialect, default_dialect
from gcs_health.mavlink.encoder import pack, payload_of
from gcs_health.mavlink.endpoints import now_us
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.requests import SET_MESSAGE_INTERVAL
from gcs_health.mavlink.spellings import Endpoint

WAITING = 20_000  # messages between MAVSDK's thread and ours, half a minute of a fast link
PATIENCE = 30.0  # s for an autopilot's first heartbeat; without one MAVSDK never gives anything
LOOK = 0.1  # s between looks for systems that are new
COMMAND_LONG, PARAM_VALUE, COMMAND_ACK_ACCEPTED = "COMMAND_LONG", "PARAM_VALUE", 0
NAN = float("nan")
_KEPT: list[Any] = []  # callbacks that C holds


class MavsdkLinks:
    """Endpoints read through MAVSDK; used as `endpoints.Links` is.

    Attributes
    ----------
    notices : what is to be told, each once.
    unknown : messages skipped because our dialect does not have them, by name.
    unusable : messages skipped because their values do not fit their fields, by name.

    Raises
    ------
    EndpointError : the endpoint cannot be opened, or MAVSDK is not there; from `packets`, when no
        autopilot was heard for `patience` seconds.
    """

    def __init__(
        self, endpoints: list[Endpoint], dialect: Dialect | None = None, patience: float = PATIENCE
    ) -> None:
        self.notices: list[str] = []
        self.unknown: dict[str, int] = {}
        self.unusable: dict[str, int] = {}
        self._endpoints = endpoints
        self._patience = patience
        self._started = time.monotonic()
        self._next_look = 0.0
        self._autopilot = False
        self._dialect = dialect or default_dialect()
        self._of_name = {message.name: message for message in self._dialect.messages.values()}
        self._sequence: dict[tuple[int, int], int] = {}
        self._came: queue.Queue[tuple[int, Any]] = queue.Queue(WAITING)
        self._said: queue.SimpleQueue[str] = queue.SimpleQueue()  # notices of other threads
        self._overflowed = False
        self._directs: dict[int, Any] = {}  # by the number of the system that it is subscribed to
        self._ear = FrameDecoder(self._dialect, stamped=False)
        self._station = open_station(endpoints)
        from mavsdk.plugins.mavlink_direct import MavlinkDirect

        self._direct_of = MavlinkDirect

    def __enter__(self) -> "MavsdkLinks":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def packets(self, tick: float = 0.2) -> Iterator[Packet]:
        """Yield what arrives, one frame each, and an empty packet at least every `tick` seconds; for ever."""
        while True:
            self._watch_systems()
            while not self._said.empty():
                self.notices.append(self._said.get())
            try:
                came = [self._came.get(timeout=tick)]
                while not self._came.empty():
                    came.append(self._came.get_nowait())
            except queue.Empty:
                came = []
            for receive_us, message in came:
                yield from self._packet(receive_us, message)
            yield Packet("", b"", now_us())

    def rest(self) -> Iterator[Packet]:
        """Yield what was received before and not given yet; nothing new."""
        while not self._came.empty():
            yield from self._packet(*self._came.get_nowait())

    def _packet(self, receive_us: int, message: Any) -> Iterator[Packet]:
        head = message.message_name, message.system_id, message.component_id
        frame = self.frame(*head, message.fields_json)
        if frame:
            yield Packet("mavsdk", frame, receive_us)

    def send(self, data: bytes) -> None:
        """Send frames of ours through MAVSDK; commands wait for their acknowledgement on a thread."""
        for _, _, _, id, _, payload in self._ear.feed(data):
            message = self._dialect.messages[id]
            values = message.layout.unpack(payload.ljust(message.size, b"\0"))
            fields = {
                name: values[at : at + count] if count else values[at]
                for name, (at, count) in message.positions.items()
            }
            threading.Thread(target=self._send, args=(message.name, fields), daemon=True).start()

    def close(self) -> None:
        """Let go of MAVSDK."""
        self._directs.clear()
        self._station.destroy()

    def frame(self, name: str, system: int, component: int, fields_json: str) -> bytes:
        """Return a message as a frame; empty where our dialect has no such one."""
        message = self._of_name.get(name)
        if message is None:
            self.unknown[name] = self.unknown.get(name, 0) + 1
            return b""
        try:
            told = dict(json.loads(fields_json))  # it names the message among the fields
            if name == PARAM_VALUE and told["param_value"] is None:
                raise ValueError  # PX4 sends the bits of an integer as a float: of -1 only "NaN" is left
            fields = {key: _wire(kind, told[key]) for key, kind, _ in message.fields if key in told}
            payload = payload_of(message, fields)
        except (KeyError, ValueError, TypeError, OverflowError, struct.error):
            self.unusable[name] = self.unusable.get(name, 0) + 1
            return b""
        sender = (system, component)
        sequence = self._sequence.get(sender, -1) + 1 & 0xFF
        self._sequence[sender] = sequence
        return pack(message, payload, sequence, system, component)

    def _watch_systems(self) -> None:
        """Subscribe to every system that appeared: MAVSDK gives messages system by system."""
        now = time.monotonic()
        if now < self._next_look:
            return
        self._next_look = now + LOOK
        for system in self._station.get_systems():
            self._autopilot = self._autopilot or system.has_autopilot()
            number = system.get_system_id()
            if number in self._directs:
                continue
            direct = self._directs[number] = self._direct_of(system)
            direct.load_custom_xml(dialect_xml())
            direct.subscribe_message("", self._take)
        if not self._autopilot and now - self._started > self._patience:
            others = ", ".join(str(number) for number in sorted(self._directs))
            raise EndpointError(
                f"{', '.join(endpoint.text for endpoint in self._endpoints)}: MAVSDK heard no autopilot for "
                f"{self._patience:g} s{f', only system {others}' if others else ''}; does the vehicle send its "
                "HEARTBEAT there, and does no other program hold the port?"
            )

    def _take(self, message: Any, _: Any) -> None:
        """Take a message on MAVSDK's thread, which must not wait for ours."""
        try:
            self._came.put_nowait((now_us(), message))
        except queue.Full:
            if not self._overflowed:
                self._overflowed = True
                self._said.put("MAVSDK gives messages faster than they can be taken: some are lost")

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        from mavsdk.plugins.mavlink_direct import MavlinkMessage

        target = fields.get("target_system", 0), fields.get("target_component", 0)
        said = {key: value.decode() if isinstance(value, bytes) else value for key, value in fields.items()}
        message = MavlinkMessage(
            message_name=name,
            target_system_id=target[0],
            target_component_id=target[1],
            fields_json=json.dumps(said),
        )
        directs = dict(self._directs)
        if target[0] in directs:
            directs = {target[0]: directs[target[0]]}  # else each system's plugin would send it once more
        for direct in directs.values():
            try:
                if name == COMMAND_LONG:
                    answer = json.loads(direct.send_command(message).fields_json)
                    self._tell_answer(fields, int(answer.get("result", COMMAND_ACK_ACCEPTED)))
                else:
                    direct.send_message(message)
            except Exception as error:  # MAVSDK's own: a command unanswered, or a link gone, ends nothing
                why = getattr(getattr(error, "result", None), "name", str(error)).lower().replace("_", " ")
                self._said.put(
                    f"MAVSDK got no answer to the request for {self._request(name, fields)}: {why}"
                )

    def _tell_answer(self, fields: dict[str, Any], result: int) -> None:
        asked = self._request(COMMAND_LONG, fields)
        if result == COMMAND_ACK_ACCEPTED:
            self._said.put(f"the vehicle will send {asked}")
        else:
            self._said.put(f"the vehicle refused to send {asked} (MAV_RESULT {result})")

    def _request(self, name: str, fields: dict[str, Any]) -> str:
        if name != COMMAND_LONG or fields["command"] != SET_MESSAGE_INTERVAL:
            return name
        return f"{self._dialect.name(int(fields['param1']))} every {fields['param2'] / 1000.0:.0f} ms"


def open_station(endpoints: list[Endpoint]) -> Any:
    """Return a `mavsdk.Mavsdk`, a ground station at these endpoints, its own log kept quiet.

    Raises
    ------
    EndpointError : MAVSDK is not there, or an endpoint cannot be opened.
    """
    try:
        import mavsdk
    except (ImportError, OSError) as error:
        raise EndpointError(f"MAVSDK cannot be loaded: {error}") from None
    _silence()
    kind = mavsdk.ComponentType.GROUND_STATION
    station = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
    for endpoint in endpoints:
        try:
            result = station.add_any_connection(url_of(endpoint))
        except EndpointError:
            station.destroy()
            raise
        if result != mavsdk.ConnectionResult.SUCCESS:
            station.destroy()
            why = result.name.lower().replace("_", " ")
            raise EndpointError(f"{endpoint.text}: MAVSDK cannot open {url_of(endpoint)}: {why}")
    return station


def url_of(endpoint: Endpoint) -> str:
    """Spell an endpoint as MAVSDK does."""
    if endpoint.kind == "serial":
        return f"serial://{endpoint.host}:{endpoint.port}"
    if endpoint.kind == "file":
        raise EndpointError(f"{endpoint.text}: a file needs no MAVSDK: gcs-health replay reads it")
    return f"{endpoint.kind}://{endpoint.host}:{endpoint.port}"


def dialect_xml() -> str:
    """Return `dialects/esc.xml`: in the wheel beside the generated code, in a checkout in its folder."""
    shipped = resources.files("gcs_health.mavlink.generated") / "esc.xml"
    if shipped.is_file():
        return shipped.read_text("utf-8")
    return (Path(__file__).parents[2] / "dialects" / "esc.xml").read_text("utf-8")


@cache
def _silence() -> None:
    """Keep MAVSDK's log off standard output, where our JSON lines may go.

    Not by `mavsdk.log_subscribe`: it decodes the line before it asks us, and prints an error and the line
    when a vehicle's STATUSTEXT is not UTF-8. The callback must live as long as the library.
    """
    from mavsdk import logging

    _KEPT.append(logging.LogCallback(lambda *_: True))  # true: do not print it
    logging._cmavsdk_lib.mavsdk_log_subscribe(_KEPT[0], None)


def _wire(kind: str, value: Any) -> Any:
    """Return a JSON value as the encoder takes a field of this MAVLink type.

    NaN comes as null (infinities too), or as text in some versions; long char arrays as numbers.
    """
    if kind == "char":
        if isinstance(value, int):
            return bytes((value,))
        return bytes(value) if isinstance(value, list) else str(value)
    if isinstance(value, list):
        return [_wire(kind, item) for item in value]
    if kind in ("float", "double"):
        return NAN if value is None else float(value)
    return int(value)
