"""Tilts by a level: lean and wobble of a table, and the right angle between two axes.

A level that turns with a table, at the table's angle θ (counter-clockwise seen from above) along
the azimuth A = A₀ − θ, reads its zero, the lean of the axis and the wobble of its bearing::

    reading = z + λ_x cos A − λ_y sin A + Σ_{k ≥ 2} (a_k cos kθ + b_k sin kθ)

λ_x and λ_y are the rotations about east and north; the reading is positive where the end of the
level at A is high. A wobble once a turn is a lean; a level on the base sees wobble alone.

On a horizontal axis that an axis with a vertical direction carries, direct (s = 1) and reversed
(s = −1), a level reads::

    reading = z + s (σ + c cos θ + d sin θ)

with σ the deviation from the right angle and c, d the lean. In one sense alone σ is not told
from z.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.qualification.linear_fit import linear_fit
from inercal.benches.qualification.measurements.head_map import ARCSEC
from inercal.benches.qualification.measurements.measured_parameters import (
    MeasuredParameters,
    from_fit,
)

_MOST = 6  # highest wobble that is looked for


def table_tilt(
    angle: Array, reading: Array, sd: float, azimuth: float, scale_sd: float = 0.0, wobble: int = 1
) -> MeasuredParameters:
    """Return "lean_x" and "lean_y", rad, by a level that turns with the table.

    Parameters
    ----------
    angle : (m,) array
        Of the table, rad.
    reading : (m,) array
        rad.
    sd : float
        Of one reading, rad.
    azimuth : float
        Of the level at the angle zero, clockwise from north, rad.
    scale_sd : float
        Relative standard uncertainty of the level's scale.
    wobble : int
        Highest harmonic of the wobble in the model; 1 is none.

    Raises
    ------
    InputError
        Angles that do not determine the harmonics.
    """
    along = azimuth - angle
    first = np.stack([np.cos(along), -np.sin(along), np.ones_like(angle)], axis=-1)

    def pair(k: int) -> Array:
        return np.stack([np.cos(k * angle), np.sin(k * angle)], axis=-1)

    columns = np.hstack([first, *(pair(k) for k in range(2, wobble + 1))])
    missing = {
        f"wobble {k} times a turn, of {{size:.2g}}″, is not modelled: state wobble = {k}": ARCSEC
        * pair(k)
        for k in range(wobble + 1, _MOST + 1)
    }
    fit = linear_fit(
        columns,
        reading,
        np.full(len(reading), sd),
        missing,
        "read the level at more azimuths, evenly spaced over a turn",
    )
    lean = fit.value[:2]
    covariance = fit.covariance[:2, :2] + scale_sd**2 * np.outer(lean, lean)
    amplitudes = [np.hypot(*fit.value[2 * k - 1 : 2 * k + 1]) for k in range(2, wobble + 1)]
    remarks = tuple(
        f"wobble {k} times a turn: {size / ARCSEC:.2g}″" for k, size in enumerate(amplitudes, 2)
    )
    unseen = ("a wobble once a turn, which looks like lean",)
    return from_fit(fit, ("lean_x", "lean_y"), "rad", lean, covariance, unseen, remarks)


def refuse_base_level() -> None:
    """Refuse a level on the base for a lean.

    Raises
    ------
    InputError
    """
    raise InputError(
        "a level on the base sees only the wobble of the table, and its zero cannot be "
        "distinguished from the lean; set the level on the table",
        key="[measurement] level_at",
    )


def right_angle(
    angle: Array, sense: Array, reading: Array, sd: float, name: str, sign: float, scale_sd: float
) -> MeasuredParameters:
    """Return the deviation of two axes from a right angle, rad.

    Parameters
    ----------
    angle : (m,) array
        Of the carrying axis, rad.
    sense : (m,) array
        1 with the level direct, −1 reversed.
    reading : (m,) array
        rad, positive where the end of the level toward the carried axis is high, direct.
    sd : float
        Of one reading, rad.
    name : str
        "square_1" or "square_2".
    sign : float
        Of the parameter where the carried axis points up beyond the level.
    scale_sd : float
        Relative standard uncertainty of the level's scale.

    Raises
    ------
    InputError
        The level was not reversed, or the axis not turned.
    """
    if not ({1.0, -1.0} == set(np.unique(sense).tolist())):
        raise InputError(
            "the level was read in only one sense, so its zero cannot be distinguished from the "
            "right angle; read it direct (1) and reversed (-1)",
            key="[measurement] sense",
        )
    even = np.ones_like(angle)
    columns = np.stack([sense, even, sense * np.cos(angle), sense * np.sin(angle)], axis=-1)
    missing = {
        f"a wobble {k} times a turn, of {{size:.2g}}″, is not in the model": ARCSEC
        * sense[:, None]
        * np.stack([np.cos(k * angle), np.sin(k * angle)], axis=-1)
        for k in (2, 3)
    }
    fit = linear_fit(
        columns,
        reading,
        np.full(len(reading), sd),
        missing,
        "the lean of the carrying axis cannot be distinguished from the right angle; turn it to "
        "three or more angles, evenly spaced over a turn",
    )
    value = sign * fit.value[:1]
    covariance = fit.covariance[:1, :1] + scale_sd**2 * np.outer(value, value)
    lean = np.hypot(*fit.value[2:4]) / ARCSEC
    remarks = (f"lean of the carrying axis: {lean:.2g}″",)
    return from_fit(fit, (name,), "rad", value, covariance, (), remarks)


def right_angle_sign(axes: str, number: int) -> float:
    """Return the sign of `right_angle` for the axes of a turntable.

    The parameter turns the carried axis a_j about the third axis e, a_j + σ e × a_j; its component
    along the carrying axis a_i, which points up, is σ (e × a_j)·a_i.

    Parameters
    ----------
    axes : str
        Body axes, outermost first.
    number : int
        1 of the outermost and the next.

    Raises
    ------
    InputError
        No such pair.
    """
    if not 1 <= number < len(axes):
        raise InputError(
            f"axes {axes!r} have no right angle {number}", key="[measurement] right_angle"
        )
    i, j = ("xyz".index(a) for a in axes[number - 1 : number + 1])
    unit = np.eye(3)
    return float(np.cross(unit[3 - i - j], unit[j]) @ unit[i])
