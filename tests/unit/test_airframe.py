"""Airframes from tables, parameters and guesses."""

import struct
from pathlib import Path

import pytest

from gcs_health.airframe import Airframe, AirframeSource, Rotor
from gcs_health.airframe_parameters import AirframeParameters
from gcs_health.airframe_tables import ardupilot_frame, assume_airframe, px4_frame
from gcs_health.samples import Parameter

INT32, REAL32, INT8 = 6, 9, 2


def parameter(name: str, value: float, kind: int = REAL32, bitwise: bool = False) -> Parameter:
    wire = struct.unpack("<f", struct.pack("<i", int(value)))[0] if bitwise else value
    bits = struct.unpack("<i", struct.pack("<f", wire))[0]
    return Parameter(1, 1, 22, 0, None, name, wire, bits, kind, 0, 0)


def collect(*samples: Parameter) -> Airframe | None:
    parameters = AirframeParameters()
    for sample in samples:
        parameters.feed(sample)
    return parameters.airframe()


def px4_quad(bitwise: bool) -> list[Parameter]:
    rows = ((0.1, 0.2, 0.05), (-0.1, -0.2, 0.05), (0.1, -0.2, -0.05), (-0.1, 0.2, -0.05))
    samples = [parameter("CA_ROTOR_COUNT", 4, INT32, bitwise)]
    for n, (x, y, km) in enumerate(rows):
        for key, value in (("PX", x), ("PY", y), ("PZ", -0.03), ("KM", km)):
            samples.append(parameter(f"CA_ROTOR{n}_{key}", value))
    return samples


@pytest.mark.parametrize("bitwise", [True, False])
def test_px4_geometry_whichever_way_its_integers_come(bitwise: bool) -> None:
    airframe = collect(*reversed(px4_quad(bitwise)))
    assert airframe is not None
    assert airframe.source is AirframeSource.PARAMETERS
    assert airframe.metric
    assert [r.spin for r in airframe.rotors] == [1, 1, -1, -1]
    assert airframe.rotors[2].position == pytest.approx((0.1, -0.2, -0.03))
    assert [airframe.seat(k) for k in range(4)] == [
        "front right, CCW",
        "rear left, CCW",
        "front left, CW",
        "rear right, CW",
    ]


def test_px4_geometry_waits_until_it_is_whole() -> None:
    samples = px4_quad(True)
    assert collect(*samples[:-1]) is None
    assert collect(*samples) is not None


def test_a_tilted_rotor_is_told() -> None:
    airframe = collect(*px4_quad(True), parameter("CA_ROTOR1_AX", 0.5), parameter("CA_ROTOR1_AZ", -0.866))
    assert airframe is not None
    assert airframe.warnings == ("motor 2 is tilted: treated as upright",)


def test_px4_autostart_is_the_last_resort() -> None:
    airframe = collect(parameter("SYS_AUTOSTART", 6001, INT32, True))
    assert airframe is not None
    assert len(airframe.rotors) == 6
    assert "CA_ROTOR parameters not heard" in airframe.warnings[0]
    assert collect(parameter("SYS_AUTOSTART", 2100, INT32, True)) is None


def test_ardupilot_frame_with_outputs_moved() -> None:
    airframe = collect(
        parameter("FRAME_CLASS", 1, INT8),
        parameter("FRAME_TYPE", 1, INT8),
        parameter("SERVO9_FUNCTION", 33),
        parameter("SERVO10_FUNCTION", 34),
        parameter("SERVO11_FUNCTION", 35),
        parameter("SERVO12_FUNCTION", 36),
    )
    assert airframe is not None
    assert [(r.motor, r.esc) for r in airframe.rotors] == [(1, 8), (2, 9), (3, 10), (4, 11)]
    assert not airframe.metric
    assert airframe.seat(0) == "front right, CCW"


def test_ardupilot_coaxial_octo_tells_its_layers() -> None:
    airframe = collect(parameter("FRAME_CLASS", 4, INT8), parameter("FRAME_TYPE", 1, INT8))
    assert airframe is not None
    seats = {airframe.seat(k) for k in range(8)}
    assert len(seats) == 8
    assert "front right top, CCW" in seats
    assert "front right bottom, CW" in seats


def test_an_unknown_frame_is_no_airframe() -> None:
    assert collect(parameter("FRAME_CLASS", 6, INT8), parameter("FRAME_TYPE", 0, INT8)) is None
    assert ardupilot_frame(1, 99) is None


def test_a_class_with_a_catch_all_row_takes_any_type() -> None:
    assert ardupilot_frame(5, 3) == ardupilot_frame(5, 1)
    assert ardupilot_frame(5, 10) != ardupilot_frame(5, 1)


def test_every_frame_balances() -> None:
    """Equal thrusts give no moment about the arms' centre in x, y; spins add to zero where all are known."""
    for frame_class in (1, 2, 3, 4, 5, 12, 14):
        for frame_type in range(20):
            found = ardupilot_frame(frame_class, frame_type)
            if found is None:
                continue
            name, rotors = found
            assert [r.motor for r in rotors] == list(range(1, len(rotors) + 1)), name
            assert sum(r.position[1] for r in rotors) == pytest.approx(0.0, abs=0.02), name
            if all(r.spin for r in rotors):
                assert sum(r.spin for r in rotors) == 0, name


def test_the_tables_agree_with_the_published_ones() -> None:
    import tomllib

    folder = Path(__file__).parents[2].parent / "shared" / "data-tables"
    if not folder.is_dir():
        pytest.skip("the published frame tables are not beside this checkout")
    frames = tomllib.loads((folder / "ardupilot_frames.toml").read_text())["frame"]
    assert len(frames) > 30
    for frame in frames:
        found = ardupilot_frame(frame["frame_class"], frame["frame_type"])
        assert found is not None
        for rotor, motor in zip(found[1], frame["motors"], strict=True):
            assert rotor.position[:2] == (motor["x"], motor["y"])
            assert rotor.spin == {"CCW": 1, "CW": -1, "none": 0}[motor["spin"]]
    for frame in tomllib.loads((folder / "px4_frames.toml").read_text())["frame"]:
        px4 = px4_frame(frame["sys_autostart"])
        assert px4 is not None
        for rotor, motor in zip(px4[1], frame["rotors"], strict=True):
            assert rotor.position[:2] == (motor["x"], motor["y"])


@pytest.mark.parametrize(
    ("count", "kind", "rotors"), [(0, 2, 4), (4, 2, 4), (0, 13, 6), (8, None, 8), (0, 14, 8)]
)
def test_a_guess_says_that_it_is_one(count: int, kind: int | None, rotors: int) -> None:
    airframe = assume_airframe(count, kind)
    assert airframe is not None
    assert airframe.source is AirframeSource.ASSUMED
    assert len(airframe.rotors) == rotors
    assert "assumed" in airframe.warnings[0]
    assert "--vehicle" in airframe.warnings[0]


def test_nothing_to_guess_from_is_no_airframe() -> None:
    assert assume_airframe(0, None) is None
    assert assume_airframe(5, 43) is None


def test_a_seat_in_the_middle_has_a_name() -> None:
    rotors = tuple(
        Rotor(k + 1, k, p, 0) for k, p in enumerate([(1.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-1.0, 1.0, 0.0)])
    )
    airframe = Airframe("odd", rotors, AirframeSource.FILE)
    assert [airframe.seat(k) for k in range(3)] == [
        "front, spin unknown",
        "middle, spin unknown",
        "rear right, spin unknown",
    ]
