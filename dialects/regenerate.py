"""Generate `gcs_health/mavlink/generated/*.py` from the XML beside this file with pymavlink's own generator.

python dialects/regenerate.py            # into the package
python dialects/regenerate.py FOLDER
"""

import contextlib
import io
import sys
import tempfile
from pathlib import Path

from pymavlink.generator import mavgen

HERE = Path(__file__).resolve().parent
TARGET = HERE.parent / "gcs_health" / "mavlink" / "generated"
NAMES = ("esc", "gcs_health")


def generate(name: str) -> str:
    """Return a module's text: no path, date or machine in it."""
    with tempfile.TemporaryDirectory() as place:
        out = Path(place) / name
        options = mavgen.Opts(str(out), wire_protocol="2.0", language="Python3", validate=False)
        with contextlib.redirect_stdout(io.StringIO()):  # the generator talks
            mavgen.mavgen(options, [str(HERE / f"{name}.xml")])
        return out.with_suffix(".py").read_text()


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else TARGET
    for each in NAMES:
        (folder / f"{each}.py").write_text(generate(each))
