"""List the imperfections of a calibration: errors of the bench, noise, and priors.

Each imperfection consists of independent random numbers (draws). If a bench declares the same
imperfection for every position, turn, dwell or axis, the budget has one line for it, in which the
draws are combined in quadrature.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi, radians

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.parameters import Parameter
from inercal.basics.units import format_number, format_quantity
from inercal.estimation import Gaussian
from inercal.physics.sensors import G0, Sensor

NOISE = "noise"
_COPY_SUFFIX = re.compile(r"(_[abxyz]|_?\d)?(\[.*\])?$")  # axis and step at the end of a name
# The part of a meaning that says which parameter of several it is.
_AXIS_SUFFIX = re.compile(r" about [xyz]$|, (toward the centre|along)$")
_PARAMETER_TITLES = {  # titles of parameters whose names are not words
    "g": "gravity",
    "mount": "mounting",
    "index": "indexing",
    "dwell_rate": "rate of dwells",
    "dwell_tilt": "tilt of dwells",
    "earth_up": "earth rate, vertical",
    "earth": "earth rate, level",
    "earth_visit": "earth rate, level, at a visit",
    "angle": "turn angle",
    "axis": "turn axis",
    "timebase": "clock",
    "sin": "head, sines",
    "cos": "head, cosines",
    "base": "zero of the head",
    "division": "graduations",
    "trim": "autocollimator, pairs",
    "face": "autocollimator, faces",
    "polygon": "polygon's faces",
    "pier": "tilt of the base",
    "creep": "creep of the base",
}
_PRINTED_UNITS = {  # unit in SI: printed unit, SI size
    "m": ("µm", 1e-6),
    "m/s²": ("µg", 1e-6 * G0),
    "(m/s²)⁻¹": ("ppm/g", 1e-6 / G0),
    "1": ("ppm", 1e-6),
    "rad/s": ("°/h", pi / 648_000),
}


@dataclass(frozen=True)
class Imperfection:
    """One line of a budget.

    Parameters
    ----------
    name : str
        Name of the imperfection in one or two words.
    meaning : str
        Description for a report, in one line.
    stated : str
        Printed standard deviation.
    draws : tuple of str
        Names of the independent draws: full names of bench parameters, readings ("x[p01_r1]"), or
        coefficients.
    """

    name: str
    meaning: str
    stated: str
    draws: tuple[str, ...]


def bench_imperfections(declared: Mapping[str, Parameter]) -> list[Imperfection]:
    """Return the imperfections of a bench, without parameters that are stated as exact.

    Parameters
    ----------
    declared : mapping of str to Parameter
        Bench parameters by full name, such as "index_x[p07]".
    """
    groups: dict[str, list[str]] = {}
    for name, parameter in declared.items():
        if parameter.sd > 0:
            groups.setdefault(_COPY_SUFFIX.sub("", name), []).append(name)
    found: list[Imperfection] = []
    for key, names in groups.items():
        first = declared[names[0]]
        deviations = [declared[name].sd for name in names]
        meaning = _AXIS_SUFFIX.sub("", first.meaning)
        word, stated = _PARAMETER_TITLES.get(key, key), format_deviations(deviations, first.unit)
        found.append(Imperfection(word, meaning, stated, tuple(names)))
    return found


def noise_imperfection(sensor: Sensor, labels: Sequence[str], noise: Array) -> Imperfection:
    """Return the noise of the readings as an imperfection.

    Parameters
    ----------
    sensor : Sensor
    labels : sequence of r str
        Labels of the rows.
    noise : (r, m, m) array
        Covariance of the readings of each row, SI.
    """
    sd = np.sqrt(np.diagonal(noise, axis1=-2, axis2=-1))
    texts: list[str] = []
    for kind, unit in (("f", "m/s²"), ("w", "rad/s")):
        members = [k for k, axis in enumerate(sensor.axes) if axis.measures == kind]
        if members:
            texts.append(format_deviations(sd[:, members].ravel().tolist(), unit))
    draws = tuple(f"{channel}[{label}]" for label in labels for channel in sensor.channels)
    return Imperfection(NOISE, "noise of each mean reading", ", ".join(texts), draws)


def prior_imperfection(sensor: Sensor, prior: Gaussian) -> Imperfection:
    """Return the uncertainty of a prior on coefficients as an imperfection."""
    names = ", ".join(prior.names)
    sd = np.sqrt(np.diagonal(prior.covariance)).tolist()
    lines = [sensor.coefficient(name) for name in prior.names]
    texts = [format_quantity(x, 0.0, line.unit, 3) for x, line in zip(sd, lines, strict=True)]
    return Imperfection(f"prior of {names}", "known from elsewhere", ", ".join(texts), prior.names)


def format_deviations(deviations: Sequence[float], unit: str) -> str:
    """Return a standard deviation, or a range of them, as text in a convenient unit.

    Examples
    --------
    >>> format_deviations([1e-5, 1e-5], "m"), format_deviations([1e-4, 3e-4], "1")
    ('10 µm', '100 – 300 ppm')
    """
    low, high = min(deviations), max(deviations)
    name, si = _angle_unit(high) if unit == "rad" else _PRINTED_UNITS[unit]
    ends = [format_number(x / si, 3) for x in (low, high)]
    return f"{' – '.join(dict.fromkeys(ends))} {name}"


def _angle_unit(size: float) -> tuple[str, float]:
    return ("°", radians(1)) if abs(size) >= radians(0.09) else ("″", radians(1) / 3600)
