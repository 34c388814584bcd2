"""Estimate from the mean readings of positions and turns by maximum likelihood.

The mean reading of each row is compared with the model's reading of the mean motion, which is exact
for models affine in f and ω. The bench's imperfections are nuisances with their standard deviations
as priors; the mean specific force during each turn is a nuisance without a prior. The stated
uncertainty therefore includes errors of the fixture, the turn angles, local gravity and the clock.

The first-order fit does not include the second-order effects of unknown tilts. A face that is
tilted by t reads g (1 − |t|²/2) along its normal, and misalignments m add m·t. The fit estimates t
and the coefficients c with covariance P. Let τ be the errors of t and δ the errors of c. Their
second-order terms are, for reading i in row r::

    Q_i = Σ_k η_ik τ_rk,   η_ik = ½ (∂²h_i/∂t²) τ_rk + (∂²h_i/∂c ∂t_k)·δ

The means of these terms correct the readings, and their covariance is added to the noise. For
Gaussian errors

    E[Q_i] = Σ_k cov(η_ik, τ_rk)
    cov(Q_i, Q_j) = Σ_kl cov(η_ik, η_jl) cov(τ_rk, τ_sl) + cov(η_ik, τ_sl) cov(η_jl, τ_rk)

(GUM, JCGM 100:2008, note to 5.1.2; moments by Isserlis' theorem). At half a degree the effect is
38 ppm of scale factor, with an equally large uncertainty. This is more than the noise of a good
MEMS accelerometer. A tilted turn axis has the same effect.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import NotObserved
from inercal.basics.keys import CoefficientName
from inercal.basics.parameters import Parameter
from inercal.benches import Hand
from inercal.benches.hand.bench import sensed_motion
from inercal.estimation import Estimate, Problem
from inercal.estimation.gauss_newton_steps import QR_MAX_TRIALS
from inercal.methods import Priors, mean_problem, observability, solving
from inercal.methods.mean_problem import ReadingNoise
from inercal.physics.motion import Motion
from inercal.physics.plan import HandSteps, Hold, Turn
from inercal.physics.sensors import Sensor, nominal_inverse
from inercal.recordings import Observations


class Curvature(NamedTuple):
    """Second-order effect of the tilts on the mean readings from r rows and m axes, SI.

    `shift` (..., r, m) is the mean of the effect, and `covariance` (..., r·m, r·m) is its
    covariance, row after row.
    """

    shift: Array
    covariance: Array


def tilt_curvature(
    estimate: Estimate, sensor: Sensor, bench: Hand, done: HandSteps, durations: Array
) -> Curvature | None:
    """Return the second-order effect at a first-order estimate, or None if all tilts are exact.

    Parameters
    ----------
    estimate : Estimate
        Estimate of the coefficients and the bench's nuisances.
    sensor : Sensor
        A sensor whose model is affine in f and ω.
    bench : Hand
        The bench with the values of its exact parameters.
    done : sequence of r HandStep
        The steps that were carried out.
    durations : (r,) array
        Duration of each step, s.
    """
    p, r, m = len(sensor.coefficients), len(done), len(sensor.axes)
    names = [bench.tilt_names(step) for step in done]
    loose = [n for n in range(r) if set(names[n]) <= set(estimate.names)]
    if not loose:
        return None
    rows = np.array(loose)
    c, lead = estimate.value[..., :p], estimate.value.shape[:-1]
    declared = bench.acting_parameters(done, rates=True)
    q = {name: np.array(parameter.value) for name, parameter in declared.items()}
    q |= {name: estimate.value[..., k] for k, name in enumerate(estimate.names)}
    index = np.array([[estimate.names.index(name) for name in names[n]] for n in loose])
    slope = sensor.slope(Motion(np.zeros((1, 3))), c)[..., 0, :, :]
    still = sensor.design(Motion(np.zeros((1, 3))), c)
    own = [
        [k for k, name in enumerate(sensor.coefficients) if CoefficientName(name).axis == axis]
        for axis in sensor.channels
    ]
    most = max(map(len, own))
    # η with respect to the coefficients of the reading's axis, and to the tangent itself.
    place = np.zeros((len(loose), m, 2, most + 1), dtype=np.int64)
    place[..., most] = index[:, None]
    eta = np.zeros((*lead, *place.shape))
    for n, row_place in enumerate(loose):
        step = done[row_place]
        row = sensed_motion(step, float(durations[row_place]), q)
        # The second derivative with respect to a tangent is minus the vector that is tilted.
        leans, part = (row.f, slope[..., :3]) if isinstance(step, Hold) else (row.w, slope[..., 3:])
        eta[..., n, :, :, most] = -0.5 * (part @ leans[..., None])
        for k, name in enumerate(names[row_place]):
            to_f, to_w = (d.get(name, np.zeros(3)) for d in (row.df, row.dw))
            mixed = sensor.design(Motion(to_f[..., None, :], to_w[..., None, :]), c) - still
            for i, some in enumerate(own):
                place[n, i, k, : len(some)] = some
                eta[..., n, i, k, : len(some)] = mixed[..., 0, i, some]
    moments = _moments if lead <= (QR_MAX_TRIALS,) else _moments_of_trials
    return moments(eta, place, estimate.covariance, index, rows, r)


def _moments_of_trials(
    eta: Array, place: Indices, spread: Array, index: Indices, rows: Indices, r: int
) -> Curvature:
    """Return the same as `_moments`, but with compiled code."""
    from inercal.methods.residuals._row_operations import second_order_moments

    trials, (_, m, _, _) = len(eta), place.shape
    result = Curvature(np.zeros((trials, r, m)), np.zeros((trials, r * m, r * m)))
    scratch = np.empty((*place.shape[:-1], spread.shape[-1]))
    spread = np.require(spread, requirements=["C", "W"])
    second_order_moments(eta, place, spread, index, rows, scratch, *result)
    return result


def _moments(
    eta: Array, place: Indices, spread: Array, index: Indices, rows: Indices, r: int
) -> Curvature:
    """Return the mean and covariance of Q.

    Parameters
    ----------
    eta, place : (..., t, m, 2, d) and (t, m, 2, d) arrays
        η for t tilted rows, and the indices of the parameters that it refers to.
    spread : (..., p, p) array
        Covariance P.
    index : (t, 2) array of int
        Indices of the tangents.
    rows : (t,) array of int
        Indices of the tilted rows, among r rows.
    """
    lead, (t, m, _, d) = eta.shape[:-4], place.shape
    flat = np.zeros((*lead, t * m * 2, spread.shape[-1]))
    # Unused entries refer to the first parameter, with η equal to zero.
    for k in range(d):
        flat[..., np.arange(t * m * 2), place[..., k].ravel()] += eta[..., k].reshape(*lead, -1)
    tau = index.ravel()
    eta_tau = (flat @ spread[..., tau]).reshape(*lead, t, m, 2, t, 2)
    eta_eta = (flat @ spread @ flat.mT).reshape(*lead, t, m, 2, t, m, 2)
    tau_tau = spread[..., tau, :][..., tau].reshape(*lead, t, 2, t, 2)
    shift = np.zeros((*lead, r, m))
    shift[..., rows, :] = np.einsum("...rakrk->...ra", eta_tau)
    covariance = np.einsum("...rakjbl,...rkjl->...rajb", eta_eta, tau_tau)
    covariance += np.einsum("...rakjl,...jblrk->...rajb", eta_tau, eta_tau)
    whole = np.zeros((*lead, r, m, r, m))
    for n, at in enumerate(rows.tolist()):
        whole[..., at, :, rows, :] = np.moveaxis(covariance[..., n, :, :, :], -2, 0)
    return Curvature(shift, whole.reshape(*lead, r * m, r * m))


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
    observations = observations.without_drift
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
    families = {"turn_on": tuple(switched)} if switched else {}
    exact = tuple(full for full, one in declared.items() if one.name == "angle" and not one.sd)
    if exact:  # independent angles are no candidates, but exact ones have a common error
        families["turn_angle"] = exact
    turns = [k for k, step in enumerate(done) if isinstance(step, Turn)]
    forces: dict[str, Array] = {}
    if turns and sensor.rank("f") < len("xyz"):
        declared |= _unread_forces([done[k] for k in turns], bench.gravity.value)
    elif turns:
        mean = observations.mean[..., turns, :] @ nominal_inverse(sensor.axes)[:, :3]
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
        families=families,
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
    variance = np.linalg.diagonal(blocks)
    independent = observations.between_rows is None and observations.common is None
    if independent and np.count_nonzero(blocks) == np.count_nonzero(variance):
        deviations = np.sqrt(variance).reshape(*variance.shape[:-2], -1)
        return ReadingNoise(deviations, correlated=False)
    return ReadingNoise(observations.full_covariance, correlated=True)
