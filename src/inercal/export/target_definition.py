"""What a target of `inercal export` declares, as data, and what it returns."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import parse_quantity
from inercal.export.model import ExportModel
from inercal.export.ranges import Ranges
from inercal.export.term_kinds import TermKind

_WORDS: dict[type, str] = {int: "a whole number", float: "a number", str: "a text"}


@dataclass(frozen=True)
class TargetOption:
    """An option of a target or of a format to import.

    Parameters
    ----------
    name, meaning : str
    default : object
        None if it need not be stated and has no default.
    required : bool
    kind : type
        int, float or str; a text becomes one.
    like : str
        A unit of the dimension of a quantity ("0.8 mg"), which becomes a float in SI.
    choices : tuple of str
        The possible words.
    """

    name: str
    meaning: str
    default: Any = None
    required: bool = False
    kind: type[int] | type[float] | type[str] = float
    like: str = ""
    choices: tuple[str, ...] = ()


def resolve_options(
    of: str, options: Sequence[TargetOption], stated: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the value of every option of a target, or of a format to import.

    Parameters
    ----------
    of : str
        Name of the target or of the format.
    options : sequence of TargetOption
    stated : mapping of str to object
        Texts or values by name.

    Raises
    ------
    InputError
        An unknown option, a missing one, or a value that the option does not take.
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
            f"{of} needs {needs}",
            key="--set",
            names=tuple(one.name for one in missing),
        )
    return {
        one.name: one.default if (value := stated.get(one.name)) is None else _value(one, value)
        for one in options
    }


def _value(option: TargetOption, value: Any) -> Any:
    try:
        if option.like and isinstance(value, str):
            return parse_quantity(value, like=option.like).value
        if option.choices:
            if value not in option.choices:
                raise ValueError(f"give {' or '.join(option.choices)}")
            return value
        if option.kind is int:
            return int(value, 0) if isinstance(value, str) else int(value)
        found = option.kind(value)
        if isinstance(found, float) and not math.isfinite(found):
            raise ValueError
        return found
    except InputError as error:
        raise error.located(f"--set {option.name}", key="--set") from None
    except (TypeError, ValueError) as error:
        what = str(error) if option.choices else f"{option.meaning}: give {_WORDS[option.kind]}"
        raise InputError(
            f"--set {option.name}={value}: {what}", key="--set", names=(option.name,)
        ) from None


@dataclass(frozen=True)
class Request:
    """A calibration to write for a target.

    Parameters
    ----------
    model : ExportModel
    ranges : Ranges
    options : mapping of str to object
        Every option of the target, as declared.
    name : str
        An identifier (letters, digits, _) for names in code.
    check_reading : (1, k) array
        A reading in SI within the ranges, whose correction the file can state as a check.
    check_dT : (1,) array
        Its temperature, K from the reference.
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
        (readings (n, k) in SI, dT (n,)) -> motion (n, k): what the target computes, from the
        numbers as written. Channels and motion are those of `ExportModel`.
    write : callable
        Lines of explanation, ASCII -> the content of the file.
    formula : tuple of str
        What the target computes, in ASCII.
    reads : str
        What the formula takes: "readings in m/s^2 and rad/s".
    remarks : tuple of str
        What the user must set or know to use the file.
    correct_with_bias : callable or None
        As `correct`, where the target estimates the bias itself and the file has none.
    takes_output : bool
        Whether the formula takes the sensor's own output, not SI.
    possible : callable or None
        Readings (n, k) in SI -> the nearest readings in whole counts, if the target takes counts.
    holds : mapping of "f" or "w" to set of TermKind, or None
        The terms of this file, where its options leave out some that the target can hold.
    """

    correct: Callable[[Array, Array], Array]
    write: Callable[[Sequence[str]], str]
    formula: tuple[str, ...]
    reads: str = "readings after the nominal readout, in m/s^2 and rad/s"
    remarks: tuple[str, ...] = ()
    correct_with_bias: Callable[[Array, Array], Array] | None = None
    takes_output: bool = False
    possible: Callable[[Array], Array] | None = None
    holds: Mapping[str, frozenset[TermKind]] | None = None


@dataclass(frozen=True)
class Target:
    """A program, device or language that a calibration is written for.

    Parameters
    ----------
    name, meaning : str
    suffix : str
        Of the file, ".params".
    holds : mapping of "f" or "w" to set of TermKind
        The terms of accelerometers and gyros that it can apply; a kind that is absent is not taken.
    render : callable
        Request -> Rendering.
    options : tuple of TargetOption
    temperature_order : int
        The highest power of temperature of a bias that it can apply.
    named_by_function : bool
        Whether the language finds the function by the name of its file, NAME_correct.
    """

    name: str
    meaning: str
    suffix: str
    holds: Mapping[str, frozenset[TermKind]]
    render: Callable[[Request], Rendering]
    options: tuple[TargetOption, ...] = ()
    temperature_order: int = 0
    named_by_function: bool = False

    @property
    def file_suffix(self) -> str:
        """The end of the name of a file, ".px4.params"; of target csv ".csv"."""
        own = f".{self.name}"
        return own if own == self.suffix else f"{own}{self.suffix}"
