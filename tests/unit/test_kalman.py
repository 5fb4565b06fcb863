"""Kalman steps: textbook identities, and consistency on data that the model itself made."""

import numpy as np
import pytest

from gcs_health.estimators import kalman


def _random_case(rng: np.random.Generator, n: int, m: int) -> tuple[np.ndarray, ...]:
    A = rng.normal(size=(n, n))
    P = A @ A.T + np.eye(n)
    return (
        rng.normal(size=n),
        P,
        rng.normal(size=m),
        rng.normal(size=(m, n)),
        np.diag(rng.uniform(0.5, 2.0, m)),
    )


def test_scalar_rows_equal_the_joint_update() -> None:
    rng = np.random.default_rng(3)
    for n in (3, 4, 8):
        x, P, z, H, R = _random_case(rng, n, 4)
        joint = kalman.update(x, P, z, H, R)
        xs, Ps = x.tolist(), P.tolist()
        for row in range(4):
            xs, Ps, innovation, S = kalman.update_scalar(xs, Ps, z[row], H[row].tolist(), R[row, row])
            assert S > 0.0
            assert np.isfinite(innovation)
        np.testing.assert_allclose(xs, joint.x, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(Ps, joint.P, rtol=1e-8, atol=1e-9)


def test_covariance_stays_symmetric_and_positive() -> None:
    rng = np.random.default_rng(4)
    x, P, _, _, _ = _random_case(rng, 6, 3)
    for _ in range(300):
        P = kalman.predict(x, P, np.eye(6), 1e-4 * np.eye(6)).P
        done = kalman.update(x, P, rng.normal(size=3), rng.normal(size=(3, 6)), np.eye(3))
        x, P = done.x, done.P
        assert (P == P.T).all()
    assert np.linalg.eigvalsh(P).min() > 0.0


def test_a_missing_row_is_skipped_and_nothing_is_changed_in_place() -> None:
    rng = np.random.default_rng(5)
    x, P, z, H, R = _random_case(rng, 4, 3)
    z[1] = np.nan
    before = x.copy(), P.copy()
    some = kalman.update(x, P, z, H, R)
    rows = [0, 2]
    same = kalman.update(x, P, z[rows], H[rows], R[np.ix_(rows, rows)])
    np.testing.assert_array_equal(some.x, same.x)
    np.testing.assert_array_equal(some.P, same.P)
    assert some.innovation.shape == (2,)
    assert some.S.shape == (2, 2)
    np.testing.assert_array_equal(x, before[0])
    np.testing.assert_array_equal(P, before[1])
    none = kalman.update(x, P, np.full(3, np.nan), H, R)
    np.testing.assert_array_equal(none.x, x)
    assert none.nis == 0.0
    lists = P.tolist()
    assert kalman.update_scalar(x.tolist(), lists, float("inf"), H[0].tolist(), 1.0)[1] is lists


def test_prediction_adds_noise_once() -> None:
    P = np.diag([1.0, 2.0])
    step = kalman.predict(np.array([1.0, -1.0]), P, np.array([[1.0, 0.5], [0.0, 1.0]]), 0.1 * np.eye(2))
    np.testing.assert_allclose(step.x, [0.5, -1.0])
    np.testing.assert_allclose(step.P, [[1.6, 1.0], [1.0, 2.1]])


def test_nees_and_nis_are_consistent_on_data_of_the_model() -> None:
    """400 runs of the paper's filter on its own model: means within the 99.9 % band of chi-square / 400."""
    rng = np.random.default_rng(6)
    runs, steps, n = 400, 40, 4
    q, p0 = 2e-4, 0.1
    signs = np.array([[1.0, -1, -1, 1], [1, 1, -1, -1], [-1, -1, -1, -1]])
    gains = np.array([1e-4, 1e-4, 5e-6])[:, None]
    nees, nis = [], []
    for _ in range(runs):
        truth = 1.0 + rng.normal(0.0, p0**0.5, n)
        x, P = np.ones(n), p0 * np.eye(n)
        for _ in range(steps):
            truth = truth + rng.normal(0.0, q**0.5, n)
            H = gains * signs * rng.uniform(400.0, 1000.0, n) ** 2
            z = H @ truth + rng.normal(size=3)
            x, P = kalman.predict(x, P, np.eye(n), q * np.eye(n))
            done = kalman.update(x, P, z, H, np.eye(3))
            x, P = done.x, done.P
        error = truth - x
        nees.append(error @ np.linalg.solve(P, error))
        nis.append(done.nis)
    # chi-square with 400 n degrees over 400: mean n, standard deviation sqrt(2 n / 400)
    assert np.mean(nees) == pytest.approx(4.0, abs=3.3 * (8.0 / runs) ** 0.5)
    assert np.mean(nis) == pytest.approx(3.0, abs=3.3 * (6.0 / runs) ** 0.5)
