"""Convert the declared terms of three accelerometers to arrays for compiled kernels.

The kernels use this table, so the model is declared only once, in
`inercal.physics.sensors.coefficient_tables`.
"""

from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.keys import CoefficientName
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_tables import Product

# Powers of the components in a product, then of sign and temperature.
_POWERS = ("fi", "fp", "fo", "si", "dT")
# Kinds of products: 1, a, a², a³, |a| and a|a| with the component a along the axis; the component
# along P, or O; any other product.
_ALONG = ((0, 0), (1, 0), (2, 0), (3, 0), (1, 1), (2, 1))
ALONG = len(_ALONG)
ACROSS = ALONG, ALONG + 1
OTHER = ALONG + 2


class TermTable(NamedTuple):
    """Products of an accelerometer triad, one per entry, and the axes they act along."""

    frames: Array  # (3, 3, 3), rows I, P, O of each axis
    tilts: Indices  # (3, 2), indices of delta_o and delta_p that rotate each axis; −1 for none
    coefficient: Indices  # (t,), index of the coefficient of each product
    axis: Indices  # (t,)
    factor: Array  # (t,)
    place: Indices  # (t,), kind of the product: below `ALONG`, one of `ACROSS`, or `OTHER`
    powers: Indices  # (t, 5), powers of fi, fp, fo, the sign of fi, and ΔT


def term_table(sensor: Sensor) -> TermTable | None:
    """Return the table for a sensor, or None if its model has terms that the table cannot contain.

    There is no table for sensors other than three accelerometers, for terms with the rate and its
    derivative, or for the bias asymmetry, which has no inverse at zero.
    """
    if len(sensor.axes) != 3 or any(axis.measures != "f" for axis in sensor.axes):
        return None
    tilts = np.full((3, 2), -1)
    lines: list[tuple[int, int, Product]] = []
    for k, full in enumerate(sensor.coefficients):
        name, short = CoefficientName(full).parts
        axis = sensor.channels.index(name)
        if sensor.form == "tilted" and short in ("delta_o", "delta_p"):
            tilts[axis, ("delta_o", "delta_p").index(short)] = k
        else:
            lines += [(k, axis, one) for one in sensor.coefficient(full).basis.products]
    if any(not set(one.components) <= {*_POWERS} or one.components == ("si",) for *_, one in lines):
        return None
    powers = np.array(
        [[one.components.count(name) for name in _POWERS] for *_, one in lines], dtype=np.int64
    ).reshape(-1, len(_POWERS))
    return TermTable(
        np.stack([axis.frame for axis in sensor.axes]),
        tilts,
        np.array([k for k, *_ in lines], dtype=np.int64),
        np.array([axis for _, axis, _ in lines], dtype=np.int64),
        np.array([one.factor for *_, one in lines]),
        np.array([_place(*one) for one in powers.tolist()], dtype=np.int64),
        powers,
    )


def _place(i: int, p: int, o: int, sign: int, warm: int) -> int:
    if p == o == warm == 0 and (i, sign) in _ALONG:
        return _ALONG.index((i, sign))
    if i == sign == warm == 0 and p + o == 1:
        return ACROSS[o]
    return OTHER
