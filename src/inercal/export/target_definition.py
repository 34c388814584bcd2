"""Declarations of targets for `inercal export`, and of the options of targets and readers.

They declare their options and what they return.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import parse_quantity
from inercal.export.model import ExportModel
from inercal.export.ranges import Ranges
from inercal.export.term_kinds import TermKind

_WORDS: dict[type, str] = {int: "a whole number", float: "a finite number", str: "a text"}
DEVICE_ID = (1, (1 << 31) - 1)  # autopilots store an id as INT32, and 0 means no device
STEP = (1e-15, 10**9)  # size of a count or of a step of a register, SI


@dataclass(frozen=True)
class TargetOption:
    """An option of an export target or of an import format.

    Parameters
    ----------
    name, meaning : str
    default : object
        Default value; None if the option may be omitted and has no default.
    required : bool
    kind : type
        Type to which a text is converted: int, float or str.
    like : str
        A unit with the dimension of the option, if it is a quantity. A text such as "0.8 mg" is
        converted to a float in SI.
    choices : tuple of str
        The permitted words.
    limits : (float, float)
        The least and the largest permitted number, in SI if the option is a quantity.
    """

    name: str
    meaning: str
    default: Any = None
    required: bool = False
    kind: type[int] | type[float] | type[str] = float
    like: str = ""
    choices: tuple[str, ...] = ()
    limits: tuple[float, float] = (-math.inf, math.inf)


def resolve_options(
    of: str, options: Sequence[TargetOption], stated: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the value of every option of an export target or import format.

    Parameters
    ----------
    of : str
        Name of the target or of the format.
    options : sequence of TargetOption
    stated : mapping of str to object
        Stated texts or values, by name.

    Raises
    ------
    InputError
        An option is unknown or missing, or a value is not permitted.
    """
    known = {one.name: one for one in options}
    for name in stated:
        if name not in known:
            raise InputError(
                f"{of} has no option {name!r}; it has {', '.join(known) or 'no options'}",
                key="--set",
                names=(name,),
            )
    missing = [one for one in options if one.required and stated.get(one.name) is None]
    if missing:
        needs = "; ".join(f"--set {one.name}=… ({one.meaning})" for one in missing)
        raise InputError(
            f"{of} needs {needs}", key="--set", names=tuple(one.name for one in missing)
        )
    return {
        one.name: one.default if (value := stated.get(one.name)) is None else _value(one, value)
        for one in options
    }


def _value(option: TargetOption, value: Any) -> Any:
    low, high = option.limits
    wanted = " or ".join(option.choices) or _WORDS[option.kind]
    if option.limits != (-math.inf, math.inf):
        wanted += f" from {low} to {high}{option.like and ' in SI units'}"
    try:
        if option.like and isinstance(value, str):
            found = parse_quantity(value, like=option.like).value
        elif option.kind is int:
            found = int(value, 0) if isinstance(value, str) else int(value)
        else:
            found = option.kind(value)
        allowed = found in option.choices if option.choices else True
        if not isinstance(found, str):
            allowed = math.isfinite(found) and low <= found <= high
        if allowed:
            return found
    except InputError as error:
        raise error.located(f"--set {option.name}", key="--set") from None
    except (TypeError, ValueError, OverflowError):
        pass
    raise InputError(
        f"--set {option.name}={value}: give {wanted} ({option.meaning})",
        key="--set",
        names=(option.name,),
    )


@dataclass(frozen=True)
class Request:
    """A request to write a calibration for a target.

    Parameters
    ----------
    model : ExportModel
    ranges : Ranges
    options : mapping of str to object
        Values of all options that the target declares.
    name : str
        Name for generated code, with only letters, digits and underscores.
    check_reading : (1, k) array
        A reading in SI within the ranges. The file can state its correction as a check.
    check_dT : (1,) array
        Temperature difference of this reading from the reference, K.
    """

    model: ExportModel
    ranges: Ranges
    options: Mapping[str, Any]
    name: str
    check_reading: Array
    check_dT: Array


@dataclass(frozen=True)
class Rendering:
    """A calibration in the form of a target.

    Parameters
    ----------
    correct : callable
        Function (readings (n, k) in SI, dT (n,)) -> motion (n, k). It repeats the target's
        computation with the numbers as written in the file. Channels and motion are defined as in
        `ExportModel`.
    write : callable
        Function: lines of explanation in ASCII -> content of the file.
    formula : tuple of str
        The formula that the target computes, in ASCII.
    reads : str
        Input of the formula in words, such as "readings in m/s^2 and rad/s".
    remarks : tuple of str
        Settings and facts that the user of the file must know.
    correct_with_bias : callable or None
        Like `correct`, but including the bias. It is stated if the target estimates the bias itself
        and the file contains no bias.
    takes_output : bool
        Whether the input of the formula is the sensor's own output and not readings in SI.
    measured_only : bool
        Whether the file accepts only the channels in `ExportModel.inputs`, in this order.
    possible : callable or None
        Function: readings (n, k) in SI -> nearest readings that are whole counts. It is stated if
        the target uses counts.
    holds : mapping of "f", "w" or "m" to set of TermKind, or None
        The terms in this file, if its options omit some terms that the target can represent.
    rotation : (3,) array or None
        Rotation of the magnetometers' matrix that this file omits, as a rotation vector, rad.
    place : str
        Path of the file within the folder, if the target writes a folder; otherwise "".
    beside : mapping of str to str
        The contents of the other files of this folder, by path.
    states_u : bool
        Whether the file contains the uncertainties of the coefficients.
    """

    correct: Callable[[Array, Array], Array]
    write: Callable[[Sequence[str]], str]
    formula: tuple[str, ...]
    reads: str = "readings after the nominal readout, in m/s^2 and rad/s"
    remarks: tuple[str, ...] = ()
    correct_with_bias: Callable[[Array, Array], Array] | None = None
    takes_output: bool = False
    measured_only: bool = False
    possible: Callable[[Array], Array] | None = None
    holds: Mapping[str, frozenset[TermKind]] | None = None
    rotation: Array | None = None
    place: str = ""
    beside: Mapping[str, str] = field(default_factory=dict[str, str])
    states_u: bool = False


@dataclass(frozen=True)
class Target:
    """A program, device or language for which calibrations are written.

    Parameters
    ----------
    name, meaning : str
    suffix : str
        Suffix of the file, such as ".params"; empty for a folder.
    holds : mapping of "f", "w" or "m" to set of TermKind
        The terms of accelerometers, gyros and magnetometers that the target can apply; a missing
        kind of sensor is not supported.
    render : callable
        Function Request -> Rendering.
    options : tuple of TargetOption
    temperature_order : int
        The highest power of temperature that the target can apply to a bias.
    named_by_function : bool
        Whether the language finds the function by its file name, NAME_correct.
    is_folder : bool
        Whether the target writes a folder of files.
    """

    name: str
    meaning: str
    suffix: str
    holds: Mapping[str, frozenset[TermKind]]
    render: Callable[[Request], Rendering]
    options: tuple[TargetOption, ...] = ()
    temperature_order: int = 0
    named_by_function: bool = False
    is_folder: bool = False

    @property
    def file_suffix(self) -> str:
        """The suffix of a file name, such as ".px4.params", or ".export.csv" for target csv."""
        own = f".{self.name}"
        return f"{'.export' if own == self.suffix else own}{self.suffix}"
