"""Batches of centrifuge fits: the compiled normal equations against Jacobians and single fits."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray
from tests.accuracy.centrifuge import PAPER_G, RATES, Triad, full_circle, sensed_motion
from tests.base_seeds import chosen

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches import Centrifuge
from inercal.estimation import Gaussian
from inercal.methods.centrifuge_norm import ml
from inercal.methods.centrifuge_norm.problems import norm_problem
from inercal.physics.plan import Spin
from inercal.physics.sensors import Sensor, triad
from inercal.recordings import Observations

Array = NDArray[np.float64]
TRIALS = 11
SD = 8e-6 * PAPER_G
EXACT = Centrifuge(Measured(PAPER_G, 0.0), Measured(1.0, 0.0), Measured(0.0, 0.0))
UNCERTAIN = Centrifuge(
    Measured(PAPER_G, 3e-4),
    Measured(1.0, 1e-5),
    Measured(0.683, 1.7e-3),
    Measured(2e-8, 1e-8),
    rate=1e-6,
    tilt=1e-5,
    dwell_rate=5e-7,
    dwell_tilt=2e-6,
)
NINE = triad().with_coefficients("k0", "k1", "k2")
FIFTEEN = triad().with_coefficients("k0", "k1", "k2", "k3", "nonorthogonality")
WARM = triad().with_coefficients("k0", "k1", "k2", "koq", "kip", "k1_dT", "k0_dT")
SYMMETRIC = replace(
    triad().with_coefficients("k0", "k1", "k2", "misalignment"), form="tilted", frame="symmetric"
)
CASES = {
    "nine": (NINE, EXACT),
    "fifteen": (FIFTEEN, EXACT),
    "fifteen, tilted": (replace(FIFTEEN, form="tilted"), EXACT),
    "fifteen, uncertain bench": (replace(FIFTEEN, form="tilted"), UNCERTAIN),
    "temperature and cross terms": (WARM, UNCERTAIN),
    "gauge": (SYMMETRIC, UNCERTAIN),
}


def table(sensor: Sensor, trials: int = TRIALS) -> tuple[Observations, list[Spin]]:
    """Return noisy readings of the paper's triad, (trials, r, 3), with correlated noise."""
    f, rates = sensed_motion(full_circle(), RATES)
    rng = np.random.default_rng(5)
    y = Triad().output(f) / 1.25 * PAPER_G + SD * rng.normal(size=(trials, *f.shape))
    root = SD * (np.eye(3) + 0.3 * rng.normal(size=(len(f), 3, 3)))
    labels = tuple(map(str, range(len(f))))
    rows = Observations(
        labels,
        y,
        root @ np.swapaxes(root, -1, -2),
        np.ones(len(f)),
        np.ones(len(f), dtype=np.int64),
        np.arange(len(f), dtype=float),
        sensor.channels,
        temperature=293.15 + 10 * rng.normal(size=len(f)),
    )
    return rows, [Spin(label, w) for label, w in zip(labels, rates.tolist(), strict=True)]


@pytest.mark.parametrize("name", CASES)
def test_normal_equations_are_those_of_the_jacobian(name: str):
    sensor, bench = CASES[name]
    rows, spins = table(sensor)
    whole = norm_problem(rows, sensor, bench, spins)
    assert whole.normal_equations is not None
    assert callable(whole.noise)
    x = whole.start + 1e-6 * whole.scale * np.random.default_rng(6).normal(
        size=(TRIALS, whole.start.size)
    )
    some = np.array([7, 2, 3])
    found = whole.normal_equations(x[some], some)
    for k, t in enumerate(some):
        alone = norm_problem(rows.of_trials(slice(t, t + 1)), sensor, bench, spins)
        assert callable(alone.noise)
        residual, jacobian = (
            a.reshape(a.shape[-a.ndim + 1 :]) for a in alone.linearise(x[t][None])
        )
        weight = 1 / alone.noise(x[t][None]).ravel()
        assert_allclose(found.residual[k], residual, atol=1e-11 * np.abs(rows.mean).max())
        assert_allclose(found.weight[k], weight, rtol=1e-9)
        a = weight[:, None] * jacobian
        size = np.linalg.norm(a, axis=0)
        triangle = np.tril_indices(len(size))
        assert_allclose(
            found.normal[k] / np.outer(size, size)[triangle],
            (a.T @ a / np.outer(size, size))[triangle],
            atol=1e-9,
        )
        u = weight * residual
        assert_allclose(
            found.gradient[k] / size, a.T @ u / size, atol=1e-9 * float(np.linalg.norm(u))
        )


@pytest.mark.parametrize("name", chosen(CASES, [*CASES][::2]))
@pytest.mark.parametrize("known", [False, True])
def test_a_batch_has_the_estimates_of_single_fits(name: str, known: bool):
    sensor, bench = CASES[name]
    rows, spins = table(sensor)
    mean = 1e-3 * np.random.default_rng(7).normal(size=(TRIALS, 2))
    prior = [Gaussian.independent(("x.k0", "y.k0"), np.zeros(2), 0.5)]
    prior = [replace(prior[0], mean=mean)] if known else []
    together = ml(rows, sensor, bench, spins, prior)
    assert together.converged.all()
    for t in (0, TRIALS - 1):
        own = [replace(one, mean=one.mean[t]) for one in prior]
        alone = ml(replace(rows, mean=rows.mean[t]), sensor, bench, spins, own)
        sd = np.sqrt(np.diag(alone.covariance))
        assert_allclose(together.value[t] / sd, alone.value / sd, atol=1e-6)
        assert_allclose(
            together.covariance[t] / np.outer(sd, sd),
            alone.covariance / np.outer(sd, sd),
            atol=1e-6,
        )
        assert_allclose(together.whitened[t], alone.whitened, atol=1e-6)
        assert_allclose(together.chi2[t], alone.chi2, rtol=1e-6)
        assert together.rank == alone.rank
        assert together.dof == alone.dof


def test_a_batch_that_does_not_determine_a_coefficient_is_refused():
    rows, spins = table(NINE)
    few = rows.rows(range(6))
    with pytest.raises(NotObserved):
        ml(few, NINE, EXACT, spins[:6])


def test_one_trial_of_nonsense_does_not_affect_the_others():
    rows, spins = table(FIFTEEN)
    good = ml(rows, FIFTEEN, EXACT, spins)
    wild = rows.mean.copy()
    wild[4] *= np.random.default_rng(8).uniform(-9, 9, size=wild[4].shape)
    found = ml(replace(rows, mean=wild), FIFTEEN, EXACT, spins)
    others = np.arange(TRIALS) != 4
    sd = np.sqrt(np.diagonal(good.covariance, axis1=-2, axis2=-1))
    assert np.abs((found.value - good.value) / sd)[others].max() < 1e-6
    assert found.converged[others].all()
