"""Find the directions of an arm of a centrifuge or rate table, and check its units.

The specific force on an arm has the norm √(g² + (r ω²)²). A rate that is stated in another unit
multiplies ω at all rows by the same factor, and a radius in mm that is stated as m multiplies ω² by
1000. The wrong unit is therefore the one whose factor makes all norms agree.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import format_quantity, si_factor
from inercal.physics.plan import Spin
from inercal.physics.section_settings import key_error
from inercal.recordings.data import RunBase
from inercal.recordings.data.recording_loader import readback_units
from inercal.recordings.segments.dwells import ARM_RATE


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


RATES = ("rad/s", "rpm", "rev/s", "°/s")
LENGTHS = {0.001: "mm", 0.01: "cm", 100.0: "cm", 1000.0: "mm"}


class ArmUnit(NamedTuple):
    """A unit that the rate or the radius of an arm seems to have.

    Parameters
    ----------
    times : float
        Factor of the rate that has the same effect on the centripetal acceleration.
    key : str
        Key of the run file.
    text : str
        What this unit means for the run file.
    name : str
        The unit.
    """

    times: float
    key: str
    text: str
    name: str

    def error(self, run: RunBase[Any]) -> InputError:
        """Return the error that names the unit."""
        text = f"according to the norms of the readings, {self.text}"
        return key_error(self.key, text, run.path, (self.name,))


def other_arm_units(run: RunBase[Any], radius: float) -> tuple[ArmUnit, ...]:
    """Return the units that may be confused with the stated ones; the radius is in m."""
    given, declared = readback_units(run)[ARM_RATE], run.data.arm_rate_unit
    found = [
        ArmUnit(
            si_factor(unit, "rad/s") / given,
            "[data] arm_rate_unit",
            f'the rates are in {unit}, not in {declared}; state arm_rate_unit = "{unit}"',
            unit,
        )
        for unit in RATES
    ]
    for factor, unit in LENGTHS.items():
        true = format_quantity(radius * factor, 0.0, "m", 3)
        text = f"the radius is about {true}, not {radius:.4g} m; check whether it is in m or {unit}"
        found.append(ArmUnit(factor**0.5, "[bench] radius", text, unit))
    return tuple(one for one in found if not 0.99 < one.times < 1.01)


def fitting_arm_unit(
    run: RunBase[Any], radius: float, off: Callable[[float], float]
) -> tuple[ArmUnit, float]:
    """Return the unit whose factor makes the norms agree best, and by how much they then differ.

    Parameters
    ----------
    run : Run
    radius : float
        Stated radius, m.
    off : callable
        Gives the relative error of the norms if the rates are multiplied by a factor.
    """
    return min(((one, off(one.times)) for one in other_arm_units(run, radius)), key=lambda x: x[1])
