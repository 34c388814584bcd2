"""Whether errors of `ml` agree with its uncertainties: sessions simulated without inercal.

Every band is four standard deviations of what is averaged, at three hundred trials.
"""

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.ferraris import EARTH, POSITIONS, TURNS, Handling, Imu
from tests.consistency.conftest import TRIALS, Sessions

from inercal.benches import Hand
from inercal.methods import METHODS

Array = NDArray[np.float64]
PLANNED = [name for name, m in METHODS.items() if m.bench is Hand and not m.unknown_attitudes]
pytestmark = pytest.mark.slow
both = pytest.mark.parametrize("method", PLANNED)


@both
def test_normalised_error_squared_is_one(sessions: Sessions, method: str):
    judged = sessions.judged[method]
    assert judged.estimate.converged.all()
    band = 4 * np.sqrt(2 / (len(judged.names) * TRIALS))
    assert judged.nees.mean() == pytest.approx(1, abs=band)


@both
def test_no_coefficient_is_biased(sessions: Sessions, method: str):
    error = sessions.judged[method].error
    standard_errors = error.mean(axis=0) / (error.std(axis=0, ddof=1) / TRIALS**0.5)
    assert np.abs(standard_errors).max() < 4


@both
def test_each_coefficient_errs_by_its_stated_deviation(sessions: Sessions, method: str):
    judged = sessions.judged[method]
    ratio = np.sqrt(np.mean((judged.error / judged.std) ** 2, axis=0))
    np.testing.assert_allclose(ratio, 1, rtol=0, atol=4 / np.sqrt(2 * TRIALS))


@both
def test_chi_squared_is_its_degrees_of_freedom(sessions: Sessions, method: str):
    estimate = sessions.judged[method].estimate
    band = 4 * np.sqrt(2 / (estimate.dof * TRIALS))
    assert np.mean(estimate.chi2) / estimate.dof == pytest.approx(1, abs=band)


@both
def test_no_unbiased_estimator_could_err_less(sessions: Sessions, method: str):
    """The errors reach the Cramér–Rao bound, and what is stated is the bound."""
    judged = sessions.judged[method]
    turns = dict(TURNS) if method == "ferraris" else {}
    bound = cramer_rao(sessions.device, sessions.hands, turns)
    bound = np.array([bound[name] for name in judged.names])
    rms = np.sqrt(np.mean(judged.error**2, axis=0))
    np.testing.assert_allclose(rms / bound, 1, rtol=0, atol=4 / np.sqrt(2 * TRIALS))
    # The noise is estimated, with 114 degrees of freedom: 7 % a trial, 0.4 % in the mean.
    stated = np.sqrt(np.mean(judged.std**2, axis=0))
    np.testing.assert_allclose(stated / bound, 1, rtol=0, atol=0.02)


def cramer_rao(
    device: Imu,
    hands: Handling,
    turns: dict[str, Array],
    *,
    hold_seconds: float = 10.0,
    turn_seconds: float = 8.0,
) -> dict[str, float]:
    """Return the least standard deviation of each coefficient, by name.

    Densely, from the physics: the mean readings of all sections as one function of everything
    unknown, its Jacobian by central differences, and the inverse of the information of readings
    and of what is known beforehand. Readings of the turns' specific force cost three unknowns a
    turn, since nothing is known of it.
    """
    lean, level = len(POSITIONS), EARTH * np.cos(hands.latitude or 0) / 2**0.5
    known = [  # (how many, what is known of each of them)
        (1, hands.gravity_sd),
        (2 * lean, hands.tilt),
        (2 * lean, level),
        (len(turns), hands.turn_angle),
        (2 * len(turns), hands.turn_tilt),
        (1, hands.timebase),
        (3 * len(turns), np.inf),
    ]
    matrices = [device.M_a, device.b_a, device.M_g, device.b_g, device.G]
    shapes = [m.shape for m in matrices]
    own = np.concatenate([m.ravel() for m in matrices])
    sizes = [m.size for m in matrices]
    counts = [n for n, _ in known]

    def split(x: Array, parts: list[int]) -> list[Array]:
        return np.split(x, np.cumsum(parts)[:-1])

    def readings(x: Array) -> Array:
        M_a, b_a, M_g, b_g, G = (
            m.reshape(shape) for m, shape in zip(split(x[: own.size], sizes), shapes, strict=True)
        )
        dg, tilt, earth, dangle, dn, clock, force = split(x[own.size :], counts)
        g = hands.gravity + dg[0]
        rate_up = EARTH * np.sin(hands.latitude or 0)
        felt: list[tuple[Array, Array]] = []
        for k, up in enumerate(POSITIONS.values()):
            d = np.eye(3)[up == 0]
            u = up + tilt[2 * k : 2 * k + 2] @ d
            u = u / np.linalg.norm(u)
            felt.append((g * u, rate_up * u + earth[2 * k : 2 * k + 2] @ d))
        for k, axis in enumerate(turns.values()):
            n = axis + dn[2 * k : 2 * k + 2] @ np.eye(3)[axis == 0]
            rate = (2 * np.pi + dangle[k]) / (turn_seconds * (1 + clock[0]))
            f = hands.gravity * axis + force[3 * k : 3 * k + 3]
            felt.append((f, rate * n / np.linalg.norm(n) + rate_up * f / hands.gravity))
        return np.concatenate([np.r_[M_a @ f + b_a, G @ f + M_g @ w + b_g] for f, w in felt])

    x = np.concatenate([own, np.zeros(sum(counts))])
    step = 1e-5
    columns = [
        (readings(x + step * row) - readings(x - step * row)) / (2 * step) for row in np.eye(x.size)
    ]
    J = np.stack(columns, axis=1)
    seconds = [hold_seconds] * lean + [turn_seconds] * len(turns)
    white = np.repeat([device.white_a, device.white_g], 3)
    sd = (white / np.sqrt(seconds)[:, None]).ravel()
    beforehand = np.concatenate([np.full(n, size**-2.0) for n, size in known])
    information = J.T @ (J / sd[:, None] ** 2)
    information += np.diag(np.concatenate([np.zeros(own.size), beforehand]))
    if not turns:  # the gyros' matrix is then taken as nominal: a device's is so within 1 %
        information[12:21, 12:21] += np.eye(9) / 0.01**2
    # The unknowns differ by many orders of magnitude; scaled, the inverse is well conditioned.
    scale = np.sqrt(np.diag(information))
    variance = np.diag(np.linalg.inv(information / np.outer(scale, scale))) / scale**2
    spread = [
        m.reshape(shape)
        for m, shape in zip(split(np.sqrt(variance[: own.size]), sizes), shapes, strict=True)
    ]
    eye = np.eye(3)
    named = Imu(eye + spread[0], spread[1], eye + spread[2], spread[3], spread[4]).coefficients()
    return {name: abs(value) for name, value in named.items()}
