"""The airframe from the parameters in the stream, as PX4 and as ArduPilot keep it.

PX4        CA_ROTOR_COUNT, CA_ROTORn_PX/PY/PZ [m], CA_ROTORn_KM (positive = counter-clockwise); else SYS_AUTOSTART
ArduPilot  FRAME_CLASS and FRAME_TYPE by table (quads to Copter 3.4: FRAME)

Which output drives which motor says which ESC is whose:

PX4        PWM_MAIN_FUNCn, PWM_AUX_FUNCn, UAVCAN_EC_FUNCn = 100 + motor. To about 1.16 DShot's slot is the rank
           among the used outputs, UAVCAN's the output (DShot.cpp update_num_motors, uavcan actuators/esc.cpp);
           after it the slot is motor - 1 (PX4#25849)
ArduPilot  SERVOn_FUNCTION = 33-40 and 82-85; the ESC index is the channel less ESC_TLM_MAV_OFS
           (AP_ESC_Telem.cpp send_esc_telemetry_mavlink)

PX4 puts the bits of an int32 into the float, ArduPilot casts: `Parameter.number` reads both.
"""

import math
import re

from gcs_health.airframe import Airframe, AirframeSource, Rotor
from gcs_health.airframe_tables import ardupilot_frame, px4_frame
from gcs_health.samples import Parameter

_OUTPUT = re.compile(r"(SERVO)(\d+)_FUNCTION|(PWM_MAIN|PWM_AUX|UAVCAN_EC)_FUNC(\d+)")
_KEPT = re.compile(
    r"CA_ROTOR(_COUNT|\d+_(PX|PY|PZ|KM|AX|AY|AZ))|SYS_AUTOSTART|FRAME(_CLASS|_TYPE)?|ESC_TLM_MAV_OFS"
)
_ARDUPILOT_MOTORS = {f: f - 32 for f in range(33, 41)} | {f: f - 73 for f in range(82, 86)}
_PX4_MOTORS = {f: f - 100 for f in range(101, 113)}
# CAN first; beside an IO processor's MAIN outputs, only the AUX ones can speak DShot
_PX4_BANKS = ("UAVCAN_EC", "PWM_AUX", "PWM_MAIN")
_TILTED = 0.985  # cosine of 10°: below, a rotor's thrust is not vertical enough to be called so
_NEEDED = ("PX", "PY", "KM")
_AXIS = (("AX", 0.0), ("AY", 0.0), ("AZ", -1.0))
_QUADROTOR = 2  # MAV_TYPE
_OLD_QUADS = range(6)  # FRAME of a quad: the same numbers as FRAME_TYPE has now


class AirframeParameters:
    """Collects parameters; `airframe` answers once they tell a whole geometry."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {}
        self._outputs: dict[str, dict[int, int]] = {}  # function by output number, from 1, of each driver

    def feed(self, sample: Parameter) -> bool:
        """Take one parameter; return whether it concerns the geometry and is new."""
        output = _OUTPUT.fullmatch(sample.name)
        if output is None and not _KEPT.fullmatch(sample.name):
            return False
        value = sample.number
        if not math.isfinite(value):
            return False
        if output is not None:
            functions = self._outputs.setdefault(output[1] or output[3], {})
            number, function = int(output[2] or output[4]), int(value)
            news = functions.get(number) != function
            functions[number] = function
            return news
        news = self._values.get(sample.name) != value
        self._values[sample.name] = value
        return news

    def airframe(self, vehicle_type: int | None = None) -> Airframe | None:
        """Return the airframe as far as the parameters tell it whole; None if they do not (yet).

        `vehicle_type` is MAV_TYPE: old ArduPilots keep the frame's class nowhere else.
        """
        return self._control_allocation() or self._ardupilot(vehicle_type) or self._autostart()

    def output_channels(self) -> dict[int, int]:
        """Return the output channel, from 0, of each motor, from 1, as SERVO_OUTPUT_RAW numbers them.

        Empty where the parameters do not tell it of every motor.
        """
        airframe = self.airframe()
        rotors = len(airframe.rotors) if airframe is not None else 0
        if "CA_ROTOR_COUNT" in self._values or "SYS_AUTOSTART" in self._values:
            bank = self._px4_bank(rotors)
            return self._motors(bank, _PX4_MOTORS, rotors) if bank is not None else {}
        return self._motors("SERVO", _ARDUPILOT_MOTORS, rotors)

    def missing(self) -> str:
        """Say which parameters a geometry begun still lacks; empty if none is begun, or none lacks."""
        if self.airframe() is not None:
            return ""
        count = self._rotor_count()
        wanted: list[str] = []
        if count:
            wanted = [f"CA_ROTOR{n}_{key}" for n in range(count) for key in _NEEDED]
        elif any(name.startswith("CA_ROTOR") for name in self._values):
            wanted = ["CA_ROTOR_COUNT"]
        elif "FRAME_CLASS" in self._values or "FRAME_TYPE" in self._values:
            wanted = ["FRAME_CLASS", "FRAME_TYPE"]
        lacking = [name for name in wanted if name not in self._values]
        return f"not heard: {', '.join(lacking)}" if lacking else ""

    # -- PX4 ----------------------------------------------------------------------------------------

    def _rotor_count(self) -> int:
        count = int(self._values.get("CA_ROTOR_COUNT", 0))
        return count if 3 <= count <= 12 else 0

    def _control_allocation(self) -> Airframe | None:
        count = self._rotor_count()
        slots, warning = self._px4_slots(count)
        rotors, warnings = [], [warning] if warning else []
        for n in range(count):
            got = [self._values.get(f"CA_ROTOR{n}_{key}") for key in _NEEDED]
            if None in got:
                return None
            x, y, km = (v for v in got if v is not None)
            z = self._values.get(f"CA_ROTOR{n}_PZ", 0.0)
            rotors.append(Rotor(n + 1, slots.get(n + 1, n), (x, y, z), 1 if km > 0 else -1 if km < 0 else 0))
            if self._upright(n) < _TILTED:
                warnings.append(f"motor {n + 1} is tilted: treated as upright")
        if not any(r.position[0] for r in rotors) or not any(r.position[1] for r in rotors):
            return None
        # arms of whole metres are a pattern that nobody has measured: ground stations offer 1 and -1
        metric = not all(float(v).is_integer() for r in rotors for v in r.position[:2])
        name = f"{count} rotors (CA_ROTOR)"
        return Airframe(name, tuple(rotors), AirframeSource.PARAMETERS, metric, warnings=tuple(warnings))

    def _upright(self, n: int) -> float:
        """Cosine between rotor n's thrust axis and straight up."""
        ax, ay, az = (self._values.get(f"CA_ROTOR{n}_{key}", d) for key, d in _AXIS)
        length = math.sqrt(ax * ax + ay * ay + az * az)
        return -az / length if length else 1.0

    def _autostart(self) -> Airframe | None:
        found = px4_frame(int(self._values.get("SYS_AUTOSTART", 0)))
        if found is None or "CA_ROTOR_COUNT" in self._values:
            return None
        name, rotors, metric = found
        slots, warning = self._px4_slots(len(rotors))
        warnings = [f"geometry of SYS_AUTOSTART's {name}: CA_ROTOR parameters not heard", warning]
        return Airframe(
            name,
            tuple(Rotor(r.motor, slots.get(r.motor, r.esc), r.position, r.spin) for r in rotors),
            AirframeSource.PARAMETERS,
            metric=metric,
            warnings=tuple(filter(None, warnings)),
        )

    def _px4_bank(self, rotors: int) -> str | None:
        """Return the driver that has every motor; None if none is known to."""
        return next((bank for bank in _PX4_BANKS if self._motors(bank, _PX4_MOTORS, rotors)), None)

    def _px4_slots(self, rotors: int) -> tuple[dict[int, int], str]:
        """Return the ESC_STATUS slot of each motor where it is not motor - 1, and what to say of it."""
        bank = self._px4_bank(rotors)
        if bank is None:
            return {}, ""
        slots = self._motors(bank, _PX4_MOTORS, rotors)
        if bank != "UAVCAN_EC":
            used = sorted(n for n, function in self._outputs[bank].items() if function in _PX4_MOTORS)
            slots = {motor: used.index(channel + 1) for motor, channel in slots.items()}
        if all(slot == motor - 1 for motor, slot in slots.items()):
            return {}, ""
        order = ", ".join(
            f"ESC {slots[motor]} motor {motor}" for motor in sorted(slots, key=slots.__getitem__)
        )
        return slots, f"ESCs in the order of {bank}_FUNC: {order}; PX4 after 1.16 sends them in motor order"

    # -- ArduPilot ----------------------------------------------------------------------------------

    def _ardupilot(self, vehicle_type: int | None) -> Airframe | None:
        frame_class, frame_type = self._values.get("FRAME_CLASS"), self._values.get("FRAME_TYPE")
        if frame_class is None and vehicle_type == _QUADROTOR and self._values.get("FRAME") in _OLD_QUADS:
            frame_class, frame_type = 1.0, self._values["FRAME"]
        if not frame_class or frame_type is None:
            return None
        found = ardupilot_frame(int(frame_class), int(frame_type))
        if found is None:
            return None
        name, rotors = found
        # all or none: with some, a motor given its own number could be given another's ESC
        channels = self._motors("SERVO", _ARDUPILOT_MOTORS, len(rotors))
        offset = int(self._values.get("ESC_TLM_MAV_OFS", 0))
        placed = tuple(
            Rotor(r.motor, channels.get(r.motor, r.motor - 1 + offset) - offset, r.position, r.spin)
            for r in rotors
        )
        warnings = (
            () if channels else ("SERVOn_FUNCTION of every motor not heard: ESC n - 1 taken for motor n",)
        )
        if any(rotor.esc < 0 for rotor in placed):
            warnings = (*warnings, f"ESC_TLM_MAV_OFS {offset} hides the ESCs of the outputs before it")
        return Airframe(name, placed, AirframeSource.PARAMETERS, metric=False, warnings=warnings)

    def _motors(self, driver: str, motor_of: dict[int, int], rotors: int) -> dict[int, int]:
        """Return the output channel, from 0, of motors 1 to `rotors`; empty unless each has one."""
        channels: dict[int, int] = {}
        for number, function in sorted(self._outputs.get(driver, {}).items()):
            motor = motor_of.get(function, 0)
            if 1 <= motor <= rotors:
                channels.setdefault(motor, number - 1)
        return channels if len(channels) == rotors else {}
