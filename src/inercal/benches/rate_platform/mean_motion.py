"""Compute the mean motion during sections on a rate platform, with its derivatives.

The equations and symbols are the same as in `inercal.benches.rate_platform.bench`.

The level earth rate turns in the case while the table turns, and changes the readings. The change
within a section follows from the rate of the table, except for the azimuth at its start. It is
neither noise nor a disturbance, so it is subtracted before the samples of a section are judged.
With h = (h₁, h₂) at the start of a section and s(t) the readings for unit h₁ and h₂ without their
mean, h minimises

    Σ (y − s h)²/σ² + 2 |h|²/(ω_ie cos φ)²

over all sections in a setting, because they are to start at the same azimuth. σ is the noise of a
sample, from the differences between neighbouring samples. If a section of at least one turn fits
another azimuth, with |h| = ω_ie cos φ, clearly better, this azimuth is used.
"""

from collections.abc import Callable, Mapping, Sequence
from math import cos, pi, sin
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import Measured
from inercal.benches.contract import MeanMotion, stack_derivatives
from inercal.benches.rate_platform.sections import KnownTurn, PlatformStep, RateDwell
from inercal.physics.earth import EARTH_RATE, earth_rate_up_north
from inercal.physics.frames import exp_so3, left_jacobian, skew, transform
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor
from inercal.recordings import Mark, Recording

if TYPE_CHECKING:
    from inercal.benches.rate_platform.bench import RatePlatform


_WHOLE = 0.99  # turns
_BETTER = 14.0  # drop of χ², 3.7σ
_TINY = 1e-12  # rad/s: no sensor has less noise, and the level earth rate at a pole is smaller

_UNITS = np.eye(3)


def perpendicular_axes(axis: str) -> tuple[Array, Array]:
    """Return the two case axes that follow an axis in the cycle x, y, z."""
    j = "xyz".index(axis[-1])
    return _UNITS[(j + 1) % 3], _UNITS[(j + 2) % 3]


def level_rate_factor(step: RateDwell) -> tuple[float, float]:
    """Return the sensed fraction of the horizontal earth rate, sinc(Θ/2), and Θ/2 in rad."""
    if step.rate == 0:
        return 1.0, 0.0
    half = step.rate * step.seconds / 2
    if half == 0:
        return 0.0, 0.0  # an unknown number of whole turns
    return float(np.sinc(half / pi)), half


def level_earth_rate(step: RateDwell, time: Array) -> Array:
    """Return the horizontal earth rate in the case for h = (1, 0) and (0, 1), (n, 3, 2).

    Parameters
    ----------
    step : RateDwell
    time : (n,) array
        Time from the start of the dwell, s.
    """
    angle = step.rate * time * (-1 if step.axis.startswith("-") else 1)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    first, second = perpendicular_axes(step.axis)
    return np.stack([c * first - s * second, s * first + c * second], axis=-1)


def level_rate_changes(
    latitude: Measured | None,
    recording: Recording,
    sensor: Sensor,
    marks: Sequence[Mark],
    steps: Sequence[PlatformStep],
) -> Callable[[str], Array | float]:
    """Return a function that returns the changes within the section with a label, (n, m) rad/s.

    The changes have a mean of zero. They are 0 for rests, poses and turns by an angle.

    Parameters
    ----------
    latitude : Measured or None
        Latitude, rad.
    recording : Recording
        Recording without a trial axis.
    sensor : Sensor
    marks, steps : sequences of r Mark and PlatformStep
    """
    level = earth_rate_up_north(latitude.value)[1] if latitude else 0.0
    columns = [recording.channels.index(name) for name in sensor.channels]
    axes = np.array([axis.i if axis.measures == "w" else (0.0, 0.0, 0.0) for axis in sensor.axes])
    settings: dict[str, list[tuple[Mark, RateDwell]]] = {}
    for mark, step in zip(marks, steps, strict=True):
        if isinstance(step, RateDwell) and step.rate and not isinstance(step, KnownTurn):
            settings.setdefault(step.place, []).append((mark, step))

    def unit_changes(mark: Mark, step: RateDwell) -> Array:
        time = recording.time[mark.start : mark.stop] - recording.time[mark.start]
        changes: Array = axes @ level_earth_rate(step, time + 0.5 / recording.rate_hz)
        return changes - changes.mean(axis=0)

    known: dict[str, Array] = {}
    at = {mark.label: (mark, step) for own in settings.values() for mark, step in own}
    for own in settings.values() if level > _TINY else ():
        grams, products = np.zeros((len(own), 2, 2)), np.zeros((len(own), 2))
        for k, (mark, step) in enumerate(own):
            read = sensor.to_si(recording.data[mark.start : mark.stop, columns])
            unit = unit_changes(mark, step)
            weighted = unit / (np.diff(read, axis=0).var(axis=0) / 2 + _TINY**2)[:, None]
            grams[k] = np.einsum("nmj,nmk->jk", weighted, unit)
            products[k] = np.einsum("nmj,nm->j", weighted, read)
        prior = 2 / level**2 * np.eye(2)
        gram, product = prior + grams.sum(axis=0), products.sum(axis=0)
        common: Array = np.asarray(np.linalg.solve(gram, product), dtype=float)
        for (mark, step), gram, product in zip(own, grams, products, strict=True):
            alone = np.linalg.solve(prior + gram, product)
            alone *= level / (np.hypot(*alone) + _TINY**2)
            drop = float((common - alone) @ (gram @ (common + alone) - 2 * product))
            turned = abs(step.rate) * step.seconds > _WHOLE * 2 * pi
            known[mark.label] = alone if turned and drop > _BETTER else common
    return lambda label: unit_changes(*at[label]) @ known[label] if label in known else 0.0


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
    f = g[..., None] * transform(turn, vertical)
    w = transform(turn, up_rate[..., None] * vertical + h1 * across[0] + h2 * across[1])
    df, dw = {"g": transform(turn, vertical)}, dict[str, Array]()
    for k, c in zip((1, 2), across, strict=True):
        by_tilt = transform(turn, jacobian @ c)
        df[f"attitude_{k}[{label}]"] = g[..., None] * by_tilt
        dw[f"attitude_{k}[{label}]"] = up_rate[..., None] * by_tilt
        dw[f"pose_earth_{k}[{label}]"] = turn @ c
    for k, a in enumerate("xyz"):
        df[f"mounting_{a}"] = (-skew(f) @ by_mounting)[..., k]
        dw[f"mounting_{a}"] = (-skew(w) @ by_mounting)[..., k]
    return _RowMotion(f, w, df, dw, transform(turn, vertical))
