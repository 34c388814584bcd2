"""The filter's way there and back against all states at once, and against its own constants."""

import numpy as np
import pytest

from inercal.estimation.kalman import (
    allocate_steps,
    predict,
    smooth_steps,
    start_smoother,
    update,
)

N, K, M, EPOCHS = 7, 2, 3, 9  # states, driven ones, observations, epochs


class SimulatedErrors:
    """A random system: states K to K + 2 decay, one of them begins anew; the others are constant.

    At epoch 4 nothing is observed and the driven states are lost.
    """

    def __init__(self, seed: int):
        rng = np.random.default_rng([seed, 65])
        self.prior = np.diag(rng.uniform(0.5, 2.0, N)) + 0.3
        self.a = rng.standard_normal((EPOCHS, K, N))
        self.keep = np.ones((EPOCHS, N))
        self.keep[:, K] = 0.8
        self.a[4], self.keep[4, K + 1] = 0.0, 0.0
        root = rng.standard_normal((K, K))
        self.driven = root @ root.T
        self.drawn = np.zeros((EPOCHS, N))
        self.drawn[:, K], self.drawn[4, K + 1] = 0.3, 0.7
        self.h = rng.standard_normal((EPOCHS, M, N))
        self.z = rng.standard_normal((EPOCHS, M))
        self.r = rng.uniform(0.1, 1.0, M)
        self.h[4] = self.z[4] = 0.0

    def whole(self) -> tuple[np.ndarray, np.ndarray]:
        """Return mean (e, n) and covariance (e, n, n) of each epoch's states given all of z."""
        joint = np.zeros((EPOCHS, N, EPOCHS, N))
        p = self.prior
        for e in range(EPOCHS):
            phi, q = np.diag(self.keep[e]), np.diag(self.drawn[e])
            phi[:K], q[:K, :K] = self.a[e], self.driven
            p = phi @ p @ phi.T + q
            for before in range(e):
                joint[e, :, before] = phi @ joint[e - 1, :, before]
                joint[before, :, e] = joint[e, :, before].T
            joint[e, :, e] = p
        p = joint.reshape(EPOCHS * N, EPOCHS * N)
        h = np.zeros((EPOCHS, M, EPOCHS, N))
        h[range(EPOCHS), :, range(EPOCHS)] = self.h
        h = h.reshape(EPOCHS * M, EPOCHS * N)
        gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + np.diag(np.tile(self.r, EPOCHS)))
        mean = gain @ self.z.ravel()
        left = (p - gain @ h @ p).reshape(EPOCHS, N, EPOCHS, N)
        return mean.reshape(EPOCHS, N), left[range(EPOCHS), :, range(EPOCHS)]

    def there_and_back(self, fed: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the filter's estimates, and smoothed ones with variances, (e, n) each.

        After each epoch a part of x, `fed`, is fed back to an estimate beside the filter.
        """
        made = allocate_steps(EPOCHS, N, K, M, np.eye(N))
        x, p, beside = np.zeros(N), self.prior.copy(), np.zeros(N)
        found = np.zeros((EPOCHS, N))
        for e in range(EPOCHS):
            made.a[e], made.keep[e], made.h[e] = self.a[e], self.keep[e], self.h[e]
            phi = np.diag(self.keep[e])
            phi[:K] = self.a[e]
            x, beside = phi @ x, phi @ beside
            predict(p, self.a[e], self.keep[e], self.driven, self.drawn[e], np.empty((K, N)))
            for k in range(M):
                if e == 4:
                    continue
                z = self.z[e, k] - self.h[e, k] @ beside
                made.off[e, k], made.s[e, k] = update(
                    x, p, self.h[e, k], z, self.r[k], made.gain[e, k]
                )
            made.rows[e] = p
            beside, x = beside + fed * x, (1 - fed) * x
            found[e] = beside + x
        added, variance = np.zeros((EPOCHS, N)), np.zeros((EPOCHS, N))
        back = start_smoother(np.zeros((N, N)))
        smooth_steps(made, back, np.zeros(N), np.arange(EPOCHS), added, variance)
        return found, found + added, variance


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("fed", [0.0, 1.0])
def test_the_way_back_gives_each_epoch_what_all_observations_say(seed: int, fed: float):
    drawn = SimulatedErrors(seed)
    mean, covariance = drawn.whole()
    _, value, variance = drawn.there_and_back(fed)
    assert value == pytest.approx(mean, rel=0, abs=1e-10)
    assert variance == pytest.approx(np.diagonal(covariance, axis1=1, axis2=2), rel=1e-9)


def test_a_constant_is_all_along_what_it_is_at_the_end():
    found, value, variance = SimulatedErrors(1).there_and_back(1.0)
    constants = slice(K + 2, N)
    assert value[:, constants] == pytest.approx(np.tile(found[-1, constants], (EPOCHS, 1)))
    assert np.ptp(variance[:, constants], axis=0).max() < 1e-12
    assert np.ptp(found[:, constants], axis=0).min() > 0.1  # the filter's own were not
