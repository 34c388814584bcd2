"""Store what the estimation of a magnetometer needs, as plain arrays.

A node is a rest, or a short piece of motion, with one mean reading of the magnetometer. All
vectors of a node are in the frame that the accelerometers define ("body"). Readings, offsets and
the strength of the field share one unit, usually T.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from inercal.basics.arrays import Array, Bools, Indices
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured

Hemisphere = Literal["north", "south"]
_RELATIVE = 1e-9  # tolerance for the scale direction


@dataclass(frozen=True, eq=False)
class LinearModel:
    """A reading that is linear in p coefficients: y = (A₀ + Σ c_j ΔT^q_j A_j) (h, 1).

    Parameters
    ----------
    names : tuple of p str
        Names of the coefficients.
    nominal : (3, 4) array
        A₀: the stated axes in the first three columns, and the offset without coefficients.
    directions : (p, 3, 4) array
        A_j. A coefficient either acts on the field or is an offset, which uses only the last
        column.
    powers : (p,) array of int, optional
        q_j, the power of the temperature deviation; 0 by default.

    Raises
    ------
    InputError
        A shape is wrong, a value is not finite, the stated axes lie in a plane, or a scale is not
        among the coefficients.
    """

    names: tuple[str, ...]
    nominal: Array
    directions: Array
    powers: Indices = field(default_factory=lambda: np.zeros(0, dtype=np.int64))

    def __post_init__(self) -> None:
        p = len(self.names)
        if not self.powers.size:
            object.__setattr__(self, "powers", np.zeros(p, dtype=np.int64))
        _require_shapes(self, nominal=(3, 4), directions=(p, 3, 4), powers=(p,))
        if abs(np.linalg.det(self.nominal[:, :3])) < _RELATIVE:
            raise InputError("the three stated axes of the magnetometer lie in a plane", key="axis")
        _ = self.scale_direction

    @property
    def axes(self) -> tuple[str, ...]:
        """The names of the axes, in the order of the readings."""
        return tuple(dict.fromkeys(CoefficientName(name).axis for name in self.names))

    @cached_property
    def acts_on_field(self) -> Bools:
        """Whether each coefficient changes the matrix of the field, (p,)."""
        return np.any(self.directions[:, :, :3] != 0, axis=(1, 2))

    @cached_property
    def scale_direction(self) -> Array:
        """Coefficients e with Σ e_j A_j = (the stated axes, 0), (p,).

        A common scale of all axes is the same as another strength of the field, and D can change
        its sign.
        """
        usable = self.acts_on_field & (self.powers == 0)
        axes = self.nominal[:, :3].ravel()
        columns = self.directions[usable, :, :3].reshape(-1, 9).T
        e = np.zeros(len(self.names))
        e[usable] = np.linalg.lstsq(columns, axes)[0]
        if np.linalg.norm(columns @ e[usable] - axes) > _RELATIVE * np.linalg.norm(axes):
            raise InputError("all scale coefficients of the magnetometer must be estimated")
        return np.where(np.abs(e) > _RELATIVE, e, 0.0)

    def matrices(self, coefficients: Array, temperature: Array) -> Array:
        """Return (D, o) of each node, (n, 3, 4), at temperature deviations (n,)."""
        weights = coefficients * temperature[:, None] ** self.powers
        return self.nominal + (weights @ self.directions.reshape(-1, 12)).reshape(-1, 3, 4)

    def derivatives(self, h: Array, temperature: Array) -> Array:
        """Return the derivatives of the readings, (n, 3, p), for the fields h (n, 3)."""
        by_field = (
            np.tensordot(h, self.directions[:, :, :3], axes=(1, 2)) + self.directions[:, :, 3]
        )
        return (by_field * (temperature[:, None] ** self.powers)[..., None]).mT


@dataclass(frozen=True, eq=False)
class FieldNodes:
    """The magnetometer's readings at n nodes, in the order of time.

    Parameters
    ----------
    labels : tuple of n str
    reading : (n, 3) array
    covariance : (n, 3, 3) array
        Covariance of each reading.
    time : (n,) array
        s.
    temperature : (n,) array
        Deviation from the reference temperature, K.
    """

    labels: tuple[str, ...]
    reading: Array
    covariance: Array
    time: Array
    temperature: Array

    def __post_init__(self) -> None:
        n = len(self.labels)
        _require_shapes(self, reading=(n, 3), covariance=(n, 3, 3), time=(n,), temperature=(n,))
        _require_positive("the covariance of the magnetometer's readings", self.covariance)


@dataclass(frozen=True, eq=False)
class Directions:
    """The upward direction (that of the specific force) at d of the nodes, from accelerometers.

    Only the components across the direction are used, since the accelerometers were fitted to the
    norm.

    Parameters
    ----------
    node : (d,) array of int
        Index of each node, ascending.
    up : (d, 3) array
        Unit vectors.
    covariance : (d, 3, 3) array
        Covariance of each vector without the uncertainty of the known coefficients.
    derivative : (d, 3, q) array
        Derivatives with respect to the known coefficients.
    """

    node: Indices
    up: Array
    covariance: Array
    derivative: Array


@dataclass(frozen=True, eq=False)
class Links:
    """The rotations between l pairs of neighbouring nodes, from gyros.

    Parameters
    ----------
    before : (l,) array of int
        Index j of the first node of each pair, ascending; the second is j + 1.
    rotation : (l, 3, 3) array
        Matrix from the body frame of node j + 1 to that of node j.
    covariance : (l, 3, 3) array
        Covariance of the rotation's error, in the body frame of node j + 1, rad², without the
        uncertainty of the known coefficients.
    derivative : (l, 3, q) array
        Derivatives of the rotation, in the same frame, with respect to the known coefficients.
    about_up : (l,) array of bool
        Whether only the turn about the vertical is used.
    """

    before: Indices
    rotation: Array
    covariance: Array
    derivative: Array
    about_up: Bools

    @classmethod
    def none(cls, q: int = 0) -> "Links":
        """Return no link, for q known coefficients."""
        empty, matrices = np.zeros(0, dtype=np.int64), np.zeros((0, 3, 3))
        return cls(empty, matrices, matrices, np.zeros((0, 3, q)), np.zeros(0, dtype=bool))


@dataclass(frozen=True)
class FieldConditions:
    """What is known about the field at the place of the recording.

    Parameters
    ----------
    strength : Measured, optional
        In the unit of the readings. If it is not stated, the common scale of the axes is set so
        that the mean of the scale coefficients is zero.
    dip : Measured, optional
        Angle of the field below the horizontal plane, rad; positive in the northern hemisphere.
    hemisphere : "north" or "south", optional
        Sign of the dip. If neither is stated, the magnetometer is assumed to be right-handed
        relative to its stated axes.

    Raises
    ------
    InputError
        A value is impossible, or the dip contradicts the hemisphere.
    """

    strength: Measured | None = None
    dip: Measured | None = None
    hemisphere: Hemisphere | None = None

    def __post_init__(self) -> None:
        if self.strength is not None and not (
            0 < self.strength.value < np.inf and 0 <= self.strength.sd < self.strength.value
        ):
            raise InputError(
                "the strength of the field must be positive and larger than its uncertainty",
                key="field",
            )
        if self.dip is None:
            return
        if not (abs(self.dip.value) <= np.pi / 2 and 0 < self.dip.sd < np.pi):
            raise InputError(
                "the dip must be between −90° and 90°, with a positive uncertainty", key="dip"
            )
        if self.sign and self.sign * self.dip.value < -3 * self.dip.sd:
            raise InputError(
                f"the dip of {np.degrees(self.dip.value):.3g}° contradicts the {self.hemisphere}ern"
                " hemisphere; a field that points down (northern hemisphere) has a positive dip",
                key="dip",
            )

    @property
    def sign(self) -> int:
        """Sign of the dip: 1 in the north, −1 in the south, 0 if it is unknown."""
        if self.hemisphere is not None:
            return 1 if self.hemisphere == "north" else -1
        if self.dip is None or abs(self.dip.value) < 3 * self.dip.sd:
            return 0
        return 1 if self.dip.value > 0 else -1


def check_records(nodes: FieldNodes, directions: Directions, links: Links, known: Array) -> None:
    """Raise an `InputError` if the records do not fit together.

    Parameters
    ----------
    nodes, directions, links
    known : (q, q) array
        Covariance of the known coefficients.
    """
    n, d, count, q = len(nodes.labels), len(directions.node), len(links.before), len(known)
    if known.shape != (q, q) or not np.all(np.isfinite(known)):
        raise InputError("the covariance of the known coefficients must be square and finite")
    _require_shapes(directions, up=(d, 3), covariance=(d, 3, 3), derivative=(d, 3, q))
    _require_shapes(
        links,
        rotation=(count, 3, 3),
        covariance=(count, 3, 3),
        derivative=(count, 3, q),
        about_up=(count,),
    )
    for what, index, most in (
        ("an upward direction", directions.node, n - 1),
        ("a rotation", links.before, n - 2),
    ):
        wrong = index.size and (np.any(np.diff(index) < 1) or index[0] < 0 or index[-1] > most)
        if wrong:
            raise InputError(f"the nodes of {what} must ascend from 0 to at most {most}")
    _require_positive("the covariance of the upward directions", directions.covariance)
    _require_positive("the covariance of the rotations", links.covariance)
    if np.any(np.abs(np.linalg.norm(directions.up, axis=1) - 1) > 1e-6):
        raise InputError("the upward directions must be unit vectors")
    turns = links.before[links.about_up]
    if not np.all(np.isin(turns, directions.node) & np.isin(turns + 1, directions.node)):
        raise InputError("a turn about the vertical needs an upward direction at both of its nodes")


def _require_shapes(record: object, **shapes: tuple[int, ...]) -> None:
    for name, shape in shapes.items():
        values = getattr(record, name)
        what = f"{type(record).__name__}.{name}"
        if values.shape != shape:
            raise InputError(f"{what} has shape {values.shape}; expected {shape}")
        if not np.all(np.isfinite(values)):
            raise InputError(f"{what} contains a value that is not finite")


def _require_positive(what: str, covariance: Array) -> None:
    if covariance.size and np.min(np.linalg.eigvalsh(covariance)) <= 0:
        raise InputError(f"{what} must be positive definite")
