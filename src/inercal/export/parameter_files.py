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

from inercal.basics.errors import InputError
from inercal.export.reader_definition import REFERENCE, StatedCalibration, StatedTriad

_COMMENT = re.compile(r"#|//")
_BETWEEN = re.compile(r"[\s,;=:]+")
_NUMBERS = re.compile(r"\[[\d,\s]*\]")  # of `param show`: [used,all]
_MARK = re.compile(r"\d+\s+\d+\s+|(?:[x*+]\s+)+")  # vehicle and component, or used and saved
_NAME = re.compile(r"[A-Z][A-Z0-9]*(?:_[A-Z0-9]+)+")
_SHORTENED = 40


def stated_parameters(text: str, autopilot: str) -> dict[str, float]:
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
    known: dict[str, float] = {}
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
    program: str, triads: Mapping[str, StatedTriad], references: set[float], parameter: str
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
        triads.get("f"),
        triads.get("w"),
        reference_temperature=next(iter(references), REFERENCE),
        notes=(
            *(f"{program} states no misalignment and no scale factor of gyros",)
            * bool({*triads} - {"m"}),
            *(f"{program} states no rotation between magnetometers and body",) * ("m" in triads),
        ),
        magnetometer=triads.get("m"),
    )
