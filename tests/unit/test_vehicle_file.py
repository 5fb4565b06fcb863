"""The vehicle file: what is read, and one clear line for each way to get it wrong."""

from pathlib import Path

import pytest

from gcs_health.airframe import AirframeSource
from gcs_health.errors import AirframeError
from gcs_health.vehicle_file import load_vehicle

HEAD = 'schema = "gcs_health.vehicle/1"\nname = "quad"\n'


def rotor(motor: int, x: float, y: float, spin: str = "cw", more: str = "") -> str:
    return f'[[rotor]]\nmotor = {motor}\nposition = [{x}, {y}, 0.0]\nspin = "{spin}"\n{more}\n'


QUAD = (
    rotor(2, -1, -1, "ccw")
    + rotor(1, 1, 1, "ccw", "esc = 5\nradius = 0.1")
    + rotor(3, 1, -1)
    + rotor(4, -1, 1)
)


def write(place: Path, text: str | bytes) -> Path:
    path = place / "quad.toml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def test_a_good_file_is_read_whole(tmp_path: Path) -> None:
    text = HEAD + "mass = 1.5\ninertia = [0.01, 0.02, 0.03]\n" + QUAD + "[effectiveness]\nroll = 1e-4\n"
    airframe = load_vehicle(write(tmp_path, text))
    assert airframe.source is AirframeSource.FILE
    assert airframe.metric
    assert [r.motor for r in airframe.rotors] == [1, 2, 3, 4]
    assert [r.esc for r in airframe.rotors] == [5, 1, 2, 3]
    assert [r.spin for r in airframe.rotors] == [1, 1, -1, -1]
    assert airframe.rotors[0].radius == 0.1
    assert (airframe.mass, airframe.inertia) == (1.5, (0.01, 0.02, 0.03))
    assert airframe.effectiveness.roll == 1e-4
    assert airframe.effectiveness.thrust is None


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (QUAD, "quad.toml: schema: expected 'gcs_health.vehicle/1', got None"),
        (HEAD + QUAD.replace('"cw"', '"left"', 1), "rotor[2].spin: expected 'cw' or 'ccw', got 'left'"),
        (HEAD + "weight = 3\n" + QUAD, "quad.toml: weight: unknown key"),
        (HEAD + "mas = 3\n" + QUAD, "mas: unknown key; did you mean 'mass'?"),
        (HEAD + "mass = -1\n" + QUAD, "mass: expected a number above 0, got -1"),
        (HEAD + "mass = true\n" + QUAD, "mass: expected a number, got True"),
        (HEAD + "mass = nan\n" + QUAD, "mass: expected a number, got nan"),
        (HEAD + "inertia = [1, 2]\n" + QUAD, "inertia: expected three numbers"),
        (HEAD, "rotor: expected one [[rotor]] table per rotor"),
        (HEAD + rotor(1, 1, 1) + rotor(2, -1, -1), "rotor: expected 3 to 12 rotors, got 2"),
        (HEAD + QUAD + rotor(4, 0.5, 0.5), "rotor[4].motor: 4 is already that of rotor[3]"),
        (HEAD + QUAD + rotor(6, 0.5, 0.5), "rotor[4].esc: 5 is already that of rotor[1]"),
        (HEAD + QUAD + rotor(5, 1, 1), "rotor[4].position: (1.0, 1.0, 0.0) is already that of rotor[1]"),
        (HEAD + "".join(rotor(k, k, 0) for k in (1, 2, 3)), "do not spread forward and right"),
        (HEAD + QUAD.replace("motor = 3", "motor = 0"), "rotor[2].motor: expected a whole number from 1 on"),
        (HEAD + QUAD.replace("motor = 3\n", ""), "rotor[2].motor: is missing"),
        (HEAD + QUAD.replace("[1, -1, 0.0]", '[1, "x", 0.0]'), "rotor[2].position[1]: expected a number"),
        (HEAD + QUAD + "[effectiveness]\nlift = 1\n", "effectiveness.lift: unknown key"),
        (HEAD + QUAD + "[effectiveness]\nroll = 0\n", "effectiveness.roll: expected a number above 0"),
        (HEAD + "[[rotor]", "not valid TOML"),
        (b"\xff\xfe\x00", "this is not text"),
    ],
)
def test_each_mistake_gets_a_line_that_names_file_and_key(
    tmp_path: Path, text: str | bytes, complaint: str
) -> None:
    with pytest.raises(AirframeError) as caught:
        load_vehicle(write(tmp_path, text))
    line = str(caught.value)
    assert complaint in line
    assert "quad.toml" in line
    assert "\n" not in line


@pytest.mark.parametrize("name", ["absent.toml", "."])
def test_what_cannot_be_read_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(AirframeError, match="cannot read the vehicle file"):
        load_vehicle(tmp_path / name)


def test_the_real_craft_are_readable() -> None:
    folder = Path(__file__).parents[2].parent / "shared" / "data" / "vehicles"
    if not folder.is_dir():
        pytest.skip("the vehicle files of real craft are not beside this checkout")
    for path in folder.glob("*.toml"):
        assert len(load_vehicle(path).rotors) == 4
