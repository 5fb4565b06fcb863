"""What we ask a vehicle for, when asked to ask: message rates that are too low, and its parameters."""

from typing import Any

SET_MESSAGE_INTERVAL, REQUEST_MESSAGE = 511, 512
AUTOPILOT_VERSION = 148
ENOUGH = 0.8  # of the rate wanted: what comes as often as that is left as it is
PX4, ARDUPILOT = 12, 3
OUR_SYSTEM, OUR_COMPONENT = 255, 190  # a ground station

# (message id, name, rate [Hz]) by autopilot; mavlink notes: what a link can carry and we can use
WANTED: dict[int, tuple[tuple[int, str, int], ...]] = {
    PX4: (
        (291, "ESC_STATUS", 10),
        (290, "ESC_INFO", 1),
        (105, "HIGHRES_IMU", 50),
        (375, "ACTUATOR_OUTPUT_STATUS", 10),
        (245, "EXTENDED_SYS_STATE", 1),
    ),
    ARDUPILOT: (
        (11030, "ESC_TELEMETRY_1_TO_4", 10),
        (11031, "ESC_TELEMETRY_5_TO_8", 10),
        (27, "RAW_IMU", 50),
        (36, "SERVO_OUTPUT_RAW", 10),
        (245, "EXTENDED_SYS_STATE", 1),
    ),
}


class RateRequests:
    """Packs the requests to one vehicle."""

    def __init__(self) -> None:
        from pymavlink.dialects.v20 import common

        self._dialect: Any = common
        self._link: Any = common.MAVLink(None, srcSystem=OUR_SYSTEM, srcComponent=OUR_COMPONENT)

    def to(
        self,
        system: int,
        component: int,
        autopilot: int | None,
        heard: dict[int, float],
        geometry_known: bool,
        hardware_known: bool = True,
    ) -> tuple[list[bytes], str]:
        """Return the frames to send and what they ask for in words; nothing for an unknown autopilot.

        `heard` are the rates [Hz] at which messages come already: nothing is ever asked to come slower.
        Without a known geometry all parameters are asked for; without a known hardware its AUTOPILOT_VERSION.
        """
        frames, said = [], []
        for message, name, rate in WANTED.get(autopilot or 0, ()):
            if heard.get(message, 0.0) >= ENOUGH * rate:
                continue
            command = self._dialect.MAVLink_command_long_message(
                system, component, SET_MESSAGE_INTERVAL, 0, message, 1e6 / rate, 0, 0, 0, 0, 0
            )
            frames.append(bytes(command.pack(self._link)))
            self._link.seq = (self._link.seq + 1) % 256
            said.append(f"{name} {rate} Hz")
        if not geometry_known:
            request = self._dialect.MAVLink_param_request_list_message(system, component)
            frames.append(bytes(request.pack(self._link)))
            self._link.seq = (self._link.seq + 1) % 256
            said.append("its parameters")
        if not hardware_known:
            request = self._dialect.MAVLink_command_long_message(
                system, component, REQUEST_MESSAGE, 0, AUTOPILOT_VERSION, 0, 0, 0, 0, 0, 0
            )
            frames.append(bytes(request.pack(self._link)))
            self._link.seq = (self._link.seq + 1) % 256
            said.append("its hardware's name")
        return frames, ", ".join(said)
