"""Values of the options of a target, from the texts of the user."""

import math
from collections.abc import Mapping
from typing import Any, Protocol

from inercal.basics.errors import InputError
from inercal.basics.units import parse_quantity
from inercal.export.target_definition import TargetOption


class _WithOptions(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def options(self) -> tuple[TargetOption, ...]: ...


def resolve_options(of: _WithOptions, stated: Mapping[str, Any]) -> dict[str, Any]:
    """Return the value of every option of a target, or of a format to import.

    Parameters
    ----------
    of : Target or CalibrationReader
    stated : mapping of str to object
        Texts or values by name.

    Raises
    ------
    InputError
        An unknown option, a missing one, or a value that the option does not take.
    """
    known = {one.name: one for one in of.options}
    for name in stated:
        if name not in known:
            raise InputError(
                f"{of.name} has no option {name!r}; it has {', '.join(known) or 'no options'}",
                key="--set",
                names=(name,),
            )
    missing = [one for one in of.options if one.required and stated.get(one.name) is None]
    if missing:
        needs = "; ".join(f"--set {one.name}=… ({one.meaning})" for one in missing)
        raise InputError(
            f"{of.name} needs {needs}",
            key="--set",
            names=tuple(one.name for one in missing),
        )
    return {
        one.name: one.default if (value := stated.get(one.name)) is None else _value(one, value)
        for one in of.options
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


_WORDS: dict[type, str] = {int: "a whole number", float: "a number", str: "a text"}
