"""Check whether the completed steps determine the coefficients, and which steps are missing.

There are two rules beyond the algebraic rank of the problem:

* Bias and scale of an accelerometer must be separated by readings of both signs. It is not enough
  to assume that faces are level. Without −z, for example, K₀ of z would depend on positions in
  which z should read zero, and on how level they were.
* A direction is not observed if its uncertainty exceeds a tenth of its natural size (10 % of scale,
  0.1 g of bias, 0.1 rad of misalignment). This holds even if residual excitation (the earth's rate,
  an accidental tilt) gives the problem full rank.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import NotObserved
from inercal.basics.keys import CoefficientName
from inercal.estimation import Estimate
from inercal.estimation.nullspace import undetermined_combinations
from inercal.methods import Priors
from inercal.physics.plan import HandSteps, Hold, Turn
from inercal.physics.sensors import Sensor

NOISE_ONLY_NOTE = (
    "The uncertainties include only the noise of the means, because this estimator treats the "
    "bench as exact."
)
OBSERVABILITY_LIMIT = 0.1  # of the natural size
_MOST_NAMED = 8  # number of coefficients named in a line that also names turns
_MIN_INPUT = 0.5  # g; smallest input, up and down, that an axis must have sensed


def require_bias_scale_separation(
    sensor: Sensor, done: HandSteps, missing: HandSteps, priors: Priors
) -> None:
    """Raise NotObserved if the positions cannot separate bias and scale of an accelerometer axis.

    Raises
    ------
    NotObserved
        The message names the coefficients, the direction and the missing position.
    """
    known = {name for prior in priors for name in prior.names}
    ups = np.array([step.up for step in done if isinstance(step, Hold)]).reshape(-1, 3)
    problems: dict[tuple[str, str], str] = {}
    for axis in sensor.axes:
        pair = (f"{axis.name}.k0", f"{axis.name}.k1")
        if axis.measures != "f" or not set(pair) <= set(sensor.coefficients) or known & set(pair):
            continue
        along = ups @ np.array(axis.i)
        sides = [
            f"{sign}{axis.name}"
            for sign, there in (("+", along > _MIN_INPUT), ("−", along < -_MIN_INPUT))
            if not there.any()
        ]
        if sides:
            problems[pair] = (
                f"{pair[0]} and {pair[1]} cannot be distinguished, because no position has "
                f"{' and '.join(sides)} up"
            )
    if problems:
        raise NotObserved(
            f"{'; '.join(problems.values())}{steps_in_words(missing)}; record the missing "
            "position, or give a prior for one of the two coefficients",
            tuple(problems.values()),
            names=tuple(name for pair in problems for name in pair),
        )


def require_observed(estimate: Estimate, sensor: Sensor, missing: HandSteps) -> None:
    """Raise NotObserved if a direction's uncertainty exceeds a tenth of its natural size.

    Raises
    ------
    NotObserved
        The message names the coefficients and the directions.
    """
    p, limit = len(sensor.coefficients), OBSERVABILITY_LIMIT**2
    covariance = estimate.covariance.reshape(-1, *estimate.covariance.shape[-2:])[:, :p, :p]
    # No variance exceeds the trace, so eigenvalues are computed for few trials, if any.
    trace = np.linalg.diagonal(covariance) @ sensor.unit_scale**-2.0
    suspects = covariance[trace > limit] / np.outer(sensor.unit_scale, sensor.unit_scale)
    if not len(suspects):
        return
    # With many trials, the trial whose weakest direction has the largest variance decides.
    variance, directions = np.linalg.eigh(suspects[np.argmax(np.linalg.eigvalsh(suspects)[:, -1])])
    weak = directions[:, variance > limit].T
    if not len(weak):
        return
    raise not_observed_error(
        sensor, tuple(direction_in_words(row, sensor.coefficients) for row in weak), missing
    )


def not_observed_error(
    sensor: Sensor, directions: Sequence[str], missing: HandSteps
) -> NotObserved:
    """Return an error with the coefficients, the undetermined combinations, and a remedy.

    Parameters
    ----------
    sensor : Sensor
    directions : sequence of str
        Combinations of coefficients in words, in units of g and rad/s.
    missing : sequence of HandStep
        Planned steps without a section in the recording.
    """
    plain = tuple(words.partition(" (in units")[0] for words in directions)
    touched = {word for words in plain for word in words.split()}
    named = tuple(name for name in sensor.coefficients if name in touched)
    turns = [step for step in missing if isinstance(step, Turn)]
    gyros = set(sensor.select_axes("w").coefficients)
    if turns and gyros.issuperset(named):
        axes = ", ".join(dict.fromkeys(CoefficientName(name).axis for name in named))
        few = len(named) <= _MOST_NAMED
        listed = ", ".join(named) if few else f"{len(named)} coefficients of {axes}"
        return NotObserved(
            f"these data do not determine {listed}{steps_in_words(turns)}; record these turns, "
            "or use method multi_position, which needs no turn by a known angle",
            plain,
            names=named,
        )
    remedy = "record what is missing" if missing else "add steps or check the stated uncertainties"
    return NotObserved(
        f"these data do not determine {', '.join(named)}{steps_in_words(missing)}; {remedy}, "
        f"choose fewer coefficients, or give a prior {undetermined_combinations(plain)}",
        plain,
        names=named,
    )


def steps_in_words(missing: HandSteps) -> str:
    """Return the steps that were not carried out as part of a sentence; empty if none."""
    if not missing:
        return ""
    texts = [f"{step.label} ({step.describe()})" for step in missing]
    return "; the recording does not contain " + ", ".join(texts)


def direction_in_words(direction: Array, names: Sequence[str]) -> str:
    """Return the largest components of a direction as part of a sentence."""
    large = np.flatnonzero(np.abs(direction) > 0.3 * np.abs(direction).max()).tolist()
    return " ".join(f"{direction[k]:+.2g} {names[k]}" for k in large)
