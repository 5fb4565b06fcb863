"""How autopilots speak: which message, at which rate, with which conventions.

PX4: ESC_STATUS of each generation, HIGHRES_IMU in boot µs, parameters with integers bit-cast.
ArduPilot: ESC_TELEMETRY_x without stamps, RAW_IMU in mG and mrad/s, FRAME_CLASS. Source: mavlink.md 1, 3-8.
"""

import math
import struct
from collections.abc import Callable
from heapq import heapify, heappop, heappush
from operator import itemgetter
from typing import NamedTuple

from gcs_health.mavlink.dialect import Dialect
from gcs_health.mavlink.encoder import Encoder, clipped
from gcs_health.simulate.esc_view import EscView
from gcs_health.simulate.sensors import EscSample
from gcs_health.simulate.stream_rates import RATES, UNASKED
from gcs_health.simulate.world import World

BOOTED = 5.0  # s since boot at flight time 0
UNIX_BOOT_US = 1_700_000_000_000_000
ARMED, CUSTOM_MODE_ON = 128, 1
UNUSED = 65535
ESC_GROUPS = ("1_TO_4", "5_TO_8", "9_TO_12")
_PLACE = itemgetter(1)
_SILENT = EscSample(0.0, 0.0, 0.0, 0.0, 0.0)  # what is told of an ESC that is not heard


class Parameter(NamedTuple):
    """One parameter; `integer` decides its type and, on PX4, its bits."""

    name: str
    value: float
    integer: bool


class Telemetry:
    """Turns the world into frames; `due` gives those whose time has come."""

    def __init__(self, world: World, dialect: Dialect, system: int = 1) -> None:
        self.world = world
        self.encoder = Encoder(dialect, system)
        told = world.scenario.telemetry
        self.ardupilot = told.autopilot == "ardupilot"
        self.generation = {"px4_g1": 1, "px4_g2": 2}.get(told.autopilot, 3)
        rates = RATES["ardupilot" if self.ardupilot else "px4"] | told.rates
        self.requested = told.requested or not self.ardupilot
        if not self.requested:
            rates = {
                name: rate if name in UNASKED or name in told.rates else 0.0 for name, rate in rates.items()
            }
        self._usual = {name: 1.0 / rate if rate > 0.0 else math.inf for name, rate in rates.items()}
        self.interval = dict(self._usual)
        # (flight time [s], place among messages of one moment, name), a heap
        self._queue = [
            (0.1 + 1e-3 * k if rates[name] > 0.0 else math.inf, k, name) for k, name in enumerate(rates)
        ]
        heapify(self._queue)
        # the newest PX4 keeps an ESC's values for 0.1 s of silence; older drivers zero them at once
        self.escs = EscView(world, 0.1 if self.generation == 3 and not self.ardupilot else 0.0)
        self._build: dict[str, Callable[[float], list[bytes]]] = {
            "HEARTBEAT": self._heartbeat,
            "SYS_STATUS": self._sys_status,
            "SYSTEM_TIME": self._system_time,
            "HIGHRES_IMU": self._highres_imu,
            "RAW_IMU": self._raw_imu,
            "ATTITUDE": self._attitude,
            "ESC_INFO": self._esc_info,
            "ESC_STATUS": self._esc_status,
            "ESC_TELEMETRY": self._esc_telemetry,
            "SERVO_OUTPUT_RAW": self._servo_output_raw,
            "ACTUATOR_OUTPUT_STATUS": self._actuator_output_status,
            "EXTENDED_SYS_STATE": self._extended_sys_state,
            "BATTERY_STATUS": self._battery_status,
            "ATTITUDE_TARGET": self._attitude_target,
            "VIBRATION": self._vibration,
            "TIMESYNC": self._timesync,
        }

    def due(self) -> list[bytes]:
        """Return the frames whose time has come."""
        t, queue = self.world.t, self._queue
        ready = []
        while queue and queue[0][0] <= t:
            ready.append(heappop(queue))
        out: list[bytes] = []
        if len(ready) > 1:
            ready.sort(key=_PLACE)
        for at, place, name in ready:
            # a stream faster than the physics sends with every step, no more
            heappush(queue, (max(at + self.interval[name], t), place, name))
            out += self._build[name](t)
        return out

    def next_due(self) -> float:
        """Return the time of the next frame [s]."""
        return self._queue[0][0]

    def set_interval(self, name: str, interval: float) -> bool:
        """Send a message every `interval` s (infinite = never, 0 = as usual); return whether there is such a one."""
        if name not in self.interval:
            return False
        self.interval[name] = interval = interval or self._usual[name]
        at = self.world.t + min(interval, 1e-3) if interval < math.inf else math.inf
        self._queue = [(at if of == name else due, place, of) for due, place, of in self._queue]
        heapify(self._queue)
        return True

    def one(self, name: str) -> list[bytes]:
        """Return a message now; empty if there is no such one."""
        build = self._build.get(name) if name in self.interval else None
        return build(self.world.t) if build else []

    # -- messages -----------------------------------------------------------------------------------

    def boot_us(self, t: float) -> int:
        """Return flight time as time since boot [µs]."""
        return round((BOOTED + t) * 1e6)

    def _armed(self) -> bool:
        crashed = bool(self.world.controller.crashed)
        return not self.world.goal.off and not crashed

    def _heartbeat(self, t: float) -> list[bytes]:
        mode = 5 if self.ardupilot else 3 << 16  # LOITER; POSCTL
        return [
            self.encoder.frame(
                "HEARTBEAT",
                type=self.world.scenario.vehicle.mav_type,
                autopilot=3 if self.ardupilot else 12,
                base_mode=CUSTOM_MODE_ON | (ARMED if self._armed() else 0),
                custom_mode=mode,
                system_status=4 if self._armed() else 3,
                mavlink_version=3,
            )
        ]

    def _sys_status(self, t: float) -> list[bytes]:
        plant = self.world.plant
        return [
            self.encoder.frame(
                "SYS_STATUS",
                load=350,
                voltage_battery=clipped(plant.bus * 1e3, 0, 65535),
                current_battery=clipped(plant.battery_current * 100.0, -1, 32767),
                battery_remaining=self._remaining(),
            )
        ]

    def _remaining(self) -> int:
        return clipped(
            100.0 * (1.0 - self.world.plant.used / self.world.scenario.vehicle.battery.capacity), 0, 100
        )

    def _system_time(self, t: float) -> list[bytes]:
        boot = self.boot_us(t)
        return [
            self.encoder.frame("SYSTEM_TIME", time_unix_usec=UNIX_BOOT_US + boot, time_boot_ms=boot // 1000)
        ]

    def _highres_imu(self, t: float) -> list[bytes]:
        at, (ax, ay, az, p, q, r) = self.world.imu.latest
        return [
            self.encoder.frame(
                "HIGHRES_IMU",
                time_usec=self.boot_us(at),
                xacc=ax,
                yacc=ay,
                zacc=az,
                xgyro=p,
                ygyro=q,
                zgyro=r,
                abs_pressure=1013.0,
                temperature=25.0,
                fields_updated=0x3F,
            )
        ]

    def _raw_imu(self, t: float) -> list[bytes]:
        at, values = self.world.imu.latest
        units = [1e3 / 9.80665] * 3 + [1e3] * 3
        x = [clipped(value * unit, -32768, 32767) for value, unit in zip(values, units, strict=True)]
        return [
            self.encoder.frame(
                "RAW_IMU",
                time_usec=self.boot_us(at),
                xacc=x[0],
                yacc=x[1],
                zacc=x[2],
                xgyro=x[3],
                ygyro=x[4],
                zgyro=x[5],
            )
        ]

    def _attitude(self, t: float) -> list[bytes]:
        w, x, y, z = self.world.plant.attitude
        p, q, r = self.world.plant.rates
        return [
            self.encoder.frame(
                "ATTITUDE",
                time_boot_ms=self.boot_us(t) // 1000,
                roll=math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
                pitch=math.asin(min(max(2 * (w * y - z * x), -1.0), 1.0)),
                yaw=math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
                rollspeed=p,
                pitchspeed=q,
                yawspeed=r,
            )
        ]

    def _esc_status(self, t: float) -> list[bytes]:
        out, newest = [], self.generation == 3
        for first in range(0, self.escs.slots, 4):
            taken = 0 if self.generation == 1 else first  # the first generation repeats ESC 0-3
            slots = [self.escs.slot(taken + k, t) for k in range(4)]
            if newest and not any([slot.alive for slot in slots]):
                continue
            # the newest generation stamps the sending, the others the newest sample of the driver
            at = t if newest else max([slot.sample.t for slot in slots if slot.sample], default=t)
            told = [slot.sample if slot.alive and slot.sample else _SILENT for slot in slots]
            out.append(
                self.encoder.frame(
                    "ESC_STATUS",
                    time_usec=self.boot_us(at),
                    rpm=[round(sample.rpm) for sample in told],
                    voltage=[sample.voltage for sample in told],
                    current=[sample.current for sample in told],
                    index=first,
                )
            )
        return out

    def _esc_info(self, t: float) -> list[bytes]:
        out = []
        for first in range(0, self.escs.slots, 4):
            slots = [self.escs.slot(first + k, t) for k in range(4)]
            online = sum(1 << k for k, slot in enumerate(slots) if slot.alive)
            told = [slot.sample if slot.alive and slot.sample else _SILENT for slot in slots]
            out.append(
                self.encoder.frame(
                    "ESC_INFO",
                    time_usec=self.boot_us(t),
                    counter=int(t * 100.0) & 0xFFFF,
                    failure_flags=[slot.flags for slot in slots],
                    temperature=[round(sample.temperature * 100.0) for sample in told],
                    index=first,
                    count=self.escs.slots,
                    connection_type=5,
                    info=online if self.generation == 3 else online << first & 0xFF,
                )
            )
        return out

    def _esc_telemetry(self, t: float) -> list[bytes]:
        out = []
        for group, name in enumerate(ESC_GROUPS[: math.ceil(self.escs.slots / 4)]):
            slots = [self.escs.slot(4 * group + k, t) for k in range(4)]
            if all(slot.sample is None for slot in slots):
                continue
            samples = [slot.sample for slot in slots]
            out.append(
                self.encoder.frame(
                    f"ESC_TELEMETRY_{name}",
                    voltage=[clipped(s.voltage * 100.0, 0, 65535) if s else 0 for s in samples],
                    current=[clipped(s.current * 100.0, 0, 65535) if s else 0 for s in samples],
                    rpm=[
                        clipped(slot.sample.rpm, 0, 65535) if slot.sample and slot.silent < 1.0 else 0
                        for slot in slots
                    ],
                    count=[slot.packets & 0xFFFF for slot in slots],
                    temperature=[clipped(s.temperature, 0, 255) if s else 0 for s in samples],
                )
            )
        return out

    def _outputs(self) -> list[float]:
        top = self.world.scenario.vehicle.motor.top
        return [wanted / top for wanted in self.world.controller.wanted]

    def _servo_output_raw(self, t: float) -> list[bytes]:
        # PX4 says of an unused output that it is not there, ArduPilot gives 0
        fields = {} if self.ardupilot else {f"servo{k + 1}_raw": UNUSED for k in range(8)}
        for rotor, value in zip(self.world.scenario.vehicle.rotors, self._outputs(), strict=True):
            fields[f"servo{rotor.esc + 1}_raw"] = round(1000.0 + 1000.0 * value)
        return [self.encoder.frame("SERVO_OUTPUT_RAW", time_usec=self.boot_us(t) & 0xFFFFFFFF, **fields)]

    def _actuator_output_status(self, t: float) -> list[bytes]:
        values = self._outputs()
        return [
            self.encoder.frame(
                "ACTUATOR_OUTPUT_STATUS", time_usec=self.boot_us(t), active=len(values), actuator=values
            )
        ]

    def _extended_sys_state(self, t: float) -> list[bytes]:
        world = self.world
        standing = -world.plant.position[2] - world.scenario.vehicle.leg < 0.05
        return [self.encoder.frame("EXTENDED_SYS_STATE", landed_state=1 if standing else 2)]

    def _battery_status(self, t: float) -> list[bytes]:
        plant = self.world.plant
        return [
            self.encoder.frame(
                "BATTERY_STATUS",
                current_consumed=round(plant.used * 1000.0),
                energy_consumed=-1,
                temperature=32767,
                voltages=[clipped(plant.bus * 1e3, 0, 65534)] + [65535] * 9,
                current_battery=clipped(plant.battery_current * 100.0, -1, 32767),
                battery_remaining=self._remaining(),
            )
        ]

    def _attitude_target(self, t: float) -> list[bytes]:
        pilot = self.world.controller
        p, q, r = pilot.turn
        thrust = sum(value * value for value in self._outputs()) / len(pilot.wanted)
        return [
            self.encoder.frame(
                "ATTITUDE_TARGET",
                time_boot_ms=self.boot_us(t) // 1000,
                q=_facing_north(*pilot.thrust_axis),
                body_roll_rate=p,
                body_pitch_rate=q,
                body_yaw_rate=r,
                thrust=thrust,
            )
        ]

    def _vibration(self, t: float) -> list[bytes]:
        """What the rotors shake and the sensor's own noise: no peak, a level."""
        sensors, plant = self.world.scenario.sensors, self.world.plant
        noise = sensors.accelerometer_noise**2
        flat = sum((rotor.imbalance * rotor.w**2 / plant.mass) ** 2 for rotor in plant.rotors)
        beat = self.world.scenario.vehicle.motor.blade_pass
        high = sum((beat * rotor.lift / plant.mass) ** 2 for rotor in plant.rotors)
        across, along = math.sqrt(0.5 * flat + noise), math.sqrt(0.5 * high + noise)
        return [
            self.encoder.frame(
                "VIBRATION",
                time_usec=self.boot_us(t),
                vibration_x=across,
                vibration_y=across,
                vibration_z=along,
            )
        ]

    def _timesync(self, t: float) -> list[bytes]:
        return [self.encoder.frame("TIMESYNC", ts1=self.boot_us(t) * 1000)]

    # -- parameters ---------------------------------------------------------------------------------

    def parameters(self) -> list[Parameter]:
        """Return the parameters that tell geometry and filters."""
        vehicle, sensors = self.world.scenario.vehicle, self.world.scenario.sensors
        if self.ardupilot:
            frame_class, frame_type = vehicle.ardupilot_frame
            out = [Parameter("FRAME_CLASS", frame_class, True), Parameter("FRAME_TYPE", frame_type, True)]
            out += [Parameter("INS_ACCEL_FILTER", sensors.imu_filter, False)]
            out += [Parameter("INS_GYRO_FILTER", sensors.imu_filter, False)]
            for rotor in vehicle.rotors:
                function = 32 + rotor.motor if rotor.motor <= 8 else 73 + rotor.motor
                out.append(Parameter(f"SERVO{rotor.esc + 1}_FUNCTION", function, True))
            return out
        out = [
            Parameter("SYS_AUTOSTART", vehicle.px4_airframe, True),
            Parameter("CA_AIRFRAME", 0, True),
            Parameter("CA_ROTOR_COUNT", len(vehicle.rotors), True),
        ]
        ratio = vehicle.motor.torque / vehicle.motor.thrust
        for i, rotor in enumerate(vehicle.rotors):
            for axis, value in zip("XYZ", rotor.position, strict=True):
                out.append(Parameter(f"CA_ROTOR{i}_P{axis}", value, False))
            out.append(Parameter(f"CA_ROTOR{i}_KM", rotor.spin * ratio, False))
        out.append(Parameter("IMU_INTEG_RATE", sensors.imu_integration_rate, True))
        return out

    def parameter(self, k: int) -> bytes:
        """Return the PARAM_VALUE of the k-th."""
        every = self.parameters()
        name, value, integer = every[k]
        if integer and not self.ardupilot:
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        return self.encoder.frame(
            "PARAM_VALUE",
            param_value=value,
            param_count=len(every),
            param_index=k,
            param_id=name,
            param_type=6 if integer else 9,
        )


def _facing_north(x: float, y: float, z: float) -> list[float]:
    """Return the attitude (w, x, y, z) whose body z is (x, y, z) in the world, turned least from level."""
    w = math.sqrt(0.5 * (1.0 + z)) if z > -1.0 else 0.0
    return [w, -y / (2.0 * w), x / (2.0 * w), 0.0] if w else [0.0, 1.0, 0.0, 0.0]
