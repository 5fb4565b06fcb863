"""Write `lost_propeller.tlog`: a synthetic quadrotor that loses the propeller of motor 3 in flight.

A rigid body on four rotors (quad X, PX4 numbering) hovers and follows small attitude steps; at 12 s
one propeller leaves: its thrust and drag vanish, the freed motor overspeeds, the vehicle tumbles.
It speaks as PX4 does: boot-time stamps, CA_ROTOR parameters with integers bit-cast, ESC_STATUS with
volts and amperes, EXTENDED_SYS_STATE. The truth stands beside it in `lost_propeller.truth.json`.

    python replay/make_lost_propeller.py            # writes beside this file
    python replay/make_lost_propeller.py OUT.tlog --seed 3 --motor 1 --lost-at 9

Simulated, and simpler than a real ejection, which is gradual: it shows the tool, it proves nothing.
"""

import argparse
import io
import json
import math
import struct
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from gcs_health.mavlink.generated import esc

STEP = 0.001  # s
GRAVITY = 9.81  # m/s²
ARM = 0.15  # m, forward and right of each rotor
MASS, INERTIA = 1.2, np.array([0.012, 0.012, 0.022])  # kg, kg m²
THRUST, TORQUE = 9.0e-6, 1.4e-7  # N/(rad/s)², N m/(rad/s)²
ROTOR_INERTIA = 4.0e-5  # kg m²
MOTOR_LAG, OVERSPEED, TOP_SPEED = 0.035, 1.25, 950.0  # s, -, rad/s
# motor: forward, right, spin (+1 = counter-clockwise seen from above), as PX4 numbers a quad X
LAYOUT = np.array([[ARM, ARM, 1.0], [-ARM, -ARM, 1.0], [ARM, -ARM, -1.0], [-ARM, ARM, -1.0]])
# forces and moments of four unit thrusts: up, roll, pitch, yaw
ALLOCATION = np.array([np.ones(4), -LAYOUT[:, 1], LAYOUT[:, 0], LAYOUT[:, 2] * TORQUE / THRUST])
MIX = np.linalg.inv(ALLOCATION)
BOOT_UNIX_US = 1_700_000_000_000_000
TAKEOFF, STEPS_EVERY = 1.5, 0.8  # s


class Quadrotor:
    """Rigid body in forward-right-down axes with first-order motors and an attitude controller."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.attitude, self.rates = np.zeros(3), np.zeros(3)  # rad, rad/s (Euler, small until the loss)
        self.climb = self.height = 0.0
        self.speed = np.zeros(4)
        self.gust = np.zeros(4)
        self.lost: int | None = None
        self.specific_force = np.array([0.0, 0.0, -GRAVITY])

    def command(self, t: float, target: np.ndarray, height: float) -> np.ndarray:
        """Return the wanted rotor speeds [rad/s]."""
        if t < TAKEOFF:
            return np.full(4, 180.0)
        lift = GRAVITY + 2.0 * np.clip(height - self.height, -1, 1) - 2.4 * self.climb
        level = max(0.5, math.cos(self.attitude[0]) * math.cos(self.attitude[1]))
        wanted_rates = 6.0 * (target - self.attitude)
        moment = INERTIA * np.array([18.0, 18.0, 5.0]) * (wanted_rates - self.rates)
        thrust = MIX @ np.concatenate([[MASS * lift / level], moment])
        return np.sqrt(np.clip(thrust, 0.15, 7.5) / THRUST)

    def step(self, wanted: np.ndarray) -> None:
        """Advance by `STEP`."""
        top = np.full(4, TOP_SPEED)
        thrust_of = np.full(4, THRUST)
        if self.lost is not None:
            thrust_of[self.lost] = 0.0
            wanted = wanted.copy()
            wanted[self.lost] *= OVERSPEED
            top[self.lost] *= OVERSPEED
        change = (np.minimum(wanted, top) - self.speed) / MOTOR_LAG
        self.speed = np.maximum(self.speed + STEP * change, 0.0)
        # slow air: a first-order Gauss-Markov disturbance of force and moments
        self.gust += STEP * (-self.gust / 0.8) + math.sqrt(STEP) * self.rng.normal(0, [0.25, 0.5, 0.5, 0.2])
        up, *moment = ALLOCATION @ (thrust_of * self.speed**2)
        moment = np.array(moment)
        moment[2] += float(LAYOUT[:, 2] @ change) * ROTOR_INERTIA
        moment += INERTIA * self.gust[1:] - 0.002 * self.rates
        gyroscopic = np.cross(self.rates, INERTIA * self.rates)
        self.rates = self.rates + STEP * (moment - gyroscopic) / INERTIA
        self.attitude = self.attitude + STEP * self.rates
        lift = up / MASS + self.gust[0]
        tilt = math.cos(self.attitude[0]) * math.cos(self.attitude[1])
        self.climb += STEP * (lift * tilt - GRAVITY)
        self.height += STEP * self.climb
        if self.height <= 0.0:  # the ground carries what the rotors do not
            self.height = self.climb = 0.0
            self.rates, self.attitude = np.zeros(3), np.zeros(3)
            lift = GRAVITY
        self.specific_force = np.array([0.0, 0.0, -lift])


class Telemetry:
    """Frames with stamps, as a ground station would have logged them from a PX4."""

    def __init__(self) -> None:
        self.log = io.BytesIO()
        self.stock = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.esc = esc.MAVLink(None, srcSystem=1, srcComponent=1)

    def send(self, t: float, message: object) -> None:
        """Append one message at vehicle time `t` [s]; the link takes 4 ms."""
        link = self.esc if isinstance(message, esc.MAVLink_message) else self.stock
        frame = message.pack(link)  # type: ignore[attr-defined]
        link.seq = self.stock.seq = self.esc.seq = (link.seq + 1) % 256
        self.log.write(struct.pack(">Q", BOOT_UNIX_US + round((t + 0.004) * 1e6)) + frame)

    def parameters(self, t: float) -> None:
        """Send the geometry as PX4 does: integers bit-cast into the float."""
        values: list[tuple[str, float, bool]] = [("CA_AIRFRAME", 0, True), ("CA_ROTOR_COUNT", 4, True)]
        for i, (x, y, spin) in enumerate(LAYOUT):
            values += [(f"CA_ROTOR{i}_PX", x, False), (f"CA_ROTOR{i}_PY", y, False)]
            values += [(f"CA_ROTOR{i}_PZ", 0.0, False), (f"CA_ROTOR{i}_KM", 0.05 * spin, False)]
        for k, (name, value, integer) in enumerate(values):
            wire = struct.unpack("<f", struct.pack("<i", int(value)))[0] if integer else value
            kind = mavlink.MAV_PARAM_TYPE_INT32 if integer else mavlink.MAV_PARAM_TYPE_REAL32
            message = mavlink.MAVLink_param_value_message(name.encode(), wire, kind, len(values), k)
            self.send(t + 0.002 * k, message)


def fly(seed: int, motor: int, lost_at: float, duration: float) -> bytes:
    """Fly and return the log's bytes."""
    rng = np.random.default_rng(seed)
    vehicle, radio = Quadrotor(rng), Telemetry()
    target = np.zeros(3)
    radio.parameters(0.2)
    phase = rng.uniform(0, 2 * math.pi, 4)
    unbalance = rng.uniform(0.2, 0.5, 4)  # m/s² at hover
    for k in range(round(duration / STEP)):
        t = 1.0 + k * STEP  # boot time; the radio comes up a second after boot
        flight = t - 1.0
        if k % round(STEPS_EVERY / STEP) == 0 and flight > TAKEOFF + 2:
            target = np.append(rng.uniform(-0.12, 0.12, 2), 0.0)
        if flight >= lost_at and vehicle.lost is None:
            vehicle.lost = motor - 1
        wanted = vehicle.command(flight, target, 15.0)
        vehicle.step(wanted)
        phase += STEP * vehicle.speed
        stamp = round(t * 1e6)
        if k % 10 == 0:
            shake = unbalance * (vehicle.speed / 570.0) ** 2
            force = vehicle.specific_force + rng.normal(0, 0.15, 3)
            force[:2] += [float(shake @ np.cos(phase)), float(shake @ np.sin(phase))]
            rates = vehicle.rates + rng.normal(0, 0.01, 3)
            radio.send(
                t,
                mavlink.MAVLink_highres_imu_message(
                    stamp, *force, *rates, 0.2, 0.0, 0.4, 1013.2, 0.0, 15.0, 25.0, 0b111111, 0
                ),
            )
        if k % 20 == 5:
            rpm = np.round((vehicle.speed + rng.normal(0, 1.0, 4)) * 30 / math.pi).astype(int)
            drive = np.where(np.arange(4) == vehicle.lost, 0.1, 1.0)
            current = drive * 2.4e-8 * vehicle.speed**3
            radio.send(
                t, esc.MAVLink_esc_status_message(0, stamp, rpm.tolist(), [15.6] * 4, current.tolist())
            )
        if k % 1000 == 0:
            armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED | mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
            radio.send(
                t,
                mavlink.MAVLink_heartbeat_message(
                    mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_PX4, armed, 3 << 16, 4, 3
                ),
            )
            landed = 2 if flight > TAKEOFF + 0.3 else 1
            radio.send(t, mavlink.MAVLink_extended_sys_state_message(0, landed))
        if k % 100 == 50:
            radio.send(t, mavlink.MAVLink_attitude_message(stamp // 1000, *vehicle.attitude, *vehicle.rates))
    return radio.log.getvalue()


def main() -> None:
    """Write the flight and its truth."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", nargs="?", type=Path, default=Path(__file__).with_name("lost_propeller.tlog"))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--motor", type=int, default=3, help="whose propeller leaves, the autopilot's number")
    parser.add_argument("--lost-at", type=float, default=12.0, help="seconds from the first record")
    parser.add_argument("--duration", type=float, default=13.0, help="seconds")
    args = parser.parse_args()
    args.out.write_bytes(fly(args.seed, args.motor, args.lost_at, args.duration))
    truth = {
        "file": args.out.name,
        "made_by": f"replay/{Path(__file__).name} --seed {args.seed}",
        "vehicle": "simulated quadrotor X, 1.2 kg, PX4 numbering",
        "truth": {
            "condition": "fault",
            "fault": "propeller lost",
            "motor": args.motor,
            "lost_at_vehicle_s": 1.0 + args.lost_at,
        },
    }
    args.out.with_suffix(".truth.json").write_text(json.dumps(truth, indent=2) + "\n")


if __name__ == "__main__":
    main()
