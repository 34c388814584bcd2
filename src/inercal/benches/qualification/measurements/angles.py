"""Determine the angle errors of a head or a readback, and tilts and right angles of axes.

Head map, with a polygon and an autocollimator: at the angle θ the autocollimator reads the angle by
which the spindle leads θ, minus the deviation p of the face::

    reading + p = Δ(θ) + a,   Δ = Σ_h s_h sin hθ + c_h cos hθ + division

a is the zero of the autocollimator, which is constant in each series. With n positions and a known
polygon, each amplitude has u = σ √(2/n). If the polygon is unknown, it is turned by one face after
each of n series (closure). These determine both the head and the polygon, because the errors of
each sum to zero by definition. Harmonics n, 2n, … and the mean are the same at all positions, so a
closure cannot measure them. They remain in `division` and `base`.

Source: JCGM 100:2008, H.3 (least squares); Probert & Rittman 1992, 10.1088/0957-0233/3/1/008.

Tilts, with a level: lean and wobble of a table, and the right angle of two axes. A level turns with
a table. At the table's angle θ (counter-clockwise seen from above) it points to the azimuth A = A₀
− θ. It reads its zero, the lean of the axis and the wobble of the bearing::

    reading = z + λ_x cos A − λ_y sin A + Σ_{k ≥ 2} (a_k cos kθ + b_k sin kθ)

λ_x and λ_y are the rotations about east and north. The reading is positive if the end of the level
at A is high. A wobble once per turn looks like a lean. A level on the base reads only the wobble.

A level on a horizontal axis, which a vertical axis carries, reads in the direct (s = 1) and
reversed (s = −1) position::

    reading = z + s (σ + c cos θ + d sin θ)

where σ is the deviation from the right angle, and c and d are the lean. In only one position σ
cannot be distinguished from z.
"""

from dataclasses import replace
from math import pi

import numpy as np
from numpy.typing import NDArray

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.benches.qualification.linear_fit import (
    LinearFit,
    MeasuredParameters,
    from_fit,
    linear_fit,
)
from inercal.estimation.scores import SIGNIFICANCE_LEVEL

ARCSEC = pi / 648000
_FEWEST = 3  # fewest positions


def head_map(
    angle: Array,
    reading: Array,
    sd: float,
    harmonics: int,
    *,
    deviation: Array | None = None,
    certificate_sd: float = 0.0,
    division_sd: float = 0.0,
    face: NDArray[np.intp] | None = None,
    series: NDArray[np.intp] | None = None,
) -> MeasuredParameters:
    """Estimate the amplitudes "sin1", "cos1", … of Δ, rad.

    Parameters
    ----------
    angle : (m,) array
        Nominal angles, rad.
    reading : (m,) array
        Readings of the autocollimator in the sense of the angle, rad.
    sd : float
        Standard deviation of one reading, rad.
    harmonics : int
        Number of harmonics.
    deviation : (n,) array or None
        Certified deviations of the faces, rad; None for an unknown polygon.
    certificate_sd, division_sd : float
        Standard deviations of each certified deviation, and of the error of each graduation that
        the harmonics do not describe, rad.
    face, series : (m,) array of int, optional
        The face of each reading, counted from 0, and its series. By default each reading belongs to
        the face at its angle, and all readings to one series.

    Raises
    ------
    InputError
        The positions are not evenly spaced over the turn or cannot separate the harmonics, or the
        series cannot separate an unknown polygon from the head.
    """
    place, n = _positions(angle)
    if not 1 <= harmonics < n / 2:
        raise InputError(
            f"{n} positions do not determine harmonic {harmonics} of a head: "
            f"measure at more than {2 * harmonics} positions, or qualify fewer harmonics",
            key="[measurement] harmonics",
        )
    at = (
        np.zeros(len(angle), np.intp)
        if series is None
        else np.unique(series, return_inverse=True)[1]
    )
    if deviation is None:
        if face is None or series is None:
            raise InputError(
                "one series cannot separate the head from an unknown polygon: give the certificate "
                "of the polygon, or columns face and series of a closure",
                key="[measurement] polygon",
            )
        fit = _closure(place, n, reading, sd, face, at, harmonics, division_sd)
    else:
        own = place * len(deviation) // n if face is None else face
        if face is None and (place * len(deviation) % n).any():
            raise InputError(
                f"{n} positions do not all lie on a face of a polygon with {len(deviation)} faces; "
                "add the column face",
                key="[measurement] face",
            )
        if own.min() < 0 or own.max() >= len(deviation):
            raise InputError(
                f"the polygon has only {len(deviation)} faces, no face {int(own.max()) + 1}",
                key="[measurement] face",
            )
        noise = sd**2 * np.eye(len(angle))
        noise += certificate_sd**2 * (own[:, None] == own)
        noise += division_sd**2 * (place[:, None] == place)
        zeros = (at[:, None] == np.unique(at)).astype(float)
        columns, missing = _waves(2 * pi * place / n, harmonics, n)
        fit = linear_fit(np.hstack([columns, zeros]), reading + deviation[own], noise, missing)
    k = 2 * harmonics
    names = tuple(f"{wave}{h}" for h in range(1, harmonics + 1) for wave in ("sin", "cos"))
    unseen = (
        f"harmonics {n}, {2 * n}, … of the head, which are equal at all {n} positions; they remain "
        "in the error of each graduation",
        "the mean of the head's error, which remains in the zero of the head",
    )
    return from_fit(fit, names, "rad", fit.value[:k], fit.covariance[:k, :k], unseen)


def _positions(angle: Array) -> tuple[NDArray[np.intp], int]:
    """Return the number of each position, and the number of positions in a turn."""
    turned = np.mod(angle, 2 * pi)
    distinct = np.unique(np.round(turned / (1e-3 * pi / 180)).astype(int) % 360000)
    n = len(distinct)
    place = np.round(turned * n / (2 * pi)).astype(np.intp) % n
    off = np.abs(np.mod(turned - 2 * pi * place / n + pi, 2 * pi) - pi)
    if n < _FEWEST or off.max() > 1e-3 or len(np.unique(place)) < n:
        raise InputError(
            f"the {n} positions are not evenly spaced over a turn: measure at equal steps, at "
            "least three",
            key="[measurement] angle",
        )
    return place, n


def _waves(theta: Array, harmonics: int, n: int) -> tuple[Array, dict[str, Array]]:
    """Return the columns of the harmonics, and of further harmonics that may be missing."""

    def pair(h: int) -> Array:
        if 2 * h == n:
            return np.cos(h * theta)[:, None]
        return np.stack([np.sin(h * theta), np.cos(h * theta)], axis=-1)

    columns = np.hstack([pair(h) for h in range(1, harmonics + 1)])
    missing = {
        f"harmonic {h} ({{size:.2g}}″) is not in the model: qualify {h} harmonics": ARCSEC * pair(h)
        for h in range(harmonics + 1, n // 2 + 1)
    }
    return columns, missing


def _closure(
    place: NDArray[np.intp],
    n: int,
    reading: Array,
    sd: float,
    face: NDArray[np.intp],
    series: NDArray[np.intp],
    harmonics: int,
    division_sd: float,
) -> LinearFit:
    """Fit the harmonics to the errors of the head in a closure."""
    faces = int(face.max()) + 1
    head = _sum_free_basis(n)
    columns = np.hstack(
        [
            head[place],
            -_sum_free_basis(faces)[face],
            (series[:, None] == np.unique(series)).astype(float),
        ]
    )
    whole = linear_fit(
        columns,
        reading,
        np.full(len(reading), sd),
        unseen="the polygon cannot be separated from the head; turn the polygon by one face in "
        "each further series",
        level=SIGNIFICANCE_LEVEL / 2,
    )
    k = n - 1
    even = 2 * pi * np.arange(n) / n
    waves, missing = _waves(even, harmonics, n)
    noise = whole.covariance[:k, :k] + division_sd**2 * np.eye(k)
    beyond = {words: head.T @ one for words, one in missing.items()}
    fit = linear_fit(head.T @ waves, whole.value[:k], noise, beyond, level=SIGNIFICANCE_LEVEL / 2)
    both = replace(fit, chi2=fit.chi2 + whole.chi2, dof=fit.dof + whole.dof)
    suspects = (*whole.suspects, *fit.suspects)
    return replace(both, suspects=suspects)


def _sum_free_basis(n: int) -> Array:
    """Return orthonormal columns that span the vectors whose sum is zero, (n, n − 1)."""
    return np.linalg.qr(np.eye(n) - 1 / n)[0][:, : n - 1]


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
