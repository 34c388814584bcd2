"""The classical evaluation of a rate test: least squares of the readings with equal weights.

Each axis by itself, y = c + K ω_I + δ_O ω_P − δ_P ω_O and the further terms that are chosen, over
the stated rates, rests and poses, with the vertical part of the earth's rate. K is the slope of the
straight line of IEEE Std 528, and 1 + scale where no nonlinear term is left out.

The bench is taken as exact: the covariance is that of the noise of the means alone. The problem of
`ml`, in which the errors of the bench have their stated deviations, tests whether the readings
agree with one another.

Sources: IEEE Std 528, 952 and 1431.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from inercal.basics.errors import InputError
from inercal.benches.rate_platform.bench import RatePlatform
from inercal.benches.rate_platform.sections import PlatformStep
from inercal.estimation import Estimate, Gaussian
from inercal.methods import estimator_inputs
from inercal.methods.observability import NOISE_ONLY_NOTE
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

NAME = "estimator ieee"


def refuse_priors_and_form(
    observations: Observations, sensor: Sensor, priors: Sequence[Gaussian]
) -> None:
    """Refuse what the evaluation cannot use.

    Raises
    ------
    InputError
        Priors, coefficients of temperature, the tilted form, or a trial axis.
    """
    estimator_inputs.refuse_priors(priors, "ieee", "ml")
    estimator_inputs.refuse_temperature_terms(sensor, "ieee", "ml")
    estimator_inputs.require_single_recording(observations, NAME)
    if sensor.form != "reference":
        raise InputError(
            f'{NAME} estimates the reference form; set [sensor] form = "reference", or use '
            "estimator ml",
            key="[sensor] form",
        )


def least_squares_line(
    observations: Observations,
    sensor: Sensor,
    bench: RatePlatform,
    steps: Sequence[PlatformStep],
    used: NDArray[np.int64],
) -> Estimate:
    """Return the coefficients, with the noise of the means propagated.

    Parameters
    ----------
    observations : Observations
        Of r rows and m axes, without a trial axis.
    sensor : Sensor
        In the reference form, whose readings are linear in its p coefficients.
    bench : RatePlatform
    steps : sequence of r RateDwell or Pose
    used : (k,) array of int
        Places of the used readings, row after row.
    """
    nominal = bench.mean_motion(steps, {}).motion
    motion = Motion(nominal.f, nominal.w)
    p = len(sensor.coefficients)
    none = np.zeros(p)
    design = sensor.design(motion, none).reshape(-1, p)[used]
    off = (observations.mean - sensor.forward(motion, none)).ravel()[used]
    inverse = np.linalg.pinv(design / sensor.unit_scale) / sensor.unit_scale[:, None]
    noise = observations.full_covariance[np.ix_(used, used)]
    spread = inverse @ noise @ inverse.T
    information = np.linalg.inv(spread / np.outer(sensor.unit_scale, sensor.unit_scale))
    singular = np.sqrt(np.linalg.eigvalsh(information)[::-1])
    return Estimate.from_closed_form(
        sensor.coefficients, inverse @ off, spread, singular, (NOISE_ONLY_NOTE,)
    )
