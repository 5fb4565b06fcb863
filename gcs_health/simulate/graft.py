"""A fault put into a recorded healthy flight, so that the recording looks as if it had happened.

effectiveness   IMU, rates of ATTITUDE, rotor speeds, currents, motor outputs: `graft_loss.py`, `graft_commands.py`
unbalance       accelerations: m_u r_u w² / m, turning with the rotor, through the stream's own filter
drag            that motor's current
telemetry       the ESC's telemetry: `graft_escs.py`

Stamps, order, sequence numbers, senders and every other byte stay; the CRC of an edited frame is made anew.
Source: sheet 1 section 2; sheet 2 section 5; mavlink.md sections 3 to 5.
"""

import cmath
import math
from collections.abc import Iterable
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from gcs_health.errors import ConfigError
from gcs_health.gate import GRAVITY
from gcs_health.mavlink.dialect import Dialect, default_dialect
from gcs_health.samples import EscInfo, EscStatus, EscTelemetry, Imu, Outputs
from gcs_health.simulate.graft_commands import learned
from gcs_health.simulate.graft_escs import TelemetryFault
from gcs_health.simulate.graft_fault import GraftFault
from gcs_health.simulate.graft_loss import GRID, loss_of
from gcs_health.simulate.recording import Flown, Recorded, is_signed, repacked, unpacked, with_times

Array = NDArray[np.float64]
Fields = dict[str, Any]
RPM = 30.0 / math.pi
HIGHRES_IMU, ESC_STATUS = 105, 291
ATTITUDES = (30, 31)  # ATTITUDE, ATTITUDE_QUATERNION
RATES = ("rollspeed", "pitchspeed", "yawspeed")
MILLI_G = 1000.0 / GRAVITY
# scale of (acc, gyro) on the wire: SI, or mG and mrad/s
IMU_UNITS = {HIGHRES_IMU: (1.0, 1.0), **dict.fromkeys((26, 27, 116, 129), (MILLI_G, 1e3))}
DEEP = 0.5  # of effectiveness; below, the simulator's own flights differ after a second


class Graft:
    """Edits the frames of one flight for one fault; `frames` does it.

    Attributes
    ----------
    edited : frames that it changed. stamp : receive stamp of the fault's beginning [UNIX µs].
    notes : what the user should know of how true this one is.

    Raises
    ------
    ConfigError : the fault does not fit the vehicle or the recording; one line.
    """

    def __init__(self, flown: Flown, fault: GraftFault, dialect: Dialect | None = None) -> None:
        self.flown, self.fault = flown, fault
        self.dialect = dialect or default_dialect()
        self.edited = self.stamp = 0
        self.notes: list[str] = []
        self._rotor = self._index("rotor", fault.motor)
        self._at = flown.first_t + fault.at
        if not self._at < flown.last_t:
            _refuse(
                "at",
                f"{fault.at:g} s is after the end, the flight lasts {flown.last_t - flown.first_t:.0f} s",
            )
        rotors = flown.airframe.rotors
        self._escs = {rotor.esc: k for k, rotor in enumerate(rotors)}
        self._channels = tuple(enumerate(flown.channels))
        getattr(self, f"_prepare_{fault.effect}")()

    def _index(self, key: str, motor: int) -> int:
        numbers = [rotor.motor for rotor in self.flown.airframe.rotors]
        if motor not in numbers:
            _refuse(key, f"the vehicle has motors {', '.join(map(str, numbers))}, got {motor}")
        return numbers.index(motor)

    # -- each fault's preparation ---------------------------------------------------------------------

    def _prepare_effectiveness(self) -> None:
        self._loss = loss = loss_of(self.flown, self._rotor, self.fault)
        self._commands = learned(self.flown)
        if not self._commands:
            self.notes.append("motor outputs stay as recorded: none here that follows the rotor speeds")
        most = float(np.max(self.flown.speed))
        asked = (
            np.array([np.interp(loss.t, self.flown.rotor_t, w) for w in self.flown.speed.T]) ** 2
            + loss.change
        )
        asked_most = math.sqrt(max(float(np.max(asked)), 0.0))
        if asked_most > 1.02 * most:
            self.notes.append(
                f"the answer asks {asked_most / most:.2f} times the fastest speed of the recording: "
                "a real motor may not reach it"
            )
        if self.fault.size < DEEP:
            self.notes.append(
                f"a loss to {self.fault.size:g} also changes yaw and path after about a second: "
                "only the first second is believable"
            )

    def _prepare_unbalance(self) -> None:
        """Integrate the rotor's angle over its interpolated speed."""
        if not self.flown.airframe.mass:
            _refuse("unbalance", "needs the mass in the vehicle file, to become an acceleration")
        flown = self.flown
        self._t = np.arange(flown.rotor_t[0], flown.last_t + GRID, GRID)
        speed = np.interp(self._t, flown.rotor_t, flown.speed[:, self._rotor])
        self._phase = np.concatenate([[0.0], np.cumsum(0.5 * GRID * (speed[1:] + speed[:-1]))])

    def _prepare_drag(self) -> None:
        if self._rotor not in self.flown.powered:
            _refuse("drag", f"the log has no current of motor {self.fault.motor}'s ESC to raise")

    def _prepare_telemetry(self) -> None:
        rotors, fault = self.flown.airframe.rotors, self.fault
        other = rotors[self._index("with", fault.other)].esc if fault.other else -1
        for motor, esc in ((fault.motor, rotors[self._rotor].esc), (fault.other, other)):
            if motor and esc not in self.flown.reported:
                _refuse("telemetry", f"the log has no ESC telemetry of motor {motor}")
        self._telemetry = TelemetryFault(self.dialect, fault, rotors[self._rotor].esc, other)

    # -- frames ---------------------------------------------------------------------------------------

    def frames(self, frames: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
        """Return the flight's frames with the fault in them."""
        return self.edit(with_times(frames, self.dialect))

    def edit(self, records: Iterable[Recorded]) -> list[tuple[int, bytes]]:
        """Return the frames of these records with the fault in them.

        Raises
        ------
        ConfigError : a frame to be edited is signed.
        """
        out = []
        for record in records:
            raw = record.raw
            mine = record.sender == self.flown.vehicle
            if mine and not self.stamp and record.t >= self._at:
                self.stamp = record.stamp
            fields = self._fields(record) if mine else None
            if fields is not None:
                raw = repacked(self.dialect.messages[record.message], raw, fields)
                if raw != record.raw:
                    if is_signed(record.raw):
                        raise ConfigError(
                            "the log is signed: an edited frame's signature would no longer hold"
                        )
                    self.edited += 1
            out.append((record.stamp, raw))
        return out

    def _fields(self, record: Recorded) -> Fields | None:
        """Return the edited fields of a frame; None for one that the fault does not touch."""
        effect, sample, fault = self.fault.effect, record.sample, self.fault
        if effect == "telemetry":
            if not isinstance(sample, EscStatus | EscInfo | EscTelemetry):
                return None
            if not self._at <= record.t < self.flown.first_t + fault.until:
                self._telemetry.remember(record)
                return None
            return self._telemetry.fields(record, record.t - self._at)
        if not record.t >= self._at:
            return None
        if effect == "drag":
            return self._dragged(record)
        if effect == "unbalance":
            return self._shaken(record)
        return self._lost(record)

    def _unpacked(self, record: Recorded) -> Fields:
        return unpacked(self.dialect.messages[record.message], record.raw)

    def _grown(self, record: Recorded) -> float:
        return self.fault.grown(record.t - self._at)

    # -- loss of effectiveness ------------------------------------------------------------------------

    def _lost(self, record: Recorded) -> Fields | None:
        loss, sample, t = self._loss, record.sample, record.t
        if isinstance(sample, Imu) and record.message in IMU_UNITS:
            acc, gyro = IMU_UNITS[record.message]
            rates = [gyro * float(np.interp(t, loss.t, row)) for row in loss.rates]
            lift = acc * float(np.interp(t, loss.t, loss.lift))
            return self._added(
                record, dict(zip(("xgyro", "ygyro", "zgyro", "zacc"), (*rates, lift), strict=True))
            )
        if record.message in ATTITUDES:
            rates = [float(np.interp(t, loss.t, row)) for row in loss.rates]
            return self._added(record, dict(zip(RATES, rates, strict=True)))
        if isinstance(sample, EscStatus | EscTelemetry):
            return self._hurried(record, sample.index)
        if isinstance(sample, Outputs) and record.message in self._commands and not sample.port:
            fields = self._unpacked(record)
            for rotor, channel in self._channels:
                before = float(np.interp(t, self.flown.rotor_t, self.flown.speed[:, rotor]))
                change = self._speed(t, rotor, before) - before
                self._commands[record.message].fields(fields, record.message, channel, change)
            return fields
        return None

    def _added(self, record: Recorded, added: dict[str, float]) -> Fields:
        """Return the fields with something added, in the message's own units and steps."""
        fields = self._unpacked(record)
        for name, value in added.items():
            before = fields[name]
            if not value:  # -0.0 + 0.0 is another number on the wire
                continue
            if isinstance(before, int):
                fields[name] = min(max(round(before + value), -32768), 32767)
            else:
                fields[name] = before + value
        return fields

    def _speed(self, t: float, rotor: int, before: float) -> float:
        """Return the speed that the controller would have asked, where `before` was recorded [rad/s]."""
        change = float(np.interp(t, self._loss.t, self._loss.change[rotor]))
        return math.sqrt(max(before * before + change, 0.0))

    def _hurried(self, record: Recorded, first: int) -> Fields:
        """Give every rotor the speed that the controller would have asked of it, and the current for it."""
        fields = self._unpacked(record)
        for k in range(4):
            rotor, rpm = self._escs.get(first + k), fields["rpm"][k]
            if rotor is None or not rpm:
                continue
            before = abs(rpm) / RPM
            after = self._speed(record.t, rotor, before)
            rpm_after = round(math.copysign(after * RPM, rpm))
            fields["rpm"][k] = rpm_after if record.message == ESC_STATUS else min(rpm_after, 65535)
            left = 1.0
            if rotor == self._rotor:  # a propeller that lifts less also drags less
                left -= float(np.interp(record.t, self._loss.t, self._loss.share))
            _scale_current(fields, k, left * (after / before) ** 2)
        return fields

    # -- drag and unbalance ---------------------------------------------------------------------------

    def _dragged(self, record: Recorded) -> Fields | None:
        if not isinstance(record.sample, EscStatus | EscTelemetry):
            return None
        k = self.flown.airframe.rotors[self._rotor].esc - record.sample.index
        if not 0 <= k < 4:
            return None
        fields = self._unpacked(record)
        _scale_current(fields, k, 1.0 + (self.fault.size - 1.0) * self._grown(record))
        return fields

    def _shaken(self, record: Recorded) -> Fields | None:
        if not isinstance(record.sample, Imu) or record.message not in IMU_UNITS:
            return None
        acc, _ = IMU_UNITS[record.message]
        force = self._unbalance(record)
        return self._added(record, {"xacc": acc * force.real, "yacc": acc * force.imag})

    def _unbalance(self, record: Recorded) -> complex:
        """Return the in-plane acceleration ax + j ay [m/s²] as the stream shows it."""
        assert self.flown.airframe.mass is not None
        speed = float(np.interp(record.t, self.flown.rotor_t, self.flown.speed[:, self._rotor]))
        response = self.response(speed, record.message)
        size = (
            self.fault.size * self._grown(record) * speed * speed / self.flown.airframe.mass * abs(response)
        )
        turned = float(np.interp(record.t, self._t, self._phase)) + cmath.phase(response)
        # counter-clockwise seen from above is from x towards -y in these axes
        spin = self.flown.airframe.rotors[self._rotor].spin or 1
        return complex(size * math.cos(turned), -spin * size * math.sin(turned))

    def response(self, speed: float, message: int) -> complex:
        """Return the stream's filter at the rotor's frequency: PX4's mean, or ArduPilot's two poles."""
        parameters = self.flown.parameters
        if message == HIGHRES_IMU:
            half = 0.5 * speed / parameters.get("IMU_INTEG_RATE", 200.0)
            return math.sin(half) / half * cmath.exp(-1j * half) if half else 1.0 + 0.0j
        cutoff = 2.0 * math.pi * parameters.get("INS_ACCEL_FILTER", 20.0)
        s = 1j * speed / cutoff
        return 1.0 / (s * s + math.sqrt(2.0) * s + 1.0)


def _scale_current(fields: Fields, k: int, factor: float) -> None:
    before = fields["current"][k]
    value = before * factor
    fields["current"][k] = value if isinstance(before, float) else min(round(value), 65535)


def _refuse(key: str, what: str) -> NoReturn:
    raise ConfigError(f"--fault: {key}: {what}")
