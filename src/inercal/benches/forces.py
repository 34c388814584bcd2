"""What a bench makes accelerometers feel, position by position, with its derivatives."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Felt:
    """Specific force in each row, (..., r, 3) m/s², with derivatives.

    Parameters
    ----------
    f : (..., r, 3) array
        In the sensor's frame.
    by : mapping of str to (..., r, 3) array
        ∂f by each of the bench's parameters that act, by full name.
    """

    f: Array
    by: Mapping[str, Array] = field(default_factory=dict[str, Array])
