"""What a bench makes accelerometers feel, position by position, with its derivatives."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.plan import Spin

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


def directions(steps: Sequence[Spin]) -> tuple[Array, Array]:
    """Return `out` and `up` of each step in the body, (r, 3) each.

    Raises
    ------
    InputError
        A step of unknown attitude.
    """
    known = [step.attitude for step in steps if step.attitude is not None]
    if len(known) < len(steps):
        lacking = next(step.label for step in steps if step.attitude is None)
        raise InputError(f"{lacking}: its attitude on the arm is not known")
    return np.array([a.out for a in known]), np.array([a.up for a in known])
