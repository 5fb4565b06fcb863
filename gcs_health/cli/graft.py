"""`gcs-health graft`: put a fault into a recorded healthy flight."""

import argparse
from pathlib import Path

from gcs_health.cli import DONE
from gcs_health.errors import ConfigError
from gcs_health.simulate.flight import record
from gcs_health.simulate.graft import Graft
from gcs_health.simulate.graft_fault import parse_fault
from gcs_health.simulate.recording import first_pass, read_frames
from gcs_health.simulate.truth import grafted
from gcs_health.vehicle_file import load_vehicle

SAID = {
    "effectiveness": "IMU, attitude rates, rotor speeds, currents, motor outputs; path stays as recorded",
    "unbalance": "accelerations; rotor speeds and everything else stay as recorded",
    "drag": "the motor's current",
    "telemetry": "the ESC telemetry",
}


def run(options: argparse.Namespace) -> int:
    """Graft, write the log and its truth."""
    faults = [parse_fault(text) for text in options.fault]
    airframe = load_vehicle(options.vehicle) if options.vehicle else None
    if Path(options.output).resolve() == Path(options.file).resolve():
        raise ConfigError(f"{options.output}: this is the recording itself; name another file with -o")
    frames = read_frames(options.file)
    flown = first_pass(options.file, frames, airframe)
    edited, begun = 0, []
    for fault in faults:
        graft = Graft(flown, fault)
        frames = graft.frames(frames)
        edited += graft.edited
        begun.append((fault, graft.stamp))
        print(f"motor {fault.motor}, {fault.effect} at {fault.at:g} s: edited {SAID[fault.effect]}")
        for note in graft.notes:
            print(f"  {note}")
        at = flown.first_t + fault.at
        if fault.effect == "effectiveness" and not ((flown.opened > at) & (flown.opened < at + 1.0)).any():
            print("  at that time the monitor gives no verdicts (not flying freely, or still settling)")
    path = Path(options.output)
    beside = path.with_suffix(".truth.json")
    try:
        path.write_bytes(b"".join(record(stamp, raw) for stamp, raw in frames))
        truth = grafted(begun, flown, Path(options.file).name, path.name, frames[0][0])
        beside.write_text(truth, encoding="utf-8")
    except OSError as error:
        raise ConfigError(f"{error.filename}: cannot write: {error.strerror}") from None
    print(f"{path}: {edited} of {len(frames)} frames edited; the truth is in {beside.name}")
    return DONE
