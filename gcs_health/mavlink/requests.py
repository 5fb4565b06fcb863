"""What we ask a vehicle for, when asked to ask: MAV_CMD_SET_MESSAGE_INTERVAL, nothing else."""

from typing import Any

SET_MESSAGE_INTERVAL = 511
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

    def to(self, system: int, component: int, autopilot: int | None) -> tuple[list[bytes], str]:
        """Return the frames to send and what they ask for in words; nothing for an unknown autopilot."""
        frames, said = [], []
        for message, name, rate in WANTED.get(autopilot or 0, ()):
            command = self._dialect.MAVLink_command_long_message(
                system, component, SET_MESSAGE_INTERVAL, 0, message, 1e6 / rate, 0, 0, 0, 0, 0
            )
            frames.append(bytes(command.pack(self._link)))
            self._link.seq = (self._link.seq + 1) % 256
            said.append(f"{name} {rate} Hz")
        return frames, ", ".join(said)
