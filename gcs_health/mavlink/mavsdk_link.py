"""MAVSDK as a second way in: its MavlinkDirect messages turned back into frames.

The same `Monitor` takes them, so that decoding, recording and alerts are those of the direct path. What
MAVSDK does not tell is lost: the sequence numbers are counted anew here, signatures and damage unseen.

MAVSDK is a ground station of its own: it sends heartbeats and asks for the autopilot's version, whatever
we do. It is imported when a link is opened, not before.
"""

import json
import queue
import threading
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

from gcs_health.errors import EndpointError
from gcs_health.mavlink.dialect import Dialect, default_dialect
from gcs_health.mavlink.encoder import pack, payload_of
from gcs_health.mavlink.endpoints import Packet, now_us
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.mavlink.spellings import Endpoint

WAITING = 20_000  # messages between MAVSDK's thread and ours, half a minute of a fast link
COMMAND_LONG, COMMAND_ACK_ACCEPTED = "COMMAND_LONG", 0
NAN = float("nan")


class MavsdkLinks:
    """Endpoints read through MAVSDK; used as `endpoints.Links` is.

    Attributes
    ----------
    notices : what is to be told, each once.
    unknown : messages by name that our dialect does not have.

    Raises
    ------
    EndpointError : the endpoint cannot be opened, or MAVSDK is not there.
    """

    def __init__(self, endpoints: list[Endpoint], dialect: Dialect | None = None) -> None:
        self.notices: list[str] = []
        self.unknown: dict[str, int] = {}
        self._dialect = dialect or default_dialect()
        self._of_name = {message.name: message for message in self._dialect.messages.values()}
        self._sequence: dict[tuple[int, int], int] = {}
        self._came: queue.Queue[tuple[int, Any]] = queue.Queue(WAITING)
        self._overflowed = False
        self._heard: set[int] = set()  # systems that we subscribed to
        self._directs: list[Any] = []
        self._ear = FrameDecoder(self._dialect, stamped=False)
        try:
            import mavsdk
            from mavsdk.plugins.mavlink_direct import MavlinkDirect
        except (ImportError, OSError) as error:
            raise EndpointError(f"--backend mavsdk: MAVSDK cannot be loaded: {error}") from None
        self._direct_of = MavlinkDirect
        mavsdk.log_subscribe(_quiet)  # else it writes to standard output, among our JSON lines
        kind = mavsdk.ComponentType.GROUND_STATION
        self._station = mavsdk.Mavsdk(mavsdk.Configuration.create_with_component_type(kind))
        for endpoint in endpoints:
            result = self._station.add_any_connection(url_of(endpoint))
            if result != mavsdk.ConnectionResult.SUCCESS:
                self.close()
                why = result.name.lower().replace("_", " ")
                raise EndpointError(f"{endpoint.text}: MAVSDK cannot open {url_of(endpoint)}: {why}")

    def __enter__(self) -> "MavsdkLinks":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def packets(self, tick: float = 0.2) -> Iterator[Packet]:
        """Yield what arrives, one frame each, and an empty packet at least every `tick` seconds; for ever."""
        while True:
            self._watch_systems()
            try:
                came = [self._came.get(timeout=tick)]
                while not self._came.empty():
                    came.append(self._came.get_nowait())
            except queue.Empty:
                came = []
            for receive_us, message in came:
                frame = self.frame(
                    message.message_name, message.system_id, message.component_id, message.fields_json
                )
                if frame:
                    yield Packet("mavsdk", frame, receive_us)
            yield Packet("", b"", now_us())

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
        fields = {
            key: _wire(value)
            for key, value in json.loads(fields_json).items()
            if key in message.positions  # its JSON names the message among the fields
        }
        sender = (system, component)
        sequence = self._sequence.get(sender, -1) + 1 & 0xFF
        self._sequence[sender] = sequence
        return pack(message, payload_of(message, fields), sequence, system, component)

    def _watch_systems(self) -> None:
        """Subscribe to every system that appeared: MAVSDK gives messages system by system."""
        for system in self._station.get_systems():
            number = system.get_system_id()
            if number in self._heard:
                continue
            self._heard.add(number)
            direct = self._direct_of(system)
            direct.load_custom_xml(dialect_xml())
            direct.subscribe_message("", self._take)
            self._directs.append(direct)

    def _take(self, message: Any, _: Any) -> None:
        """Take a message on MAVSDK's thread, which must not wait for ours."""
        try:
            self._came.put_nowait((now_us(), message))
        except queue.Full:
            if not self._overflowed:
                self._overflowed = True
                self.notices.append("MAVSDK gives messages faster than they can be taken: some are lost")

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
        for direct in self._directs:
            try:
                if name == COMMAND_LONG:
                    answer = json.loads(direct.send_command(message).fields_json)
                    self._note_answer(fields, answer.get("result", COMMAND_ACK_ACCEPTED))
                else:
                    direct.send_message(message)
            except Exception as error:  # MAVSDK's own: a refused or unanswered command ends nothing
                self.notices.append(f"MAVSDK could not send {name}: {error}")

    def _note_answer(self, fields: dict[str, Any], result: int) -> None:
        asked = self._dialect.name(int(fields["param1"]))
        if result == COMMAND_ACK_ACCEPTED:
            self.notices.append(f"the vehicle will send {asked} every {fields['param2'] / 1000.0:.0f} ms")
        else:
            self.notices.append(f"the vehicle refused to send {asked} as asked (MAV_RESULT {result})")


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


def _quiet(*_: object) -> bool:
    """Swallow a log line of MAVSDK's."""
    return True


def _wire(value: Any) -> Any:
    """Return a JSON value as the encoder takes it: NaN comes as null, or as text in some versions."""
    if isinstance(value, list):
        return [_wire(item) for item in value]
    if value is None or value in ("NaN", "nan", "-nan"):
        return NAN
    if isinstance(value, str) and value in ("inf", "Infinity", "-inf", "-Infinity"):
        return float(value)
    return value
