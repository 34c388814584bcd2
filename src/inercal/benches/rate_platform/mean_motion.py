"""Compute the mean motion during sections on a rate platform, with its derivatives.

The equations and symbols are the same as in `inercal.benches.rate_platform.bench`.
"""

from collections.abc import Callable, Mapping, Sequence
from math import cos, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.contract import MeanMotion, stack_derivatives
from inercal.benches.rate_platform.level_rate import level_rate_factor, perpendicular_axes
from inercal.benches.rate_platform.sections import KnownTurn, PlatformStep, RateDwell
from inercal.physics.earth import EARTH_RATE
from inercal.physics.frames import exp_so3, left_jacobian, skew
from inercal.physics.motion import Motion

if TYPE_CHECKING:
    from inercal.benches.rate_platform.bench import RatePlatform

_UNITS = np.eye(3)
_STEEP = 0.9  # if up has a larger x component, x is too near to up to be a reference
Value = Callable[[str], Array]


class _RowMotion(NamedTuple):
    """Specific force and rate in one section, (..., 3), their derivatives by full name, and up."""

    f: Array
    w: Array
    df: dict[str, Array]
    dw: dict[str, Array]
    vertical: Array


def sensed_motion(
    bench: "RatePlatform", steps: Sequence[PlatformStep], q: Mapping[str, Array]
) -> MeanMotion:
    """Return the mean motion during each section, with its derivatives.

    Parameters
    ----------
    bench : RatePlatform
    steps : sequence of r RateDwell or Pose
    q : mapping of str to (...) array
        Values of errors, SI, by full name. A missing error keeps its stated value.
    """
    shape = np.broadcast_shapes(*(np.shape(one) for one in q.values()))
    zero = np.zeros(shape)
    g = np.broadcast_to(np.asarray(q.get("g", bench.gravity.value), dtype=float), shape)
    place = None if bench.latitude is None else q.get("latitude", np.array(bench.latitude.value))
    up_rate, north_rate = zero, zero
    if place is not None:
        up_rate, north_rate = zero + EARTH_RATE * np.sin(place), zero + EARTH_RATE * np.cos(place)

    known = bench.qualified.correction

    def value(name: str) -> Array:
        if name in q:
            return np.asarray(q[name], dtype=float) + zero
        return zero + known(name)

    rows = [
        _dwell(step, value, g, up_rate, by_order)
        if isinstance(step, RateDwell)
        else _pose(step.label, np.array(step.up), value, g, up_rate)
        for step, by_order in zip(steps, _slopes_of_order(steps), strict=True)
    ]
    f, w = (np.stack([getattr(row, name) for row in rows], axis=-2) for name in ("f", "w"))
    for row in rows:
        row.dw["latitude"] = north_rate[..., None] * row.vertical
    return MeanMotion(
        Motion(f, w),
        stack_derivatives([row.df for row in rows], (*shape, 3)),
        stack_derivatives([row.dw for row in rows], (*shape, 3)),
    )


def tilt_directions(up: Array) -> tuple[Array, Array]:
    """Return two unit vectors perpendicular to a unit vector, (3,) each."""
    reference: Array = _UNITS[1] if abs(up[0]) > _STEEP else _UNITS[0]
    first = skew(up) @ reference
    first = first / np.linalg.norm(first)
    return first, skew(up) @ first


def changes_of_rate(steps: Sequence[PlatformStep]) -> list[float]:
    """Return the change of the rate before each dwell, rad/s; 0 for the first in a setting.

    A dwell at an unchanged rate, such as a second reading, has the change of the dwell before.
    """
    before: dict[str, tuple[float, float]] = {}
    changes: list[float] = []
    for step in steps:
        change = 0.0
        if isinstance(step, RateDwell):
            rate = 0.0 if isinstance(step, KnownTurn) else step.rate  # a turn ends at rest
            last, change = before.get(step.place, (rate, 0.0))
            change = rate - last if rate != last else change
            before[step.place] = rate, change
        changes.append(change)
    return changes


def _slopes_of_order(steps: Sequence[PlatformStep]) -> list[dict[str, float]]:
    """Return the derivatives of each rate for the errors that depend on the rate before."""
    rates = [step.rate if isinstance(step, RateDwell) else 0.0 for step in steps]
    top = max(map(abs, rates), default=0.0) or 1.0
    return [
        {"rate_hysteresis": -0.5 * float(np.sign(c)) * (1 - (w / top) ** 2), "settling": c}
        for w, c in zip(rates, changes_of_rate(steps), strict=True)
    ]


def _dwell(
    step: RateDwell, value: Value, g: Array, up_rate: Array, by_order: Mapping[str, float]
) -> _RowMotion:
    place, rate = step.place, step.rate
    level = level_rate_factor(step)
    up, across = np.array(step.up), perpendicular_axes(step.axis)
    tilts = [value(f"setting_{k}[{place}]")[..., None] for k in (1, 2)]
    axis = up + tilts[0] * across[0] + tilts[1] * across[1]
    length = np.linalg.norm(axis, axis=-1, keepdims=True)
    axis = axis / length
    by_tilt = [(a - axis * (axis @ a)[..., None]) / length for a in across]
    # (a₁, a₂, up) is right-handed if a positive axis points up.
    angle = -level[1] if step.axis.startswith("-") else level[1]
    c, s = level[0] * cos(angle), level[0] * sin(angle)
    beside = [a - t * up for a, t in zip(across, tilts, strict=True)]
    by_earth = (c * beside[0] - s * beside[1], s * beside[0] + c * beside[1])
    h1, h2 = (value(f"earth_{k}[{place}]")[..., None] for k in (1, 2))
    in_case = (c * h1 + s * h2, c * h2 - s * h1)
    by_turning = _slopes_of_rate(step, by_order)
    along = (rate + up_rate)[..., None]
    for name, slope in by_turning.items():
        along = along + slope * value(name)[..., None]
    turn_on = np.stack([value(f"turn_on_{a}[{place}]") for a in "xyz"], axis=-1)
    w = along * axis + in_case[0] * beside[0] + in_case[1] * beside[1] + turn_on
    arms = [value(f"arm_{k}[{place}]")[..., None] for k in (1, 2)]
    f = g[..., None] * axis - rate**2 * (arms[0] * across[0] + arms[1] * across[1])
    df, dw = {"g": axis}, dict[str, Array]()
    for k in (1, 2):
        df[f"setting_{k}[{place}]"] = g[..., None] * by_tilt[k - 1]
        dw[f"setting_{k}[{place}]"] = along * by_tilt[k - 1] - in_case[k - 1] * up
        dw[f"earth_{k}[{place}]"] = by_earth[k - 1]
    for a, unit in zip("xyz", _UNITS, strict=True):
        dw[f"turn_on_{a}[{place}]"] = np.broadcast_to(unit, w.shape)
    if rate:
        for k in (1, 2):
            df[f"arm_{k}[{place}]"] = np.broadcast_to(-(rate**2) * across[k - 1], f.shape)
    dw |= {name: slope * axis for name, slope in by_turning.items()}
    return _RowMotion(f, w, df, dw, axis)


def _slopes_of_rate(step: RateDwell, by_order: Mapping[str, float]) -> dict[str, float]:
    """Return the derivatives of the rate about the table's axis for the table's errors."""
    rate, label = step.rate, step.label
    inverse = 1 / step.seconds if step.seconds else 0.0
    if isinstance(step, KnownTurn):
        return {f"turn_angle[{label}]": inverse}
    if rate == 0:
        return {"settling": by_order["settling"]}
    return {
        "rate_scale": rate,
        f"rate_stability[{label}]": rate,
        "rate_asymmetry": abs(rate),
        f"angle_reading[{label}]": inverse,
        **by_order,
    }


def _pose(label: str, up: Array, value: Value, g: Array, up_rate: Array) -> _RowMotion:
    across = tilt_directions(up)
    t1, t2 = (value(f"attitude_{k}[{label}]")[..., None] for k in (1, 2))
    tilt = t1 * across[0] + t2 * across[1]
    vertical = exp_so3(tilt) @ up
    jacobian = -skew(vertical) @ left_jacobian(tilt)
    mounting = np.stack([value(f"mounting_{a}") for a in "xyz"], axis=-1)
    turn, by_mounting = exp_so3(mounting), left_jacobian(mounting)
    h1, h2 = (value(f"pose_earth_{k}[{label}]")[..., None] for k in (1, 2))
    f = g[..., None] * _turned(turn, vertical)
    w = _turned(turn, up_rate[..., None] * vertical + h1 * across[0] + h2 * across[1])
    df, dw = {"g": _turned(turn, vertical)}, dict[str, Array]()
    for k, c in zip((1, 2), across, strict=True):
        by_tilt = _turned(turn, jacobian @ c)
        df[f"attitude_{k}[{label}]"] = g[..., None] * by_tilt
        dw[f"attitude_{k}[{label}]"] = up_rate[..., None] * by_tilt
        dw[f"pose_earth_{k}[{label}]"] = turn @ c
    for k, a in enumerate("xyz"):
        df[f"mounting_{a}"] = (-skew(f) @ by_mounting)[..., k]
        dw[f"mounting_{a}"] = (-skew(w) @ by_mounting)[..., k]
    return _RowMotion(f, w, df, dw, _turned(turn, vertical))


def _turned(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]
