"""Estimate the prior of a new sensor from calibrations of earlier sensors of its type.

Sensor i has the coefficients θ_i ~ N(μ, T), and its calibration gives c_i = θ_i + e_i with the
covariance of the file. Bench errors that several files share are correlated, so they are neither
scatter between sensors nor do they average out in the mean. Mean and standard deviation of a new
sensor are predicted for each coefficient (`estimation.uncertainty.new_member`). The correlations
come from the REML estimate of T, which is drawn towards uncorrelated coefficients, and from the
covariance of the mean.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.basics.units import format_count
from inercal.calibration import Calibration
from inercal.calibration.comparison import fixed_coefficients, recording_sha256
from inercal.calibration.type_prior import (
    CoefficientPrior,
    OutlyingSensor,
    SourceSensor,
    TypePrior,
    TypeReadout,
)
from inercal.estimation.uncertainty import new_member
from inercal.physics.sensors import SI_UNITS, Axis
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


LEAST_SENSORS = 3
FALSE_ALARMS = 0.01  # probability that any sensor is named although all are of one population


def type_prior(
    calibrations: Sequence[str | Path] | Mapping[str, Calibration],
    coefficients: Sequence[str] = (),
    *,
    without: Sequence[str] = (),
    each_axis: bool = False,
    type_name: str = "",
) -> TypePrior:
    """Return the prior of a new sensor from calibrations of other sensors of its type.

    Parameters
    ----------
    calibrations : sequence of paths, or mapping of str to Calibration
        Calibration files, or calibrations by the name of their source; one for each sensor.
    coefficients : sequence of str
        Names or groups, such as "kip", "ax.k2" or "cross". By default, all coefficients of
        `DEFAULT_GROUPS` that all calibrations have.
    without : sequence of str
        Names of sensors to leave out.
    each_axis : bool
        Whether each axis is a sensor of its own. Calibrations with one axis always are; otherwise
        the prior has one value for each axis.
    type_name : str
        Name of the type, for the file.

    Raises
    ------
    InputError
        There are fewer than three sensors, a sensor occurs twice, the sensors have different
        readouts or forms, or a coefficient is not available.
    """
    chosen = choose_calibrations(calibrations, without)
    members = find_members(chosen, each_axis)
    if len(members) < LEAST_SENSORS:
        raise InputError(
            f"{format_count(len(members), 'sensor')} cannot show how much sensors of a "
            f"type differ; give the calibrations of {LEAST_SENSORS} or more sensors",
            key="FILE",
        )
    names = common_names(members, tuple(coefficients))
    require_comparable(members, names)
    values = np.array([[m.calibration.values[m.places[name]] for name in names] for m in members])
    covariance = joint_covariance(members, names)
    n, p = values.shape
    found = [new_member.predict_new_member(values[:, k], covariance[:, k, :, k]) for k in range(p)]
    shared, own = _shared_and_own(covariance)
    measured = np.einsum("nkk->k", own) / n
    correlation, other_axis = _correlations(values, shared, own, found)
    axes = members[0].axes
    used = {CoefficientName(name).axis for name in names}
    return TypePrior(
        type_name=type_name,
        form=members[0].calibration.sensor.form,
        count=n,
        correlations=(
            "Few sensors cannot show correlations between coefficients, so the prior uses about "
            f"{100 * (n - 1) / (n + p):.0f} % of the observed correlations"
        )
        * (p > 1),
        coefficient=tuple(
            CoefficientPrior(
                name=name,
                unit=SI_UNITS[term_of(members[0], name).unit],
                **one._asdict(),
                measurement_share=float(measured[k] / (measured[k] + one.between_sensors**2)),
                correlation=tuple(correlation[k].tolist()),
                other_axis=tuple(other_axis[k].tolist()),
            )
            for k, (name, one) in enumerate(zip(names, found, strict=True))
        ),
        readout=tuple(
            TypeReadout(axis=name, measures=axes[name].measures, **asdict(axes[name].readout))
            for name in axes
            if name in used
        ),
        sensor=tuple(
            SourceSensor(
                name=one.sensor.name, source=source, recording_sha256=recording_sha256(one)
            )
            for source, one in chosen.items()
        ),
        outlying=_outlying_sensors(members, names, values, covariance),
        notes=tuple(
            f"{source} does not state which errors it shares with the other files, so all of its "
            "uncertainty is treated as shared"
            for source, one in chosen.items()
            if one.shared is None
        ),
    )


def _shared_and_own(covariance: Array) -> tuple[Array, Array]:
    """Return the covariance that all sensors share, (p, p), and the rest of each, (n, p, p)."""
    n = len(covariance)
    blocks = np.einsum("ikil->ikl", covariance)
    shared = (covariance.sum(axis=(0, 2)) - blocks.sum(axis=0)) / (n * (n - 1))
    shared = _nonnegative((shared + shared.T) / 2)
    return shared, np.array([_nonnegative(block - shared) for block in blocks])


def _correlations(
    values: Array, shared: Array, own: Array, found: Sequence[new_member.NewMember]
) -> tuple[Array, Array]:
    """Return the correlations of a new sensor, with the same axis and with another, (p, p)."""
    scatter = np.array([one.between_sensors for one in found])
    of_scatter, of_mean = new_member.scatter_correlation(values, own, scatter)
    of_mean = of_mean + shared
    size = np.sqrt(np.diag(of_mean))
    share = np.sqrt([one.mean_share for one in found])
    rest = np.sqrt(1 - share**2)
    other_axis = of_mean / np.outer(size, size) * np.outer(share, share)
    correlation = of_scatter * np.outer(rest, rest) + other_axis
    np.fill_diagonal(correlation, 1.0)
    return np.clip(correlation, -1, 1), np.clip(other_axis, -1, 1)


def _nonnegative(covariance: Array) -> Array:
    root = symmetric_root(covariance)
    return root @ root


def _outlying_sensors(
    members: Sequence[Member], names: Sequence[str], values: Array, covariance: Array
) -> tuple[OutlyingSensor, ...]:
    """Return the values that the other sensors predict with p < `FALSE_ALARMS` over all tests."""
    n, p = values.shape
    each = FALSE_ALARMS / (n * p)
    outlying: list[OutlyingSensor] = []
    for k, name in enumerate(names):
        chance = new_member.left_out_p_values(values[:, k], covariance[:, k, :, k])
        outlying += [
            OutlyingSensor(sensor=members[int(m)].label, coefficient=name, p=float(chance[m]))
            for m in np.flatnonzero(chance < each)
        ]
    return tuple(outlying)
