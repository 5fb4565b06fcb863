"""A fault put into a recorded healthy flight, so that the recording looks as if it had happened.

Partial loss theta of rotor i, from its time on; b_j the rotor's column of geometry, u its squared speed:

    D_row(t) = -theta G_row,i u_i(t)                     wrench that is missing
    p''  = D' - 2 p' / tau - p / tau²                    what roll, pitch, yaw rate show of it (rate loop)
    a_z  += D_z exp(-(t - t0) / tau_z)                   what the accelerometer shows (height loop)
    B diag(1 - theta e_i) du = theta b_i u_i             speeds that restore the wrench, least in squares
    u_j  += share(t) du_j                                share = what the loops have answered by then

Unbalance m_u r_u adds (m_u r_u w² / m) |H(w)| cos(th + arg H) along x, its quadrature along y, H the stream's
filter. Drag multiplies the current. Telemetry faults are exact. All else of the recording stays as it is;
commands stay too. Source: sheet 1 section 2; sheet 2 section 5; mavlink.md sections 3 to 5.
"""

import cmath
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gcs_health.errors import ConfigError
from gcs_health.gate import GRAVITY
from gcs_health.mavlink.dialect import Dialect, default_dialect
from gcs_health.samples import EscStatus, EscTelemetry, Imu
from gcs_health.simulate.graft_fault import GraftFault
from gcs_health.simulate.recording import Flown, Recorded, is_signed, repacked, unpacked, with_times

Array = NDArray[np.float64]
RATE_LOOP, HEIGHT_LOOP = 0.12, 0.3  # s
GRID = 0.001  # s
RPM = 30.0 / math.pi
HIGHRES_IMU, ATTITUDE = 105, 30
MILLI_G = 1000.0 / GRAVITY
# scale of (acc, gyro) on the wire: SI, or mG and mrad/s
IMU_UNITS = {HIGHRES_IMU: (1.0, 1.0), **dict.fromkeys((26, 27, 116, 129), (MILLI_G, 1e3))}
AP_SILENT = 1.0  # s after which ArduPilot says 0 rpm


class Graft:
    """Edits the frames of one flight for one fault; `frames` does it.

    Raises
    ------
    ConfigError : the fault does not fit the vehicle or the recording; one line.
    """

    def __init__(self, flown: Flown, fault: GraftFault, dialect: Dialect | None = None) -> None:
        self.flown, self.fault = flown, fault
        self.dialect = dialect or default_dialect()
        self.edited = 0
        rotors = flown.airframe.rotors
        self._rotor = self._index(fault.motor)
        self._other = self._index(fault.other) if fault.other else -1
        self._at = flown.first_t + fault.at
        if not self._at < flown.last_t:
            raise ConfigError(
                f"--fault: at: {fault.at:g} s is after the end, the flight lasts "
                f"{flown.last_t - flown.first_t:.0f} s"
            )
        self._escs = [rotor.esc for rotor in rotors]
        self._held: dict[int, tuple[Any, ...]] = {}
        self._mass = flown.airframe.mass
        if fault.effect == "unbalance" and not self._mass:
            raise ConfigError(
                "--fault: unbalance: needs the mass in the vehicle file, to become an acceleration"
            )
        if fault.effect == "effectiveness":
            self._prepare_loss()
        elif fault.effect == "unbalance":
            self._prepare_phase()

    def _index(self, motor: int) -> int:
        numbers = [rotor.motor for rotor in self.flown.airframe.rotors]
        if motor not in numbers:
            raise ConfigError(f"--fault: rotor: the vehicle has motors 1 to {max(numbers)}, got {motor}")
        return numbers.index(motor)

    # -- what the fault does, on a grid of a millisecond ----------------------------------------------

    def _speed(self, rotor: int, t: Array) -> Array:
        out: Array = np.interp(t, self.flown.rotor_t, self.flown.speed[:, rotor])
        return out

    def _prepare_loss(self) -> None:
        flown, i = self.flown, self._rotor
        self._t = t = np.arange(self._at, flown.last_t + GRID, GRID)
        since = t - self._at
        ramp = np.minimum(since / self.fault.ramp, 1.0) if self.fault.ramp else np.ones_like(since)
        theta = (1.0 - self.fault.size) * ramp
        missing = -theta * flown.matrix[:, i : i + 1] * self._speed(i, t) ** 2  # D, (4, k)
        self._rates = np.array([_answered(row) for row in missing[:3]])
        left = np.exp(-GRID / HEIGHT_LOOP)
        # the height loop answers each new piece of the loss with the same lag
        pieces = np.diff(missing[3], prepend=0.0)
        self._lift = _fading(pieces, left)
        turned = np.gradient(self._rates, GRID, axis=1)
        size = np.where(np.abs(missing) > 1e-12, missing, np.inf)
        share = np.vstack([1.0 - turned / size[:3], 1.0 - self._lift / size[3]])
        self._change = self._compensation(theta, share)

    def _compensation(self, theta: Array, share: Array) -> Array:
        """Return du (n, k): what the controller adds to each rotor's squared speed."""
        rotors, i = self.flown.airframe.rotors, self._rotor
        x = np.array([rotor.position[0] for rotor in rotors])
        y = np.array([rotor.position[1] for rotor in rotors])
        B = np.array([-y, x, [float(rotor.spin) for rotor in rotors], np.ones(len(rotors))])
        out = np.zeros((len(rotors), len(theta)))
        squares = self._speed(i, self._t) ** 2
        for level in np.unique(np.round(theta, 2)):  # the ramp in steps: one inverse each
            chosen = np.round(theta, 2) == level
            kept = np.ones(len(rotors))
            kept[i] = 1.0 - level
            # rows that answer at their own pace: each share of the missing wrench is restored by itself
            restore = np.linalg.pinv(B * kept)
            wanted = share[:, chosen] * (level * B[:, i : i + 1] * squares[chosen])
            out[:, chosen] = restore @ wanted
        return out

    def _prepare_phase(self) -> None:
        """The rotor's angle: the integral of its interpolated speed."""
        self._t = t = np.arange(self.flown.rotor_t[0], self.flown.last_t + GRID, GRID)
        speed = self._speed(self._rotor, t)
        self._phase = np.concatenate([[0.0], np.cumsum(0.5 * GRID * (speed[1:] + speed[:-1]))])

    # -- frames ---------------------------------------------------------------------------------------

    def frames(self, frames: list[tuple[int, bytes]]) -> list[tuple[int, bytes]]:
        """Return the flight's frames with the fault in them."""
        out = []
        for record in with_times(frames, self.dialect):
            raw = record.raw
            if record.sample is not None and record.sender == self.flown.vehicle and record.t >= self._at:
                fields = self._fields(record)
                if fields is not None:
                    if is_signed(raw):
                        raise ConfigError(
                            "the log is signed: an edited frame's signature would no longer hold"
                        )
                    raw = repacked(self.dialect.messages[record.message], raw, fields)
                    self.edited += raw != record.raw
            elif record.sender == self.flown.vehicle and isinstance(record.sample, EscStatus | EscTelemetry):
                self._remember(record)
            out.append((record.stamp, raw))
        return out

    def _fields(self, record: Recorded) -> dict[str, Any] | None:
        effect, sample = self.fault.effect, record.sample
        moves = effect in ("effectiveness", "unbalance")
        if moves and (isinstance(sample, Imu) or (record.message == ATTITUDE and effect == "effectiveness")):
            return self._shaken(record)
        if effect != "unbalance" and isinstance(sample, EscStatus | EscTelemetry):
            return self._esc(record, sample)
        return None

    def _shaken(self, record: Recorded) -> dict[str, Any]:
        fields = unpacked(self.dialect.messages[record.message], record.raw)
        if record.message == ATTITUDE:
            for k, name in enumerate(("rollspeed", "pitchspeed", "yawspeed")):
                fields[name] += float(np.interp(record.t, self._t, self._rates[k]))
            return fields
        acc, gyro = IMU_UNITS[record.message]
        added: dict[str, float] = {}
        if self.fault.effect == "effectiveness":
            for k, name in enumerate(("xgyro", "ygyro", "zgyro")):
                added[name] = gyro * float(np.interp(record.t, self._t, self._rates[k]))
            added["zacc"] = acc * float(np.interp(record.t, self._t, self._lift))
        else:
            force = self._unbalance(record.t, record.message)
            added["xacc"], added["yacc"] = acc * force.real, acc * force.imag
        whole = record.message != HIGHRES_IMU
        for name, value in added.items():
            fields[name] = (
                min(max(round(fields[name] + value), -32768), 32767) if whole else fields[name] + value
            )
        return fields

    def _unbalance(self, t: float, message: int) -> complex:
        """Return the in-plane acceleration ax + j ay [m/s²] as the stream shows it."""
        assert self._mass is not None
        speed = float(np.interp(t, self.flown.rotor_t, self.flown.speed[:, self._rotor]))
        angle = float(np.interp(t, self._t, self._phase))
        response = self.response(speed, message)
        size = self.fault.size * self.fault.grown(t - self._at) * speed * speed / self._mass * abs(response)
        spin = self.flown.airframe.rotors[self._rotor].spin or 1
        turned = angle + cmath.phase(response)
        # counter-clockwise seen from above is from x towards -y in these axes
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

    # -- ESC telemetry --------------------------------------------------------------------------------

    def _slots(self, record: Recorded) -> tuple[dict[str, Any], int]:
        """Return the fields and the ESC index of the first slot."""
        sample = record.sample
        assert isinstance(sample, EscStatus | EscTelemetry)
        return unpacked(self.dialect.messages[record.message], record.raw), sample.index

    def _arrays(self, fields: dict[str, Any]) -> list[str]:
        return [name for name, value in fields.items() if isinstance(value, list) and len(value) == 4]

    def _remember(self, record: Recorded) -> None:
        fields, first = self._slots(record)
        for k in range(4):
            self._held[first + k] = tuple(fields[name][k] for name in self._arrays(fields))

    def _esc(self, record: Recorded, sample: EscStatus | EscTelemetry) -> dict[str, Any]:
        fields, first = self._slots(record)
        effect = self.fault.effect
        if effect == "telemetry":
            self._cut(record, fields, first, isinstance(sample, EscTelemetry))
            return fields
        for k in range(4):
            esc = first + k
            if esc not in self._escs or not fields["rpm"][k]:
                continue
            rotor = self._escs.index(esc)
            if effect == "drag":
                if rotor == self._rotor:
                    grown = 1.0 + (self.fault.size - 1.0) * self.fault.grown(record.t - self._at)
                    self._scale_current(fields, k, grown)
            else:
                self._slow_or_hurry(record.t, fields, k, rotor)
        return fields

    def _slow_or_hurry(self, t: float, fields: dict[str, Any], k: int, rotor: int) -> None:
        """Give a rotor the speed that the controller would have asked of it, and the current for it."""
        rpm = fields["rpm"][k]
        before = abs(rpm) / RPM
        change = float(np.interp(t, self._t, self._change[rotor]))
        after = math.sqrt(max(before * before + change, 0.0))
        fields["rpm"][k] = round(math.copysign(after * RPM, rpm))
        left = 1.0
        if rotor == self._rotor:  # a propeller that lifts less also drags less
            left = 1.0 - (1.0 - self.fault.size) * self.fault.grown(t - self._at)
        self._scale_current(fields, k, left * (after / before) ** 2)

    def _scale_current(self, fields: dict[str, Any], k: int, factor: float) -> None:
        value = fields["current"][k] * factor
        fields["current"][k] = value if isinstance(fields["current"][k], float) else min(round(value), 65535)

    def _cut(self, record: Recorded, fields: dict[str, Any], first: int, ardupilot: bool) -> None:
        """Lose, freeze or swap; PX4 says zeros for an ESC it lost, ArduPilot repeats all but the speed."""
        names = self._arrays(fields)
        mine = self._escs[self._rotor]
        if self.fault.how == "swapped":
            fresh = {first + k: tuple(fields[name][k] for name in names) for k in range(4)}
            for esc, source in ((mine, self._escs[self._other]), (self._escs[self._other], mine)):
                if esc in fresh and (source in fresh or source in self._held):
                    self._put(fields, names, esc - first, fresh.get(source) or self._held[source])
            self._held.update(fresh)
            return
        if not first <= mine < first + 4:
            return
        k = mine - first
        if self.fault.how == "lost" and not ardupilot:
            self._put(fields, names, k, tuple(0 for _ in names))
            return
        if mine in self._held:
            self._put(fields, names, k, self._held[mine])
        if self.fault.how == "lost" and record.t - self._at > AP_SILENT:
            fields["rpm"][k] = 0

    def _put(self, fields: dict[str, Any], names: list[str], k: int, values: tuple[Any, ...]) -> None:
        for name, value in zip(names, values, strict=True):
            fields[name][k] = value


def _answered(missing: Array) -> Array:
    """Return the rate [rad/s] that a critically damped rate loop leaves of a missing moment, on the grid."""
    out = np.empty_like(missing)
    rate = speed = before = 0.0
    for k, value in enumerate(missing.tolist()):
        speed += value - before - GRID * (2.0 * speed / RATE_LOOP + rate / RATE_LOOP**2)
        before = value
        rate += GRID * speed
        out[k] = rate
    return out


def _fading(pieces: Array, keep: float) -> Array:
    out = np.empty_like(pieces)
    value = 0.0
    for k, piece in enumerate(pieces.tolist()):
        value = keep * value + piece
        out[k] = value
    return out
