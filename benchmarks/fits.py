"""Many small fits: six positions, 12 coefficients and 13 nuisances (tilts and gravity) a trial.

y_r = b + (I + S) R(tilt_r) g up_r in six positions r: 18 observations and 13 priors for 25
parameters, values and covariances for all trials. The peer is a loop over SciPy with the analytic
Jacobian, by its default method (trf) and its fastest (lm), at its default tolerances.
"""

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares as scipy_least_squares

from benchmarks import Row, best
from inercal.estimation import Gaussian, Problem, least_squares

Array = NDArray[np.float64]
TRIALS, PEER_TRIALS = 4000, 400
UP = np.vstack([np.eye(3), -np.eye(3)])
TILTS = np.roll(UP, 1, axis=1), np.roll(UP, 2, axis=1)
NAMES = tuple(
    [f"b{i}" for i in "xyz"]
    + [f"s{i}{j}" for i in "xyz" for j in "xyz"]
    + [f"tilt{r}{k}" for r in range(6) for k in "ab"]
    + ["g"]
)
G, SD, PRIOR_SD = 9.80665, 1e-4, np.append(np.full(12, 1e-3), 1e-4)
START = np.append(np.zeros(24), G)


def model(x: Array) -> tuple[Array, Array]:
    """Return h (..., 18) and ∂h/∂x (..., 18, 25)."""
    lead = x.shape[:-1]
    bias, matrix = x[..., None, :3], np.eye(3) + x[..., 3:12].reshape(*lead, 3, 3)
    tilt, g = x[..., 12:24].reshape(*lead, 6, 2), x[..., 24, None, None]
    across = np.swapaxes(matrix, -1, -2)
    along = UP + tilt[..., :1] * TILTS[0] + tilt[..., 1:] * TILTS[1]
    norm = 1 / np.sqrt(1 + tilt[..., :1] ** 2 + tilt[..., 1:] ** 2)
    up = norm * along
    f, felt = g * up, up @ across
    jacobian = np.zeros((*lead, 6, 3, 25))
    for i in range(3):
        jacobian[..., i, i] = 1.0
        jacobian[..., i, 3 + 3 * i : 6 + 3 * i] = f
    for k, direction in enumerate(TILTS):
        turned = (g * norm * (direction - tilt[..., k, None] * norm * up)) @ across
        for r in range(6):
            jacobian[..., r, :, 12 + 2 * r + k] = turned[..., r, :]
    jacobian[..., 24] = felt
    return (bias + g * felt).reshape(*lead, 18), jacobian.reshape(*lead, 18, 25)


def draw(trials: int) -> tuple[Array, Array]:
    """Return truths (trials, 25) and observations (trials, 18)."""
    rng = np.random.default_rng(0)
    truth = np.tile(START, (trials, 1))
    truth[:, :3] += 0.1 * rng.normal(size=(trials, 3))
    truth[:, 3:12] += 0.01 * rng.normal(size=(trials, 9))
    truth[:, 12:] += PRIOR_SD * rng.normal(size=(trials, 13))
    return truth, model(truth)[0] + SD * rng.normal(size=(trials, 18))


def ours(y: Array) -> tuple[Array, Array]:
    """Return values and covariances of all trials, together."""

    def linearise(x: Array) -> tuple[Array, Array]:
        h, jacobian = model(x)
        return y - h, jacobian

    problem = Problem(
        names=NAMES,
        start=START,
        linearise=linearise,
        noise=np.full(18, SD),
        scale=np.concatenate([np.full(3, 0.1), np.full(9, 0.01), PRIOR_SD]),
        priors=(Gaussian.independent(NAMES[12:], START[12:], PRIOR_SD),),
        wanted=NAMES[:12],
    )
    estimate = least_squares(problem)
    assert estimate.converged.all()
    return estimate.value, estimate.covariance


def peer(
    y: Array, method: Literal["trf", "lm"], sd: float = SD, prior_sd: Array = PRIOR_SD
) -> tuple[Array, Array]:
    """Return values and covariances of all trials, one after another."""
    prior = np.zeros((13, 25))
    prior[:, 12:] = np.diag(1 / prior_sd)

    def fit(one: Array) -> tuple[Array, Array]:
        last: list[Array] = []  # SciPy asks for the residual and then for the Jacobian, at one x

        def residual(x: Array) -> Array:
            h, jacobian = model(x)
            last[:] = [x.copy(), jacobian]
            return np.concatenate([(h - one) / sd, (x[12:] - START[12:]) / prior_sd])

        def derivative(x: Array) -> Array:
            jacobian = last[1] if np.array_equal(last[0], x) else model(x)[1]
            return np.concatenate([jacobian / sd, prior])

        found = scipy_least_squares(
            residual,
            START,
            derivative,  # pyright: ignore[reportArgumentType]  SciPy has no stubs
            method=method,
            x_scale="jac",
        )
        return found.x, np.linalg.inv(found.jac.T @ found.jac)

    pairs = [fit(one) for one in y]
    return np.array([v for v, _ in pairs]), np.array([c for _, c in pairs])


def rows() -> list[Row]:
    """Compare the answers, then the times; the peer's time is of fewer trials, scaled up."""
    _, y = draw(TRIALS)
    few = y[:PEER_TRIALS]
    value, covariance = ours(y)
    sd = np.sqrt(np.diagonal(covariance[:PEER_TRIALS], axis1=-2, axis2=-1))
    methods: dict[str, Callable[[], tuple[Array, Array]]] = {
        "scipy trf": lambda: peer(few, "trf"),
        "scipy lm": lambda: peer(few, "lm"),
    }
    for work in methods.values():
        other, other_covariance = work()
        assert np.abs((value[:PEER_TRIALS] - other) / sd).max() < 1e-4
        scale = sd[:, :, None] * sd[:, None, :]
        assert np.abs((covariance[:PEER_TRIALS] - other_covariance) / scale).max() < 1e-4
    times = {name: best(work, 3) * TRIALS / PEER_TRIALS for name, work in methods.items()}
    label, own = f"six positions, 25 parameters, {TRIALS} trials", best(lambda: ours(y))
    return [Row(label, own, times[name], name) for name in times]
