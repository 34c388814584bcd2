"""Maximum likelihood from the mean readings of holds and turns.

Each row's mean reading is compared with the model's reading of the mean motion (exact for models
affine in f and ω). The bench's imperfections ride along as nuisances with their standard
deviations as priors, the mean specific force during each turn as a free one, so that the stated
uncertainty holds fixture and turn-angle errors, local gravity and the clock.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from inercal.arrays import Array
from inercal.benches import Hand
from inercal.benches.hand.bench import felt
from inercal.errors import NotObserved
from inercal.estimate import Estimate, Gaussian, Problem, least_squares
from inercal.methods import candidates, temperature
from inercal.methods.curvature import Curvature, of_tilts
from inercal.methods.observed import not_observed, require_observed, require_separated
from inercal.motion import Motion
from inercal.observe import vector
from inercal.plan import HandStep, Hold, Turn
from inercal.recording import Observations
from inercal.sensors import G0, Sensor, inverse

_EXACT = 1e-15  # SI; what is known better is exact, such as the level earth rate at a pole
_ACROSS = 1e-6  # of g, or of a turn's rate


def ml(
    observations: Observations,
    sensor: Sensor,
    bench: Hand,
    steps: Sequence[HandStep],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the estimate of the sensor's coefficients and the bench's nuisances.

    Parameters
    ----------
    observations : Observations
        Rows in SI; labels name steps, channels are the sensor's axes.
    sensor : Sensor
        With the coefficients that are wanted.
    bench : Hand
    steps : sequence of HandStep
        The nominal plan; steps without a row were not carried out.
    priors : sequence of Gaussian
        On coefficients, from elsewhere.

    Raises
    ------
    NotObserved
        Coefficients that these steps leave open, by name, and the steps that are missing.
    """
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels]
    missing = [step for step in steps if step.label not in observations.labels]
    try:
        first = least_squares(problem(observations, sensor, bench, done, priors))
        curvature = of_tilts(first, sensor, bench, done, observations.duration)
        whole = problem(observations, sensor, bench, done, priors, curvature)
        estimate = first if curvature is None else least_squares(whole)
    except NotObserved as error:
        raise not_observed(sensor, error.directions, missing) from None
    require_observed(estimate, sensor, missing)
    require_separated(sensor, done, missing, priors)
    return replace(estimate, tests=observations.tests)


def problem(
    observations: Observations,
    sensor: Sensor,
    bench: Hand,
    done: Sequence[HandStep],
    priors: Sequence[Gaussian] = (),
    curvature: Curvature | None = None,
    *,
    freed: bool = False,
) -> Problem:
    """Return the estimation problem; `done` are the steps of the rows, in their order.

    `curvature` corrects the readings for the second order of the tilts, once that is known; `freed`
    has columns of the bench's exact parameters too, for the candidates of the score tests.
    """
    mean = observations.mean
    if curvature is None:
        noise = _noise(observations)
    else:
        mean = mean - curvature.shift
        noise = observations.full_covariance + curvature.covariance
    stated = bench.nuisances(done, sensor)
    rates = any(axis.measures == "w" for axis in sensor.axes)
    declared = candidates.freed(stated) if freed else stated
    loose = {name: p for name, p in declared.items() if p.sd > _EXACT}
    known = {name: np.array(p.value) for name, p in declared.items() if name not in loose}
    forces = [f"force_{a}[{step.label}]" for step in done if isinstance(step, Turn) for a in "xyz"]
    names = (*sensor.coefficients, *loose, *forces)
    p = len(sensor.coefficients)
    turns = [k for k, step in enumerate(done) if isinstance(step, Turn)]
    warmth = temperature.offset(observations, sensor)
    # Without turns all trials start from one point, which is then worked out once.
    trials = observations.mean.shape[:-2] if turns else ()
    start = np.zeros((*trials, len(names)))
    start[..., p : p + len(loose)] = [parameter.value for parameter in loose.values()]
    if turns:
        bare = Sensor(sensor.name, sensor.axes)
        start_force = inverse(bare, observations.mean[..., turns, :], np.zeros(0)).f
        start[..., p + len(loose) :] = start_force.reshape(*trials, -1)

    def linearise(x: Array) -> tuple[Array, Array]:
        q = known | {name: x[..., p + k] for k, name in enumerate(names[p:])}
        rows = [
            felt(step, float(t), q) for step, t in zip(done, observations.duration, strict=True)
        ]
        shape = (*x.shape[:-1], len(rows), 3)
        f, w = np.empty(shape), np.empty(shape)
        df, dw = (np.zeros((*shape, len(names) - p)) for _ in range(2))
        for k, row in enumerate(rows):
            f[..., k, :], w[..., k, :] = row.f, row.w
            for target, derivatives in ((df, row.df), (dw, row.dw)):
                for name, value in derivatives.items():
                    if name in position:
                        target[..., k, :, position[name]] = value
        motion = Motion(f, w, dT=warmth) if rates else Motion(f, dT=warmth)
        return vector(sensor, mean, x[..., :p], motion, df, dw if rates else None)

    def larger() -> Problem:
        whole = candidates.extended(sensor, warmed=observations.warmed)
        return problem(observations, whole, bench, done, curvature=curvature, freed=True)

    position = {name: k for k, name in enumerate(names[p:])}
    sizes = [candidates.natural(parameter) for parameter in loose.values()]
    bench_prior = Gaussian.independent(
        tuple(loose),
        [parameter.value for parameter in loose.values()],
        [parameter.sd for parameter in loose.values()],
    )
    return Problem(
        names=names,
        start=start,
        linearise=linearise,
        noise=noise,
        scale=np.concatenate([sensor.natural, sizes, np.full(len(forces), G0)]),
        priors=(bench_prior, *priors) if loose else tuple(priors),
        wanted=sensor.coefficients,
        observations=tuple(f"{a}[{row}]" for row in observations.labels for a in sensor.channels),
        candidates=candidates.of_means(
            larger, names, sensor, stated, observations.time, level=_level(sensor, done)
        ),
    )


def _level(sensor: Sensor, done: Sequence[HandStep]) -> NDArray[np.bool_] | None:
    """Return which readings are of axes that feel nothing nominally, (r·m,), row after row.

    None where each position was taken once: two or four such readings of an axis tell no sign.
    """
    at = [step.up if isinstance(step, Hold) else step.axis for step in done]
    if len(set(zip(map(type, done), at, strict=True))) == len(at):
        return None
    across = np.abs(np.array(at) @ np.array([axis.i for axis in sensor.axes]).T) < _ACROSS
    still = np.array([isinstance(step, Hold) for step in done])
    rates = np.array([axis.measures == "w" for axis in sensor.axes])
    return (across | (still[:, None] & rates)).ravel()


def _noise(observations: Observations) -> Array:
    """Return the covariance of all readings, or without correlations their deviations, (..., r·m).

    Standard deviations are quicker to work with.
    """
    blocks = observations.covariance
    variance = np.diagonal(blocks, axis1=-2, axis2=-1)
    if observations.drift is None and np.count_nonzero(blocks) == np.count_nonzero(variance):
        return np.sqrt(variance).reshape(*variance.shape[:-2], -1)
    return observations.full_covariance
