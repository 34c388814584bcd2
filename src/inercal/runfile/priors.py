"""Read the priors of a run: stated values, calibration files, or earlier sensors of the type."""

from collections.abc import Mapping
from dataclasses import replace
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from inercal.basics.keys import CoefficientName
from inercal.basics.units import si_factor
from inercal.estimation import Gaussian
from inercal.physics.quantities import QUANTITIES
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Axis, Readout, Sensor
from inercal.runfile.schema import MethodSection
from inercal.runfile.sensor_builder import coefficient_value

if TYPE_CHECKING:
    from inercal.calibration import Calibration


def method_priors(section: MethodSection, folder: Path, sensor: Sensor) -> tuple[Gaussian, ...]:
    """Return the priors stated in [method]: prior, prior_file, prior_from and prior_type.

    Parameters
    ----------
    section : MethodSection
    folder : Path
        Folder of the run file.
    sensor : Sensor
        The sensor with the coefficients of the method.

    Raises
    ------
    InputError
        A prior has no uncertainty, a calibration file cannot be used, or a coefficient has several
        sources. Several sources are not allowed because they may come from the same measurement.
    """
    priors: list[Gaussian] = []
    for name, text in section.prior.items():
        value = coefficient_value(sensor, name, text, "[method.prior]")
        if value.sd == 0:
            key = f"[method.prior] {name}"
            raise key_error(
                key,
                f"{text!r} has no uncertainty; add ± and the standard uncertainty",
                names=(name,),
            )
        priors.append(Gaussian((name,), np.array([value.value]), np.array([[value.sd**2]])))
    if section.prior_file is not None:
        priors.append(_static_prior(folder / section.prior_file, sensor))
    for file, names in section.prior_from.items():
        priors.append(_prior_from(f'[method.prior_from."{file}"]', folder / file, names, sensor))
    if section.prior_type is not None:
        priors.append(type_prior_of(folder / section.prior_type, sensor))
    found = [name for prior in priors for name in prior.names]
    if twice := tuple(name for name in dict.fromkeys(found) if found.count(name) > 1):
        raise key_error(
            "[method]",
            f"prior, prior_file, prior_from and prior_type give {', '.join(twice)} more than once; "
            "keep one source for each coefficient",
            names=twice,
        )
    return tuple(priors)


def _static_prior(path: Path, sensor: Sensor) -> Gaussian:
    """Return bias and scale factor from a static calibration as a prior.

    IEEE Std 836 recommends determining bias and scale factor in a static multi-position test.
    """
    from inercal.calibration.files import load
    from inercal.methods.centrifuge_norm import METHOD as CENTRIFUGE

    key = "[method] prior_file"
    known = load(path)
    if known.method == CENTRIFUGE.name:
        raise key_error(
            key, f"{path.name} is a calibration on a centrifuge; give a static calibration"
        )
    if known.sensor.name != sensor.name:
        raise key_error(
            key,
            f"{path.name} is of sensor {known.sensor.name!r}, but [sensor] name is "
            f"{sensor.name!r}; give a calibration of this sensor",
        )
    # If there are misalignments, k1 does not mean the same in the two forms.
    known = known.in_form(sensor.form)
    names = tuple(
        name
        for name in sensor.coefficients
        if CoefficientName(name).term in ("k0", "k1") and name in known.sensor.coefficients
    )
    if not names:
        raise key_error(
            key, f"{path.name} has no k0 and k1 of {', '.join(sensor.channels)}; give another file"
        )
    theirs = {axis.name: axis for axis in known.sensor.axes}
    for axis in sensor.axes:
        _require_same_readout(key, path, axis, theirs.get(axis.name, axis))
    return _gaussian(names, known, names)


def _prior_from(key: str, path: Path, taken: Mapping[str, str], sensor: Sensor) -> Gaussian:
    """Return coefficients from another calibration as a prior, under the names used in this run.

    Parameters
    ----------
    key : str
        The section of the run file.
    path : Path
        Path of the calibration file. Its sensor may have other axes, for example if the same
        accelerometer was calibrated on another bench.
    taken : mapping of str to str
        Name of each coefficient in the file, keyed by its name in this run, such as {"a.k3":
        "ax.k3"}.
    sensor : Sensor

    Raises
    ------
    InputError
        A coefficient is missing from the run or the file, its two names refer to different terms,
        or the nominal readouts differ.
    """
    from inercal.calibration.files import load

    known = load(path)
    if not taken:
        raise key_error(
            key, 'the section is empty; name the coefficients to take, such as "a.k3" = "ax.k3"'
        )
    for ours, theirs in taken.items():
        for name, each, whose in (
            (ours, sensor, "the method estimates"),
            (theirs, known.sensor, f"{path.name} has"),
        ):
            if name not in each.coefficients:
                text = f"no coefficient {name!r}; {whose} {', '.join(each.coefficients)}"
                raise key_error(key, text, names=(name,))
        term = CoefficientName(ours).term
        if term != CoefficientName(theirs).term:
            text = f"{ours} and {theirs} are different terms; use the same term in both"
            raise key_error(key, text, names=(ours, theirs))
        if term.startswith("delta"):
            text = f"{ours} depends on the fixture, not only on the accelerometer; remove it"
            raise key_error(key, text, names=(ours,))
        has_misalignment = any(".delta" in name for name in known.sensor.coefficients)
        if term == "k1" and has_misalignment and known.sensor.form != sensor.form:
            raise key_error(
                key,
                f"{theirs} is in the {known.sensor.form} form, where k1 contains a misalignment; "
                f"calibrate that sensor in the {sensor.form} form",
                names=(theirs,),
            )
        mine, other = (
            next(axis for axis in each.axes if axis.name == CoefficientName(name).axis)
            for name, each in ((ours, sensor), (theirs, known.sensor))
        )
        _require_same_readout(key, path, mine, other)
    sources = tuple(taken.values())
    if twice := tuple(name for name in dict.fromkeys(sources) if sources.count(name) > 1):
        raise key_error(
            key,
            f"{', '.join(twice)} of {path.name} is the prior of two coefficients; use it only once",
            names=twice,
        )
    return _gaussian(tuple(taken), known, sources)


def type_prior_of(path: Path, sensor: Sensor) -> Gaussian:
    """Return the prior of a sensor from a file of `inercal prior`.

    A coefficient without an axis is the prior for every axis of its kind, and these axes have the
    error of the mean in common. The file states an sd for which ± 2 sd has the coverage of
    Student's t.

    Parameters
    ----------
    path : Path
    sensor : Sensor
        The sensor with the coefficients of the method; the others in the file are not used.

    Raises
    ------
    InputError
        The file has no coefficient of the sensor, or refers to another readout or form.
    """
    from inercal.calibration.type_prior import load_type_prior

    key = "[method] prior_type"
    known = load_type_prior(path)
    axes = {
        (one.axis or axis.name): (
            axis,
            replace(axis, readout=Readout(one.scale, one.offset, one.unit)),
        )
        for one in known.readout
        for axis in sensor.axes
        if axis.measures == one.measures and one.axis in ("", axis.name)
    }
    used: dict[str, tuple[int, str]] = {}
    for k, name in enumerate(known.names):
        own, term = CoefficientName(name).parts
        for axis in [own] if own else axes:
            if (full := CoefficientName.of(axis, term)) in sensor.coefficients:
                used[full] = (k, "" if own else axis)
    if not used:
        raise key_error(
            key,
            f"{path.name} has {', '.join(known.names)}, but the method estimates "
            f"{', '.join(sensor.coefficients)}; give the prior of one of these",
            names=known.names,
        )
    for name in used:
        _require_same_readout(key, path, *axes[CoefficientName(name).axis])
        if CoefficientName(name).term == "k1" and known.form != sensor.form:
            raise key_error(
                key,
                f"{name} in {path.name} is in the {known.form} form; make the prior from "
                f"calibrations in the {sensor.form} form",
                names=(name,),
            )
    mean = np.array([known.coefficient[k].mean for k, _ in used.values()])
    return Gaussian(tuple(used), mean, known.covariance(used.values()))


def _gaussian(names: tuple[str, ...], known: "Calibration", sources: tuple[str, ...]) -> Gaussian:
    """Return the values and covariance of a calibration's coefficients, with new names."""
    index = [known.sensor.coefficients.index(name) for name in sources]
    range_k = None if known.validity is None else known.validity.temperature
    return Gaussian(names, known.values[index], known.covariance[np.ix_(index, index)], range_k)


def _require_same_readout(key: str, path: Path, axis: Axis, other: Axis) -> None:
    """Raise an error if the coefficients of an axis refer to a different nominal readout."""
    if not has_same_readout(axis, other):
        raise key_error(
            key,
            f"nominal scale and offset of {axis.name} are {describe_readout(other)} in "
            f"{path.name}, but {describe_readout(axis)} in this run; the coefficients refer to "
            "them: state the same in [sensor]",
            names=(axis.name,),
        )


def has_same_readout(axis: Axis, other: Axis) -> bool:
    """Return whether the coefficients of two axes refer to the same nominal readout."""
    mine, theirs = axis.readout, other.readout
    return isclose(theirs.scale, mine.scale) and isclose(theirs.offset, mine.offset)


def describe_readout(axis: Axis) -> str:
    """Describe nominal scale and offset of an axis, such as "3 V/g and 0"."""
    unit, readout = QUANTITIES[axis.measures].reading_unit, axis.readout
    per = f"({unit})" if "/" in unit else unit
    return f"{readout.scale * si_factor(unit):.6g} {readout.unit}/{per} and {readout.offset:g}"
