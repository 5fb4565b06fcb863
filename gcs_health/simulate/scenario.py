"""A scenario: vehicle, flight, wind, faults, sensors, link and seed, in a small TOML.

Everything has a default but the vehicle; unknown keys, faults before take-off and rotors that are not
there get one line that names file and key. `--set wind.speed=5` edits a value before it is checked.
"""

import math
import tomllib
from dataclasses import dataclass, field, fields
from importlib import resources
from pathlib import Path
from typing import Any

from gcs_health.checked import Table
from gcs_health.errors import ConfigError
from gcs_health.gate import GRAVITY
from gcs_health.simulate.faults import KINDS, Fault
from gcs_health.simulate.payload import Payload
from gcs_health.simulate.sensors import SensorConfig
from gcs_health.simulate.stream_rates import RATES
from gcs_health.simulate.trajectory import KINDS as TRAJECTORIES
from gcs_health.simulate.trajectory import Trajectory
from gcs_health.simulate.vehicle import LEAST_LIFT, SimVehicle, load_sim_vehicle
from gcs_health.simulate.wind import GRADES

SCHEMA = "gcs_health.scenario/1"
FASTEST_PHYSICS = 20_000.0  # Hz; finer steps cost time and show nothing new
LONGEST = 86_400.0  # s of flight
SHARES = ("loss", "burst_loss", "reorder", "duplicate")
ABOVE_0 = (
    *("imu_integration_rate", "imu_filter", "accelerometer_range", "gyro_range"),
    *("esc_rate", "esc_rpm_step", "esc_current_step"),
)
AUTOPILOTS = ("px4", "px4_g1", "px4_g2", "px4_g3", "ardupilot")


@dataclass(frozen=True, slots=True)
class Wind:
    """Mean wind [m/s] from `direction` [deg, 0 = from north], grade of turbulence, strength of the own wake [-]."""

    speed: float = 0.0
    direction: float = 0.0
    turbulence: str = "low"
    wake: float = 0.0


@dataclass(frozen=True, slots=True)
class Link:
    """What the way to the ground does to frames.

    delay, jitter [s]; loss, burst_loss (share of frames lost in bursts of `burst` frames); reorder and
    duplicate (share of frames); second_system : another healthy vehicle, system 7, flies and speaks on the
    same port.
    """

    delay: float = 0.004
    jitter: float = 0.0
    loss: float = 0.0
    burst_loss: float = 0.0
    burst: float = 10.0
    reorder: float = 0.0
    duplicate: float = 0.0
    second_system: bool = False


@dataclass(frozen=True, slots=True)
class Spread:
    """How much each flight's vehicle differs from the file, standard deviations [-]."""

    mass: float = 0.02
    thrust: float = 0.03
    inertia: float = 0.05
    rotor: float = 0.02  # between the rotors of one vehicle


@dataclass(frozen=True, slots=True)
class Telemetry:
    """How it speaks: autopilot, rates by message name [Hz] over its defaults.

    requested : a ground station has asked ArduPilot for its usual streams; else it sends its HEARTBEAT
    alone until one does.
    """

    autopilot: str = "px4"
    requested: bool = True
    rates: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Scenario:
    """A flight to be simulated; the same values and seed give the same bytes."""

    vehicle: SimVehicle
    name: str = "scenario"
    about: str = ""
    seed: int = 1
    physics_rate: float = 1000.0
    reaction: float = 0.15  # s until the controller knows that a rotor is lost; on six rotors and more
    trajectory: Trajectory = field(default_factory=Trajectory)
    wind: Wind = field(default_factory=Wind)
    payload: Payload = field(default_factory=Payload)
    faults: tuple[Fault, ...] = ()
    sensors: SensorConfig = field(default_factory=SensorConfig)
    link: Link = field(default_factory=Link)
    spread: Spread = field(default_factory=Spread)
    telemetry: Telemetry = field(default_factory=Telemetry)


def shipped() -> dict[str, str]:
    """Return the names of the scenarios that come with the package, and a sentence each."""
    folder = resources.files("gcs_health.simulate") / "scenarios"
    found = {}
    for file in sorted(folder.iterdir(), key=lambda item: item.name):
        if file.name.endswith(".toml"):
            found[file.name.removesuffix(".toml")] = tomllib.loads(file.read_text("utf-8"))["about"]
    return found


def load_scenario(which: str, changes: list[str] | None = None) -> Scenario:
    """Read a scenario by shipped name or path, with `--set` changes "key.key=value".

    Raises
    ------
    ConfigError : one line that names file and key.
    """
    names = shipped()
    path = None
    if which in names:
        text = (resources.files("gcs_health.simulate") / "scenarios" / f"{which}.toml").read_text("utf-8")
        file = f"{which}.toml"
    else:
        path = Path(which)
        if path.suffix != ".toml" and not path.exists():
            raise ConfigError(f"scenario {which!r} is neither a file nor one of {', '.join(names)}")
        Table.read(path)  # complains of what cannot be read or parsed
        text, file = path.read_text("utf-8"), str(path)
    values = tomllib.loads(text)
    for change in changes or []:
        _change(values, change)
    return _scenario(Table(values, file), which, path)


def _change(values: dict[str, Any], change: str) -> None:
    """Apply one "key.key=value"; the value is TOML, or text where it is not. `fault.0.at` is the first's."""
    key, equals, text = change.partition("=")
    if not equals or not key.strip():
        raise ConfigError(f"--set {change}: expected key=value, as in wind.speed=5")
    try:
        value = tomllib.loads(f"v = {text}")["v"]
    except tomllib.TOMLDecodeError:
        value = text
    *path, last = key.strip().split(".")
    at: Any = values
    for part in path:
        if isinstance(at, list):
            if not part.isdigit() or int(part) >= len(at):
                raise ConfigError(f"--set {change}: there is no {part!r}: {len(at)} are listed, from 0")
            at = at[int(part)]
        else:
            at = at.setdefault(part, {})
        if not isinstance(at, dict | list):
            raise ConfigError(f"--set {change}: {part!r} is not a table")
    if isinstance(at, list):
        raise ConfigError(f"--set {change}: say which one, as in {'.'.join([*path, '0', last])}")
    at[last] = value


def _scenario(table: Table, which: str, path: Path | None) -> Scenario:
    table.schema(SCHEMA)
    vehicle = load_sim_vehicle(table.text("vehicle"), path)
    trajectory = _trajectory(table.table("trajectory"))
    scenario = Scenario(
        vehicle=vehicle,
        name=path.stem if path else table.text("name", which),
        about=table.text("about", ""),
        seed=table.integer("seed", 1),
        physics_rate=table.number("physics_rate", 1000.0, least=500.0, most=FASTEST_PHYSICS),
        reaction=table.number("reaction", 0.15, least=0.0),
        trajectory=trajectory,
        wind=_wind(table.table("wind")),
        payload=_payload(table.table("payload"), vehicle, trajectory),
        faults=tuple(_fault(row, vehicle, trajectory) for row in table.tables("fault")),
        sensors=_numbers(table.table("sensors"), SensorConfig, {"esc_current": ("motor", "battery")}),
        link=_numbers(table.table("link"), Link, {}),
        spread=_numbers(table.table("spread"), Spread, {}),
        telemetry=_telemetry(table.table("telemetry")),
    )
    table.value("name", "")
    table.done()
    return scenario


def _trajectory(row: Table) -> Trajectory:
    d = Trajectory()
    plan = Trajectory(
        kind=row.choice("kind", TRAJECTORIES, d.kind),
        height=row.positive("height", d.height),
        speed=row.number("speed", d.speed, least=0.0),
        radius=row.positive("radius", d.radius),
        every=row.positive("every", d.every),
        lands=row.flag("lands", d.lands),
        duration=row.positive("duration", d.duration),
    )
    row.done()
    if plan.duration > LONGEST:
        row.fail("duration", f"expected up to {LONGEST:g} s, a day, got {plan.duration:g}")
    if plan.landing_from <= plan.flying_from:
        row.fail("duration", f"{plan.duration:g} s are too short to climb to {plan.height:g} m and land")
    return plan


def _wind(row: Table) -> Wind:
    d = Wind()
    wind = Wind(
        row.number("speed", d.speed, least=0.0),
        row.number("direction", d.direction),
        row.choice("turbulence", tuple(GRADES), d.turbulence),
        row.number("wake", d.wake, least=0.0, most=0.5),
    )
    row.done()
    return wind


def _payload(row: Table, vehicle: SimVehicle, plan: Trajectory) -> Payload:
    d = Payload()
    payload = Payload(
        row.number("mass", d.mass, least=0.0),
        row.vector("position", d.position),
        row.number("dropped_at", least=0.0) if "dropped_at" in row else math.inf,
    )
    row.done()
    most = len(vehicle.rotors) * vehicle.motor.thrust * vehicle.motor.top**2 / (LEAST_LIFT * GRAVITY)
    if payload.mass + vehicle.mass > most:
        row.fail("mass", f"{vehicle.name} lifts up to {most - vehicle.mass:.2g} kg, got {payload.mass:g}")
    if payload.dropped_at < plan.flying_from:
        at = payload.dropped_at
        row.fail("dropped_at", f"{at:g} s is before the vehicle flies: from {plan.flying_from:.1f} s on")
    return payload


def _fault(row: Table, vehicle: SimVehicle, plan: Trajectory) -> Fault:
    kind = row.choice("kind", tuple(KINDS))
    motor = row.integer("motor", least=1)
    count = len(vehicle.rotors)
    if motor > count:
        row.fail("motor", f"{vehicle.name} has motors 1 to {count}, got {motor}")
    at = row.number("at", least=0.0)
    size = float("nan")
    rule = KINDS[kind]
    if rule.size:
        size = row.number("size", least=rule.low)
        if size > (count if kind == "esc_swapped" else rule.high):
            row.fail("size", f"expected {rule.size} from {rule.low:g} to {rule.high:g}, got {size:g}")
    elif "size" in row:
        row.fail("size", f"a {kind} has no size")
    ramp = row.number("ramp", 0.0, least=0.0)
    row.done()
    # from the start of the flight only what can be flown with, and what is only told
    if at < plan.flying_from and not (
        rule.telemetry or kind in ("unbalance", "bearing", "effectiveness", "slow")
    ):
        row.fail("at", f"{at:g} s is before the vehicle flies: from {plan.flying_from:.1f} s on")
    if at >= plan.duration:
        row.fail("at", f"{at:g} s is after the flight's end at {plan.duration:g} s")
    return Fault(kind, motor - 1, at, size, ramp)


def _numbers(row: Table, kind: type[Any], choices: dict[str, tuple[str, ...]]) -> Any:
    values: dict[str, Any] = {}
    for item in fields(kind):
        if item.name in choices:
            values[item.name] = row.choice(item.name, choices[item.name], item.default)
        elif isinstance(item.default, bool):
            values[item.name] = row.flag(item.name, item.default)
        elif item.name in ABOVE_0:
            values[item.name] = row.positive(item.name, item.default)
        else:
            least = 1.0 if item.name == "burst" else 0.0
            most = 1.0 if item.name in SHARES else math.inf
            values[item.name] = row.number(item.name, item.default, least, most)
    row.done()
    return kind(**values)


def _telemetry(row: Table) -> Telemetry:
    autopilot = row.choice("autopilot", AUTOPILOTS, "px4")
    rates = row.table("rates")
    known = RATES["ardupilot" if autopilot == "ardupilot" else "px4"]
    found = {name: rates.number(name, least=0.0) for name in known if name in rates}
    for name in known:
        rates.value(name, None)
    rates.done()
    requested = row.flag("requested", True)
    if not requested and autopilot != "ardupilot":
        row.fail("requested", f"{autopilot} sends its streams unasked; only ardupilot waits")
    row.done()
    return Telemetry(autopilot, requested, found)
