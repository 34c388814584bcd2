"""Maximum-likelihood estimates from the mean readings of positions and turns.

The mean reading of each row is compared with the model's reading of the mean motion, which is exact
for models affine in f and ω. The bench's imperfections are nuisances with their standard deviations
as priors; the mean specific force during each turn is a nuisance without a prior. The stated
uncertainty therefore includes errors of the fixture, the turn angles, local gravity and the clock.
"""

from dataclasses import replace

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.errors import NotObserved
from inercal.basics.parameters import Parameter
from inercal.benches import Hand
from inercal.estimation import Estimate, Problem
from inercal.methods import Priors, mean_problem, observability, solving
from inercal.methods.curvature import Curvature, tilt_curvature
from inercal.methods.mean_problem import ReadingNoise
from inercal.physics.plan import HandSteps, Hold, Turn
from inercal.physics.sensors import Sensor, inverse
from inercal.recordings import Observations

_EXACT_LIMIT = 1e-15  # SI; smaller deviations count as exact, like the level earth rate at a pole
_UNREAD = 0.05  # of g, for a tilted turn axis and for a sensor that is away from the axis
_ZERO_INPUT_LIMIT = 1e-6  # of g, or of a turn's rate


def ml(
    observations: Observations, sensor: Sensor, bench: Hand, steps: HandSteps, priors: Priors = ()
) -> Estimate:
    """Return the estimate of the sensor's coefficients and the bench's nuisances.

    If the slopes within the rests reveal a drift, it is subtracted, with its uncertainty.

    Parameters
    ----------
    observations : Observations
        Rows in SI; their labels name the steps, and their channels are the sensor's axes.
    sensor : Sensor
        The sensor with the coefficients to estimate.
    bench : Hand
    steps : sequence of HandStep
        The planned steps; steps without a row were not carried out.
    priors : sequence of Gaussian
        Priors on coefficients, from other measurements.

    Raises
    ------
    NotObserved
        These steps do not determine all coefficients. The message names the coefficients and the
        missing steps.
    """
    observations = observations.without_drift()
    by_label = {step.label: step for step in steps}
    done = [by_label[label] for label in observations.labels]
    missing = [step for step in steps if step.label not in observations.labels]

    def first(some: Observations, own: Priors) -> Problem:
        return hand_problem(some, sensor, bench, done, own)

    def with_curvature(some: Observations, own: Priors, found: Estimate) -> Problem | None:
        curvature = tilt_curvature(found, sensor, bench, done, some.duration)
        return curvature and hand_problem(some, sensor, bench, done, own, curvature)

    try:
        estimate = solving.solve(observations, priors, first, with_curvature)
    except NotObserved as error:
        raise observability.not_observed_error(sensor, error.directions, missing) from None
    observability.require_observed(estimate, sensor, missing)
    observability.require_bias_scale_separation(sensor, done, missing, priors)
    return replace(estimate, tests=observations.tests)


def hand_problem(
    observations: Observations,
    sensor: Sensor,
    bench: Hand,
    done: HandSteps,
    priors: Priors = (),
    curvature: Curvature | None = None,
) -> Problem:
    """Return the estimation problem; `done` are the steps of the rows, in the order of the rows.

    `curvature` corrects the readings for the second-order effects of the tilts.
    """
    noise = _reading_noise(observations)
    if curvature is not None:
        full = observations.full_covariance + curvature.covariance
        noise = ReadingNoise(full, correlated=True)
        observations = replace(observations, mean=observations.mean - curvature.shift)
    # The duration of a step comes from the recording, not from the plan.
    lasting = [
        replace(step, seconds=t)
        for step, t in zip(done, observations.duration.tolist(), strict=True)
    ]
    declared = {
        name: one if one.sd > _EXACT_LIMIT else replace(one, sd=0.0)
        for name, one in bench.nuisances(done, sensor).items()
    }
    switched = bench.turn_on_biases(done, sensor)
    turns = [k for k, step in enumerate(done) if isinstance(step, Turn)]
    forces: dict[str, Array] = {}
    if turns and sensor.rank("f") < len("xyz"):
        declared |= _unread_forces([done[k] for k in turns], bench.gravity.value)
    elif turns:
        bare = Sensor(sensor.name, sensor.axes)
        mean = inverse(bare, observations.mean[..., turns, :], np.zeros(0)).f
        forces = {
            f"force_{a}[{done[k].label}]": mean[..., j, i]
            for j, k in enumerate(turns)
            for i, a in enumerate("xyz")
        }
    return mean_problem.problem_of_readings(
        observations,
        sensor,
        declared,
        lambda q: bench.mean_motion(lasting, q),
        priors,
        with_drift_candidate=True,
        unknown_forces=forces,
        stated_noise=noise,
        zero_input=_zero_input_readings(sensor, done),
        families={"turn_on": tuple(switched)} if switched else None,
        suspects=switched | declared,
    )


def _unread_forces(turns: HandSteps, gravity: float) -> dict[str, Parameter]:
    """Return the mean specific forces in turns as nuisances, if not all components are read."""
    text = "mean specific force in the turn"
    return {
        f"force_{a}[{step.label}]": Parameter(
            f"force_{a}", "m/s²", _UNREAD * gravity, "turn", gravity * along, text
        )
        for step in turns
        if isinstance(step, Turn)
        for a, along in zip("xyz", step.axis, strict=True)
    }


def _zero_input_readings(sensor: Sensor, done: HandSteps) -> Bools | None:
    """Return which readings come from axes with zero nominal input, (r·m,), row after row.

    Return None if each position occurs once: two or four readings of an axis do not reveal a sign.
    """
    at = [step.up if isinstance(step, Hold) else step.axis for step in done]
    if len(set(zip(map(type, done), at, strict=True))) == len(at):
        return None
    across = np.abs(np.array(at) @ np.array([axis.i for axis in sensor.axes]).T) < _ZERO_INPUT_LIMIT
    still = np.array([isinstance(step, Hold) for step in done])
    rates = np.array([axis.measures == "w" for axis in sensor.axes])
    return (across | (still[:, None] & rates)).ravel()


def _reading_noise(observations: Observations) -> ReadingNoise:
    """Return the covariance of all readings, or their standard deviations if uncorrelated.

    Whitening is faster with standard deviations.
    """
    blocks = observations.covariance
    variance = np.diagonal(blocks, axis1=-2, axis2=-1)
    independent = observations.between_rows is None and observations.common is None
    if independent and np.count_nonzero(blocks) == np.count_nonzero(variance):
        deviations = np.sqrt(variance).reshape(*variance.shape[:-2], -1)
        return ReadingNoise(deviations, correlated=False)
    return ReadingNoise(observations.full_covariance, correlated=True)
