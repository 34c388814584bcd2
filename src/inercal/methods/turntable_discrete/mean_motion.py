"""The mean motion that an IMU on a turntable senses in a position, and over a rotation.

The readback's attitude C_k at times t_k is off by a small rotation φ_k = B_k β in the level frame::

    f̄ = mean Cᵀ(v + v × φ),  v = (0, 0, g)
    ω̄ = mean Cᵀ(Ω + Ω × φ) + Σ log(C_kᵀ C_k+1)/T + Σ Cᵀ (φ_k+1 − φ_k)/T

with means by trapezoids, Ω the earth's rate. Over whole turns harmonics cancel by themselves. A
readback that is late shifts the sum by its two ends: nothing from rest to rest or at a steady rate.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import copysign, pi

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.parameters import Parameter
from inercal.benches import MeanMotion
from inercal.benches.turntable.attitude import linear_misalignment, reference_attitude
from inercal.benches.turntable.bench import Turntable
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.frames import log_so3
from inercal.physics.motion import Motion
from inercal.physics.plan import Position, TableStep

_TURN_POINTS = 361  # points of one turn that is taken from the plan


@dataclass(frozen=True, eq=False)
class AxisAngles:
    """How the axes stood or turned in one row.

    Parameters
    ----------
    time : (n,) array
        s; one sample is a position.
    angles : (..., n, k) array
        Readback, rad, the outermost axis first.
    """

    time: Array
    angles: Array


def declared_parameters(bench: Turntable) -> dict[str, Parameter]:
    """Return the bench's parameters by name, with its latitude, which is exact."""
    meaning = "latitude of the bench"
    latitude = Parameter("latitude", "rad", 0.0, "run", bench.latitude, meaning)
    return bench.acting_parameters() | {"latitude": latitude}


def planned_angles(bench: Turntable, steps: Sequence[TableStep]) -> list[AxisAngles]:
    """Return the ways that steps ask for; of a rotation one turn at its steady rate.

    Parameters
    ----------
    bench : Turntable
    steps : sequence of TableStep
        In the order they were carried out: a rotation may begin where the step before has ended.
    """
    now = np.zeros(len(bench.axes))
    ways: list[AxisAngles] = []
    for step in steps:
        if step.angles is not None:
            now = np.array(step.angles, dtype=float)
        if isinstance(step, Position):
            ways.append(AxisAngles(np.zeros(1), now[None]))
            continue
        turned = np.zeros((_TURN_POINTS, len(now)))
        turned[:, step.axis] = np.linspace(0, copysign(2 * pi, step.angle), _TURN_POINTS)
        ways.append(AxisAngles(np.linspace(0, 2 * pi / step.rate, _TURN_POINTS), now + turned))
        now = now.copy()
        now[step.axis] += step.angle
    return ways


def time_mean(values: Array, time: Array) -> Array:
    """Return the mean of values (..., n, k) over time by trapezoids; of one sample itself."""
    return _time_weights(time) @ values


def _time_weights(time: Array) -> Array:
    """Return the share of each sample in a mean over time by trapezoids, (n,)."""
    if len(time) == 1:
        return np.ones(1)
    steps = np.diff(time) / (time[-1] - time[0])
    weights = np.zeros(len(time))
    weights[1:] += 0.5 * steps
    weights[:-1] += 0.5 * steps
    return weights


@dataclass(frozen=True, eq=False)
class RowMeans:
    """Means of one row: f and ω, (..., 3), and how they move with the bench's parameters."""

    f: Array
    w: Array
    df: Mapping[str, Array]
    dw: Mapping[str, Array]


def row_means(bench: Turntable, way: AxisAngles) -> RowMeans:
    """Return the sensed motion in one row with the bench as its readback says.

    Raises
    ------
    InputError
        Angles of another number of axes.
    """
    time, mat = way.time, reference_attitude(bench, way.angles)
    seen = linear_misalignment(bench, way.angles)
    up, north = earth_rate_up_north(bench.latitude)
    force, earth = np.array([0, 0, bench.gravity.value]), np.array([0, north, up])
    back = np.swapaxes(mat, -1, -2)
    weighted = _time_weights(time)[:, None, None] * back
    mean = weighted.sum(axis=-3)
    # Means of products of an element of Cᵀ and one of B: (..., 9, 3 q) of n samples.
    products = np.swapaxes(weighted.reshape(*mat.shape[:-2], 9), -1, -2) @ seen.by.reshape(
        *mat.shape[:-2], -1
    )
    products = products.reshape(*products.shape[:-2], 3, 3, 3, -1)

    def moved(v: Array) -> Array:
        """Return mean Cᵀ (v × B), (..., 3, q)."""
        return np.einsum("jk,...ijkq->...iq", np.cross(v, np.eye(3)).T, products)

    f, w = mean @ force, mean @ earth
    by_f, by_w = moved(force), moved(earth)
    northward = np.array([0, -up, north])  # ∂(earth's rate)/∂(latitude)
    dw = {"latitude": mean @ northward}
    if len(time) > 1:
        lasting = time[-1] - time[0]
        steps = log_so3(back[..., :-1, :, :] @ mat[..., 1:, :, :])
        turned = steps.sum(axis=-2) / lasting
        middle = 0.5 * (back[..., :-1, :, :] + back[..., 1:, :, :])
        by_w = by_w + np.sum(middle @ np.diff(seen.by, axis=-3), axis=-3) / lasting
        rates = steps / np.diff(time)[:, None]
        first, last = (
            1.5 * rates[..., a, :] - 0.5 * rates[..., b, :] for a, b in ((0, 1), (-1, -2))
        )
        dw["latency"] = (last - first) / lasting
        dw["clock"] = turned
        w = w + turned
    names = [q.name for q in seen.parameters]
    df = {name: by_f[..., j] for j, name in enumerate(names)} | {"g": f / bench.gravity.value}
    return RowMeans(f, w, df, dw | {name: by_w[..., j] for j, name in enumerate(names)})


def stack_row_means(
    bench: Turntable, ways: Sequence[AxisAngles]
) -> tuple[Motion, dict[str, Array], dict[str, Array]]:
    """Return all rows: the motion, (..., r, 3), ∂f and ∂ω by the bench's parameters.

    Raises
    ------
    InputError
        Angles of another number of axes.
    """
    result = [row_means(bench, way) for way in ways]
    zero = np.zeros_like(result[0].f)

    def stacked(each: Sequence[Array]) -> Array:
        return np.stack(np.broadcast_arrays(*each), axis=-2)

    df = {n: stacked([one.df[n] for one in result]) for n in result[0].df}
    names = dict.fromkeys(name for one in result for name in one.dw)
    dw = {n: stacked([one.dw.get(n, zero) for one in result]) for n in names}
    motion = Motion(stacked([one.f for one in result]), stacked([one.w for one in result]))
    return motion, df, dw


def sensed_motion(
    bench: Turntable,
    motion: Motion,
    df: Mapping[str, Array],
    dw: Mapping[str, Array],
    q: Mapping[str, Array],
) -> MeanMotion:
    """Return the sensed motion with the bench's parameters at q, to first order in their errors.

    Parameters
    ----------
    bench : Turntable
    motion, df, dw
        As of `stack_row_means`.
    q : mapping of str to (...) array
        Values by name, SI; those missing are as declared.
    """
    known = declared_parameters(bench)
    f, w = motion.f, motion.w
    for name in (one for one in {**df, **dw} if one in q):
        # The readback is not corrected for its stated delay, so the whole delay is an error.
        off = q[name] - (0.0 if name == "latency" else known[name].value)
        if np.any(off):
            beside = off[..., None, None]
            f = f + df[name] * beside if name in df else f
            w = w + dw[name] * beside if name in dw else w
    return MeanMotion(Motion(f, w), df, dw)
