"""Read the axes of a sensor from a run file, and build the sensors that they form.

Other orders and signs of columns serve to find columns that are exchanged or reversed.
"""

import re
from collections.abc import Sequence
from itertools import permutations, product
from json import dumps
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import error_location
from inercal.basics.units import format_count
from inercal.physics.quantities import QUANTITIES, Measures
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Axis, Direction, Noise, Readout, Sensor, axes_along

_UNIT = re.compile(r"\s*[(\[].*")
_THREE = ("x", "y", "z")


class StatedAxes(NamedTuple):
    """Axes of one kind as stated in [sensor] and [data].

    Parameters
    ----------
    measures : "f", "w" or "m"
    columns : tuple of str or int
        One column for each axis.
    directions : tuple of Direction
        Key `axis`; empty if it is not stated.
    readout, noise
        Readout and noise of each axis.
    """

    measures: Measures
    columns: tuple[str | int, ...]
    directions: tuple[Direction, ...]
    readout: Readout = Readout()
    noise: Noise = Noise()

    @property
    def section(self) -> str:
        """The section of the run file that states the axes."""
        return f"[sensor.{QUANTITIES[self.measures].sensor}]"

    def axes(self) -> tuple[Axis, ...]:
        """Return the axes, along x, y and z if three columns have no stated directions.

        Raises
        ------
        InputError
            The directions are not known, are not possible, or do not match the columns.
        """
        key, count = f"{self.section} axis", len(self.columns)
        given: Sequence[Direction] = self.directions or self._directions_of_columns()
        if len(given) != count:
            columns = (
                f"{format_count(count, 'column')} in [data] {QUANTITIES[self.measures].sensor}"
            )
            raise key_error(
                key,
                f"gives {format_count(len(given), 'direction')} for {columns}; give one direction "
                "for each column",
            )
        with error_location(key, key=key):
            return axes_along(
                given, self.measures, QUANTITIES[self.measures].letter, self.readout, self.noise
            )

    def _directions_of_columns(self) -> tuple[str, ...]:
        """Return x, y, z for three columns, and otherwise what the names of the columns say."""
        if letters := axis_letters(self.columns):
            return letters
        single = len(self.columns) == 1
        what = "its direction" if single else "their directions"
        like = '"z"' if single else '["x", "y", [0.6, 0, 0.8]]'
        named = ", ".join(map(repr, self.columns))
        raise key_error(
            f"{self.section} axis",
            f"is missing: {named} does not say it; state {what} in the case, such as axis = {like}",
            names=tuple(map(str, self.columns)),
        )


def axis_letters(columns: Sequence[str | int]) -> tuple[str, ...]:
    """Return the case axes of columns: x, y, z for three, otherwise those at the names' ends.

    The result is empty if a name does not end in x, y or z, or two end alike.

    >>> axis_letters(["gyro_z (deg/s)"]), axis_letters([4, 5, 6]), axis_letters(["left", "right"])
    (('z',), ('x', 'y', 'z'), ())
    """
    return _THREE if len(columns) == len(_THREE) else axis_ends(columns)


def axis_ends(columns: Sequence[str | int]) -> tuple[str, ...]:
    """Return the axes at the ends of the columns' names; empty if two are alike or one has none."""
    ends = tuple(_UNIT.sub("", str(one)).strip().lower()[-1:] for one in columns)
    return ends if set(ends) <= {*_THREE} and len(set(ends)) == len(ends) else ()


def any_axes(name: str, *stated: StatedAxes) -> Sensor:
    """Return the sensor with any number of axes, without coefficients.

    Raises
    ------
    InputError
        There are no axes, or their directions are unknown or not possible.
    """
    if not stated:
        raise key_error(
            "[sensor]", "has neither accelerometers nor gyros; state [sensor.gyro], or both"
        )
    return Sensor(name, tuple(axis for one in stated for axis in one.axes()))


def three_axes(name: str, *stated: StatedAxes) -> Sensor:
    """Return a triad of accelerometers, with or without other triads, without coefficients.

    Raises
    ------
    InputError
        There are no accelerometers, or a kind of axes is not a triad along x, y and z.
    """
    if "f" not in {one.measures for one in stated}:
        raise key_error("[data] accelerometer", "names no columns; name three, of x, y, z")
    for one in stated:
        if tuple(one.directions or _THREE) != _THREE:
            raise key_error(
                f"{one.section} axis",
                "this bench needs axes along x, y and z; remove the key, and name three columns",
            )
        if len(one.columns) != len(_THREE):
            raise key_error(
                f"[data] {QUANTITIES[one.measures].sensor}",
                f"{format_count(len(one.columns), 'column')}; this bench needs three, of x, y, z",
            )
    return any_axes(name, *stated)


class SignedPermutation(NamedTuple):
    """Another order of columns, each with a sign: new[i] = signs[i] · old[order[i]]."""

    order: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def is_identity(self) -> bool:
        """Whether order and signs are unchanged."""
        return self.order == tuple(range(len(self.order))) and min(self.signs) > 0

    def reorder(self, columns: Array) -> Array:
        """Return the columns (..., k) in this order with these signs."""
        return columns[..., list(self.order)] * np.array(self.signs, dtype=float)

    def signed_names(self, names: tuple[str, ...]) -> str:
        """Return the names of the columns in this order, with signs as in a run file."""
        each = (
            names[k] if sign > 0 else names[k][1:] if names[k].startswith("-") else f"-{names[k]}"
            for k, sign in zip(self.order, self.signs, strict=True)
        )
        return dumps(list(each), ensure_ascii=False)


def identity_permutation(k: int) -> SignedPermutation:
    """Return the permutation that leaves k columns unchanged."""
    return SignedPermutation(tuple(range(k)), (1,) * k)


def signed_permutations(k: int) -> tuple[SignedPermutation, ...]:
    """Return all orders and signs of k columns, starting with the identity."""
    return tuple(
        SignedPermutation(o, s) for o in permutations(range(k)) for s in product((1, -1), repeat=k)
    )
