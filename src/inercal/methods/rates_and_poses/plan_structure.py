"""Check from the rank of a plan, regardless of noise, whether sections determine the coefficients.

The design is the sensitivity of the nominal readings to the coefficients, without bench errors and
without earth's rotation. Each column is scaled to norm one. An error is raised if the
singular value of a direction is below 2e-3 of the largest one. Such a direction would be determined
only by the earth's rate, or by the scatter of rates about one speed.
"""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import NotObserved
from inercal.basics.keys import CoefficientName
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.sections import PlatformSteps, RateDwell
from inercal.estimation.nullspace import row_echelon_form, undetermined_combinations
from inercal.methods import Priors, temperature
from inercal.methods.observability import direction_in_words
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

TOLERANCE = 2e-3  # of the largest scaled singular value
_NAMED = 1e-6  # of the largest weight in a direction


def require_determined(
    observations: Observations,
    sensor: Sensor,
    bench: RatePlatform,
    steps: PlatformSteps,
    priors: Priors,
    used: Indices,
) -> None:
    """Raise NotObserved if the sections do not determine all coefficients without a prior.

    Parameters
    ----------
    observations : Observations
        Observations, of which only the temperatures are used.
    sensor : Sensor
        Sensor with p coefficients.
    bench : RatePlatform
    steps : sequence of r RateDwell or Pose
        The steps of the rows.
    priors : sequence of Gaussian
    used : (k,) array of int
        Indices of the readings that are used, row after row.

    Raises
    ------
    NotObserved
        The message names the coefficients, the directions, and the sections to add.
    """
    design = _nominal_design(observations, sensor, bench, steps)[..., used, :]
    # Only temperatures differ between trials.
    design = design.reshape(-1, *design.shape[-2:])[0]
    known = {name for prior in priors for name in prior.names}
    free = [k for k, name in enumerate(sensor.coefficients) if name not in known]
    names = [sensor.coefficients[k] for k in free]
    null = null_directions(design[:, free])
    if not len(null):
        return
    weights = row_echelon_form(null / sensor.unit_scale[free])
    large = np.abs(weights) > _NAMED * np.abs(weights).max(axis=1, keepdims=True)
    touched = tuple(names[k] for k in np.flatnonzero(large.any(axis=0)).tolist())
    words = tuple(direction_in_words(row, names) for row in weights)
    raise NotObserved(
        f"these steps do not determine {', '.join(touched)}; "
        f"{_remedy(touched, sensor, steps)}choose fewer coefficients, or give a prior "
        f"{undetermined_combinations(words)}",
        words,
        names=touched,
    )


def null_directions(design: Array) -> Array:
    """Return an orthogonal basis of the directions, (k, p), that a design (m, p) leaves free."""
    size = np.linalg.norm(design, axis=0)
    absent = size <= _NAMED * size.max(initial=0.0)
    size = np.where(absent, 1.0, size)
    _, s, v = np.linalg.svd(np.where(absent, 0.0, design / size))
    rank = int(np.sum(s > TOLERANCE * s.max(initial=0.0)))
    return v[rank:] / size


def _nominal_design(
    observations: Observations, sensor: Sensor, bench: RatePlatform, steps: PlatformSteps
) -> Array:
    """Return the sensitivity of the nominal readings to the coefficients, (..., r m, p)."""
    nominal = bench.without_earth_rate().mean_motion(steps, {}).motion
    offsets = temperature.row_offsets(observations, sensor)
    motion = Motion(nominal.f, nominal.w, dT=offsets) if offsets.ndim else nominal
    natural = sensor.design(motion, np.zeros(len(sensor.coefficients)))
    return natural.reshape(*natural.shape[:-3], -1, natural.shape[-1])


def _remedy(names: Sequence[str], sensor: Sensor, steps: PlatformSteps) -> str:
    """Return the sections that would determine the coefficients, as part of a sentence."""
    terms = {CoefficientName(name).term for name in names}
    rates = [step.rate for step in steps if isinstance(step, RateDwell) and step.rate != 0]
    advice: list[str] = []
    one_sense = "scale_prime" in terms and len(set(np.sign(rates).tolist())) < 2
    if one_sense:
        advice.append("turn in both directions")
    if terms & {"scale3", "scale2"} or ("scale_prime" in terms and not one_sense):
        advice.append("turn at a further speed and rest in each setting")
    if any(term.startswith("g_") for term in terms):
        advice.append("set the case with each axis up and down")
    skew = {name for name in names if CoefficientName(name).term in ("delta_o", "delta_p")}
    if skew & set(sensor.select_axes("w").coefficients):
        advice.append("turn with the other axes up too, which shows misalignments")
    if terms & {"k0", "k1"} or skew & set(sensor.select_axes("f").coefficients):
        advice.append("rest with each axis up and down")
    if not advice:
        advice.append("rest and turn with each axis up")
    return "; ".join(advice) + "; "
