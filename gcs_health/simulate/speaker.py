"""One vehicle on the port: what it sends when, and what it answers to a ground station."""

import math
from collections.abc import Callable
from typing import Any

from gcs_health.mavlink.dialect import Dialect
from gcs_health.simulate.stream_rates import STREAM_GROUPS
from gcs_health.simulate.telemetry import Telemetry
from gcs_health.simulate.world import World

SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512
ACCEPTED, UNSUPPORTED, FAILED = 0, 3, 4
PARAMETERS_FROM, PARAMETER_STEP = 0.2, 0.01  # s; a ground station has just connected
HEARD = ("COMMAND_LONG", "PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "REQUEST_DATA_STREAM")


class Speaker:
    """The autopilot of one system id; frames go to `send` at flight time t [s]."""

    def __init__(
        self, world: World, dialect: Dialect, system: int, send: Callable[[float, bytes], None]
    ) -> None:
        self.world = world
        self.system = system
        self.telemetry = Telemetry(world, dialect, system)
        self._dialect = dialect
        self._send = send
        # all parameters once, as after a ground station's PARAM_REQUEST_LIST
        self._parameters = self._all_parameters(PARAMETERS_FROM) if self.telemetry.requested else []
        self.next_due = 0.0

    def _all_parameters(self, since: float) -> list[tuple[float, int]]:
        return [(since + PARAMETER_STEP * k, k) for k in range(len(self.telemetry.parameters()))]

    def speak(self, t: float) -> None:
        """Send what is due by flight time t [s]."""
        if t < self.next_due:
            return
        while self._parameters and t >= self._parameters[0][0]:
            self._send(t, self.telemetry.parameter(self._parameters.pop(0)[1]))
        for frame in self.telemetry.due():
            self._send(t, frame)
        parameters = self._parameters[0][0] if self._parameters else math.inf
        self.next_due = min(self.telemetry.next_due(), parameters)

    def hear(self, name: str, fields: dict[str, Any]) -> None:
        """Take one of the messages `HEARD`; those for other systems concern this one nothing."""
        if fields["target_system"] in (0, self.system):
            getattr(self, f"_on_{name.lower()}")(fields)
            self.next_due = 0.0

    def send_parameters(self) -> None:
        """Send all parameters from now on."""
        self._parameters = self._all_parameters(self.world.t)
        self.next_due = 0.0

    def _on_command_long(self, fields: dict[str, Any]) -> None:
        command, first, second = fields["command"], fields["param1"], fields["param2"]
        result, extra = UNSUPPORTED, []
        name = self._name_of(int(first)) if first == first else ""
        if command == SET_MESSAGE_INTERVAL:
            interval = math.inf if second < 0.0 else max(second * 1e-6, self.world.dt) if second else 0.0
            result = ACCEPTED if self.telemetry.set_interval(name, interval) else FAILED
        elif command == REQUEST_MESSAGE:
            extra = self._requested(name, second)
            result = ACCEPTED if extra else UNSUPPORTED
        encoder = self.telemetry.encoder
        self._send(self.world.t, encoder.frame("COMMAND_ACK", command=command, result=result))
        for frame in extra:
            self._send(self.world.t, frame)

    def _name_of(self, message: int) -> str:
        name = self._dialect.name(message)
        return "ESC_TELEMETRY" if name.startswith("ESC_TELEMETRY_") else name

    def _requested(self, name: str, second: float) -> list[bytes]:
        if name == "MESSAGE_INTERVAL":
            asked = int(second) if second == second else 0
            interval = self.telemetry.interval.get(self._name_of(asked))
            us = 0 if interval is None else -1 if interval == math.inf else round(interval * 1e6)
            return [self.telemetry.encoder.frame(name, message_id=asked, interval_us=us)]
        if name == "AUTOPILOT_VERSION":
            # MAVLINK2, MESSAGE_INTERVAL and the way parameters are encoded
            encoding = 0x20000 if self.telemetry.ardupilot else 0x10000
            fields = {"capabilities": 0x2000 | encoding, "flight_sw_version": 0x01110000, "uid": 0x5EED}
            return [self.telemetry.encoder.frame(name, **fields)]
        return self.telemetry.one(name)

    def _on_request_data_stream(self, fields: dict[str, Any]) -> None:
        """ArduPilot's groups of messages; PX4 ignores the request, and nobody acknowledges it."""
        rate = fields["req_message_rate"] if fields["start_stop"] else 0
        group = fields["req_stream_id"]
        if self.telemetry.ardupilot:
            for name in [name for of, names in STREAM_GROUPS.items() if group in (0, of) for name in names]:
                self.telemetry.set_interval(name, 1.0 / rate if rate else math.inf)

    def _on_param_request_list(self, fields: dict[str, Any]) -> None:
        self.send_parameters()

    def _on_param_request_read(self, fields: dict[str, Any]) -> None:
        name = fields["param_id"].rstrip(b"\0").decode("ascii", "replace")
        for k, parameter in enumerate(self.telemetry.parameters()):
            if parameter.name == name or k == fields["param_index"]:
                self._send(self.world.t, self.telemetry.parameter(k))
                return
