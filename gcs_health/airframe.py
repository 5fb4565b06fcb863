"""Where each rotor sits, which way it spins, and what one healthy rotor does to the vehicle."""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Literal


class AirframeSource(StrEnum):
    """Where the geometry came from, best first."""

    FILE = "file"  # --vehicle
    PARAMETERS = "parameters"  # PARAM_VALUE in the stream
    ASSUMED = "assumed"  # rotor count and MAV_TYPE: a guess, said so


@dataclass(frozen=True, slots=True)
class Rotor:
    """One rotor.

    Attributes
    ----------
    motor : the autopilot's number, from 1.
    esc : index in ESC telemetry, from 0.
    position : forward, right, down of the centre of mass [m], or in any one scale where the airframe
        says `metric` is False.
    spin : +1 counter-clockwise seen from above (its reaction yaws the body nose-right, about +z),
        -1 clockwise, 0 unknown.
    radius : propeller radius [m], None if unknown.
    propeller_mass : of the propeller, with what is balanced together with it [kg]; None if unknown.
    """

    motor: int
    esc: int
    position: tuple[float, float, float]
    spin: Literal[-1, 0, 1]
    radius: float | None = None
    propeller_mass: float | None = None


@dataclass(frozen=True, slots=True)
class Effectiveness:
    """What one healthy rotor's squared speed does, SI; None = identify it in flight.

    Attributes
    ----------
    roll, pitch, yaw : angular acceleration per squared speed [(rad/s²)/(rad/s)²] of a rotor at the
        airframe's largest lateral (roll) or longitudinal (pitch) arm; magnitudes, signs come from
        the geometry.
    yaw_inertia : yaw acceleration per rotor acceleration, I_r/I_z [-].
    thrust : specific force per squared speed [(m/s²)/(rad/s)²].
    """

    roll: float | None = None
    pitch: float | None = None
    yaw: float | None = None
    yaw_inertia: float | None = None
    thrust: float | None = None


@dataclass(frozen=True, slots=True)
class Motor:
    """One motor with its propeller, J w' = kappa_q i - kappa_tau w² - kappa_f w; None = identify in flight.

    Attributes
    ----------
    torque_constant : kappa_q [N m/A], which is kappa_e [V s/rad] too.
    torque : kappa_tau, drag torque of a healthy propeller [N m s²].
    friction : kappa_f [N m s].
    inertia : J, of rotor and propeller [kg m²].
    resistance : R, of motor and ESC [Ohm].
    current_side : where the ESC measures its current: "motor" (of the torque) or "battery".
    current_lag : first-order lag of the current behind the speed [s].
    """

    torque_constant: float | None = None
    torque: float | None = None
    friction: float | None = None
    inertia: float | None = None
    resistance: float | None = None
    current_side: Literal["motor", "battery"] | None = None
    current_lag: float | None = None


@dataclass(frozen=True, slots=True)
class Baseline:
    """What healthy flights of this very vehicle showed (`gcs-health calibrate`); empty or None = not known.

    Attributes
    ----------
    hover_speed [rad/s], hover_command [-] : medians in hover, in the order of the rotors.
    vibration : horizontal level of the autopilot's VIBRATION [m/s²].
    weight_offset : where the weight sits, forward and right of the rotors' centre [m].
    unbalance : m_u r_u / m_b of each rotor [m].
    vibration_level : horizontal acceleration above 35 Hz, rms [m/s²]; where no rotor speeds come.
    std : standard deviations by the names above, one a value.
    """

    hover_speed: tuple[float, ...] = ()
    hover_command: tuple[float, ...] = ()
    vibration: float | None = None
    weight_offset: tuple[float, ...] = ()
    unbalance: tuple[float, ...] = ()
    vibration_level: float | None = None
    std: tuple[tuple[str, tuple[float, ...]], ...] = ()

    def spread(self, name: str) -> tuple[float, ...]:
        """Return the standard deviations of one of them; empty if not known."""
        return dict(self.std).get(name, ())


@dataclass(frozen=True, slots=True)
class AlarmLevel:
    """Where an alarm lies, as healthy flights of this very vehicle put it (`gcs-health calibrate`).

    Attributes
    ----------
    threshold : passed by a healthy flight once in `every` [s].
    location, scale : of the Gumbel law of the largest in 10 s of healthy flight.
    """

    threshold: float
    location: float
    scale: float
    every: float


@dataclass(frozen=True, slots=True)
class HealthyVibration:
    """How this very vehicle vibrates when it is well: y[t] = sum_i a_i y[t-i] + e[t] of each signal's steps y.

    Attributes
    ----------
    rate : of the samples [Hz]. mean_over [s], cutoff [Hz] : what the accelerations had passed, NaN = nothing.
    channels : "ax" .. "r". coefficients : a_1, a_2 .. of each.
    variances : least and largest of e in the air of the healthy flights, of each [its unit²].
    alarm : level of the change, see `estimators/healthy_vibration.py`.
    """

    rate: float
    mean_over: float
    cutoff: float
    channels: tuple[str, ...]
    coefficients: tuple[tuple[float, ...], ...]
    variances: tuple[tuple[float, float], ...]
    alarm: AlarmLevel


@dataclass(frozen=True, slots=True)
class Airframe:
    """A multirotor as the estimators need it; rotors in order of `motor`."""

    name: str
    rotors: tuple[Rotor, ...]
    source: AirframeSource
    metric: bool = True
    mass: float | None = None  # [kg]
    inertia: tuple[float, float, float] | None = None  # [kg m²] about x, y, z
    effectiveness: Effectiveness = Effectiveness()
    motor: Motor = Motor()
    rotor_delay: float | None = None  # [s] to add to the stamps of rotor speeds; None = find in flight
    baseline: Baseline = Baseline()
    vibration_models: tuple[str, ...] = ()  # files of trained models of its vibration (`gcs-health train`)
    vibration_alarms: tuple[tuple[str, AlarmLevel], ...] = ()  # by a model's file name, before its own
    healthy_vibration: HealthyVibration | None = None
    warnings: tuple[str, ...] = ()

    def seat(self, rotor: int) -> str:
        """Say in words where rotor `rotor` sits and how it spins: "front right, CCW"."""
        place = self._place(rotor)
        if sum(self._place(other) == place for other in range(len(self.rotors))) > 1:
            x, y, _ = self.rotors[rotor].position
            place += f" at {math.degrees(math.atan2(y, x)):.0f}°"  # clockwise from the nose
        spin = {1: "CCW", -1: "CW", 0: "spin unknown"}[self.rotors[rotor].spin]
        return f"{place}, {spin}"

    def _place(self, rotor: int) -> str:
        x, y, z = self.rotors[rotor].position
        reach = max(math.hypot(r.position[0], r.position[1]) for r in self.rotors)
        # a third of the reach: a hexacopter's rotor at 90° is "right", one at 30° is "front right"
        along = "front" if x > reach / 3 else "rear" if x < -reach / 3 else ""
        across = "right" if y > reach / 3 else "left" if y < -reach / 3 else ""
        place = f"{along} {across}".strip() or "middle"
        heights = [r.position[2] for r in self.rotors if math.dist(r.position[:2], (x, y)) < 0.1 * reach]
        if max(heights) > min(heights):  # a V-tail's patterns share a place, with no height to tell
            place += " bottom" if z == max(heights) else " top"
        return place
