"""Determine tilts with a level: lean and wobble of a table, and the right angle of two axes.

A level turns with a table. At the table's angle θ (counter-clockwise seen from above) it points to
the azimuth A = A₀ − θ. It reads its zero, the lean of the axis and the wobble of the bearing::

    reading = z + λ_x cos A − λ_y sin A + Σ_{k ≥ 2} (a_k cos kθ + b_k sin kθ)

λ_x and λ_y are the rotations about east and north. The reading is positive if the end of the level
at A is high. A wobble once per turn looks like a lean. A level on the base reads only the wobble.

A level on a horizontal axis, which a vertical axis carries, reads in the direct (s = 1) and
reversed (s = −1) position::

    reading = z + s (σ + c cos θ + d sin θ)

where σ is the deviation from the right angle, and c and d are the lean. In only one position σ
cannot be distinguished from z.
"""

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.qualification.linear_fit import MeasuredParameters, from_fit, linear_fit
from inercal.benches.qualification.measurements.head_map import ARCSEC

_MOST = 6  # highest harmonic of the wobble that is tested


def table_tilt(
    angle: Array, reading: Array, sd: float, azimuth: float, scale_sd: float = 0.0, wobble: int = 1
) -> MeasuredParameters:
    """Estimate "lean_x" and "lean_y", rad, with a level that turns with the table.

    Parameters
    ----------
    angle : (m,) array
        Angles of the table, rad.
    reading : (m,) array
        Readings of the level, rad.
    sd : float
        Standard deviation of one reading, rad.
    azimuth : float
        Azimuth of the level at the angle zero, clockwise from north, rad.
    scale_sd : float
        Relative standard uncertainty of the level's scale.
    wobble : int
        Highest harmonic of the wobble in the model; 1 means no wobble.

    Raises
    ------
    InputError
        The angles do not determine the harmonics.
    """
    along = azimuth - angle
    first = np.stack([np.cos(along), -np.sin(along), np.ones_like(angle)], axis=-1)

    def pair(k: int) -> Array:
        return np.stack([np.cos(k * angle), np.sin(k * angle)], axis=-1)

    columns = np.hstack([first, *(pair(k) for k in range(2, wobble + 1))])
    missing = {
        f"a wobble {k} times per turn ({{size:.2g}}″) is not modelled: state wobble = {k}": ARCSEC
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
        f"wobble {k} times per turn: {size / ARCSEC:.2g}″" for k, size in enumerate(amplitudes, 2)
    )
    unseen = ("a wobble once per turn, which looks like a lean",)
    return from_fit(fit, ("lean_x", "lean_y"), "rad", lean, covariance, unseen, remarks)


def refuse_base_level() -> None:
    """Refuse to determine a lean with a level on the base.

    Raises
    ------
    InputError
        Always, with the reason.
    """
    raise InputError(
        "a level on the base measures only the wobble of the table, and its zero cannot be "
        "distinguished from the lean; set the level on the table",
        key="[measurement] level_at",
    )


def right_angle(
    angle: Array, sense: Array, reading: Array, sd: float, name: str, sign: float, scale_sd: float
) -> MeasuredParameters:
    """Estimate the deviation of two axes from a right angle, rad.

    Parameters
    ----------
    angle : (m,) array
        Angles of the carrying axis, rad.
    sense : (m,) array
        1 for the level in the direct position, −1 if it is reversed.
    reading : (m,) array
        Readings of the level, rad. In the direct position they are positive if the end of the level
        toward the carried axis is high.
    sd : float
        Standard deviation of one reading, rad.
    name : str
        Name of the parameter, "square_1" or "square_2".
    sign : float
        Sign of the parameter if the carried axis points above the horizontal.
    scale_sd : float
        Relative standard uncertainty of the level's scale.

    Raises
    ------
    InputError
        The level was not reversed, or the carrying axis was not turned.
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
        f"a wobble {k} times per turn ({{size:.2g}}″) is not in the model": ARCSEC
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
    """Return the sign that `right_angle` needs for the axes of a turntable.

    The parameter turns the carried axis a_j about the third axis e, to a_j + σ e × a_j. Its
    component along the carrying axis a_i, which points up, is σ (e × a_j)·a_i.

    Parameters
    ----------
    axes : str
        Body axes, outermost first.
    number : int
        Number of the right angle; 1 is between the outermost axis and the next.

    Raises
    ------
    InputError
        The axes have no right angle with this number.
    """
    if not 1 <= number < len(axes):
        raise InputError(
            f"axes {axes!r} have no right angle {number}", key="[measurement] right_angle"
        )
    i, j = ("xyz".index(a) for a in axes[number - 1 : number + 1])
    unit = np.eye(3)
    return float(np.cross(unit[3 - i - j], unit[j]) @ unit[i])
