"""`NAME.truth.json`: what is true of a made flight, in the form of the recorded flights' labels.

Rotors are motor numbers as the autopilot counts, from 1. `*_time_s` count from the log's first record,
`vehicle_time_s` is the vehicle's clock, `from_unix_us` the stamp of the moment.
"""

import json
import math
from typing import Any

from gcs_health.simulate.faults import described
from gcs_health.simulate.graft_fault import GraftFault
from gcs_health.simulate.recording import Flown
from gcs_health.simulate.scenario import Scenario
from gcs_health.simulate.telemetry import BOOTED, UNIX_BOOT_US


def simulated(scenario: Scenario, file: str, first_us: int) -> str:
    """Return the truth of a simulated flight whose first record is stamped `first_us`."""
    plan = scenario.trajectory
    faults = []
    for fault in scenario.faults:
        vehicle_time = BOOTED + float(fault.at)
        faults.append(
            described(fault) | _times(vehicle_time, UNIX_BOOT_US + round(vehicle_time * 1e6), first_us)
        )
    return _text(
        file,
        first_us,
        {
            "made_by": f"gcs-health simulate {scenario.name}, seed {scenario.seed}",
            "duration_s": plan.duration,
            "vehicle": {"type": scenario.vehicle.name, "rotors": len(scenario.vehicle.rotors)},
            "flight": {
                "kind": plan.kind,
                "wind_m_s": scenario.wind.speed,
                "turbulence": scenario.wind.turbulence,
            },
        },
        faults,
        "simulated",
    )


def grafted(faults: list[tuple[GraftFault, int]], flown: Flown, source: str, file: str, first_us: int) -> str:
    """Return the truth of a recorded flight with faults, each with the stamp of its beginning, put into it."""
    told = []
    for fault, stamp in faults:
        size = {} if math.isnan(fault.size) else {"size": fault.size}
        kind = f"{fault.effect} {fault.how}".strip()
        with_motor = {"with": fault.other} if fault.other else {}
        until = {"until_vehicle_time_s": flown.first_t + fault.until} if fault.until < math.inf else {}
        times = _times(flown.first_t + fault.at, stamp, first_us)
        told.append(
            {"kind": kind, "rotor": fault.motor, **size, **with_motor, "ramp_s": fault.ramp, **until, **times}
        )
    return _text(
        file, first_us, {"made_by": f"gcs-health graft, into {source}"}, told, "grafted into a recording"
    )


def _times(vehicle_time: float, stamp: int, first_us: int) -> dict[str, Any]:
    return {
        "label_time_s": round((stamp - first_us) * 1e-6, 6),
        "vehicle_time_s": round(vehicle_time, 6),
        "from_unix_us": stamp,
    }


def _text(file: str, first_us: int, head: dict[str, Any], faults: list[dict[str, Any]], how: str) -> str:
    first: dict[str, Any] = faults[0] if faults else {"kind": None, "rotor": None}
    truth = {
        "condition": "fault" if faults else "healthy",
        "fault": first["kind"],
        **{key: value for key, value in first.items() if key != "kind"},
        "how_known": how,
        "faults": faults,
    }
    return json.dumps({"file": file, "start_unix_us": first_us, **head, "truth": truth}, indent=1) + "\n"
