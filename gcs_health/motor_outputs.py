"""Motor commands from the autopilot's output messages: which channel is whose, in which unit, of which stream."""

import math

from gcs_health.samples import CommandReading, Outputs

NAN = math.nan
COMMAND_SILENT = 2.0  # s until another output stream is taken
ACTUATOR_OUTPUT_STATUS, SERVO_OUTPUT_RAW = 375, 36


class _Unit:
    """The unit of one output stream, told from the values it has shown so far; it only grows."""

    __slots__ = ("largest", "last", "least", "offset", "span")

    def __init__(self) -> None:
        self.last = -math.inf
        self.largest, self.least = 0.0, math.inf
        self.offset, self.span = 0.0, 1.0

    def learn(self, values: tuple[float, ...]) -> None:
        """Widen the range seen; decide the unit anew if it grew."""
        grown = False
        for value in values:
            if value > self.largest:
                self.largest, grown = value, True
            if 1.001 < value < self.least:
                self.least, grown = value, True
        if not grown or self.largest <= 1.001:
            return
        if self.largest > 2200.0:
            self.offset, self.span = 0.0, 8191.0  # UAVCAN raw
        elif self.least >= 800.0:
            self.offset, self.span = 1000.0, 1000.0  # PWM µs
        else:
            self.offset, self.span = 0.0, 2000.0  # DShot

    def command(self, value: float) -> float:
        """Return a value as 0..1."""
        return min(max((value - self.offset) / self.span, 0.0), 1.0) if value == value else NAN


class MotorOutputs:
    """Turns output samples of one vehicle into commands in the airframe's rotor order.

    Attributes
    ----------
    channels : the output channel, from 0, of each rotor.
    """

    def __init__(self) -> None:
        self.channels: tuple[int, ...] = ()
        self._given: dict[int, int] = {}  # channel by motor
        self._motors: tuple[tuple[int, int], ...] = ()  # (motor, ESC index) of each rotor
        self._units: dict[int, _Unit] = {}  # by message
        self._chosen: int | None = None  # message whose stream is taken

    def set_motors(self, motors: tuple[tuple[int, int], ...]) -> None:
        """Take motor number and ESC index of each rotor; the index is the channel where none is given."""
        self._motors = motors
        self._find_channels()

    def set_channels(self, channels: dict[int, int]) -> None:
        """Take which output channel (from 0) drives which motor (from 1)."""
        self._given = dict(channels)
        self._find_channels()

    def feed(self, t: float, sample: Outputs) -> CommandReading | None:
        """Return the commands if the sample is of the chosen stream, at vehicle time `t` [s]."""
        message = sample.message
        # ACTUATOR_CONTROL_TARGET is roll, pitch, yaw and thrust; other ports are servos and gimbals
        if message not in (ACTUATOR_OUTPUT_STATUS, SERVO_OUTPUT_RAW) or sample.port:
            return None
        unit = self._units.get(message)
        if unit is None:
            unit = self._units[message] = _Unit()
        values = sample.value
        used = tuple([values[c] if 0 <= c < len(values) else NAN for c in self.channels])
        unit.learn(used or values)
        unit.last = t
        if self._chosen != message:
            if self._chosen is not None and 0.0 <= t - self._units[self._chosen].last <= COMMAND_SILENT:
                return None
            self._chosen = message
        return CommandReading(t, tuple([unit.command(value) for value in used])) if used else None

    def _find_channels(self) -> None:
        self.channels = tuple(self._given.get(motor, esc) for motor, esc in self._motors)
