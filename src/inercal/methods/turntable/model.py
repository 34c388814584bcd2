"""The model of a triad that the turntable methods share, and its prior.

The prior standard deviation of a coefficient comes from `EXPECTED_SIZES`. The data must determine
the coefficient much better (`undecided_directions`), otherwise the result would be the prior.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import radians

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError, NotObserved
from inercal.basics.keys import CoefficientName
from inercal.basics.parameters import Parameter
from inercal.benches.turntable.attitude import (
    Misalignment,
    earth_rate_level_frame,
    reference_attitude,
)
from inercal.benches.turntable.bench import COARSE_REST_SECONDS, MIN_REST_SECONDS, Turntable
from inercal.estimation import NullDirection
from inercal.estimation.nullspace import row_echelon_form, undetermined_combinations
from inercal.methods import Priors, temperature
from inercal.methods.observability import direction_in_words
from inercal.methods.turntable import BIAS, Terms, terms
from inercal.methods.turntable.drift import NO_DRIFT, Drift, drift_model
from inercal.physics.sensors import G0, Sensor
from inercal.physics.sensors.coefficient_tables import LARGEST_RELATIVE_SIZE
from inercal.recordings import Track

ARCSEC = radians(1 / 3600)
EPOCH_PERIOD = 0.1  # s between epochs
# rad. Error of assuming linear rates between samples, without kinks, which are in Q. It also keeps
# the variance positive if the readback is stated as exact.
READBACK_NOISE_FLOOR = 0.1 * ARCSEC
# Standard deviations before the data, SI; for other terms, relative to their natural size.
EXPECTED_SIZES: Mapping[str, float] = {
    "bias": radians(1),
    "k0": 30e-3 * G0,
    "scale": 0.02,
    "k1": 0.02,
    "delta_o": 0.02,
    "delta_p": 0.02,
}
# Natural sizes: 1000 µg/g², 200 °/h/g; for temperature LARGEST_RELATIVE_SIZE, 1 mg/K
_DEFAULT_SIZE = 1e-3
# Share of the prior variance: directions above this share are determined, at least partly, by the
# prior.
_MAX_DECIDED_SHARE, _MIN_PRIOR_SHARE = 0.25, 0.01


@dataclass(frozen=True, eq=False)
class TriadModel:
    """The model for three axes of one kind in a filter.

    Parameters
    ----------
    sensor : Sensor
        A sensor with only these axes.
    terms : Terms
    channels : (3,) array of int
        Indices of their columns in the recording.
    white : (3,) array
        Variance of the integrated noise, SI²/s.
    drift : Drift
        Drift of the biases.
    expected_sizes : mapping of str to float
        Standard deviations before the data by term, in the form of `EXPECTED_SIZES`.
    """

    sensor: Sensor
    terms: Terms
    channels: Indices
    white: Array
    drift: Drift
    expected_sizes: Mapping[str, float] = field(default_factory=lambda: EXPECTED_SIZES)


def run_duration(track: Track, planned: float | None) -> float:
    """Return the duration of a run, s: as planned, or that of the track if there is no plan."""
    return float(track.time[-1] - track.time[0]) if planned is None else planned


def triad_model(
    sensor: Sensor,
    kind: str,
    run_duration: float = 0.0,
    *,
    bias_drift: bool = True,
    expected_sizes: Mapping[str, float] = EXPECTED_SIZES,
) -> TriadModel:
    """Return the accelerometers ("f") or gyros ("w") of a sensor, for a run of `run_duration` s.

    Raises
    ------
    InputError
        There are not three axes, a filter cannot estimate a term, or noise is not stated.
    """
    part = sensor.select_axes("f" if kind == "f" else "w")
    noise = [axis.noise for axis in part.axes]
    if not all(one.white > 0 for one in noise):
        which = "accelerometer" if kind == "f" else "gyro"
        key = f"[sensor.{which}] white"
        raise InputError(
            f"{key} is missing, but a filter needs the noise density of all axes; add it", key=key
        )
    return TriadModel(
        part,
        terms(part),
        np.array([sensor.channels.index(name) for name in part.channels]),
        np.array([one.white**2 for one in noise]),
        drift_model(noise, run_duration, part.name) if bias_drift else NO_DRIFT,
        expected_sizes,
    )


def expected_size(part: TriadModel) -> Array:
    """Return the prior standard deviation of each coefficient, (p,) SI."""
    named = zip(part.sensor.coefficients, part.sensor.unit_scale, strict=True)
    warm = temperature.temperature_coefficients(part.sensor)
    return np.array(
        [
            LARGEST_RELATIVE_SIZE * size
            if n in warm
            else part.expected_sizes.get(CoefficientName(n).term, _DEFAULT_SIZE * size)
            for n, size in named
        ]
    )


def initial_estimate(part: TriadModel, priors: Priors, coarse: Array) -> tuple[Array, Array]:
    """Return the coefficients and their covariance before the data.

    Parameters
    ----------
    part : TriadModel
    priors : sequence of Gaussian
        Priors on coefficients of these axes are combined with the prior from `expected_size`.
    coarse : (3,) array
        Mean reading at rest minus the sensed motion, SI: the initial values of the biases.
    """
    names = part.sensor.coefficients
    start = np.zeros(len(names))
    biases, t = part.terms.bias, part.terms
    start[biases] = coarse[t.axis[biases]] / t.weights[biases, BIAS]
    precision = np.diag(expected_size(part) ** -2.0)
    pull = np.zeros(len(names))
    for prior in priors:
        if set(prior.names) <= set(names):
            root, target = prior.rows(names)
            precision = precision + root.T @ root
            pull = pull + root.T @ (target - root @ start)
    covariance = np.linalg.inv(precision)
    return start + covariance @ pull, (covariance + covariance.T) / 2


def coarse_bias(bench: Turntable, track: Track, part: TriadModel) -> Array:
    """Return the mean reading minus the sensed motion over the first rest, (3,) SI.

    Parameters
    ----------
    bench : Turntable
    track : Track
        Track of one trial.
    part : TriadModel

    Raises
    ------
    InputError
        There is no rest of at least 20 s at the start.
    """
    resting = track.hold[track.hold >= 0]
    at = np.flatnonzero(track.hold == resting[0]) if resting.size else resting
    run_duration = float(track.time[at[-1]] - track.time[at[0]]) if at.size else 0.0
    if run_duration < MIN_REST_SECONDS:
        raise InputError(
            f"the run begins with a rest of {run_duration:.3g} s, but the filters need "
            f"{COARSE_REST_SECONDS:g} s of rest for the initial values of the biases; hold the "
            "table still that long before its first move",
            key="hold",
        )
    at = at[track.time[at] <= track.time[at[0]] + COARSE_REST_SECONDS]
    mat = reference_attitude(bench, track.angles[at[:1]])[0]
    sensed = mat.T @ (
        [0, 0, bench.gravity.value] if part.terms.first == 1 else earth_rate_level_frame(bench)
    )
    return track.reading[at][:, part.channels].mean(axis=0) - part.terms.nominal @ sensed


def undecided_directions(part: TriadModel, covariance: Array) -> tuple[NullDirection, ...]:
    """Return the directions of the coefficients that neither data nor stated priors determine.

    Parameters
    ----------
    part : TriadModel
    covariance : (p, p) array
        Covariance of the coefficients.
    """
    return _directions_by_variance_share(part, covariance, _MAX_DECIDED_SHARE, np.inf)[1]


def prior_dominated_directions(
    part: TriadModel, covariance: Array
) -> tuple[float, tuple[NullDirection, ...]]:
    """Return directions that the assumed sizes partly determine, and the largest prior share.

    The arguments are as for `undecided_directions`.
    """
    return _directions_by_variance_share(part, covariance, _MIN_PRIOR_SHARE, _MAX_DECIDED_SHARE)


def require_decided(part: TriadModel, covariance: Array, what: str) -> None:
    """Raise NotObserved if coefficients are not determined.

    Parameters
    ----------
    part, covariance
        The same as for `undecided_directions`.
    what : str
        "gyros" or "accelerometers".

    Raises
    ------
    NotObserved
    """
    free, p = undecided_directions(part, covariance), len(covariance)
    if free:
        words = tuple(direction.words for direction in free)
        touched = {word for text in words for word in text.split()}
        raise NotObserved(
            f"the run determines only {p - len(free)} of {p} coefficients of the {what}; "
            "turn about each axis with continuous readback, hold more attitudes, or give priors "
            f"{undetermined_combinations(words)}",
            words,
            names=tuple(name for name in part.sensor.coefficients if name in touched),
        )


def _directions_by_variance_share(
    part: TriadModel, covariance: Array, above: float, to: float
) -> tuple[float, tuple[NullDirection, ...]]:
    """Return directions whose share of the prior variance is in a range, and the largest share."""
    sd = expected_size(part)
    share, directions = np.linalg.eigh(covariance / np.outer(sd, sd))
    chosen = (share > above) & (share <= to)
    rows = (sd[:, None] * directions[:, chosen]).T / part.sensor.unit_scale
    names = part.sensor.coefficients
    found: list[NullDirection] = []
    for move in row_echelon_form(rows):
        weights: dict[str, float] = {n: float(w) for n, w in zip(names, move, strict=True) if w}
        found.append(NullDirection(weights, direction_in_words(move, names)))
    return float(np.max(share, where=chosen, initial=0.0)), tuple(found)


def table_sensitivity(
    seen: Misalignment, table: Sequence[Parameter], skipped: Sequence[str] = ()
) -> Array:
    """Return the sensitivity of the observed φ to the table's parameters, (e, 3, q), level frame.

    Parameters
    ----------
    seen : Misalignment
        Misalignment at e readbacks.
    table : sequence of q Parameter
        Columns are zero for parameters that do not change the attitude or are skipped.
    skipped : sequence of str
        Names of parameters to skip.
    """
    names = [one.name for one in seen.parameters]
    result = np.zeros((*seen.by.shape[:-1], len(table)))
    for k, one in enumerate(table):
        if one.name in names and one.name not in skipped:
            # The true attitude is ahead of the readback's, so the observed φ is smaller by this
            # angle.
            result[..., k] = -seen.by[..., names.index(one.name)]
    return result


def gravity_sensitivity(part: TriadModel) -> Array:
    """Return the sensitivity of the coefficients to a relative error of gravity, (p,)."""
    p = len(part.sensor.coefficients)
    by = np.zeros((3, 3, p))
    by[part.terms.axis, :, np.arange(p)] = part.terms.weights[:, part.terms.first :][:, :3]
    moved = np.linalg.lstsq(by.reshape(9, p), part.terms.nominal.ravel(), rcond=None)[0]
    return np.asarray(moved, dtype=float)
