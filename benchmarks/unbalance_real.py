"""What the unbalance estimator says of the recorded flights; `python benchmarks/unbalance.py --real FOLDER`."""

import math
from pathlib import Path

import numpy as np
from unbalance_logs import RATES, airframe, readings, thinned

from gcs_health.estimators.contract import Estimate
from gcs_health.estimators.unbalance import Baseline, UnbalanceConfig, UnbalanceEstimator

NAMED = 0.9  # probability
WITH_SPEEDS = {
    "bebop2_prop_eject": "healthy until 12.2 s; 1 and 3 turn alike and shake 5 m/s² together",
    **dict.fromkeys(
        (f"indiflight_{n}" for n in ("00230", "00258", "00262", "00267", "00271", "00341")),
        "healthy; 3 and 1 above 2 and 4",
    ),
    **dict.fromkeys((f"nanodrone_square_run{n}" for n in (1, 3, 5)), "healthy"),
    "px4_uavcan_esc": "healthy; 8 and 3 Hz",
}
UNTIL = {"bebop2_prop_eject": 12.2}  # s
# flight: the healthy flight of its configuration, None = none is there; what is true
WITHOUT = {
    "udesa_quadcarbono_M1_Hnominal_corto": (
        "udesa_quadcarbono_M1_Hnominal_corto",
        "healthy, its own baseline",
    ),
    "udesa_quadcarbono_M1_Hasymm164": ("udesa_quadcarbono_M1_Hnominal_corto", "rotor 1 cut"),
    "udesa_quadcarbono_weight_shift_M1_Hasymm164_bat_atras": (
        "udesa_quadcarbono_M1_Hnominal_corto",
        "rotor 1 cut, battery moved",
    ),
    "udesa_hexaF550_M1_Hnominal": ("udesa_hexaF550_M1_Hnominal", "healthy, its own baseline"),
    "udesa_hexaF550_M1_Hasymm10": ("udesa_hexaF550_M1_Hnominal", "rotor 1 cut"),
    "udesa_garage_manual_M2_H12": (None, "rotor 2 cut; no healthy flight"),
    "udesa_px4_prop13": (None, "one cut; says it is disarmed"),
    "agh_octo_14": ("agh_octo_01", "healthy"),
    "agh_octo_01": ("agh_octo_14", "healthy"),
    "agh_octo_03": ("agh_octo_14", "healthy, from 318 s one cut"),
    "agh_octo_07": ("agh_octo_14", "one cut"),
    "copter2015_telemetry_a": (None, "healthy"),
    "px4_v6c_hover": ("px4_v6c_hover", "healthy, its own baseline"),
    "ardupilot_log_0036": (None, "crash at 143 s"),
    "ardupilot_log_0039": (None, "uncertain"),
    "crazypad_controller_normal_flight_E8_log00": (None, "healthy"),
    "crazypad_controller_tape_on_propeller_M3_E8_log00": (None, "tape on 3"),
}


def play(
    folder: Path,
    name: str,
    config: UnbalanceConfig,
    keep: tuple[int, int] = (1, 1),
    phase: tuple[int, int] = (0, 0),
) -> tuple[UnbalanceEstimator, list[Estimate], float]:
    """Feed a flight; return the estimator, an estimate of each rotor every 2 s, and the first time [s]."""
    estimator = UnbalanceEstimator(airframe(folder, name), config)
    heard = thinned(readings(folder, name), keep, phase)
    start = heard[0].t
    said: list[Estimate] = []
    due = -math.inf
    for reading in heard:
        if reading.t - start > UNTIL.get(name, math.inf):
            break
        said += estimator.feed(reading)
        if reading.t >= due:
            said += estimator.estimates(reading.t)
            due = reading.t + 2.0
    return estimator, said, start


def baseline(folder: Path, name: str) -> Baseline:
    """Return what a healthy flight teaches."""
    return play(folder, name, UnbalanceConfig())[0].baseline()


def report(folder_name: str) -> None:
    """Print the tables."""
    folder = Path(folder_name)
    print("With rotor speeds, no damage known and no baseline; amplitudes at mean speed, last solution.\n")
    print(
        "| flight | rates | lines Hz | m/s² | may be the largest | wrong direction keeps | block s | alarms "
        "| true |\n|---|---|---|---|---|---|---|---|---|"
    )
    for name, truth in WITH_SPEEDS.items():
        for rates, keep in RATES.items():
            if name.startswith("nanodrone"):
                keep = (max(keep[0] // 5, 1), max(keep[1] // 5, 1))
            print(_tracked(folder, name, rates, keep, truth), flush=True)
    print("\nWithout rotor speeds: the level against a healthy flight's, after the rule of sheet 5.\n")
    print(
        "| flight | baseline | level / baseline, least to most | damaged, P > 0.9 from s | true |\n"
        "|---|---|---|---|---|"
    )
    for name, (healthy, truth) in WITHOUT.items():
        config = UnbalanceConfig(baseline=baseline(folder, healthy) if healthy else None)
        _, said, start = play(folder, name, config)
        ratios = [float(dict(e.evidence).get("over_baseline", math.nan)) for e in said]
        ratios = [ratio for ratio in ratios if ratio == ratio]
        span = (
            f"{min(ratios):.2f} to {max(ratios):.2f}"
            if ratios
            else "no answer: " + said[-1].reasons[-1].value
        )
        hits = [e.t - start for e in said if float(dict(e.evidence).get("present", 0.0)) > NAMED]
        print(
            f"| {name} | {healthy or '-'} | {span} | {f'{hits[0]:.0f}' if hits else 'no'} | {truth} |",
            flush=True,
        )


def _tracked(folder: Path, name: str, rates: str, keep: tuple[int, int], truth: str) -> str:
    estimator, said, start = play(folder, name, UnbalanceConfig(), keep)
    alarms = {(e.rotor + 1, round(e.t - start)) for e in said if e.failure_probability > NAMED}
    answer = estimator.answer
    if answer is None:
        return (
            f"| {name} | {rates} | - | - | {said[-1].reasons[-1].value} | - | - | {len(alarms)} | {truth} |"
        )
    amplitude = np.sqrt(answer.s()) * answer.speed**2
    return (
        f"| {name} | {rates} | {' '.join(f'{w / 6.2832:.1f}' for w in answer.speed)} | "
        f"{' '.join(f'{a:.1f}' for a in amplitude)} | {dict(said[-1].evidence).get('largest', '-')} | "
        f"{answer.leak:.0%} | {answer.length} | {len(alarms)} | {truth} |"
    )
