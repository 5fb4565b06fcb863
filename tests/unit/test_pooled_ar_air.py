"""Which windows are taken for a model's own air."""

from dataclasses import replace

import numpy as np
import pytest
from test_pooled_ar import learned, readings, told, vibration

from gcs_health.estimators.contract import Reason, Status
from gcs_health.estimators.pooled_ar_air import learned as air_of
from gcs_health.estimators.pooled_ar_air import traits
from gcs_health.estimators.pooled_ar_model import PooledModel


@pytest.fixture(scope="module")
def model() -> PooledModel:
    return learned()


def home(rng: np.random.Generator, k: float, count: int) -> np.ndarray:
    """Return traits of windows at k: the next rotor's model errs the more, the more is lost."""
    ratio, other = rng.normal(0.0, 0.05, count), rng.normal(k, 0.1, count)
    return np.stack([ratio, other, 0.5 * k + rng.normal(0.0, 0.05, count)], axis=1)


def test_home_is_known_by_all_its_traits_together() -> None:
    rng = np.random.default_rng(1)
    levels = (0.0, 0.5, 0.9)
    truth = np.repeat(levels, 60)
    z = np.concatenate([home(rng, k, 60) for k in levels])
    air = air_of(truth, truth + rng.normal(0.0, 0.02, len(truth)), z)
    fresh = [air.holds(k, row) for k in (0.0, 0.3, 0.5, 0.7, 0.9) for row in home(rng, k, 200)]
    assert np.mean(fresh) > 0.99
    assert not air.holds(0.9, np.array([0.0, 0.0, 0.45]))  # the next rotor fits as in healthy flight
    assert not air.holds(0.9, np.array([0.0, 0.9, 0.9]))
    assert not air.holds(0.0, np.array([0.6, 0.0, 0.0]))
    assert air.holds(1.2, np.array([0.0, 0.9, 0.45]))  # beyond the last level its own figures stand


def test_few_windows_of_a_level_share_what_all_scatter() -> None:
    rng = np.random.default_rng(2)
    truth = np.array([0.0] * 40 + [0.9] * 3)
    z = np.concatenate([home(rng, 0.0, 40), home(rng, 0.9, 3)])
    air = air_of(truth, truth, z)
    assert np.mean([air.holds(0.9, row) for row in home(rng, 0.9, 200)]) > 0.9
    np.testing.assert_allclose(air.covariance[1], air.covariance[1].T)


def test_one_rotor_alone_has_one_trait() -> None:
    assert traits(2.0, []).tolist() == pytest.approx([np.log(2.0)])
    assert traits(2.0, [(3.0, 0.4), (9.0, 0.8)]).tolist() == pytest.approx([np.log(2.0), np.log(3.0), 0.4])


def test_air_that_the_wide_bounds_would_pass_is_refused(model: PooledModel) -> None:
    """Noise of 1.3 times the strength: the residual variance is 1.7 times the trained one, within .6 to 2."""
    stream = readings(vibration(0, 0.3, 8.0, 906, loud=1.3))
    assert told(replace(model, air=None), stream).status is Status.VALID
    refused = told(model, stream)
    assert refused.status is not Status.VALID
    assert Reason.UNMODELLED in refused.reasons
