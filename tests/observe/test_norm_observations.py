"""Norms of many trials: the kernel against dense algebra, and against one trial at a time."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from tests.base_seeds import evidence

from inercal.methods.residuals import noisy_norm_residuals
from inercal.physics.sensors import G0, Sensor, cluster, triad

Array = NDArray[np.float64]
TRIALS, ROWS = 20, 7
TURNED = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
ORTHOGONAL = [
    triad().with_coefficients("k0", "k1", "k2"),
    triad().with_coefficients("z.k3", "y.koq", "k2", "x.k0"),
    cluster("turned", TURNED.tolist()).with_coefficients("k0", "k1", "k2", "k3", "koq"),
    triad(),
]
TILTED = [
    replace(one, form="tilted")
    for one in (
        triad().with_coefficients("k0", "k1", "k2", "k3", "nonorthogonality"),
        triad().with_coefficients("misalignment", "kip", "koq", "k1_prime"),
        cluster("skew", [[1, 0, 0], [0, 1, 0], [0.1, 0, 1]]).with_coefficients(
            "misalignment", "k2"
        ),
    )
]
OTHERS = [
    triad().with_coefficients("k0", "k1", "k2", "k3", "nonorthogonality"),
    triad().with_coefficients("bias", "nonlinearity", "cross", "koq", "k1_prime"),
    triad().with_coefficients("k0", "k0_prime"),
    replace(triad().with_coefficients("k1", "k2", "misalignment"), form="tilted"),
    triad().with_coefficients("k1", "kip"),
    cluster("skew", [[1, 0, 0], [0, 1, 0], [0.1, 0, 1]]).with_coefficients("k0", "k2"),
    cluster("four", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]]).with_coefficients("k0", "k2"),
]


def covariances(rng: np.random.Generator, *shape: int) -> Array:
    root = rng.normal(size=(*shape, shape[-1]))
    return root @ np.swapaxes(root, -1, -2)


def test_norms_jacobian_and_noise_agree_with_dense_algebra():
    """By Σ f_i² / slope_i², as in the note's σ_r of ‖f‖², but for any covariance."""
    rng = np.random.default_rng(1)
    f = 30 * G0 * rng.normal(size=(TRIALS, ROWS, 3))
    k0, k1, k2, k3, koq = rng.normal(size=(5, TRIALS, 1, 3)) * np.array(
        [0.1, 0.03, 1e-4 / G0, 1e-6 / G0**2, 1e-4 / G0]
    ).reshape(5, 1, 1, 1)
    y = k0 + (1 + k1) * f + k2 * f**2 + k3 * f**3 + koq * f * abs(f)
    slope = 1 + k1 + 2 * k2 * f + 3 * k3 * f**2 + 2 * koq * abs(f)
    covariance = covariances(rng, TRIALS, ROWS, 3)
    made = rng.uniform(1, 30, size=(1, ROWS))
    mixed = rng.permutation(15)
    c = np.concatenate([k0, k1, k2, k3, koq], axis=1).swapaxes(1, 2).reshape(TRIALS, 15)
    names = [f"{axis}.{term}" for axis in "xyz" for term in ("k0", "k1", "k2", "k3", "koq")]
    sensor = replace(triad(), coefficients=tuple(names[k] for k in mixed))
    residual, jacobian, variance, _ = noisy_norm_residuals(sensor, y, covariance, c[:, mixed], made)

    length = np.linalg.norm(f, axis=-1)
    assert_allclose(residual, made - length, rtol=1e-12, atol=1e-12)
    by_reading = (f / length[..., None])[..., None, :] @ np.linalg.inv(slope[..., None] * np.eye(3))
    design = np.zeros((TRIALS, ROWS, 3, 15))
    for a in range(3):
        x = f[..., a]
        design[..., a, 5 * a : 5 * a + 5] = np.stack([x**0, x, x**2, x**3, x * abs(x)], axis=-1)
    assert_allclose(jacobian, (-by_reading @ design)[..., 0, mixed], rtol=1e-11)
    expected = by_reading @ covariance @ np.swapaxes(by_reading, -1, -2)
    assert_allclose(variance, expected[..., 0, 0], rtol=1e-11)


def case(sensor: Sensor, seed: int) -> tuple[Array, Array, Array, Array]:
    rng = np.random.default_rng(seed)
    c = 1e-4 * rng.normal(size=(TRIALS, len(sensor.coefficients))) * sensor.unit_scale
    y = 5 * G0 * rng.normal(size=(TRIALS, ROWS, len(sensor.axes)))
    return y, covariances(rng, TRIALS, ROWS, len(sensor.axes)), c, rng.uniform(1, 9, (TRIALS, ROWS))


@pytest.mark.parametrize("sensor", [*ORTHOGONAL, *TILTED, *OTHERS])
@pytest.mark.parametrize("shared", [None, *map(evidence, (0, 1, 2)), 3])
def test_batched_trials_equal_single_trials(sensor: Sensor, shared: int | None):
    given = list(case(sensor, 3))
    if shared is not None:
        given[shared] = given[shared][0]
    together = noisy_norm_residuals(sensor, *given)
    for t in range(TRIALS):
        alone = noisy_norm_residuals(
            sensor, *(a if k == shared else a[t] for k, a in enumerate(given))
        )
        for one, other in zip(together, alone, strict=True):
            assert_allclose(one[t], other, rtol=1e-10, atol=1e-10 * abs(other).max(initial=0))


def test_readings_beyond_the_fold_are_reported_and_affect_no_other_trial():
    sensor = triad().with_coefficients("k2", "y.k3")
    y, covariance, c, made = case(sensor, 4)
    together = noisy_norm_residuals(sensor, y, covariance, 1000 * c, made)
    beyond = np.isnan(together.residual)
    assert 0.1 < beyond.mean() < 0.9
    assert np.isfinite(together.jacobian).all()
    for t in range(TRIALS):
        alone = noisy_norm_residuals(sensor, y[t], covariance[t], 1000 * c[t], made[t])
        assert_allclose(together.residual[t], alone.residual, rtol=1e-10, atol=1e-10)
        for one, other in zip(together[1:], alone[1:], strict=True):
            assert_allclose(one[t][~beyond[t]], other[~beyond[t]], rtol=1e-9)
