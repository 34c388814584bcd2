"""The parameters of a run file's filters, one by one, for a form: defaults, values, limits."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from inercal.basics.errors import InputError
from inercal.basics.small_files import read_toml
from inercal.runfile import Run, read
from inercal.runfile.filter_keys import FILTER_KEY, FILTER_METHOD, FILTER_RANGES
from inercal.runfile.schema import FilterInitialSection, FilterSection

_INITIAL = "initial"
_CHOICES: Mapping[str, tuple[str, ...]] = {
    "bias_drift": ("true", "false"),
    "table_states": ("whole", "lean", "exact"),
}


@dataclass(frozen=True)
class FilterField:
    """One parameter of the filters.

    Parameters
    ----------
    key : str
        Of [method.filter]; those of [method.filter.initial] as "initial.attitude".
    meaning : str
    default : str
        The estimator's own value, with its unit.
    stated : str
        As the run file states it; empty where it does not.
    least, largest : str
        Of a quantity, with units; else empty.
    choices : tuple of str
        What is possible, where it is no quantity.
    """

    key: str
    meaning: str
    default: str
    stated: str
    least: str = ""
    largest: str = ""
    choices: tuple[str, ...] = ()


def filter_fields(run: Run) -> tuple[FilterField, ...]:
    """Return the parameters of a run's filters; none of a method without filters.

    Raises
    ------
    InputError
        The run file cannot be read any more.
    """
    if run.method.name != FILTER_METHOD:
        return ()
    from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS

    section, result = _stated_section(run.path), list[FilterField]()
    for key, default in FILTER_CONFIGS[run.estimator].describe().items():
        place, _, name = key.rpartition(".")
        model, stated = (
            (FilterInitialSection, section.get(_INITIAL, {})) if place else (FilterSection, section)
        )
        value = stated.get(name)
        text = "" if value is None else str(value).lower() if value in (True, False) else str(value)
        limits = FILTER_RANGES.get(key)
        least, largest = ("", "") if limits is None else limits[1:]
        meaning = model.model_fields[name].description or ""
        field = FilterField(key, meaning, default, text, least, largest, _CHOICES.get(key, ()))
        result.append(field)
    return tuple(result)


def changed_section(path: Path, changes: Mapping[str, str]) -> dict[str, Any]:
    """Return [method.filter] of a run file with changes of its parameters.

    Parameters
    ----------
    path : Path
    changes : mapping of str to str
        By `FilterField.key`; "" takes the default.

    Raises
    ------
    InputError
        A key that is none, or a file that cannot be read.
    """
    section = _stated_section(path)
    initial: dict[str, Any] = dict(section.pop(_INITIAL, {}))
    for key, text in changes.items():
        place, _, name = key.rpartition(".")
        model = FilterInitialSection if place == _INITIAL else FilterSection
        if place not in ("", _INITIAL) or name not in model.model_fields or name == _INITIAL:
            raise InputError(f"{key!r} is not a parameter of the filters", key=key)
        own = initial if place else section
        own.pop(name, None)
        if text:
            # What is neither true nor false is refused as the run file's.
            own[name] = {"true": True, "false": False}.get(text, text)
    return section | ({_INITIAL: initial} if initial else {})


def filter_errors(path: Path, changes: Mapping[str, str]) -> dict[str, str]:
    """Return what is wrong with changed parameters, in words by key; "" where it is of no key.

    They are validated as the run file's are.
    """
    if (wrong := _error(path, changes)) is None:
        return {}
    found = {key: words for key in changes if (words := _error(path, {key: changes[key]}))}
    return found or {"": wrong}


def _error(path: Path, changes: Mapping[str, str]) -> str | None:
    try:
        section = changed_section(path, changes)
        read(path, {"filter": section or None})
    except InputError as error:
        words = str(error).removeprefix(f"{path}: ")
        return words.removeprefix(f"{error.key}: ") if error.key else words
    return None


def _stated_section(path: Path) -> dict[str, Any]:
    method: Any = read_toml(path, "run file").get("method", {})
    return dict(method.get("filter", {}))


__all__ = ["FILTER_KEY", "FilterField", "changed_section", "filter_errors", "filter_fields"]
