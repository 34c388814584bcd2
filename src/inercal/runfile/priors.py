"""Priors that a run file takes from calibration files, with their covariance."""

from collections.abc import Mapping
from math import isclose, pi
from pathlib import Path

import numpy as np

from inercal.calibration.files import load
from inercal.errors import InputError
from inercal.estimate import Gaussian
from inercal.keys import CoefficientName
from inercal.methods import centrifuge_norm
from inercal.sensors import G0, Axis, Sensor


def static_prior(path: Path, sensor: Sensor) -> Gaussian:
    """Return bias and scale factor as a calibration at rest found them, as a prior.

    IEEE Std 836 advises to take both from a static multi-position test.
    """
    key = "[method] prior_file"
    known = load(path)
    if known.method == centrifuge_norm.METHOD.name:
        raise InputError(
            f"{key}: {path.name} is a calibration on a centrifuge; give a calibration at rest"
        )
    if known.sensor.name != sensor.name:
        raise InputError(
            f"{key}: {path.name} is of {known.sensor.name!r}, not of {sensor.name!r} "
            "([sensor] name)"
        )
    # In the two forms k1 means different things beside misalignments.
    known = known.in_form(sensor.form)
    names = tuple(
        name
        for name in sensor.coefficients
        if CoefficientName(name).term in ("k0", "k1") and name in known.sensor.coefficients
    )
    if not names:
        raise InputError(f"{key}: {path.name} knows no k0 and k1 of {', '.join(sensor.channels)}")
    theirs = {axis.name: axis for axis in known.sensor.axes}
    for axis in sensor.axes:
        _require_same_readout(key, path, axis, theirs.get(axis.name, axis))
    index = [known.sensor.coefficients.index(name) for name in names]
    return Gaussian(names, known.values[index], known.covariance[np.ix_(index, index)])


def prior_from(path: Path, taken: Mapping[str, str], sensor: Sensor) -> Gaussian:
    """Return coefficients as another calibration found them, under its own names, as a prior.

    Parameters
    ----------
    path : Path
        Of the calibration file; its sensor may have other axes: the same accelerometer on another
        bench.
    taken : mapping of str to str
        Which coefficient of ours is which one of the file: {"a.k3": "ax.k3"}.
    sensor : Sensor

    Raises
    ------
    InputError
        A coefficient that either side has not, another kind of coefficient, or another nominal
        readout.
    """
    key = f'[method.prior_from."{path.name}"]'
    known = load(path)
    if not taken:
        raise InputError(f'{key}: say what to take, such as "a.k3" = "ax.k3"')
    index: list[int] = []
    for ours, theirs in taken.items():
        for name, one, whose in (
            (ours, sensor, "the method finds"),
            (theirs, known.sensor, f"{path.name} knows"),
        ):
            if name not in one.coefficients:
                raise InputError(f"{key}: no {name!r}; {whose} {', '.join(one.coefficients)}")
        term = CoefficientName(ours).term
        if term != CoefficientName(theirs).term:
            raise InputError(f"{key}: {ours} and {theirs} are not of one kind")
        if term.startswith("delta"):
            raise InputError(f"{key}: {ours} is of the fixture, not of the accelerometer")
        turned = any(".delta" in name for name in known.sensor.coefficients)
        if term == "k1" and turned and known.sensor.form != sensor.form:
            raise InputError(
                f"{key}: {theirs} is of the {known.sensor.form} form, in which a misalignment is "
                f"part of k1; calibrate that sensor in the {sensor.form} form"
            )
        mine, other = (
            next(axis for axis in one.axes if axis.name == CoefficientName(name).axis)
            for name, one in ((ours, sensor), (theirs, known.sensor))
        )
        _require_same_readout(key, path, mine, other)
        index.append(known.sensor.coefficients.index(theirs))
    if len(set(index)) < len(index):
        raise InputError(f"{key}: one coefficient of {path.name} gives the values of two")
    return Gaussian(tuple(taken), known.values[index], known.covariance[np.ix_(index, index)])


def _require_same_readout(key: str, path: Path, axis: Axis, other: Axis) -> None:
    """Refuse an axis whose coefficients refer to another nominal readout."""
    mine, theirs = axis.readout, other.readout
    if not (isclose(theirs.scale, mine.scale) and isclose(theirs.offset, mine.offset)):
        raise InputError(
            f"{key}: {path.name} has another nominal scale or offset of {axis.name}: "
            f"{_describe_readout(other)}, not {_describe_readout(axis)}; coefficients refer to it"
        )


def _describe_readout(axis: Axis) -> str:
    size, per = (G0, "g") if axis.measures == "f" else (pi / 180, "(°/s)")
    readout = axis.readout
    return f"{readout.scale * size:.6g} {readout.unit}/{per} and {readout.offset:g}"
