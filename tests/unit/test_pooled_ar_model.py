"""The mathematics of pooled AR models against what they say in closed form."""

import math

import numpy as np
import pytest

from gcs_health.estimators.pooled_ar_model import (
    Moments,
    basis,
    basis_slope,
    best_order,
    bic,
    fit,
    grams,
    minimise,
    moments,
    residual_variances,
    rss,
    spread,
)

LEVELS = np.array([0.0, 0.25, 0.5, 0.75, 1.0])


def resonance(k: float, n: int, seed: int, quadratic: float = 0.0) -> np.ndarray:
    """Return (n,) of an AR(2) whose first coefficient is linear in k, or bent."""
    from scipy.signal import lfilter

    noise = np.random.default_rng(seed).standard_normal(n + 200)
    return lfilter([1.0], [1.0, -(1.2 - 0.6 * k + quadratic * k * k), 0.8], noise)[200:]


def by_level(n: int = 20_000, quadratic: float = 0.0, na: int = 2) -> list[Moments]:
    return [moments(resonance(k, n, i, quadratic), na) for i, k in enumerate(LEVELS)]


def test_the_basis_is_the_papers_list() -> None:
    k = np.linspace(0.0, 1.0, 7)
    listed = [np.ones(7), -1 + 2 * k, 1 - 8 * k + 8 * k**2, -1 + 18 * k - 48 * k**2 + 32 * k**3]
    listed.append(1 - 32 * k + 160 * k**2 - 256 * k**3 + 128 * k**4)
    np.testing.assert_allclose(basis(k, 5).T, listed, atol=1e-12)


def test_the_slope_is_the_derivative() -> None:
    k, h = np.linspace(-0.3, 1.3, 9), 1e-6
    numeric = (basis(k + h, 6) - basis(k - h, 6)) / (2.0 * h)
    np.testing.assert_allclose(basis_slope(k, 6), numeric, atol=1e-5)


def test_the_papers_recurrence_spans_the_same_functions() -> None:
    """Second-kind polynomials, as the printed recurrence gives, leave the residuals as they are."""
    k = np.linspace(0.0, 1.0, 20)
    second = [np.ones(20), 4 * k - 2]
    for _ in range(2):
        second.append((4 * k - 2) * second[-1] - second[-2])
    U, T = np.array(second).T, basis(k, 4)
    coefficients, *_ = np.linalg.lstsq(T, U, rcond=None)
    np.testing.assert_allclose(T @ coefficients, U, atol=1e-10)


def test_moments_do_not_depend_on_the_piece_and_pool() -> None:
    y = resonance(0.3, 5000, 1)
    whole, pieces = moments(y, 5), moments(y, 5, piece=333)
    np.testing.assert_allclose(whole.S, pieces.S)
    np.testing.assert_allclose(whole.c, pieces.c)
    both = whole + pieces
    assert both.length == 2 * whole.length == 2 * (5000 - 5)
    phi = np.array([y[t - 5 : t][::-1] for t in range(5, 5000)])
    np.testing.assert_allclose(whole.S, phi.T @ phi)
    np.testing.assert_allclose(whole.c, phi.T @ y[5:])
    np.testing.assert_allclose(whole.of_order(3).S, phi[:, :3].T @ phi[:, :3])


def test_the_fit_finds_the_coefficients() -> None:
    theta = fit(by_level(), LEVELS, 2, 2)
    a = theta @ basis(np.array([0.4]), 2).T
    np.testing.assert_allclose(a.ravel(), [1.2 - 0.24, -0.8], atol=0.01)
    np.testing.assert_allclose(residual_variances(by_level(), LEVELS, theta), 1.0, atol=0.04)


def test_weighting_matters_where_levels_differ_in_noise() -> None:
    loud = [level if i else Moments(100 * level.S, 100 * level.c, 100 * level.Y, level.length)
            for i, level in enumerate(by_level(2000))]  # fmt: skip
    weighted, plain = fit(loud, LEVELS, 2, 2), fit(loud, LEVELS, 2, 2, np.ones(5))
    errors = [abs(theta @ basis(1.0, 2) - [0.6, -0.8]).max() for theta in (weighted, plain)]
    assert errors[0] < errors[1]


def test_bic_picks_order_and_basis() -> None:
    made = by_level(quadratic=0.3, na=12)
    assert best_order(made[0], (1, 2, 4, 12)) == 2
    scores = {p: bic(made, LEVELS, fit(made, LEVELS, 2, p)) for p in (1, 2, 3, 4)}
    assert min(scores, key=scores.__getitem__) == 3


def test_grams_give_the_residuals() -> None:
    theta = fit(by_level(), LEVELS, 2, 2)
    y = resonance(0.6, 1002, 9)
    M = grams(y, theta, 100)
    assert M.shape == (10, 3, 3)
    a = theta @ basis(0.37, 2)
    e = y[2:] - a[0] * y[1:-1] - a[1] * y[:-2]
    np.testing.assert_allclose(rss(M, np.full(10, 0.37)), (e.reshape(10, 100) ** 2).sum(axis=1))


@pytest.mark.parametrize("p", [2, 3, 5])
def test_the_minimum_is_the_grids(p: int) -> None:
    theta = fit(by_level(quadratic=0.2), LEVELS, 2, p)
    M = grams(resonance(0.6, 4002, 9, 0.2), theta, 1000)
    fine = np.linspace(-0.4, 1.4, 20_001)
    for window, k in zip(M, minimise(M), strict=True):
        best = fine[np.argmin(rss(np.repeat(window[None], len(fine), axis=0), fine))]
        assert abs(k - best) < 2e-3


def test_the_bound_is_the_scatter_of_a_right_model() -> None:
    """On data of the model itself eq. (40) must be true: errors over sigma have unit variance."""
    theta = fit(by_level(200_000), LEVELS, 2, 2)
    blocks = grams(resonance(0.5, 400_002, 77), theta, 100).reshape(400, 10, 3, 3)
    k = minimise(blocks.sum(axis=1))
    sure = spread(blocks, k, 1000.0)
    z = (k - 0.5) / np.sqrt(sure.crlb)
    assert 0.85 < z.std() < 1.15
    assert abs(z.mean()) < 0.3
    assert (sure.robust >= sure.crlb).all()
    assert math.isclose(float(np.median(sure.rss)), 1000.0, rel_tol=0.1)
