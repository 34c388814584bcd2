"""Read operating points from texts, sweeps and tables, and tabulate the predictions for them.

A text names the parts of a point: "f = 0.5 g, -1 g, 0; w = 0, 0, 30 °/s; T = 40 °C"; "m" is the
magnetic flux density. Missing parts are zero; without a temperature, that of the calibration is
used. A table has the columns fx, fy, fz, wx, wy, wz, mx, my, mz and T, each with its unit in
brackets, such as "fx [g]". Missing columns are missing parts.
"""

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError, error_location
from inercal.basics.units import format_number, format_value_and_uncertainty, si_factor, to_si
from inercal.basics.units.expression import ZERO_CELSIUS
from inercal.calibration import Calibration
from inercal.calibration.prediction import SHOWN, Prediction, calibration_temperature
from inercal.estimation.uncertainty import COVERAGE
from inercal.physics.quantities import QUANTITIES
from inercal.physics.section_settings import si_value
from inercal.recordings.io.read import read_table

_LIKE = {kind: one.unit for kind, one in QUANTITIES.items()} | {"T": "°C"}
_NAMES = tuple(kind + axis for kind in QUANTITIES for axis in "xyz")
_COLUMN = re.compile(r"(\w+) *(?:\[(.*)\])?")
_SWEEP = re.compile(r"(\w+) *= *(.+?) *(?:…|\.\.\.?| to ) *(.+)")
_SHARED_UNIT = re.compile(r"(?:[+\-−]?[\d.]+ *, *)+[+\-−]?[\d.]+ *([^\d.,\s].*)")  # 20, 5, -40 µT
_STEPS = 201
_LADDERS = {"f": ("g", "mg", "µg"), "w": ("°/s", "°/h"), "m": ("µT", "nT")}
_EXAMPLE = '"f = 0.5 g, -1 g, 0; w = 0, 0, 30 °/s; T = 40 °C"'


Points: TypeAlias = dict[str, Array]
"""Arguments of `Calibration.predict`, in SI: f, w, m, (n, 3), and T, (n,); only what is stated."""


def points_from_texts(texts: Sequence[str], calibration: Calibration) -> Points:
    """Return one point for each text.

    Three numbers are components in the frame of the calibration; they may share the
    unit of the last, as in "m = 20, 5, -40 µT". If a sensor has fewer than three
    axes of a kind, one number for each axis, along its input axis, is also accepted.

    Raises
    ------
    InputError
        A text has another form, or a number that is not zero has no unit.
    """
    found = [_point(text, calibration) for text in texts]
    default = {kind: np.zeros(3) for kind in QUANTITIES}
    default |= {"T": calibration_temperature(calibration)}
    stated = {kind for one in found for kind in one}
    return {kind: np.array([one.get(kind, default[kind]) for one in found]) for kind in stated}


def _point(text: str, calibration: Calibration) -> dict[str, Any]:
    """Return the parts of a point that a text states, by "f", "w", "m" and "T", SI."""
    found: dict[str, Any] = {}
    for part in map(str.strip, text.rstrip("; ").split(";")):
        kind, equals, value = (word.strip() for word in part.partition("="))
        if not (equals and value) or kind not in _LIKE or kind in found:
            raise InputError(
                f"--at {part!r}: state {', '.join(QUANTITIES)} and T, each at most once, as in "
                f"{_EXAMPLE}",
                key="--at",
                names=(kind,),
            )
        words = [word.strip() for word in value.split(",")]
        if kind != "T" and (shared := _SHARED_UNIT.fullmatch(value)):
            words = [f"{word} {shared[1]}" for word in words[:-1]] + words[-1:]
        numbers = [_number(word, kind, f"--at {kind}") for word in words]
        found[kind] = numbers[0] if kind == "T" else _vector(numbers, kind, calibration)
        if kind == "T" and len(numbers) > 1:
            raise InputError(f"--at T = {value!r}: give one temperature", key="--at", names=("T",))
    return found


def _number(text: str, kind: str, key: str) -> float:
    """Return a quantity in SI; only zero needs no unit, and a temperature always needs one."""
    if kind != "T" and re.fullmatch(r"[+\-−]?0*\.?0*", text.strip()) and "0" in text:
        return 0.0
    return si_value(text, _LIKE[kind], key)


def _vector(numbers: Sequence[float], kind: str, calibration: Calibration) -> Array:
    directions = [axis.i for axis in calibration.sensor.axes if axis.measures == kind]
    if len(numbers) == 3:
        return np.array(numbers)
    if len(numbers) == len(directions) < 3:
        return np.linalg.pinv(np.array(directions)) @ np.array(numbers)
    raise InputError(
        f"--at {kind}: give 3 components, or one for each axis if there are fewer; "
        f"{calibration.sensor.name} has {len(directions)} axes that measure {kind}",
        key="--at",
        names=(kind,),
    )


def points_from_table(path: Path) -> Points:
    """Read operating points from a table.

    Raises
    ------
    InputError
        The file cannot be read, or a column has no unit, another name, or numbers that are missing
        or not finite.
    """
    table = read_table(path)
    parts: dict[str, Array] = {}
    for name in table.names:
        found = _COLUMN.fullmatch(name)
        short, unit = (found[1], found[2]) if found else (name, None)
        if short not in (*_NAMES, "T") or unit is None or short in parts:
            raise InputError(
                f"column {name!r}: the columns are {', '.join(_NAMES)} and T, each with its unit "
                "in brackets, as in 'fx [g]', 'wz [°/s]', 'T [°C]'",
                names=(name,),
            ).located(path)
        values = table.numbers(name)
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
            raise InputError(
                f"row {row}: {name} is not a number; fill it in", names=(name,)
            ).located(path)
        with error_location(f"{path}: column {name!r}", file=path, key=name):
            parts[short] = to_si(values, unit, _LIKE[short[0]])
    zero = np.zeros(next(iter(parts.values())).size)
    points = {
        kind: np.stack([parts.get(kind + axis, zero) for axis in "xyz"], axis=-1)
        for kind in {name[0] for name in parts} & set(QUANTITIES)
    }
    return points | {name: values for name, values in parts.items() if name == "T"}


def swept_points(text: str, base: Points) -> tuple[str, Points]:
    """Return the name of the part that varies, and 201 points between both ends.

    Parameters
    ----------
    text : str
        Text such as "fx = -1 g … 1 g" or "T = 10 °C to 40 °C".
    base : dict
        A single point, which states the other parts.

    Raises
    ------
    InputError
        The text has another form, or both ends are equal.
    """
    found = _SWEEP.fullmatch(text.strip())
    if not found or found[1] not in (*_NAMES, "T"):
        raise InputError(
            f"--sweep {text!r}: name one of {', '.join(_NAMES)} and T with both ends, as in "
            '"fx = -1 g … 1 g"',
            key="--sweep",
        )
    name, *ends = found.groups()
    low, high = (_number(end, name[0], f"--sweep {name}") for end in ends)
    if low == high:
        raise InputError(f"--sweep {text!r}: both ends are equal; give a range", key="--sweep")
    line = np.linspace(low, high, _STEPS)
    others = base.get(name[0], np.zeros((1, 3)))
    if name in base or (name != "T" and others[0, "xyz".index(name[1])]):
        raise InputError(f"--at {name}: --sweep varies it; leave it out of --at", key="--at")
    if name != "T":
        vectors = np.repeat(others, _STEPS, axis=0)
        vectors[:, "xyz".index(name[1])] = line
        line = vectors
    return name, {**base, name[0]: line}


def swept_values(name: str, found: Prediction) -> tuple[Array, str]:
    """Return the part that varies, in the unit in which it is printed, and this unit."""
    if name == "T":
        return found.temperature - ZERO_CELSIUS, "°C"
    unit, si = SHOWN[name[0]]
    return dict(_vectors(found))[name[0]][:, "xyz".index(name[1])] / si, unit


def _vectors(found: Prediction) -> Iterator[tuple[str, Array]]:
    """Yield the kinds and vectors of the points, (n, 3), SI."""
    for kind in QUANTITIES:
        if (vectors := getattr(found, kind)) is not None:
            yield kind, vectors


def point_text(found: Prediction, j: int) -> str:
    """Return a point as text, without parts that are zero and that the sensor does not measure."""
    parts: list[str] = []
    for kind, vectors in _vectors(found):
        if kind in found.measures or vectors[j].any():
            unit, si = SHOWN[kind]
            parts.append(f"{kind} = ({', '.join(f'{x / si:.6g}' for x in vectors[j])}) {unit}")
    if np.isfinite(found.temperature[j]):
        parts.append(f"T = {found.temperature[j] - ZERO_CELSIUS:.2f} °C")
    return "; ".join(parts).replace("-", "−")


def quantity_cells(found: Prediction, j: int, k: int) -> tuple[str, ...]:
    """Return the raw reading, its error, and the corrected value with U of a quantity.

    All points and quantities of a kind have the same units.
    """
    kind = found.measures[k]
    unit, si = SHOWN[kind]
    small, size = fitting_unit(kind, found.raw_error[:, [one == kind for one in found.measures]])
    value, error, u = (float(one[j, k]) for one in (found.value, found.raw_error, found.expanded))
    corrected = " ± ".join(format_value_and_uncertainty(value / si, u / si))
    raw = f"{format_number((value + error) / si, 6)} {unit}"
    cells = (raw, f"{format_number(error / size, 4)} {small}", f"{corrected} {unit}")
    return tuple(cell.replace("-", "−") for cell in cells)


def fitting_unit(kind: str, values: Array) -> tuple[str, float]:
    """Return the largest unit in which the values reach 1, and its size in SI units."""
    largest = float(np.abs(values).max())
    units = [(unit, si_factor(unit)) for unit in _LADDERS[kind]]
    return next((one for one in units if largest >= one[1]), units[-1])


def prediction_columns(found: Prediction) -> dict[str, Sequence[Any]]:
    """Return a prediction as columns of a table; shares are in percent of the variance."""
    columns: dict[str, Sequence[Any]] = {}
    for kind, vectors in _vectors(found):
        unit, si = SHOWN[kind]
        for k, axis in enumerate("xyz"):
            columns[f"{kind}{axis} [{unit}]"] = (vectors[:, k] / si).tolist()
    if np.isfinite(found.temperature).all():
        columns["T [°C]"] = (found.temperature - ZERO_CELSIUS).tolist()
    columns["inside"] = ["no" if one else "yes" for one in found.outside]
    for k, (name, kind) in enumerate(zip(found.names, found.measures, strict=True)):
        unit, si = SHOWN[kind]
        parts = {"raw error": found.raw_error, "corrected": found.value, "U": found.expanded}
        for word, values in parts.items():
            columns[f"{name} {word} [{unit}]"] = (values[:, k] / si).tolist()
        for causes in (found.groups, found.bench, found.effects):
            for cause, share in causes.items():
                columns[f"{name} share of {cause} [%]"] = np.round(100 * share[:, k], 2).tolist()
    if found.heading_std is not None and np.isfinite(found.heading_std).all():
        columns["heading U [°]"] = np.degrees(COVERAGE * found.heading_std).tolist()
    return columns
