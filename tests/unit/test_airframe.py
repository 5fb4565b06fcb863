"""Airframes from tables, parameters and guesses."""

import math
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


def ardupilot_quad(*functions: tuple[int, int], offset: int = 0) -> AirframeParameters:
    parameters = AirframeParameters()
    frame = [parameter("FRAME_CLASS", 1, INT8), parameter("FRAME_TYPE", 1, INT8)]
    outputs = [parameter(f"SERVO{channel}_FUNCTION", function) for channel, function in functions]
    for sample in [*frame, *outputs, parameter("ESC_TLM_MAV_OFS", offset)]:
        parameters.feed(sample)
    return parameters


def escs(airframe: Airframe | None) -> list[int]:
    assert airframe is not None
    return [rotor.esc for rotor in airframe.rotors]


def test_ardupilot_offset_shows_high_outputs_as_low_escs() -> None:
    """AP_ESC_Telem.cpp: "A value of 4 would send ESC on output 5 as ESC number 1"."""
    parameters = ardupilot_quad((9, 33), (10, 34), (11, 35), (12, 36), offset=8)
    assert escs(parameters.airframe()) == [0, 1, 2, 3]
    assert parameters.output_channels() == {1: 8, 2: 9, 3: 10, 4: 11}


def test_ardupilot_offset_that_hides_an_esc_is_said() -> None:
    airframe = ardupilot_quad((1, 33), (2, 34), (3, 35), (4, 36), offset=2).airframe()
    assert escs(airframe) == [-2, -1, 0, 1]
    assert airframe is not None
    assert "hides" in airframe.warnings[0]


def test_ardupilot_outputs_count_once_every_motor_has_one() -> None:
    partly = ardupilot_quad((1, 36), (2, 35), (3, 34))
    airframe = partly.airframe()
    assert escs(airframe) == [0, 1, 2, 3]
    assert airframe is not None
    assert "not heard" in airframe.warnings[0]
    assert partly.output_channels() == {}
    assert partly.feed(parameter("SERVO4_FUNCTION", 33))
    whole = partly.airframe()
    assert escs(whole) == [3, 2, 1, 0]
    assert whole is not None
    assert whole.warnings == ()
    assert not partly.feed(parameter("SERVO4_FUNCTION", 33))


@pytest.mark.parametrize(("kind", "frame", "seat"), [(2, 1, "front right, CCW"), (2, 0, "right, CCW")])
def test_old_ardupilot_keeps_a_quads_frame_in_frame(kind: int, frame: int, seat: str) -> None:
    parameters = AirframeParameters()
    parameters.feed(parameter("FRAME", frame, INT8))
    airframe = parameters.airframe(kind)
    assert airframe is not None
    assert airframe.seat(0) == seat
    assert parameters.airframe() is None
    assert parameters.airframe(13) is None


def px4_outputs(bank: str, *outputs: tuple[int, int]) -> AirframeParameters:
    parameters = AirframeParameters()
    for sample in px4_quad(True):
        parameters.feed(sample)
    for number, function in outputs:
        parameters.feed(parameter(f"{bank}_FUNC{number}", function, INT32, True))
    return parameters


@pytest.mark.parametrize("bank", ["PWM_MAIN", "PWM_AUX"])
def test_px4_dshot_slots_are_ranks_among_the_used_outputs(bank: str) -> None:
    parameters = px4_outputs(bank, (1, 0), (5, 102), (6, 101), (7, 401), (8, 104), (3, 103))
    airframe = parameters.airframe()
    assert escs(airframe) == [2, 1, 0, 3]
    assert parameters.output_channels() == {1: 5, 2: 4, 3: 2, 4: 7}
    assert airframe is not None
    assert "ESC 0 motor 3, ESC 1 motor 2, ESC 2 motor 1, ESC 3 motor 4" in airframe.warnings[0]


def test_px4_can_slots_are_outputs() -> None:
    parameters = px4_outputs("UAVCAN_EC", (2, 101), (4, 102), (6, 103), (8, 104))
    assert escs(parameters.airframe()) == [1, 3, 5, 7]
    assert parameters.output_channels() == {1: 1, 2: 3, 3: 5, 4: 7}


def test_px4_dshot_in_motor_order_needs_no_warning_wherever_it_is() -> None:
    parameters = px4_outputs("PWM_AUX", (5, 101), (6, 102), (7, 103), (8, 104))
    airframe = parameters.airframe()
    assert escs(airframe) == [0, 1, 2, 3]
    assert airframe is not None
    assert airframe.warnings == ()
    assert parameters.output_channels() == {1: 4, 2: 5, 3: 6, 4: 7}


def test_px4_outputs_that_lack_a_motor_tell_nothing() -> None:
    parameters = px4_outputs("PWM_MAIN", (1, 102), (2, 101), (3, 104))
    assert escs(parameters.airframe()) == [0, 1, 2, 3]
    assert parameters.output_channels() == {}


def test_arms_of_whole_metres_are_a_pattern() -> None:
    samples = px4_quad(True)
    whole = [
        parameter(s.name, math.copysign(1.0, s.value)) if s.name[-2:] in ("PX", "PY") else s for s in samples
    ]
    airframe = collect(*whole)
    assert airframe is not None
    assert not airframe.metric


def test_what_a_geometry_begun_lacks_is_named() -> None:
    def missing(*samples: Parameter) -> str:
        parameters = AirframeParameters()
        for sample in samples:
            parameters.feed(sample)
        return parameters.missing()

    samples = px4_quad(True)
    assert missing() == ""
    assert missing(*samples) == ""
    assert missing(*samples[1:]) == "not heard: CA_ROTOR_COUNT"
    assert missing(*samples[:-1]) == "not heard: CA_ROTOR3_KM"
    assert missing(parameter("FRAME_CLASS", 1, INT8)) == "not heard: FRAME_TYPE"
    assert missing(parameter("SERVO1_FUNCTION", 33)) == ""


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


@pytest.mark.parametrize(
    ("frame", "seats"),
    [
        ((3, 1), {"front right at 23°, CW", "front right at 67°, CCW", "rear left at -113°, CCW"}),
        ((14, 1), {"front at 18°, CCW", "front at -18°, CW", "right, CCW"}),
        ((1, 4), {"rear at 180°, CW", "rear at 180°, CCW"}),  # a V-tail: one place in the mixer's pattern
        ((4, 1), {"front right top, CCW", "front right bottom, CW"}),
    ],
)
def test_rotors_side_by_side_have_seats_of_their_own(frame: tuple[int, int], seats: set[str]) -> None:
    found = ardupilot_frame(*frame)
    assert found is not None
    airframe = Airframe(found[0], found[1], AirframeSource.PARAMETERS, metric=False)
    assert seats <= {airframe.seat(k) for k in range(len(airframe.rotors))}
