"""The unbalance estimator on recorded flights beside the checkout: ranks, ratios, and no alarm where all is well."""

import sys
from pathlib import Path

import numpy as np
import pytest

DATA = Path(__file__).parents[3] / "shared" / "data"
sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))

from unbalance_logs import RATES  # noqa: E402
from unbalance_real import WITHOUT, baseline, play  # noqa: E402

from gcs_health.estimators.unbalance import UnbalanceConfig  # noqa: E402

pytestmark = pytest.mark.skipif(
    not DATA.is_dir(), reason=f"no recorded flights beside the checkout ({DATA.name})"
)


@pytest.mark.parametrize("flight", ["00258", "00267", "00341"])
def test_rotors_1_and_3_shake_more_than_2_and_4_and_nobody_is_alarmed(flight: str) -> None:
    estimator, said, _ = play(DATA, f"indiflight_{flight}", UnbalanceConfig())
    answer = estimator.answer
    assert answer is not None
    assert not answer.flipped  # the spins are right as the vehicle file has them
    amplitude = np.sqrt(answer.s()) * answer.speed**2
    assert min(amplitude[0], amplitude[2]) > max(amplitude[1], amplitude[3])
    assert 2.8 < amplitude[2] < 4.6  # m/s², sheet 5: 2.8-4.0
    assert not any(e.failure_probability > 0.5 for e in said)


@pytest.mark.parametrize("rates", ["100/50", "50/10"])
def test_a_healthy_craft_that_shakes_more_than_a_damaged_one_raises_no_alarm(rates: str) -> None:
    estimator, said, _ = play(DATA, "bebop2_prop_eject", UnbalanceConfig(), RATES[rates])
    assert not any(e.failure_probability > 0.5 for e in said)
    answer = estimator.answer
    assert answer is not None
    if rates == "100/50":  # the two that turn alike
        assert dict(said[-1].evidence)["largest"] == "1 3"
        assert max(np.sqrt(answer.s()) * answer.speed**2) > 3.0


@pytest.mark.parametrize(
    ("flight", "damaged"),
    [
        ("udesa_quadcarbono_M1_Hasymm164", True),
        ("udesa_quadcarbono_weight_shift_M1_Hasymm164_bat_atras", True),
        ("udesa_hexaF550_M1_Hasymm10", True),
        ("udesa_hexaF550_M1_Hnominal", False),
        ("agh_octo_01", False),
        ("agh_octo_03", True),
        ("agh_octo_07", True),
        ("agh_octo_14", False),
    ],
)
def test_without_speeds_the_ratio_to_the_baseline_tells_damage_but_no_rotor(
    flight: str, damaged: bool
) -> None:
    healthy, _ = WITHOUT[flight]
    assert healthy is not None
    _, said, start = play(DATA, flight, UnbalanceConfig(baseline=baseline(DATA, healthy)))
    present = [e for e in said if float(dict(e.evidence).get("present", 0.0)) > 0.85]
    assert bool(present) is damaged
    assert not any(e.failure_probability > 0.5 for e in said)  # shared by all rotors
    if flight == "agh_octo_03":
        assert present[0].t - start > 318.0
