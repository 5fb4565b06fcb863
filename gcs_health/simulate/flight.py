"""One simulated flight: frames out as a ground station would receive them, commands in."""

import math
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from gcs_health.mavlink.dialect import Dialect, default_dialect
from gcs_health.mavlink.encoder import Encoder
from gcs_health.mavlink.frames import FrameDecoder
from gcs_health.simulate.booms import Booms
from gcs_health.simulate.link import Air
from gcs_health.simulate.scenario import Scenario
from gcs_health.simulate.telemetry import UNIX_BOOT_US, Parameter, Telemetry
from gcs_health.simulate.world import World

SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512
ACCEPTED, UNSUPPORTED, FAILED = 0, 3, 4
PARAMETERS_FROM, PARAMETER_STEP = 0.2, 0.01  # s; a ground station has just connected
SYSTEM = 1
NEIGHBOUR = 7  # system id of the other vehicle on the port


class Flight:
    """A scenario in flight; deterministic for what is fed to it.

    Attributes
    ----------
    world : the truth. boom_tips : accelerations of the boom tips [m/s²], one row a step, where there are booms.
    """

    def __init__(self, scenario: Scenario, dialect: Dialect | None = None) -> None:
        self.scenario = scenario
        self._dialect = dialect or default_dialect()
        self.world = World(scenario, [scenario.seed])
        self._telemetry = Telemetry(self.world, self._dialect, SYSTEM)
        self._air = Air(
            scenario.link, np.random.default_rng(np.random.SeedSequence(scenario.seed).spawn(7)[6])
        )
        self._ear = FrameDecoder(self._dialect, stamped=False)
        self._parameters = self._first_parameters()
        self._next = 0.0
        boom = scenario.vehicle.boom
        self._booms = Booms(boom, len(scenario.vehicle.rotors), self.world.dt) if boom else None
        self.boom_tips: list[np.ndarray[Any, np.dtype[np.float64]]] = []
        self._neighbour = Encoder(self._dialect, NEIGHBOUR) if scenario.link.second_system else None
        self._neighbour_next = 0.3

    def _first_parameters(self) -> list[tuple[float, int]]:
        """All parameters once, as after a ground station's PARAM_REQUEST_LIST."""
        count = len(self._telemetry.parameters())
        return [(PARAMETERS_FROM + PARAMETER_STEP * k, k) for k in range(count)]

    def send_parameters(self) -> None:
        """Send all parameters again, as for a ground station that connects now."""
        self._on_param_request_list({})
        self._next = 0.0

    @property
    def over(self) -> bool:
        """Whether the scenario's duration has passed."""
        return self.world.t >= self.scenario.trajectory.duration

    def step(self) -> None:
        """Advance by one physics step."""
        world = self.world
        world.step()
        t = world.t
        if self._booms is not None:
            self.boom_tips.append(self._booms.step(np.array([rotor.lift for rotor in world.plant.rotors])))
        if t < self._next:
            return
        while self._parameters and t >= self._parameters[0][0]:
            self._air.send(t, self._telemetry.parameter(self._parameters.pop(0)[1]))
        for frame in self._telemetry.due():
            self._air.send(t, frame)
        if self._neighbour is not None and t >= self._neighbour_next:
            self._neighbour_next += 1.0
            self._air.send(t, self._neighbour.frame("HEARTBEAT", type=2, autopilot=12, mavlink_version=3))
        self._next = min(
            self._telemetry.next_due(),
            self._parameters[0][0] if self._parameters else math.inf,
            self._neighbour_next if self._neighbour else math.inf,
        )

    def arrived(self) -> list[tuple[int, bytes]]:
        """Return the frames that have reached the ground by now: (UNIX µs, frame)."""
        first = UNIX_BOOT_US + self._telemetry.boot_us(0.0)
        return [(first + round(t * 1e6), frame) for t, frame in self._air.arrived(self.world.t)]

    def run(self) -> Iterator[tuple[int, bytes]]:
        """Fly to the end; yield (UNIX µs, frame) in order of arrival."""
        while not self.over:
            self.step()
            yield from self.arrived()

    # -- what a ground station asks -----------------------------------------------------------------

    def receive(self, data: bytes) -> None:
        """Take bytes from a ground station; answers go out over the same link."""
        for _, _, _, message, _, payload in self._ear.feed(data):
            known = self._dialect.messages.get(message)
            if known is not None and known.name in (
                "COMMAND_LONG",
                "PARAM_REQUEST_LIST",
                "PARAM_REQUEST_READ",
            ):
                values = known.layout.unpack(payload.ljust(known.size, b"\0")[: known.size])
                fields = {name: values[at] for name, (at, _) in known.positions.items()}
                if fields["target_system"] not in (0, SYSTEM):
                    continue  # meant for another vehicle on the same port
                getattr(self, f"_on_{known.name.lower()}")(fields)
        self._next = 0.0

    def _on_command_long(self, fields: dict[str, Any]) -> None:
        command, first, second = fields["command"], fields["param1"], fields["param2"]
        result, extra = UNSUPPORTED, []
        name = self._name_of(int(first)) if first == first else ""
        if command == SET_MESSAGE_INTERVAL:
            interval = math.inf if second < 0.0 else max(second * 1e-6, self.world.dt) if second else 0.0
            result = ACCEPTED if self._telemetry.set_interval(name, interval) else FAILED
        elif command == REQUEST_MESSAGE:
            extra = self._requested(name, second)
            result = ACCEPTED if extra else UNSUPPORTED
        encoder = self._telemetry.encoder
        self._air.send(self.world.t, encoder.frame("COMMAND_ACK", command=command, result=result))
        for frame in extra:
            self._air.send(self.world.t, frame)

    def _name_of(self, message: int) -> str:
        name = self._dialect.name(message)
        return "ESC_TELEMETRY" if name.startswith("ESC_TELEMETRY_") else name

    def _requested(self, name: str, second: float) -> list[bytes]:
        if name == "MESSAGE_INTERVAL":
            asked = int(second) if second == second else 0
            interval = self._telemetry.interval.get(self._name_of(asked))
            us = 0 if interval is None else -1 if interval == math.inf else round(interval * 1e6)
            return [self._telemetry.encoder.frame(name, message_id=asked, interval_us=us)]
        if name == "AUTOPILOT_VERSION":
            # MAVLINK2, MESSAGE_INTERVAL and the way parameters are encoded
            encoding = 0x20000 if self._telemetry.ardupilot else 0x10000
            fields = {"capabilities": 0x2000 | encoding, "flight_sw_version": 0x01110000, "uid": 0x5EED}
            return [self._telemetry.encoder.frame(name, **fields)]
        return self._telemetry.one(name)

    def _on_param_request_list(self, fields: dict[str, Any]) -> None:
        now = self.world.t
        count = len(self._telemetry.parameters())
        self._parameters = [(now + PARAMETER_STEP * k, k) for k in range(count)]

    def _on_param_request_read(self, fields: dict[str, Any]) -> None:
        every: list[Parameter] = self._telemetry.parameters()
        name = fields["param_id"].rstrip(b"\0").decode("ascii", "replace")
        for k, parameter in enumerate(every):
            if parameter.name == name or k == fields["param_index"]:
                self._air.send(self.world.t, self._telemetry.parameter(k))
                return


def record(stamp: int, frame: bytes) -> bytes:
    """Return one record of a .tlog."""
    return struct.pack(">Q", stamp) + frame
