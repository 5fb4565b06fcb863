"""The simulated vehicle: a TOML file under `gcs_health.simvehicle/1`, every number in SI.

Rotors sit as the vehicle file of the monitor has them; mass, inertia, motor and propeller are the truth
that the estimators must find. Errors name file and key.
"""

import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from gcs_health.airframe import Airframe, AirframeSource, Effectiveness, Rotor
from gcs_health.checked import Table
from gcs_health.errors import ConfigError
from gcs_health.gate import GRAVITY

SCHEMA = "gcs_health.simvehicle/1"
LEAST_LIFT = 1.2  # of the weight that all rotors at full speed must lift


@dataclass(frozen=True, slots=True)
class Motor:
    """One motor with its ESC, and the propeller on it.

    Attributes
    ----------
    thrust : kappa_T [N s²].
    torque : kappa_tau [N m s²].
    friction : kappa_f [N m s].
    torque_constant : kappa_q [N m/A], which is kappa_e [V s/rad] too.
    resistance : R [Ohm].
    inertia : of rotor and propeller, J [kg m²].
    bare_inertia : what is left of J without the propeller [-].
    bandwidth : of the ESC's speed loop [1/s].
    current_limit, brake_limit : of the ESC [A].
    idle, top : lowest and highest commanded speed [rad/s].
    inflow : thrust lost per advance ratio v_axial / (omega r) [-].
    drag : in-plane force per speed and air speed [N s²/m/rad].
    blade_pass : vertical force at twice the speed, share of thrust [-].
    """

    thrust: float
    torque: float
    inertia: float
    torque_constant: float
    resistance: float
    friction: float = 0.0
    bare_inertia: float = 0.3
    bandwidth: float = 35.0
    current_limit: float = 40.0
    brake_limit: float = 10.0
    idle: float = 100.0
    top: float = 1000.0
    inflow: float = 1.5
    drag: float = 0.0
    blade_pass: float = 0.02


@dataclass(frozen=True, slots=True)
class Battery:
    """Open-circuit voltage falls with the charge used, linearly, and sags with the current.

    voltage [V] full, empty_voltage [V], resistance [Ohm], capacity [A h].
    """

    voltage: float
    empty_voltage: float
    resistance: float
    capacity: float


@dataclass(frozen=True, slots=True)
class Boom:
    """Clamped boom with a tip mass, two out-of-plane bending modes (sheet 4, `boom.py`).

    length [m], stiffness EI [N m²], line_mass [kg/m], tip_mass [kg], damping ratio [-].
    """

    length: float
    stiffness: float
    line_mass: float
    tip_mass: float
    damping: float = 0.01


@dataclass(frozen=True, slots=True)
class SimVehicle:
    """The truth about one airframe; rotors in order of motor number."""

    name: str
    mass: float  # [kg]
    inertia: tuple[float, float, float]  # [kg m²]
    rotors: tuple[Rotor, ...]
    motor: Motor
    battery: Battery
    drag_area: float = 0.01  # C_d A [m²]
    lever: tuple[float, float, float] = (0.0, 0.0, 0.0)  # IMU from the centre of mass [m]
    leg: float = 0.08  # feet below the centre of mass [m]
    px4_airframe: int = 0  # SYS_AUTOSTART
    ardupilot_frame: tuple[int, int] = (0, 0)  # FRAME_CLASS, FRAME_TYPE; 0 = none fits
    boom: Boom | None = None

    @property
    def hover(self) -> float:
        """Rotor speed in hover [rad/s]."""
        return float((self.mass * GRAVITY / (len(self.rotors) * self.motor.thrust)) ** 0.5)

    @property
    def mav_type(self) -> int:
        """MAV_TYPE by rotor count."""
        return {3: 15, 4: 2, 6: 13, 8: 14, 10: 35, 12: 29}.get(len(self.rotors), 43)

    def airframe(self) -> Airframe:
        """Return what the monitor would be told: geometry and the true effectiveness."""
        reach_x = max(abs(rotor.position[0]) for rotor in self.rotors)
        reach_y = max(abs(rotor.position[1]) for rotor in self.rotors)
        m = self.motor
        return Airframe(
            self.name,
            self.rotors,
            AirframeSource.FILE,
            mass=self.mass,
            inertia=self.inertia,
            effectiveness=Effectiveness(
                roll=m.thrust * reach_y / self.inertia[0],
                pitch=m.thrust * reach_x / self.inertia[1],
                yaw=m.torque / self.inertia[2],
                yaw_inertia=m.inertia / self.inertia[2],
                thrust=m.thrust / self.mass,
            ),
        )


def shipped() -> dict[str, str]:
    """Return the names of the vehicles that come with the package, and their sentences."""
    folder = resources.files("gcs_health.simulate") / "vehicles"
    found = {}
    for file in sorted(folder.iterdir(), key=lambda item: item.name):
        if file.name.endswith(".toml"):
            found[file.name.removesuffix(".toml")] = tomllib.loads(file.read_text("utf-8"))["name"]
    return found


def load_sim_vehicle(which: str, beside: Path | None = None) -> SimVehicle:
    """Read a vehicle by shipped name, or by path (relative to the file that names it, `beside`).

    Raises
    ------
    ConfigError : one line: "quad.toml: mass: expected a number above 0, got -1".
    """
    if which in shipped():
        file = resources.files("gcs_health.simulate") / "vehicles" / f"{which}.toml"
        return _vehicle(Table.parsed(file.read_text("utf-8"), f"{which}.toml"))
    path = (beside.parent if beside else Path()) / which
    if path.suffix != ".toml":
        names = ", ".join(shipped())
        raise ConfigError(f"vehicle {which!r} is neither a .toml file nor one of {names}")
    return _vehicle(Table.read(path))


def _vehicle(table: Table) -> SimVehicle:
    table.schema(SCHEMA)
    rotors = tuple(_rotor(row) for row in table.tables("rotor", 3, 12))
    for k, rotor in enumerate(rotors):
        if rotor.motor != k + 1:
            table.fail(f"rotor[{k}].motor", f"expected {k + 1}: rotors in order of motor number")
    frame = table.numbers("ardupilot_frame", 2, default=(0.0, 0.0))
    vehicle = SimVehicle(
        name=table.text("name"),
        mass=table.positive("mass"),
        inertia=table.vector("inertia", positive=True),
        rotors=rotors,
        motor=table.record("motor", Motor),
        battery=table.record("battery", Battery),
        drag_area=table.number("drag_area", 0.01, least=0.0),
        lever=table.vector("lever", default=(0.0, 0.0, 0.0)),
        leg=table.positive("leg", 0.08),
        px4_airframe=table.integer("px4_airframe", 0),
        ardupilot_frame=(int(frame[0]), int(frame[1])),
        boom=table.record("boom", Boom) if "boom" in table else None,
    )
    table.done()
    lift = len(rotors) * vehicle.motor.thrust * vehicle.motor.top**2
    if lift < LEAST_LIFT * vehicle.mass * GRAVITY:
        table.fail(
            "motor.top", f"all rotors at {vehicle.motor.top} rad/s lift {lift:.1f} N: too little to fly"
        )
    return vehicle


def _rotor(row: Table) -> Rotor:
    spins: dict[str, Any] = {"ccw": 1, "cw": -1}
    motor = row.integer("motor", least=1)
    rotor = Rotor(
        motor=motor,
        esc=row.integer("esc", motor - 1),
        position=row.vector("position"),
        spin=spins[row.choice("spin", tuple(spins))],
        radius=row.positive("radius", 0.1),
    )
    row.done()
    return rotor
