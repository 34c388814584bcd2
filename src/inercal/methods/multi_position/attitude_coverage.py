"""Find out which coefficients a set of attitudes determines, and which attitude to add next.

The criterion depends only on the geometry. It is the standard deviation that each combination of
coefficients would have if every norm had an error of 1 mg and every rotation an error of 10 mrad
(and every rate one of 10 mrad/s). These errors exceed the noise of any sensor; bending, temperature
and the hand cause errors of this size. A combination that they would shift by a tenth of its
natural size is not observed, however quiet the sensor is.

Attitudes to add are selected one after another from the 26 directions of a cube's faces, edges and
corners. Each time, the next attitude is the one that, together with the turn to it, increases the
determinant of the information matrix most (D-optimal; Fedorov 1972, Theory of Optimal Experiments,
chapter 3).

An error is raised if the rests and turns do not determine the coefficients, that is, if the errors
in `attitude_coverage.GeometryErrors` would shift a combination of coefficients by a tenth of its
natural size (10 % of scale, 0.1 g of bias, 0.1 rad).
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, NotObserved
from inercal.benches.hand.bench import tangent_vectors
from inercal.estimation.nullspace import undetermined_combinations
from inercal.methods import Priors
from inercal.methods.multi_position.rest_observations import Rests
from inercal.methods.multi_position.rotations import inverse_model
from inercal.methods.observability import OBSERVABILITY_LIMIT, direction_in_words
from inercal.methods.residuals import norm_residuals
from inercal.physics.frames import exp_so3, skew
from inercal.physics.motion import Motion
from inercal.physics.plan import Hold
from inercal.physics.sensors import G0, Sensor, imu

_COVERED_COSINE = np.cos(np.pi / 4)  # a rest within 45° of an axis covers it
_TARGET_DEVIATION = 0.01  # of the natural size; attitudes are added until the geometry reaches it
WORST_FORCE = 1e-3 * G0  # m/s², error of a norm
WORST_TURN = 1e-2  # rad, error of a rotation; rad/s, error of a rate
_OTHER_UNIT = 15.0  # ratio of the rates of two gyros; °/s in rad/s gives 57
MOVE_SECONDS = 2.0
_TURN_STEPS = 8  # number of steps per turn, each at a constant attitude
# A little initial information, which keeps determinants finite (100 counts as observed)
_REGULARISATION = 1e-3
_MAX_TURN_COSINE = 0.8  # turns of 37 to 143° are easy by hand, and their path is unambiguous

_CORNERS = np.array([v for v in product((0.0, 1.0, -1.0), repeat=3) if any(v)])
CUBE_DIRECTIONS: Array = _CORNERS / np.linalg.norm(_CORNERS, axis=1, keepdims=True)


class GeometryErrors(NamedTuple):
    """Standard deviations of a norm, m/s², of a rate, rad/s, and of a rotation, rad."""

    norm: float = WORST_FORCE
    rate: float = WORST_TURN
    turn: float = WORST_TURN


def rest_rows(sensor: Sensor, up: Array, g: float, errors: GeometryErrors) -> Array:
    """Return the Jacobian of a rest in each attitude for the coefficients, (r, 1 or 4, p).

    Rows are whitened by `errors`, and columns are in natural sizes. `up` is (r, 3).
    """
    force = sensor.select_axes("f")
    p, a = len(sensor.coefficients), len(force.coefficients)
    nominal = np.zeros(p)
    motion = Motion(g * up)
    reading = force.forward(motion, nominal[:a])
    rows = np.zeros((len(up), 1 + len(sensor.axes) - len(force.axes), p))
    rows[:, 0, :a] = (
        norm_residuals(force, reading, nominal[:a], np.array([g])).jacobian[:, :-1] / errors.norm
    )
    rows[:, 1:] = sensor.design(motion, nominal)[:, len(force.axes) :] / errors.rate
    return rows * sensor.unit_scale


def turn_rows(
    sensor: Sensor, before: Array, after: Array, g: float, errors: GeometryErrors
) -> Array:
    """Return the whitened Jacobian, in natural sizes, of turns along the shortest path, (k, 2, p).

    Parameters
    ----------
    sensor : Sensor
        A sensor with gyros.
    before : (3,) array
        Up in the body frame before each turn, a unit vector.
    after : (k, 3) array
        Up after each turn; neither parallel nor opposite to `before`.
    g : float
        Local gravity, m/s².
    errors : GeometryErrors
    """
    axis = np.cross(after, before)
    sine = np.linalg.norm(axis, axis=1, keepdims=True)
    turn = axis / sine * np.arctan2(sine, after @ before[:, None])
    left = 1 - (np.arange(_TURN_STEPS) + 0.5) / _TURN_STEPS
    # The body turns by +angle about the axis, so a fixed direction turns by −angle in the body.
    to_end = exp_so3(-turn[:, None] * left[:, None])
    sensed = np.ones((len(after), _TURN_STEPS, 7))
    sensed[..., :3] = g * (to_end.mT @ after[:, None, :, None])[..., 0]
    sensed[..., 3:6] = turn[:, None] / MOVE_SECONDS
    sensitivity = np.einsum("ksab,ksq->kabq", to_end, sensed) * (MOVE_SECONDS / _TURN_STEPS)
    model = inverse_model(sensor, np.zeros(len(sensor.coefficients)))
    psi = np.einsum("kabq,bqp->kap", sensitivity, model.coefficient_derivatives)
    return tangent_vectors(after) @ skew(after) @ psi / errors.turn * sensor.unit_scale


def next_attitudes(
    sensor: Sensor,
    information: Array,
    last: Array,
    g: float,
    errors: GeometryErrors,
    *,
    max_attitudes: int,
    target_deviation: float = 0.0,
) -> tuple[list[Array], Array]:
    """Return attitudes to add and the information matrix that results.

    Parameters
    ----------
    sensor : Sensor
    information : (p, p) array
        Information from the existing rests, in natural sizes.
    last : (3,) array
        Up in the body frame at the last rest.
    g : float
    errors : GeometryErrors
    max_attitudes : int
        Stop after this number of attitudes.
    target_deviation : float
        Stop when every combination has at most this deviation, in natural sizes.
    """
    turning = len(sensor.axes) > len(sensor.select_axes("f").axes)
    at_rest = rest_rows(sensor, CUBE_DIRECTIONS, g, errors)
    chosen: list[Array] = []
    trace = _REGULARISATION * np.eye(len(information))
    while len(chosen) < max_attitudes and _largest_deviation(information) > target_deviation:
        easy = np.flatnonzero(np.abs(CUBE_DIRECTIONS @ last) < _MAX_TURN_COSINE)
        gains = at_rest[easy].mT @ at_rest[easy]
        if turning:
            ways = turn_rows(sensor, last, CUBE_DIRECTIONS[easy], g, errors)
            gains += ways.mT @ ways
        best = int(np.argmax(np.linalg.slogdet(information + gains + trace)[1]))
        information = information + gains[best]
        last = CUBE_DIRECTIONS[easy[best]]
        chosen.append(last)
    return chosen, information


def _largest_deviation(information: Array) -> float:
    """Return the largest deviation that any combination has, in natural sizes."""
    least = float(np.linalg.eigvalsh(information)[0])
    return least**-0.5 if least > 0 else np.inf


@cache
def hand_held_plan(positions: int = 24, seconds: float = 3.0) -> tuple[Hold, ...]:
    """Return a good sequence of attitudes for a hand-held IMU, starting with +z up.

    Parameters
    ----------
    positions : int
    seconds : float
        Duration of each rest, s.

    Raises
    ------
    InputError
        There are fewer positions than coefficients of an accelerometer triad.
    """
    if positions < 9:
        raise InputError(
            f"{positions} positions do not determine the 9 coefficients of the accelerometers; "
            "plan 9 positions or more",
            key="positions",
        )
    whole = imu()
    parts = (
        whole.select_axes("f").with_coefficients("bias", "scale", "nonorthogonality"),
        whole.select_axes("w").with_coefficients("bias", "scale", "misalignment", "g"),
    )
    sensor = replace(whole, coefficients=parts[0].coefficients + parts[1].coefficients)
    first = np.array([0.0, 0.0, 1.0])
    start = rest_rows(sensor, first[None], G0, GeometryErrors())[0]
    more, _ = next_attitudes(
        sensor, start.T @ start, first, G0, GeometryErrors(), max_attitudes=positions - 1
    )
    return tuple(
        Hold(f"p{k:02d}", (float(up[0]), float(up[1]), float(up[2])), seconds)
        for k, up in enumerate([first, *more], 1)
    )


def require_coverage(rests: Rests, priors: Priors) -> None:
    """Raise NotObserved if the attitudes and turns do not determine the coefficients.

    Raises
    ------
    NotObserved
        The message names the coefficients, their undetermined combinations, the axes that were
        never up, and the attitudes to add.
    """
    sensor, p, a = rests.sensor, len(rests.sensor.coefficients), len(rests.force.coefficients)
    information = geometry_information(rests, priors)
    free: list[Array] = []
    for first, stop in ((0, a), (a, p)):
        values, vectors = np.linalg.eigh(information[first:stop, first:stop])
        weak = vectors[:, values < OBSERVABILITY_LIMIT**-2].T
        free += [*np.pad(weak, ((0, 0), (first, p - stop)))]
    if not free:
        return
    words = tuple(direction_in_words(row, sensor.coefficients) for row in free)
    touched = {word for text in words for word in text.split()}
    named = tuple(name for name in sensor.coefficients if name in touched)
    ups = rests.norms(rests.start()).up
    more, _ = next_attitudes(
        sensor,
        information,
        ups[-1],
        G0,
        GeometryErrors(),
        target_deviation=_TARGET_DEVIATION,
        max_attitudes=max(a + 3 - len(ups), 4),  # the missing rests, but at least 4
    )
    cause = f"these data do not determine {', '.join(named)}"
    add = f"add: {attitudes_in_words(more)}"
    if smaller := _much_smaller_gyro(rests):
        text = f"{smaller}; {cause}; if the gyro is right, {add}"
    else:
        gaps = _coverage_gaps(rests, ups)
        text = f"{cause}: {gaps}; {add} {undetermined_combinations(words)}"
    raise NotObserved(text, words, names=named)


def _much_smaller_gyro(rests: Rests) -> str:
    """Describe an axis whose rates during the turns are far below those of the others, if any."""
    if rests.transitions is None or len(rests.sensor.axes) - rests.m < 2:
        return ""
    if not len(moving := rests.transitions.output[:, rests.m :]):
        return ""
    size = (moving - np.median(moving, axis=0)).std(axis=0)
    size /= [axis.readout.scale for axis in rests.sensor.axes[rests.m :]]
    least = int(size.argmin())
    ratio = float(np.sort(size)[1] / max(size[least], 1e-300))
    if ratio < _OTHER_UNIT:
        return ""
    name = rests.sensor.axes[rests.m + least].name
    return (
        f"{name} changes {ratio:.0f} times less than the other gyros during the turns, so first "
        "check that it works, and that its column is in the unit of [sensor.gyro]"
    )


def geometry_information(rests: Rests, priors: Priors) -> Array:
    """Return the information matrix from rests and turns with the geometry's errors, (p, p).

    The matrix is in natural sizes, at the nominal model, and separate for accelerometers and gyros.
    """
    p, a = len(rests.sensor.coefficients), len(rests.force.coefficients)
    rows = rests.rows(rests.start())
    r, k = len(rows.norm.residual), 0 if rows.rotations is None else len(rows.rotations.residual)
    errors = GeometryErrors()
    counts = [r, 2 * k, len(rows.residual) - r - 2 * k]
    size = np.repeat([errors.norm, errors.turn, errors.rate], counts)
    jacobian = rows.jacobian[:, :p] / size[:, None] * rests.sensor.unit_scale
    information = np.zeros((p, p))
    for part, of in ((slice(0, a), slice(0, r)), (slice(a, p), slice(r, None))):
        information[part, part] = jacobian[of, part].T @ jacobian[of, part]
    for prior in priors:
        known, _ = prior.rows(rests.sensor.coefficients)
        known = known * rests.sensor.unit_scale
        information += known.T @ known
    return information


def _coverage_gaps(rests: Rests, ups: Array) -> str:
    """Describe in words which attitudes the rests and turns do not cover."""
    count, a = len(ups), len(rests.force.coefficients)
    parts = [f"{count} rests"]
    if count < a:
        parts = [f"{count} rests for {a} coefficients of the accelerometers"]
    bare = [
        sign + name
        for k, name in enumerate("xyz")
        for sign, along in (("+", ups[:, k]), ("−", -ups[:, k]))
        if not (along > _COVERED_COSINE).any()
    ]
    if bare:
        parts.append(f"no rest has {' or '.join(bare)} within 45° of straight up")
    _, size, axes = np.linalg.svd(ups)
    if count > 3 and size[-1] < np.sin(np.radians(10)) * size[0]:
        off = np.degrees(np.arcsin(min(size[-1] / count**0.5, 1.0)))
        normal = ", ".join(f"{part:+.2f}" for part in axes[-1])
        parts.append(f"all are within {off:.1f}° rms of the plane perpendicular to ({normal})")
    return ", ".join(parts)


def attitudes_in_words(ups: Sequence[Array]) -> str:
    """Return attitudes as an instruction to the user."""
    holds = [Hold("", (float(x), float(y), float(z)), 0.0) for x, y, z in ups]
    return f"hold {'; '.join(hold.describe() for hold in holds)}"
