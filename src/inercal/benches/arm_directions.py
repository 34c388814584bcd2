"""Directions of the arm of a centrifuge or rate table, in the sensor's body frame."""

from collections.abc import Sequence

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.physics.plan import Spin


def outward_and_up_directions(steps: Sequence[Spin]) -> tuple[Array, Array]:
    """Return the directions `out` and `up` of each step in the body frame, (r, 3) each.

    Raises
    ------
    InputError
        The attitude of a step is not known.
    """
    known = [step.attitude for step in steps if step.attitude is not None]
    if len(known) < len(steps):
        lacking = next(step.label for step in steps if step.attitude is None)
        raise InputError(
            f"step {lacking}: its attitude is not stated; add it to the plan or the table of means",
            key="attitude",
            names=(lacking,),
        )
    return np.array([a.out for a in known]), np.array([a.up for a in known])
