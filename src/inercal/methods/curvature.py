"""Second-order effects of unknown tilts, which the first-order fit does not include.

A face that is tilted by t reads g (1 − |t|²/2) along its normal, and misalignments m add m·t. The
fit estimates t and the coefficients c with covariance P. Let τ be the errors of t and δ the errors
of c. Their second-order terms are, for reading i in row r::

    Q_i = Σ_k η_ik τ_rk,   η_ik = ½ (∂²h_i/∂t²) τ_rk + (∂²h_i/∂c ∂t_k)·δ

The means of these terms correct the readings, and their covariance is added to the noise. For
Gaussian errors

    E[Q_i] = Σ_k cov(η_ik, τ_rk)
    cov(Q_i, Q_j) = Σ_kl cov(η_ik, η_jl) cov(τ_rk, τ_sl) + cov(η_ik, τ_sl) cov(η_jl, τ_rk)

(GUM, JCGM 100:2008, note to 5.1.2; moments by Isserlis' theorem). At half a degree the effect is
38 ppm of scale factor, with an equally large uncertainty. This is more than the noise of a good
MEMS accelerometer. A tilted turn axis has the same effect.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.keys import CoefficientName
from inercal.benches import Hand
from inercal.benches.hand.bench import sensed_motion
from inercal.estimation import Estimate
from inercal.estimation.gauss_newton_steps import QR_MAX_TRIALS
from inercal.physics.motion import Motion
from inercal.physics.plan import HandSteps, Hold
from inercal.physics.sensors import Sensor


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
    from inercal.methods._curvature_kernel import second_order_moments

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
    eta_eta = (flat @ spread @ np.swapaxes(flat, -1, -2)).reshape(*lead, t, m, 2, t, m, 2)
    tau_tau = spread[..., tau, :][..., tau].reshape(*lead, t, 2, t, 2)
    shift = np.zeros((*lead, r, m))
    shift[..., rows, :] = np.einsum("...rakrk->...ra", eta_tau)
    covariance = np.einsum("...rakjbl,...rkjl->...rajb", eta_eta, tau_tau)
    covariance += np.einsum("...rakjl,...jblrk->...rajb", eta_tau, eta_tau)
    whole = np.zeros((*lead, r, m, r, m))
    for n, at in enumerate(rows.tolist()):
        whole[..., at, :, rows, :] = np.moveaxis(covariance[..., n, :, :, :], -2, 0)
    return Curvature(shift, whole.reshape(*lead, r * m, r * m))
