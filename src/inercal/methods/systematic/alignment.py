"""Find the initial attitudes for a search from the whole recording rather than from single rests.

1. The gyros transform the force of every rest to the body frame at the first rest. All transformed
   forces must point up; otherwise an axis is reversed, exchanged, or in a wrong unit.
2. When up is known at every rest, mean rates determine the level part of the Earth's rate, and with
   it the azimuth and the gyro biases, by linear least squares over all rests::

       ȳ_w − C_iᵀ e_up Ω sin φ = C_iᵀ (x e₁ + y e₂) + b_g

   The computation is repeated with this b_g, because a gyro of 10 °/h cannot determine the azimuth
   from one rest.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations
from math import degrees, radians

import numpy as np
from numpy.typing import ArrayLike

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.methods.systematic.navigation import ImuModel, earth_rate, integrate_navigation
from inercal.methods.systematic.segments import Segments
from inercal.physics.earth import earth_rate_up_north
from inercal.physics.sensors import Sensor

# Disagreement of the forces: 0.4° for a navigation-grade IMU, 3 to 7° if scale factors are off by
# 1 % and axes by 0.5°, 7 to 14° for twice these errors, 86 to 180° for a wrong axis or unit
MAX_DISAGREEMENT = radians(20)
MAX_LATITUDE = radians(85)  # beyond it, the level part of the Earth's rate is too small
_REPEATED = 3
_LONG = 1e9  # s, interval between the rests' means; so long that no rate change matters
_NAMED = 3  # number of possible causes in a message


def initial_attitudes(
    segments: Segments, model: ImuModel, c: Array, latitude: float
) -> tuple[Array, Array]:
    """Return C at each rest, (m, 3, 3), and coefficients with gyro biases, (p,) SI.

    Parameters
    ----------
    segments : Segments
    model : ImuModel
    c : (p,) array
        Coefficients at the start.
    latitude : float
        Latitude, rad.

    Raises
    ------
    InputError
        The latitude is beyond 85°, or the forces disagree by more than 20°.
    """
    if abs(latitude) > MAX_LATITUDE:
        raise InputError(
            f"latitude {degrees(latitude):.4g}° is beyond ±85°, where the level part of the "
            "Earth's rate is too small to determine the azimuth",
            key="[bench] latitude",
        )
    biases, axis = _bias_places(model.sensor)
    c = _with_mean_rates(segments, model, c)  # the Earth's rate nearly cancels over all faces
    _require_agreement(segments, model, c)
    up_rate, _ = earth_rate_up_north(latitude)
    level, attitude = np.zeros(3), np.eye(3)
    attitudes = np.zeros((0, 3, 3))
    for _ in range(_REPEATED):
        carried = _carried(segments, model, c, attitude, level)
        up = _unit((carried @ segments.mean[:, :3, None])[..., 0]).sum(axis=0)
        attitudes = _level_frame(up) @ carried
        rates = segments.mean[:, 3:] - up_rate * attitudes[:, 2]
        x, y, *found = np.linalg.lstsq(_level_rate_rows(attitudes), rates.ravel(), rcond=None)[0]
        size = np.hypot(x, y)
        turn = np.array([[y, -x, 0.0], [x, y, 0.0], [0.0, 0.0, size]]) / size
        attitudes = turn @ attitudes
        attitude, level = attitudes[0], earth_rate(latitude)
        c[biases] = np.array(found)[[k - 3 for k in axis]]
    return attitudes, c


def attitudes_at(segments: Segments, model: ImuModel, c: Array, latitude: float) -> Array:
    """Return C at each rest, (m, 3, 3), from readings corrected with the coefficients c.

    The arguments and exceptions are as for `initial_attitudes`, which uses uncorrected forces.
    """
    force = model.motion_of_readings(segments.mean, _LONG, c, 0.0, means=True).f
    mean = np.concatenate([force, segments.mean[:, 3:]], axis=1)
    return initial_attitudes(replace(segments, mean=mean), model, c, latitude)[0]


def _level_rate_rows(attitudes: Array) -> Array:
    """Return ∂(rates at rests)/∂(level part of the Earth's rate, biases), (3 m, 5)."""
    m = len(attitudes)
    rows = [attitudes.mT[..., :2], np.tile(np.eye(3), (m, 1, 1))]
    return np.concatenate(rows, axis=-1).reshape(-1, 5)


def determines_azimuth(attitudes: Array) -> bool:
    """Return whether rests at these attitudes can separate the Earth's rate from gyro biases.

    The rests can separate them if an error in one rest's rates does not cause a larger error of the
    level rate.

    Parameters
    ----------
    attitudes : (m, 3, 3) array
        C, body to n, at each rest.
    """
    rows = _level_rate_rows(attitudes)
    inverse = np.linalg.pinv(rows.T @ rows, hermitian=True)
    whole = np.linalg.matrix_rank(rows) == rows.shape[1]
    return bool(whole and np.linalg.eigvalsh(inverse[:2, :2]).max() <= 1)


def _carried(segments: Segments, model: ImuModel, c: Array, attitude: Array, earth: Array) -> Array:
    """Return C at each rest, (m, 3, 3), propagated by the gyros from the first one."""
    motion = model.motion(segments, c, 0.0)
    start = np.tile(attitude, (segments.first.size, 1, 1))
    later = integrate_navigation(segments, motion, start, earth, 0.0, chained=True).attitude
    return np.concatenate([attitude[None], later])


def _unit(v: ArrayLike) -> Array:
    return np.asarray(v, dtype=float) / np.linalg.norm(v, axis=-1, keepdims=True)


def _level_frame(up: Array) -> Array:
    """Return the rotation that takes `up` to the third axis, with arbitrary azimuth."""
    up = _unit(up)
    aside = np.eye(3)[np.argmin(np.abs(up))]
    east = _unit(np.cross(aside, up))
    return np.stack([east, np.cross(up, east), up])


def largest_force_angle(segments: Segments, model: ImuModel, c: Array) -> float:
    """Return the largest angle between the forces of two rests in the first rest's frame, rad."""
    carried = _carried(segments, model, c, np.eye(3), np.zeros(3))
    force = _unit((carried @ segments.mean[:, :3, None])[..., 0])
    cosine = np.clip(force @ force.T, -1.0, 1.0)
    return float(np.arccos(cosine.min()))


def _require_agreement(segments: Segments, model: ImuModel, c: Array) -> None:
    found = largest_force_angle(segments, model, c)
    if found <= MAX_DISAGREEMENT:
        return
    causes = [
        words
        for words, changed in _possible_mistakes(segments)
        if largest_force_angle(changed, model, _with_mean_rates(changed, model, c))
        <= MAX_DISAGREEMENT
    ]
    text = "; check the axes, signs and units of both triads"
    if causes:
        text = (
            f"; these data would fit if {' or if '.join(causes[:_NAMED])}, so correct [data] or "
            "[sensor]"
        )
    raise InputError(
        "the specific forces at the rests, transformed to the first rest by the gyros, disagree by "
        f"{degrees(found):.0f}° (more than {degrees(MAX_DISAGREEMENT):.0f}°){text}",
        key="[data]",
    )


def _with_mean_rates(segments: Segments, model: ImuModel, c: Array) -> Array:
    """Return the coefficients with gyro biases equal to the mean rates over all rests."""
    c = c.copy()
    biases, axis = _bias_places(model.sensor)
    c[biases] = segments.mean.mean(axis=0)[axis]
    return c


def _bias_places(sensor: Sensor) -> tuple[list[int], list[int]]:
    """Return the indices of the gyro biases among the coefficients, and those of their axes."""
    names = [CoefficientName(name) for name in sensor.coefficients]
    places = [k for k, name in enumerate(names) if name.term == "bias"]
    return places, [sensor.channels.index(names[k].axis) for k in places]


def _possible_mistakes(segments: Segments) -> Iterator[tuple[str, Segments]]:
    """Yield common mistakes in words, each with the segments corrected for it."""
    words = {0: "the accelerometers", 3: "the gyros"}
    for first, triad in words.items():
        for k, axis in enumerate("xyz"):
            yield (
                f"{axis} of {triad} were reversed",
                _changed(segments, {first + k: (first + k, -1)}),
            )
        for i, j in combinations(range(3), 2):
            pair = {first + i: (first + j, 1), first + j: (first + i, 1)}
            yield f"{'xyz'[i]} and {'xyz'[j]} of {triad} were exchanged", _changed(segments, pair)
    every = {k: (k, -1) for k in range(3, 6)}
    yield "all gyros were reversed", _changed(segments, every)
    for unit, size in (("°/s stated as rad/s", radians(1)), ("rad/s stated as °/s", degrees(1))):
        yield (
            f"the gyros' columns were {unit}",
            _changed(segments, {k: (k, size) for k in range(3, 6)}),
        )


def _changed(segments: Segments, columns: Mapping[int, tuple[int, float]]) -> Segments:
    """Return the segments with columns replaced by others multiplied by a factor."""
    mean, moving = segments.mean.copy(), segments.moving.copy()
    for to, (source, factor) in columns.items():
        mean[:, to] = factor * segments.mean[:, source]
        moving[:, to] = factor * segments.moving[:, source]
    return replace(segments, mean=mean, moving=moving)
