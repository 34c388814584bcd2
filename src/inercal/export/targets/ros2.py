"""ROS 2: an ament_python package whose node corrects sensor_msgs/Imu and MagneticField messages.

The correction has no imports and is that of the target python, but from readings in SI, as the
messages contain them. The covariance of a corrected quantity x = C (y − b) is

    Σ = R C diag(N²) Cᵀ + E[J C_c Jᵀ]

with the noise densities N of the sensor, the rate R of the messages, and the covariance C_c of the
coefficients, propagated to x and averaged over the calibrated range. The standard deviation N √R of
a sample of white noise is that of Kalibr's noise model. sensor_msgs/Imu.msg asks for the covariance
of the measurement, 0 means that it is unknown, and −1 in its first element that the quantity is
not reported. Sources: Imu.msg, MagneticField.msg and Temperature.msg of ros2/common_interfaces;
REP 145 (units, frames, parameters for standard deviations); REP 2003 (quality of service).
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from string import Template
from typing import Any
from xml.sax.saxutils import escape

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.export.cost import propagation
from inercal.export.header import plain_text
from inercal.export.model import ExportModel
from inercal.export.polynomial import CodeModel, code_model
from inercal.export.ranges import sample_motions
from inercal.export.target_definition import Rendering, Request, TargetOption
from inercal.export.targets import shared
from inercal.export.targets.code_text import code_rendering, code_target
from inercal.export.targets.kalibr import stated_noise
from inercal.export.targets.scripts import module_text
from inercal.physics.quantities import QUANTITIES

_TEMPLATES = Path(__file__).with_name("ros2_package")
_FIELDS = {"f": "linear_acceleration", "w": "angular_velocity", "m": "magnetic_field"}
_DENSITIES = {
    "f": ("accelerometer_noise_density", "m/s^2/sqrt(Hz)"),
    "w": ("gyroscope_noise_density", "rad/s/sqrt(Hz)"),
    "m": ("magnetometer_noise_density", "T/sqrt(Hz)"),
}
_RATE = "update_rate"
_OPTIONS = (
    *(TargetOption(name, f"{unit}, for the covariance") for name, unit in _DENSITIES.values()),
    TargetOption(_RATE, "messages per second, Hz"),
    TargetOption("noise", "imu.yaml of a noise analysis, with these keys", kind=str),
    TargetOption("maintainer", "name in package.xml", "maintainer", kind=str),
    TargetOption("email", "address in package.xml", "maintainer@example.com", kind=str),
)


_MODULES = {"imu_correction": "fw", "field_correction": "m"}  # and the kinds that they correct
_PLACES = {
    "package.xml": "package.xml",
    "setup.py": "setup.py",
    "setup.cfg": "setup.cfg",
    "README.md": "README.md",
    "config/{}.yaml": "parameters.yaml",
    "launch/{}.launch.py": "launch.py",
    "test/test_correction.py": "test_correction.py",
    "{}/settings.py": "settings.py",
    "{}/covariance.py": "covariance.py",
    "{}/node.py": "node.py",
}


def _render(request: Request) -> Rendering:
    model, name = request.model, f"{request.name}_correct"
    _require_complete(model)
    code = code_model(replace(request, model=_in_si(model)))
    parts = {
        module: replace(code, model=_part(code.model, kinds))
        for module, kinds in _MODULES.items()
        if any(kind in kinds for kind, _ in model.triads)
    }
    main, *others = parts
    units = " and ".join(QUANTITIES[kind].ascii_unit for kind, _ in model.triads)
    words = {
        "package": name,
        "maintainer": escape(plain_text(request.options["maintainer"])),
        "email": escape(plain_text(request.options["email"]), {'"': "&quot;"}),
        "sensor": escape(plain_text(model.sensor.name)),
        "settings": _settings_text(request, code, parts),
        "update_rate": shared.yaml_number(_noise(model, request.options)[1]),
        "main": main,
    }
    beside = {
        place.format(name): Template((_TEMPLATES / f"{file}.in").read_text("utf-8")).substitute(
            words
        )
        for place, file in _PLACES.items()
    }
    beside |= {f"{name}/{one}.py": module_text(parts[one], [f"see {main}.py"]) for one in others}
    beside |= {f"resource/{name}": "", f"{name}/__init__.py": ""}
    rendering = code_rendering(code, lambda header: module_text(parts[main], header))
    return replace(
        rendering,
        reads=f"readings after the nominal readout, in {units}",
        takes_output=False,
        place=f"{name}/{main}.py",
        beside=beside,
    )


def _require_complete(model: ExportModel) -> None:
    """Raise an error unless the channels are x, y and z of each triad, as in the messages."""
    if len(model.inputs) < 3 * len(model.triads):
        measured = tuple(model.channels[k] for k in model.inputs)
        raise InputError(
            "ros2-node needs three axes of each kind, because the messages have x, y and z, but "
            f"{model.sensor.name} has only {', '.join(measured)}; use target python in a node of "
            "your own",
            names=measured,
        )
    shared.require_aligned(model, "ros2-node")


def _in_si(model: ExportModel) -> ExportModel:
    """Return the model for readings in SI, in the order of the messages."""
    triads = tuple(
        (kind, replace(triad, scale=np.ones(3), offset=np.zeros(3))) for kind, triad in model.triads
    )
    return replace(model, triads=triads, inputs=list(range(3 * len(triads))))


def _part(model: ExportModel, kinds: str) -> ExportModel:
    """Return the model of some triads; magnetometers do not depend on the others."""
    triads = tuple(one for one in model.triads if one[0] in kinds)
    return replace(model, triads=triads, inputs=list(range(3 * len(triads))))


def _settings_text(request: Request, code: CodeModel, parts: Mapping[str, CodeModel]) -> str:
    """Return the constants of settings.py."""
    model, options = request.model, request.options
    noise, rate = _noise(model, options)
    by = propagation(model, sample_motions(model.calibration, request.ranges))
    calibration = np.einsum("nkp,nlp->kl", by @ model.calibration.covariance, by) / len(by)
    expected = code.correct(request.check_reading, request.check_dT)[0]
    fields = {_FIELDS[kind]: slice(3 * k, 3 * k + 3) for k, (kind, _) in enumerate(model.triads)}
    celsius = code.reference + float(request.check_dT[0])
    modules = (f"from . import {', '.join(parts)}", "")
    calls = (f"{module}.correct" if module in parts else None for module in _MODULES)
    constants = {
        "SENSOR": repr(plain_text(model.sensor.name)),
        **dict(zip(("CORRECT_IMU", "CORRECT_FIELD"), calls, strict=True)),
        "FIELDS": tuple(fields),
        "FULL_SCALE": _dict_text({n: tuple(_full_scale(model)[at]) for n, at in fields.items()}),
        "UPDATE_RATE": rate,
        "NOISE": _dict_text({name: _row(noise[at, at]) for name, at in fields.items()}),
        "CALIBRATION": _dict_text({n: _row(calibration[at, at]) for n, at in fields.items()}),
        "TAKES_TEMPERATURE": code.takes_temperature,
        "REFERENCE_TEMPERATURE": round(code.reference, 9),
        "TEMPERATURE_LIMITS": None if code.limits is None else tuple(map(float, code.limits)),
        "CHECK_READING": _dict_text(
            {name: _row(request.check_reading[0, at]) for name, at in fields.items()}
        ),
        "CHECK_TEMPERATURE": celsius,
        "CHECK_RESULT": _dict_text({name: _row(expected[at]) for name, at in fields.items()}),
    }
    return "\n".join([*modules, *(f"{name} = {value}" for name, value in constants.items()), ""])


def _dict_text(values: Mapping[str, tuple[float | None, ...]]) -> str:
    return "\n".join(["{", *(f'    "{name}": {row},' for name, row in values.items()), "}"])


def _row(values: Array) -> tuple[float, ...]:
    return tuple((values + 0.0).ravel().tolist())


def _full_scale(model: ExportModel) -> list[float | None]:
    """Return the largest magnitude of each channel within its measuring range, SI, or None."""
    readouts = [model.sensor.axes[row].readout for _, t in model.triads for row in t.rows]
    return [None if r.full_scale is None else r.full_scale / abs(r.scale) for r in readouts]


def _noise(model: ExportModel, options: Mapping[str, Any]) -> tuple[Array, float]:
    """Return the covariance of the result per Hz of the rate, (n, n), and the rate or 0.

    A quantity whose noise density is not stated has zeros.
    """
    names = (*(name for name, _ in _DENSITIES.values()), _RATE)
    stated = stated_noise(options, names, "ros2-node")
    densities = [stated.get(_DENSITIES[kind][0], 0.0) for kind, _ in model.triads]
    if any(densities) and _RATE not in stated:
        raise InputError(
            f"target ros2-node needs --set {_RATE}=… (messages per second, Hz) for the covariance "
            "from a noise density",
            key="--set",
            names=(_RATE,),
        )
    each = np.repeat(densities, 3)
    known = np.outer(each > 0, each > 0)
    return known * ((model.correction * each**2) @ model.correction.T), stated.get(_RATE, 0.0)


TARGET = replace(
    code_target("ros2-node", "ROS 2 node", "", _render, named_by_function=True),
    options=_OPTIONS,
    is_folder=True,
)
