"""Calibrate accelerometers and gyros from six positions and three turns.

If there are only gyros, the positions are used as stated. In this case no sensor reads the mean
force during a turn, so the force is assumed to be gravity along the axis.

`classical` uses the closed formulas of the source, for comparison with `ml`:
F. Ferraris, U. Grimaldi, M. Parvis, "Procedure for effortless in-field calibration of three-axis
rate gyros and accelerometers", Sensors and Materials 7(5), 1995, 311–330. The columns of the
matrices U± are the mean readings with x, y, z up and down, and those of W the integrated rates::

    accelerometer   b_a = diag(U₊ + U₋)/2                                (19, 20)
                    K_a R_a = (U₊ − U₋)/(2g),  K_a = row norms           (21–23)
    gyro            b_g = mean over the rest,  K_ga = (U₊ − U₋)/(2g)     (9)
                    K_g R_g = W / α, with bias and K_ga f̄ subtracted     (12–15)

A reading is then K R (f or ω) + b, plus K_ga f for a gyro. Faces, turns and gravity are treated as
exact. The covariance therefore includes only the noise of the means, and the formulas leave no
residual. The readings are tested with the problem of `ml`, in which faces, turns and gravity have
their stated deviations.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.benches import Hand
from inercal.estimation import Estimate
from inercal.estimation.uncertainty import propagate
from inercal.methods import Method, Priors, solving
from inercal.methods.hand_likelihood import ml
from inercal.methods.order_effects import noise_only_estimate, order_remarks, with_problem_tests
from inercal.physics.plan import HandSteps, Turn, ferraris_plan
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations


def classical(
    observations: Observations, sensor: Sensor, bench: Hand, steps: HandSteps, priors: Priors = ()
) -> Estimate:
    """Return the coefficients from the closed formulas, with the noise of the means propagated.

    Raises
    ------
    InputError
        There are priors, the tilted form, axes other than orthogonal triads, or a trial axis.
    NotObserved
        A position or a turn is missing.
    """
    solving.require_plain_means(observations, sensor, priors, "classical")
    if missing := tuple(step.label for step in steps if step.label not in observations.labels):
        raise NotObserved(
            "estimator classical needs every position and turn, but the recording does not contain "
            f"{', '.join(missing)}; record these, or use estimator ml",
            names=missing,
        )
    formulas_of = {f"{a}_{what}" for a in "xyz" for what in ("p", "a", "rot")}
    if again := tuple(label for label in observations.labels if label not in formulas_of):
        raise InputError(
            "estimator classical uses each position and turn once, but the recording repeats "
            f"{', '.join(again)}; use estimator ml",
            names=again,
        )
    solving.refuse_tilted_form(sensor, "classical", "ml")
    if not sensor.select_axes("f").axes:
        raise InputError(
            "estimator classical needs accelerometers, but the sensor has none; use estimator ml",
            key="[method] estimator",
        )
    for axes in (sensor.axes[:3], sensor.axes[3:]):
        if axes and (len(axes) != 3 or not np.allclose([a.i for a in axes], np.eye(3))):
            raise InputError(
                f"estimator classical needs triads along x, y and z, but sensor {sensor.name} "
                "has other axes; use estimator ml",
                key="[sensor]",
                names=tuple(axis.name for axis in axes),
            )
    r, m = observations.mean.shape

    def formulas(flat: Array) -> Array:
        means = dict(zip(observations.labels, flat.reshape(r, m), strict=True))
        return _coefficients(means, observations, sensor, bench.gravity.value, steps)

    flat = observations.mean.ravel()
    value, spread = propagate(formulas, flat, observations.full_covariance)
    found = noise_only_estimate(sensor, value, spread)
    return with_problem_tests(found, ml(observations, sensor, bench, steps))


def _coefficients(
    means: dict[str, Array], observations: Observations, sensor: Sensor, g: float, steps: HandSteps
) -> Array:
    up, down = (np.stack([means[f"{a}_{s}"] for a in "xyz"], axis=1) for s in "pa")
    matrix_a = (up - down)[:3] / (2 * g)
    bias_a = np.diag(up[:3] + down[:3]) / 2
    found = _triad_coefficients(sensor, 0, matrix_a, {"k0": bias_a}, "k1")
    if len(sensor.axes) == 6:
        holds = [f"{a}_{s}" for a in "xyz" for s in "pa"]
        weights = dict(zip(observations.labels, observations.samples, strict=True))
        bias_g = np.average(
            [means[h][3:] for h in holds], axis=0, weights=[weights[h] for h in holds]
        )
        to_force = (up - down)[3:] / (2 * g)
        for k, axis in enumerate(sensor.axes[3:]):
            along = to_force[k] @ axis.frame.T
            found |= {f"{axis.name}.g_{s}": along[j] for j, s in enumerate("ipo")}
            found[f"{axis.name}.bias"] = bias_g[k]
        seconds = dict(zip(observations.labels, observations.duration, strict=True))
        turns = {step.label: step for step in steps if isinstance(step, Turn)}
        columns: list[Array] = []
        for label in (f"{a}_rot" for a in "xyz" if turns):
            force = np.linalg.solve(matrix_a, means[label][:3] - bias_a)
            rate = means[label][3:] - bias_g - to_force @ force
            columns.append(rate * seconds[label] / turns[label].angle)
        if columns:
            found |= _triad_coefficients(sensor, 3, np.stack(columns, axis=1), {}, "scale")
    return np.array([found[name] for name in sensor.coefficients])


def _triad_coefficients(
    sensor: Sensor, first: int, matrix: Array, also: dict[str, Array], scale: str
) -> dict[str, float]:
    found: dict[str, float] = {}
    for k, axis in enumerate(sensor.axes[first : first + 3]):
        along = matrix[k] @ axis.frame.T
        found |= {f"{axis.name}.{name}": values[k] for name, values in also.items()}
        found[f"{axis.name}.{scale}"] = along[0] - 1
        found[f"{axis.name}.delta_o"], found[f"{axis.name}.delta_p"] = along[1], -along[2]
    return found


METHOD = Method(
    name="ferraris",
    bench=Hand,
    default_coefficients={
        "f": ("bias", "scale", "misalignment"),
        "w": ("bias", "scale", "misalignment", "g"),
    },
    also={"f": ("temperature", "temperature_order"), "w": ("temperature", "temperature_order")},
    needs=("w",),
    plan=ferraris_plan,
    estimators={"ml": ml, "classical": classical},
    closed_formulas=("classical",),
    weighs_common_errors=True,
    remarks=order_remarks,
    source="Ferraris, Grimaldi, Parvis, Sensors and Materials 7(5), 1995",
)
