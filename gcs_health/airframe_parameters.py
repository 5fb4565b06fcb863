"""The airframe from the parameters in the stream, as PX4 and as ArduPilot keep it.

PX4        CA_ROTOR_COUNT, CA_ROTORn_PX/PY/PZ [m], CA_ROTORn_KM (positive = counter-clockwise); else SYS_AUTOSTART
ArduPilot  FRAME_CLASS and FRAME_TYPE (FRAME in old versions) by table; SERVOn_FUNCTION says which
           output, and so which ESC, is whose motor

PX4 puts the bits of an int32 into the float, ArduPilot casts: `Parameter.number` reads both.
"""

import math
import re

from gcs_health.airframe import Airframe, AirframeSource, Rotor
from gcs_health.airframe_tables import ardupilot_frame, px4_frame
from gcs_health.samples import Parameter

_KEPT = re.compile(
    r"CA_ROTOR(_COUNT|\d+_(PX|PY|PZ|KM|AX|AY|AZ))|SYS_AUTOSTART|FRAME(_CLASS|_TYPE)?|SERVO\d+_FUNCTION"
    r"|ESC_TLM_MAV_OFS"
)
# SERVOn_FUNCTION of motors 1-8 and 9-12
_MOTOR_FUNCTIONS = {f: f - 32 for f in range(33, 41)} | {f: f - 73 for f in range(82, 86)}
_TILTED = 0.985  # cosine of 10°: below, a rotor's thrust is not vertical enough to be called so


class AirframeParameters:
    """Collects parameters; `airframe` answers once they tell a whole geometry."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {}

    def feed(self, sample: Parameter) -> bool:
        """Take one parameter; return whether it concerns the geometry and is new."""
        if not _KEPT.fullmatch(sample.name):
            return False
        value = sample.number
        if not math.isfinite(value) or self._values.get(sample.name) == value:
            return False
        self._values[sample.name] = value
        return True

    def airframe(self) -> Airframe | None:
        """Return the airframe as far as the parameters tell it whole; None if they do not (yet)."""
        return self._control_allocation() or self._ardupilot() or self._autostart()

    def _control_allocation(self) -> Airframe | None:
        count = int(self._values.get("CA_ROTOR_COUNT", 0))
        if not 3 <= count <= 12:
            return None
        rotors, warnings = [], []
        for n in range(count):
            got = [self._values.get(f"CA_ROTOR{n}_{key}") for key in ("PX", "PY", "KM")]
            if None in got:
                return None
            x, y, km = (v for v in got if v is not None)
            z = self._values.get(f"CA_ROTOR{n}_PZ", 0.0)
            rotors.append(Rotor(n + 1, n, (x, y, z), 1 if km > 0 else -1 if km < 0 else 0))
            if self._upright(n) < _TILTED:
                warnings.append(f"motor {n + 1} is tilted: treated as upright")
        if not any(r.position[0] for r in rotors) or not any(r.position[1] for r in rotors):
            return None
        name = f"{count} rotors from CA_ROTOR parameters"
        return Airframe(name, tuple(rotors), AirframeSource.PARAMETERS, warnings=tuple(warnings))

    def _upright(self, n: int) -> float:
        """Cosine between rotor n's thrust axis and straight up."""
        ax, ay, az = (self._values.get(f"CA_ROTOR{n}_{key}", d) for key, d in _AXIS)
        length = math.sqrt(ax * ax + ay * ay + az * az)
        return -az / length if length else 1.0

    def _ardupilot(self) -> Airframe | None:
        frame_class, frame_type = self._values.get("FRAME_CLASS"), self._values.get("FRAME_TYPE")
        if (
            frame_class is None and "FRAME" in self._values
        ):  # Copter to 3.4: FRAME is the type, quads only known
            return None
        if not frame_class or frame_type is None:
            return None
        found = ardupilot_frame(int(frame_class), int(frame_type))
        if found is None:
            return None
        name, rotors = found
        escs = self._escs()
        offset = int(self._values.get("ESC_TLM_MAV_OFS", 0))
        placed = tuple(
            Rotor(r.motor, escs.get(r.motor, r.motor - 1) + offset, r.position, r.spin) for r in rotors
        )
        warnings = () if escs else ("SERVOn_FUNCTION not heard: ESC n taken for motor n",)
        return Airframe(name, placed, AirframeSource.PARAMETERS, metric=False, warnings=warnings)

    def _escs(self) -> dict[int, int]:
        """ESC index (servo output channel from 0) of each motor."""
        return {
            motor: channel - 1
            for channel in range(1, 33)
            if (motor := _MOTOR_FUNCTIONS.get(int(self._values.get(f"SERVO{channel}_FUNCTION", 0))))
        }

    def _autostart(self) -> Airframe | None:
        found = px4_frame(int(self._values.get("SYS_AUTOSTART", 0)))
        if found is None or "CA_ROTOR_COUNT" in self._values:
            return None
        name, rotors, metric = found
        warning = f"geometry of SYS_AUTOSTART's {name}: CA_ROTOR parameters not heard"
        return Airframe(name, rotors, AirframeSource.PARAMETERS, metric=metric, warnings=(warning,))


_AXIS = (("AX", 0.0), ("AY", 0.0), ("AZ", -1.0))
