"""Snapshots made by hand, the same every time: what the screen is tested on."""

import math
from dataclasses import replace

from gcs_health.balance import figures, words
from gcs_health.dashboard.snapshot import (
    NAN,
    TRAIL,
    Entry,
    Figure,
    Level,
    LinkShot,
    NeedShot,
    ReplayShot,
    RotorShot,
    Row,
    Snapshot,
    VehicleShot,
)

T = 252.0  # s, the vehicle's clock
US = 1_780_000_000_000_000

# forward, right, down [m], spin, by motor; PX4's numbering
X = math.sqrt(0.5)
QUAD = ((X, X, 0, 1), (-X, -X, 0, 1), (X, -X, 0, -1), (-X, X, 0, -1))
HEXA = tuple(
    (math.cos(math.radians(a)), math.sin(math.radians(a)), 0.0, s)
    for a, s in ((90, -1), (-90, 1), (-30, -1), (150, 1), (30, 1), (-150, -1))
)
OCTA = tuple(
    (math.cos(math.radians(a)), math.sin(math.radians(a)), 0.0, -1 if k in (0, 1, 6, 7) else 1)
    for k, a in enumerate((22.5, -157.5, 67.5, 157.5, -22.5, -112.5, -67.5, 112.5))
)
COAX = tuple(
    (x, y, z, s if z < 0 else -s)
    for x, y, s in ((X, X, 1), (X, -X, -1), (-X, -X, 1), (-X, X, -1))
    for z in (-0.1, 0.1)
)
SEATS = {1: "CCW", -1: "CW"}
FRAMES = {"quad": QUAD, "hexa": HEXA, "octa": OCTA, "coax": COAX}


def seat(x: float, y: float, spin: int) -> str:
    along = "front" if x > 0.34 else "rear" if x < -0.34 else ""
    across = "right" if y > 0.34 else "left" if y < -0.34 else ""
    return f"{along} {across}, {SEATS[spin]}".strip()


def rotor(motor: int, place: tuple[float, float, float, int], level: Level = Level.OK) -> RotorShot:
    x, y, z, spin = place
    failed, unknown = level is Level.FAILED, level is Level.UNKNOWN
    why = "the last rotor speed is too old" if unknown else ""
    value = NAN if unknown else 0.03 if failed else 0.97 + 0.01 * (motor % 4)
    thrust = Figure(
        "effectiveness",
        "effectiveness",
        value,
        NAN if unknown else 0.03,
        0.97 if failed else 0.001,
        "valid",
        why,
        NAN if unknown else 0.18,
    )
    shaking = Figure("unbalance", "unbalance", 3.1e-6 + 1e-7 * motor, 4e-7, 0.01, "valid", "", 9e-6, (), 2e-8)
    shaking = replace(shaking, balance=words(figures(shaking.value, 0.12, 0.012, 520.0)))
    if motor in (1, 3):
        shaking = replace(
            shaking,
            value=NAN,
            balance="",
            together=(1, 3),
            why="not identifiable: which rotor it is cannot be told",
        )
    drag = Figure(
        "motor_observer", "drag", NAN, NAN, NAN, "unobservable", "no motor currents in the stream", NAN
    )
    trail = [NAN] * 10 + [0.01] * (TRAIL - 10)
    if failed:
        trail[-4:] = [0.3, 0.9, 0.97, 0.97]
    if unknown:
        trail[-3:] = [NAN] * 3
    return RotorShot(
        motor=motor,
        seat=seat(x, y, spin),
        position=(x, y, z),
        spin=spin,
        level=level,
        state={
            Level.FAILED: "propeller lost",
            Level.UNKNOWN: "unknown",
            Level.WARN: "propeller unbalanced",
        }.get(level, "healthy"),
        probability=0.97 if level > Level.OK else 0.99,
        since=249.4 if failed else 60.0,
        why=why,
        sources=("effectiveness", "motor_observer") if failed else (),
        posterior=(("healthy", 0.02 if failed else 0.99), ("propeller lost", 0.97 if failed else 0.003)),
        figures=(thrust, shaking, drag),
        speed=NAN if unknown else 1089.0 if failed else 755.0 + 7.0 * motor,
        current=NAN if unknown else 0.6 if failed else 4.0 + 0.1 * motor,
        voltage=15.8,
        temperature_degc=31.0 + motor,
        telemetry="stale" if unknown else "fresh",
        age=5.2 if unknown else 0.02,
        trail=tuple(trail),
    )


def rows(n: int, failed: int = -1, at: float = 249.4) -> tuple[Row, ...]:
    """The last minute: hover with a slow sway; rotor index `failed` loses its propeller at `at`."""
    out = []
    for k in range(620):
        t = T - 62.0 + 0.1 * (k + 1)
        lost = failed >= 0 and t >= at
        sway = [30.0 * math.sin(0.5 * t + i) for i in range(n)]
        out.append(
            Row(
                t,
                tuple(0.97 if lost and i == failed else 0.01 for i in range(n)),
                tuple(0.03 if lost and i == failed else 1.0 + 0.0005 * sway[i] for i in range(n)),
                tuple(1089.0 if lost and i == failed else 760.0 + sway[i] for i in range(n)),
                tuple(0.6 if lost and i == failed else 4.2 + 0.01 * sway[i] for i in range(n)),
                9.8 - (2.2 if lost else 0.0) + 0.2 * math.sin(3.0 * t),
                9.8 + 0.1 * math.sin(3.0 * t),
            )
        )
    return tuple(out)


NEEDS = (
    NeedShot("effectiveness", "accelerations and rates", 50.0, 50.0, True, ""),
    NeedShot("effectiveness", "rotor speeds", 9.0, 10.0, True, ""),
    NeedShot(
        "motor_observer",
        "motor currents",
        0.0,
        50.0,
        False,
        "the ESCs must measure it and report: DSHOT_TEL_CFG",
    ),
)
NOTES = (
    Entry(
        "note-3",
        "1.1",
        192.0,
        US - 60_000_000,
        "notice",
        5,
        "notice",
        "only 9.0 Hz of rotor speeds in the stream",
    ),
    Entry(
        "note-2", "1.1", 41.7, US - 210_000_000, "notice", 6, "airframe", "airframe quad_x from parameters"
    ),
    Entry("note-1", "1.1", 41.0, US - 211_000_000, "notice", 6, "seen", "vehicle 1.1 seen"),
)


def alert(motor: int, trace: tuple[Row, ...] = (), vehicle: str = "1.1") -> Entry:
    return Entry(
        f"{vehicle}-1",
        vehicle,
        249.4,
        US - 2_600_000,
        "alert",
        1,
        "PROPELLER_LOST",
        f"motor {motor} (front right, CCW): propeller lost, 97 % sure",
        motor,
        Level.FAILED,
        0.97,
        True,
        steps=((249.4, "raised"), (250.1, "escalated PROPELLER_LOST")),
        figures=(
            ("effectiveness.llr", "182"),
            ("effectiveness.speed_ratio", "1.431"),
            ("esc_info.failure_flags", "0.000"),
        ),
        advice="Land at once if control allows; do not take off again before the rotor is inspected.",
        words=((250.2, "autopilot: Motor 1 failure detected (as we say)"),),
        trace=trace,
    )


def vehicle(frame: str, levels: dict[int, Level] | None = None, name: str = "1.1") -> VehicleShot:
    places = FRAMES[frame]
    levels = levels or {}
    failed = next((k for k in range(len(places)) if levels.get(k + 1) is Level.FAILED), -1)
    return VehicleShot(
        name=name,
        title=f"PX4 {frame} X",
        mode="POSCTL",
        armed=True,
        landed=False,
        t=T,
        us=US,
        silent=0.0,
        since=T - 252.0 + 0.4,
        rotors=tuple(rotor(k + 1, place, levels.get(k + 1, Level.OK)) for k, place in enumerate(places)),
        airframe=f"{frame}_x from parameters",
        clock=("the axis is the vehicle's time since boot; arrival jitter 2.0 ms",),
        imu="HIGHRES_IMU sensor 0 at 50 Hz",
        imu_rate=50.0,
        telemetry=("PX4 ESC_STATUS: from one batch of four its generation cannot be told",),
        needs=NEEDS,
        sources=("udpin://0.0.0.0:14550 127.0.0.1:4000",),
        requests="ESC_STATUS 10 Hz, its parameters",
        messages=(("HEARTBEAT", 1.0), ("HIGHRES_IMU", 50.0), ("ESC_STATUS", 9.1)),
        loss=0.008,
        blind=tuple((12.0 * (k + 1), abs(math.sin(math.pi * 12.0 * (k + 1) / 314.0))) for k in range(96)),
        rows=rows(len(places), failed),
    )


def healthy(frame: str = "quad") -> Snapshot:
    link = LinkShot(
        (("bytes", 120_000), ("frames", 3000), ("unsigned", 3000)),
        ("/flights/a.tlog",),
        12_000_000,
        ("udpin://0.0.0.0:14550",),
    )
    return Snapshot(US, (vehicle(frame),), NOTES, link, None, "", "")


def failing(frame: str = "quad", motor: int = 1) -> Snapshot:
    craft = vehicle(frame, {motor: Level.FAILED})
    trace = tuple(row for row in craft.rows if row.t > 229.4)
    return replace(healthy(frame), vehicles=(craft,), entries=(alert(motor, trace), *NOTES))


def blind(frame: str = "quad") -> Snapshot:
    levels = {k + 1: Level.UNKNOWN for k in range(len(FRAMES[frame]))}
    return replace(healthy(frame), vehicles=(vehicle(frame, levels),))


def silent(frame: str = "quad", seconds: float = 7.0) -> Snapshot:
    craft = blind(frame).vehicles[0]
    return replace(healthy(frame), vehicles=(replace(craft, silent=seconds),))


def replayed(frame: str = "quad") -> Snapshot:
    shown = failing(frame)
    start = US - 252_000_000
    replay = ReplayShot(
        "flight.tlog", start, US + 60_000_000, US, False, False, 0.5, 1.0,
        ((US - 2_600_000, 1), (US + 30_000_000, 4)), ((start + 3_000_000, True), (US + 58_000_000, False)),
    )  # fmt: skip
    return replace(shown, replay=replay)


def two() -> Snapshot:
    other = replace(vehicle("hexa", {4: Level.FAILED}, "2.1"), title="ArduPilot hexa X", mode="LOITER")
    return replace(healthy(), vehicles=(vehicle("quad"), other), entries=(alert(4, vehicle="2.1"), *NOTES))


SCENES = {"healthy": healthy, "failing": failing, "blind": blind, "replay": replayed}
