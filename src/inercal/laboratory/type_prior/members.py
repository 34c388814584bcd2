"""The sensors of a type: their comparable coefficients, and the covariance of all values."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.calibration import Calibration
from inercal.calibration.comparison import fixed_coefficients
from inercal.physics.sensors import Axis
from inercal.physics.sensors.coefficient_selection import select_coefficients
from inercal.physics.sensors.coefficient_tables import ErrorTerm
from inercal.runfile.priors import describe_readout, has_same_readout

DEFAULT_GROUPS = ("nonlinearity", "asymmetry", "cross", "rotation", "g", "g2")
"""Groups of the coefficients that are properties of a type, and do not depend on the mounting."""
_OF_FIXTURE = ("misalignment", "arm")  # groups of coefficients that are refused


@dataclass(frozen=True, eq=False)
class Member:
    """A sensor, or one of its axes.

    Parameters
    ----------
    label : str
        Name of the sensor, for messages, with the axis if the sensor has several.
    number : int
        Number of the calibration; axes of one calibration have the same number.
    calibration : Calibration
    axes : mapping of str to Axis
        Axes by name; a single axis has the name "".
    places : mapping of str to int
        Index of each coefficient in the calibration, such as "ax.k2", or "k2" of a single axis.
    """

    label: str
    number: int
    calibration: Calibration
    axes: Mapping[str, Axis]
    places: Mapping[str, int]


def choose_calibrations(
    calibrations: Sequence[str | Path] | Mapping[str, Calibration], without: Sequence[str]
) -> dict[str, Calibration]:
    """Return the calibrations by source, without the sensors that are left out.

    Raises
    ------
    InputError
        A sensor to leave out does not exist, or there are two calibrations of a sensor.
    """
    from inercal.calibration.files import load

    is_loaded = isinstance(calibrations, Mapping)
    files = () if is_loaded else [(str(path), load(Path(path))) for path in calibrations]
    every = list(calibrations.items()) if is_loaded else files
    names = [one.sensor.name for _, one in every]
    if unknown := [name for name in without if name not in names]:
        raise InputError(
            f"--without {unknown[0]}: there is no such sensor; the sensors are {', '.join(names)}",
            key="--without",
            names=tuple(unknown),
        )
    first: dict[str, str] = {}
    for source, one in every:
        if (name := one.sensor.name) in first:
            raise InputError(
                f"{first[name]} and {source} are both of sensor {name!r}; give one calibration of "
                "each sensor",
                names=(name,),
            )
        first[name] = source
    return {source: one for source, one in every if one.sensor.name not in without}


def find_members(chosen: Mapping[str, Calibration], each_axis: bool) -> list[Member]:
    """Return the sensors, or their axes if each axis is a sensor of its own.

    Raises
    ------
    InputError
        The axes measure different quantities.
    """
    apart = each_axis or all(len(one.sensor.axes) == 1 for one in chosen.values())
    members: list[Member] = []
    for number, one in enumerate(chosen.values()):
        fixed = fixed_coefficients(one)
        places = {
            CoefficientName(name): k
            for k, name in enumerate(one.sensor.coefficients)
            if name not in fixed
        }
        if not apart:
            axes = {axis.name: axis for axis in one.sensor.axes}
            members.append(Member(one.sensor.name, number, one, axes, {**places}))
            continue
        for axis in one.sensor.axes:
            of_axis = {name.term: k for name, k in places.items() if name.axis == axis.name}
            label = one.sensor.name + (f" {axis.name}" if len(one.sensor.axes) > 1 else "")
            members.append(Member(label, number, one, {"": axis}, of_axis))
    if apart and len({axis.measures for one in members for axis in one.axes.values()}) > 1:
        raise InputError(
            "the files have accelerometers and gyros, which are not sensors of one type; "
            + ("leave out --each-axis" if each_axis else "give files of one of them"),
            key="--each-axis" if each_axis else "FILE",
        )
    return members


def term_of(member: Member, name: str) -> ErrorTerm:
    """Return the line of the coefficient table."""
    sensor = member.calibration.sensor
    return sensor.coefficient(sensor.coefficients[member.places[name]])


def common_names(members: Sequence[Member], words: tuple[str, ...]) -> tuple[str, ...]:
    """Return the chosen coefficients that all members have.

    Raises
    ------
    InputError
        A coefficient is missing, or depends on the fixture.
    """
    first = members[0]
    common = [name for name in first.places if all(name in one.places for one in members)]
    if not words:
        if not (names := [x for x in common if term_of(first, x).group in DEFAULT_GROUPS]):
            raise InputError(
                "the files have no nonlinear or cross-coupling coefficient in common; all that "
                f"they have in common, for --coefficients: {', '.join(common) or 'nothing'}",
                key="--coefficients",
            )
        return tuple(names)
    picked: dict[str, None] = {}
    for word in words:
        full = select_coefficients(list(first.axes.values()), [word])
        names = [CoefficientName(one).term if "" in first.axes else one for one in full]
        if not (found := [name for name in names if name in common]):
            raise InputError(
                f"--coefficients {word}: not all files have it; they have {', '.join(common)}",
                key="--coefficients",
                names=(word,),
            )
        picked |= dict.fromkeys(found)
    if refused := [name for name in picked if term_of(first, name).group in _OF_FIXTURE]:
        raise InputError(
            f"--coefficients {refused[0]} depends on the fixture, not only on the sensor; remove "
            "it",
            key="--coefficients",
            names=tuple(refused),
        )
    return tuple(name for name in common if name in picked)


def require_comparable(members: Sequence[Member], names: Sequence[str]) -> None:
    """Raise an error if coefficients refer to different readouts or forms.

    Raises
    ------
    InputError
    """
    first = members[0]
    form = first.calibration.sensor.form
    has_scale = any(CoefficientName(name).term == "k1" for name in names)
    for one in members[1:]:
        for name in dict.fromkeys(CoefficientName(each).axis for each in names):
            axis, other = first.axes[name], one.axes[name]
            if not has_same_readout(axis, other) or axis.measures != other.measures:
                raise InputError(
                    f"{one.label}: nominal scale and offset of {other.name} are "
                    f"{describe_readout(other)}, but {describe_readout(axis)} for {first.label}; "
                    "the coefficients refer to them: calibrate all with the same [sensor]",
                    names=(one.label,),
                )
        if has_scale and one.calibration.sensor.form != form:
            raise InputError(
                f"{one.label}: k1 is in the {one.calibration.sensor.form} form, but in the {form} "
                f"form for {first.label}; calibrate all in the same form",
                names=(one.label,),
            )


def joint_covariance(members: Sequence[Member], names: Sequence[str]) -> Array:
    """Return the covariance of all values, (n, p, n, p), with the errors that files share."""
    n, p = len(members), len(names)
    picks = [np.array([one.places[name] for name in names]) for one in members]
    columns: dict[tuple[str, str], Array] = {}
    for m, (one, places) in enumerate(zip(members, picks, strict=True)):
        for error in one.calibration.shared or ():
            column = columns.setdefault((error.name, error.determination), np.zeros((n, p)))
            column[m] = error.covariance[places] / error.std
        if one.calibration.shared is None:
            root = symmetric_root(one.calibration.covariance[np.ix_(places, places)])
            for k in range(p):
                columns.setdefault(("", str(k)), np.zeros((n, p)))[m] = root[:, k]
    joint = np.zeros((n, p, n, p))
    for column in columns.values():
        joint += np.multiply.outer(column, column)
    for m, one in enumerate(members):
        for j, other in enumerate(members):
            if one.number == other.number:
                joint[m, :, j] = one.calibration.covariance[np.ix_(picks[m], picks[j])]
    return joint


def symmetric_root(covariance: Array) -> Array:
    """Return the symmetric root of a covariance; negative eigenvalues count as 0."""
    values, vectors = np.linalg.eigh(covariance)
    return (vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T
