"""The scripts under `replay/` that reproduce papers: their scoring, and one flight through each."""

import importlib.util
import math
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from synthetic_flight import Scenario, airframe, fly

from gcs_health.estimators import REGISTRY
from gcs_health.simulate.batch import Flights


def script(name: str) -> ModuleType:
    path = Path(__file__).parents[2] / "replay" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"replay_{name}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


strack = script("strack2023")
rates = script("rates")


@pytest.mark.parametrize(
    ("said", "delays", "false", "wrong"),
    [
        ([], [], 0, 0),
        ([(10.1, 2)], [100.0], 0, 0),
        ([(10.1, 3), (10.2, 2)], [100.0], 0, 1),  # the first alarm of any rotor counts
        ([(9.0, 2), (10.2, 2)], [200.0], 1, 0),
        ([(10.31, 2)], [], 0, 0),  # too late is not found
    ],
)
def test_strack_scores_as_the_paper(
    said: list[tuple[float, int]], delays: list[float], false: int, wrong: int
) -> None:
    tally = strack.Tally()
    strack.score(tally, iter(said), 10.0, 2)
    assert tally.delays == pytest.approx(delays)
    assert (tally.ejections, tally.false, tally.wrong) == (1, false, wrong)


def test_strack_counts_every_alarm_of_a_healthy_flight() -> None:
    tally = strack.Tally()
    strack.score(tally, iter([(3.0, 0), (4.0, 1)]), math.inf, 0)
    assert (tally.ejections, tally.false, tally.delays) == (0, 2, [])


def test_strack_finds_an_ejection_in_the_simulator() -> None:
    ((readings, at, rotor, craft),) = strack.flights(1, 0, seed=41)
    base = strack.parameter_sets()["base"]
    for changes in strack.VARIANTS.values():
        told = list(strack.alarms(replace(base, **changes), readings, craft))
        assert len(told) == 1
        assert told[0][1] == rotor
        assert at < told[0][0] < at + strack.WITHIN


def test_thinning_keeps_the_newest_value() -> None:
    imu_t = np.arange(1, 101) / 500.0
    rotor_t = imu_t - 0.004
    made = Flights(
        imu_t,
        np.tile(imu_t[:, None, None], (1, 6, 2)),
        rotor_t,
        *[np.tile(rotor_t[:, None, None], (1, 4, 2)) for _ in range(2)],
        imu_t,
        np.tile(imu_t[:, None, None], (1, 4, 2)),
        np.zeros((100, 5, 2)),
        np.ones((100, 2)),
        0.0,
    )
    thin = rates.thinned(made, 50, 10)
    np.testing.assert_allclose(thin.imu_t, np.arange(1, 11) / 50.0)
    np.testing.assert_allclose(thin.rotor_t, [0.096, 0.196])
    np.testing.assert_array_equal(thin.imu[:, 0, 1], thin.imu_t)
    np.testing.assert_array_equal(thin.speed[:, 0, 1], thin.rotor_t)
    assert rates.thinned(made, 500, 500).imu_t.shape == (100,)


def test_rates_asks_every_entry_of_the_registry_that_it_names() -> None:
    assert set(rates.ENTRIES) <= set(REGISTRY)
    entry = rates.ENTRIES["effectiveness"]
    t, rotor = rates.verdict(
        "effectiveness", entry, airframe(4), fly(Scenario(4, duration=9.0, lost=1, at=8.0))
    )
    assert rotor == 1
    assert 8.0 < t < 8.3
    calm = rates.verdict("effectiveness", entry, airframe(4), fly(Scenario(4, duration=4.0)))
    assert calm == (math.inf, -1)
