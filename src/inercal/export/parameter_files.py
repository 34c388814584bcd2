"""Read the parameters of a flight controller in all formats that ground stations write.

A line contains the name of a parameter and then its value, separated by commas, equals signs or
white space. Mission Planner writes `NAME,VALUE`, and MAVProxy writes `NAME VALUE`. QGroundControl
also writes the vehicle and the component before the name, and the type after the value. The shell
of PX4 (`param show`) writes a mark, the name, the number of the parameter, a colon and the value.
Lines without a name, such as titles and sums, are ignored. Comments begin with # or //.
"""

import re
from collections.abc import Mapping
from math import isfinite

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.export.reader_definition import REFERENCE, StatedCalibration, StatedTriad
from inercal.physics.quantities import Measures

_COMMENT = re.compile(r"#|//")
_BETWEEN = re.compile(r"[\s,;=:]+")
_NUMBERS = re.compile(r"\[[\d,\s]*\]")  # of `param show`: [used,all]
_MARK = re.compile(r"\d+\s+\d+\s+|(?:[x*+]\s+)+")  # vehicle and component, or used and saved
_NAME = re.compile(r"[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)+")
_SHORTENED = 40
_LISTED = 6


class StatedParameters(dict[str, float]):
    """The parameters in a file by name; `assumed` contains the defaults used for others."""

    def __init__(self) -> None:
        super().__init__()
        self.assumed: dict[str, float] = {}

    def value(self, name: str, default: float) -> float:
        """Return a parameter, or else its default value in the flight controller."""
        if name not in self:
            self.assumed[name] = default
        return self.get(name, default)

    def axes(self, pattern: str, default: float) -> Array:
        """Return the parameters of X, Y and Z, (3,), such as those of "CAL_ACC0_{}OFF"."""
        return np.array([self.value(pattern.format(a), default) for a in "XYZ"])

    def states(self, pattern: str) -> bool:
        """Return whether the file states one of the parameters of X, Y and Z."""
        return any(pattern.format(a) in self for a in "XYZ")


def assumed_note(program: str, assumed: Mapping[str, float]) -> tuple[str, ...]:
    """Return a note that names the values that a file does not state, or none."""
    some = [f"{name} = {value:g}" for name, value in assumed.items()]
    shown = ", ".join(some[:_LISTED]) + f" and {len(some) - _LISTED} more" * (len(some) > _LISTED)
    return (f"not in the file, so the default of {program} is assumed: {shown}",) * bool(some)


def stated_parameters(text: str, autopilot: str) -> StatedParameters:
    r"""Return the parameters in a text by name; if a name is repeated, its last value applies.

    >>> stated_parameters("1\t1\tCAL_ACC0_ID\t12\t6", "PX4")
    {'CAL_ACC0_ID': 12.0}
    >>> stated_parameters("x   CAL_ACC0_XOFF [74,197] : -0.04", "PX4")
    {'CAL_ACC0_XOFF': -0.04}
    >>> stated_parameters("INS_ACCOFFS_X,0.1", "ArduPilot")
    {'INS_ACCOFFS_X': 0.1}

    Raises
    ------
    InputError
        A name has no number, or no line has a name.
    """
    known = StatedParameters()
    for place, raw in enumerate(text.splitlines(), start=1):
        line = _NUMBERS.sub(" ", _COMMENT.split(raw.replace('"', " "), maxsplit=1)[0]).strip()
        line = re.sub(r"[\t,;]", " ", line)
        if (mark := _MARK.match(line)) is not None:
            line = line[mark.end() :]
        name, *values = _BETWEEN.split(line)
        if not _NAME.fullmatch(name):
            continue
        try:
            known[name] = float(values[0])
            if not isfinite(known[name]):
                raise ValueError
        except (IndexError, ValueError):
            raise InputError(
                f"line {place} names parameter {name[:_SHORTENED]}, but no number follows it; give "
                f"parameters of {autopilot}",
                line=place,
                names=(name,),
            ) from None
    if not known:
        raise InputError(
            f"no line contains the name of a parameter and its value; give parameters of "
            f"{autopilot}, as a ground station saves them"
        )
    return known


def parameter_calibration(
    program: str,
    triads: Mapping[Measures, StatedTriad],
    references: set[float],
    parameter: str,
    known: StatedParameters,
) -> StatedCalibration:
    """Return the calibration stated by the parameters of a flight controller.

    Parameters
    ----------
    program : str
        Name of the program, used in the note.
    triads : mapping of "f", "w" or "m" to StatedTriad
    references : set of float
        Reference temperatures that the triads state, K.
    parameter : str
        Name of the parameter that contains the reference temperature.
    known : StatedParameters
        The parameters, after their values were used.

    Raises
    ------
    InputError
        The reference temperatures differ.
    """
    if len(references) > 1:
        raise InputError(
            f"{parameter} of accelerometers and gyros differ, but a sensor of inercal has only "
            "one reference temperature; import a file with only one of the two kinds"
        )
    return StatedCalibration(
        triads,
        reference_temperature=next(iter(references), REFERENCE),
        notes=(
            *(f"{program} states no misalignment and no scale factor of gyros",)
            * bool({*triads} - {"m"}),
            *(f"{program} states no rotation between magnetometers and body",) * ("m" in triads),
            *assumed_note(program, known.assumed),
        ),
    )
