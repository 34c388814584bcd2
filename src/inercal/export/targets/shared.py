"""Helpers shared by targets: number formats, comments, and checks for diagonal targets."""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.export.model import ExportModel, Triad
from inercal.export.reader_definition import StatedTriad
from inercal.export.target_definition import TargetOption
from inercal.export.term_kinds import TermKind
from inercal.physics import frames

BIAS: frozenset[TermKind] = frozenset({"bias"})
BIAS_AND_SCALE: frozenset[TermKind] = frozenset({*BIAS, "scale"})
MATRIX: frozenset[TermKind] = frozenset({*BIAS_AND_SCALE, "misalignment"})
MATRIX_AND_G: frozenset[TermKind] = frozenset({*MATRIX, "g"})
MATRICES = {"f": MATRIX, "w": MATRIX}
# Flight controllers support these terms: no cross-axis terms, and no gyro scale factors.
PARAMETERS: dict[str, frozenset[TermKind]] = {
    "f": frozenset({"bias", "scale", "bias_temperature"}),
    "w": frozenset({"bias", "bias_temperature"}),
    "m": MATRIX,  # only the symmetric part; `symmetric_part` states the rotation
}
MAX_ROTATION = TargetOption(
    "max_rotation",
    "largest rotation of magnetometers that the file may omit, such as '5 deg'",
    np.radians(5.0),
    like="deg",
)
_NO_ROTATION = 1e-9  # rad
Correction = Callable[[Array, Array], Array]
_LARGEST_OFF_DIAGONAL = 0.5


def number(value: float, digits: int = 9) -> str:
    """Return a number as text; 9 significant digits distinguish all single-precision numbers."""
    return f"{float(value) + 0.0:.{digits}g}"


def yaml_number(value: float, digits: int = 9) -> str:
    """Return a number with a decimal point, because some YAML readers read 1e-05 as text.

    >>> yaml_number(1e-5), yaml_number(2.0), yaml_number(0.25)
    ('1.0e-05', '2.0', '0.25')
    """
    mantissa, exponent, power = number(value, digits).partition("e")
    return f"{mantissa}{'' if '.' in mantissa else '.0'}{exponent}{power}"


def yaml_row(values: Sequence[float] | Array, digits: int = 9) -> str:
    """Return numbers in YAML format, separated by commas."""
    return ", ".join(yaml_number(x, digits) for x in values)


def written(values: Array, digits: int = 9) -> Array:
    """Return numbers as a program reads them from text with some significant digits."""
    flat = [float(number(x, digits)) for x in np.asarray(values).ravel()]
    return np.array(flat).reshape(np.shape(values))


def single(values: Array | float) -> Array:
    """Return numbers rounded to single precision."""
    return np.asarray(values, dtype=np.float32).astype(float)


def require_accepted(target: str, name: str, value: float, limits: tuple[float, float]) -> None:
    """Raise an error if an autopilot would not accept a parameter of a magnetometer.

    Raises
    ------
    InputError
        The value is not between the limits.
    """
    low, high = limits
    if not low < value < high:
        raise InputError(
            f"{target}: {name} would be {value:.4g}, but it must be between {low:g} and {high:g}; "
            "check the nominal readout of the magnetometers in [sensor]",
            names=(name,),
        )


def inverse(matrix: Array) -> Array:
    """Return the inverse of a matrix."""
    return np.asarray(np.linalg.inv(matrix), dtype=float)


def comments(lines: Sequence[str], mark: str) -> str:
    """Return comment lines."""
    return "".join(f"{mark} {line}\n" for line in lines)


def with_comments(body: str) -> Callable[[Sequence[str]], str]:
    """Return a function that writes a file body below an explanation in # comment lines."""
    return lambda header: comments(header, "#") + body


def json_with_comment(content: Mapping[str, Any]) -> Callable[[Sequence[str]], str]:
    """Return a function that writes a JSON object with the explanation as its first key."""
    return lambda header: json.dumps({"comment": "\n".join(header), **content}, indent=4) + "\n"


def needed(
    options: Mapping[str, Any], declared: Sequence[TargetOption], name: str, target: str
) -> Any:
    """Return the value of an option that this calibration needs.

    Raises
    ------
    InputError
        The option is not stated.
    """
    if options[name] is None:
        meaning = next(one.meaning for one in declared if one.name == name)
        raise InputError(
            f"target {target} needs --set {name}=… ({meaning})", key="--set", names=(name,)
        )
    return options[name]


def require_aligned(model: ExportModel, target: str) -> None:
    """Raise an error if a target supports only aligned axes and the sensor's are not.

    Raises
    ------
    InputError
        A sensor axis is not aligned with the axis of its channel.
    """
    for _, triad in model.triads:
        far = np.abs(triad.matrix - np.eye(3)).max(axis=1) > _LARGEST_OFF_DIAGONAL
        if far.any():
            name = model.sensor.channels[triad.rows[int(np.flatnonzero(far)[0])]]
            raise InputError(
                f"{target} needs channels along x, y and z of the frame, but {name} is along "
                "another axis; give --axes, or state the axes in [sensor] in this order",
                names=(name,),
            )


def by_triad(model: ExportModel, corrections: Mapping[str, Correction]) -> Correction:
    """Combine the corrections of both kinds of triads; channels without one stay unchanged.

    Parameters
    ----------
    model : ExportModel
    corrections : mapping of "f" or "w" to callable
        Functions (readings (n, 3), dT (n,)) -> motion (n, 3).
    """

    def correct(readings: Array, dT: Array) -> Array:
        parts: list[Array] = []
        for k, (kind, _) in enumerate(model.triads):
            mine = readings[:, 3 * k : 3 * k + 3]
            parts.append(corrections[kind](mine, dT) if kind in corrections else mine)
        return np.concatenate(parts, axis=-1)

    return correct


def matrix_correction(matrix: Array, bias: Array) -> Correction:
    """Return the correction function x = C (y − b)."""
    return lambda y, dT: (y - bias) @ matrix.T


def symmetric_part(triad: Triad, largest: float, target: str) -> tuple[Array, Array | None]:
    """Return P⁻¹, (3, 3), and the rotation vector of Q or None, in D = P Q of magnetometers.

    Parameters
    ----------
    triad : Triad
    largest : float
        Largest angle of Q that the file may omit, rad.
    target : str

    Raises
    ------
    InputError
        The angle is larger.
    """
    symmetric, turn = frames.decompose_symmetric(triad.matrix)
    rotation = frames.log_so3(turn)
    angle = float(np.linalg.norm(rotation))
    if angle > largest:
        raise InputError(
            f"{target} has a symmetric matrix for magnetometers, so it would omit a rotation of "
            f"{np.degrees(angle):.2f}° between magnetometers and body, and the limit is "
            f"{np.degrees(largest):g}°; choose a target with a full matrix, or accept the error "
            f"with --set 'max_rotation={np.ceil(np.degrees(angle)):g} deg'",
            key="--set",
            names=("max_rotation",),
        )
    return inverse(symmetric), rotation if angle > _NO_ROTATION else None


def symmetric_elements(matrix: Array) -> list[tuple[str, float, float]]:
    """Return X, Y and Z, each with a diagonal element and an element off the diagonal.

    The elements off the diagonal are 12, 13 and 23, for PX4 and for ArduPilot.
    """
    off = matrix[[0, 0, 1], [1, 2, 2]].tolist()
    return list(zip("XYZ", np.diag(matrix).tolist(), off, strict=True))


def stated_magnetometer(
    diagonal: Array, off: Array, bias: Array, autopilot: str, scale: float = 1.0
) -> StatedTriad:
    """Return magnetometers whose parameters are those of `symmetric_elements`.

    Parameters
    ----------
    diagonal, off : (3,) arrays
    bias : (3,) array
        Reading without a field, T.
    autopilot : str
    scale : float
        Factor of the matrix.

    Raises
    ------
    InputError
        The matrix is not positive definite.
    """
    matrix = np.diag(diagonal)
    matrix[[0, 0, 1, 1, 2, 2], [1, 2, 2, 0, 0, 1]] = off[[0, 1, 2, 0, 1, 2]]
    matrix = matrix * scale
    if np.linalg.eigvalsh(matrix)[0] <= 0:
        raise InputError(
            f"the matrix of the magnetometers of {autopilot} is not positive definite, so it "
            f"cannot be a calibration; give parameters of a compass that was calibrated"
        )
    return StatedTriad(matrix=inverse(matrix), bias=bias)


def parameter_correction(
    bias: Array,
    scale: Array,
    powers: Array,
    taken: float,
    limits: tuple[float, float],
    *,
    reference: float,
    centre: float,
) -> Correction:
    """Return the correction in flight controllers, x = scale ∘ (y − [P(T) − P(taken)] − b).

    Parameters
    ----------
    bias, scale : (3,) arrays
    powers : (k, 3) array
        Coefficients of P in powers of T − centre.
    taken : float
        Temperature at which the bias applies, °C.
    limits : (float, float)
        Limits to which T is clipped, °C.
    reference, centre : float
        Reference temperature of the sensor and centre of P, °C.
    """

    def polynomial(t: Array) -> Array:
        return sum(
            (t[:, None] ** k * line for k, line in enumerate(powers, start=1)),
            np.zeros((t.size, 3)),
        )

    def correct(y: Array, dT: Array) -> Array:
        t = np.clip(dT + reference, *limits) - centre
        thermal = polynomial(t) - polynomial(np.array([taken - centre]))
        return scale * (y - thermal - bias)

    return correct


def output_text(*triads: Triad) -> str:
    """Describe which output a formula uses."""
    units = " and ".join(dict.fromkeys(triad.unit for triad in triads))
    return f"readings as the sensor states them, in {units}"


def json_section(text: str, what: str, *path: str | int) -> Mapping[str, Any]:
    """Return the object at a path in a JSON text, such as ("imus", 0, "accelerometer").

    Raises
    ------
    InputError
        The text is no JSON, or there is no object at the path; `what` names the expected file.
    """
    try:
        found: Any = json.loads(text)
        for key in path:
            found = found[key]
        if not isinstance(found, dict):
            raise TypeError
    except (ValueError, LookupError, TypeError, RecursionError):
        place = ".".join(map(str, path))
        raise InputError(
            f"this is not {what}: it contains no JSON object {place}", names=(place,)
        ) from None
    return cast("dict[str, Any]", found)


def json_numbers(section: Mapping[str, Any], name: str, count: int) -> Array:
    """Return a list of numbers in a JSON object, (count,).

    Raises
    ------
    InputError
        There is no such list, or it does not contain this many finite numbers.
    """
    try:
        numbers = np.array(section[name], dtype=float)
        if numbers.shape != (count,) or not np.isfinite(numbers).all():
            raise ValueError
    except (ValueError, KeyError, TypeError):
        raise InputError(f"{name} must be {count} finite numbers", names=(name,)) from None
    return numbers


def offset_triad(matrix: Array, offset: Array, name: str) -> StatedTriad:
    """Return the triad whose correction is x = S y − offset, so that M = S⁻¹ and b = S⁻¹ offset.

    Parameters
    ----------
    matrix : (3, 3) array
        S.
    offset : (3,) array
    name : str
        Name of S in the file.

    Raises
    ------
    InputError
        S has no inverse.
    """
    if np.linalg.cond(matrix) > 1 / np.finfo(np.float32).eps:
        raise InputError(f"{name} has no inverse, so it cannot be a correction", names=(name,))
    back = inverse(matrix)
    return StatedTriad(matrix=back, bias=back @ offset)
