"""Provide the filter parameters of a run file for a form, with defaults, values and limits."""

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
    """One filter parameter.

    Parameters
    ----------
    key : str
        Key in [method.filter]. Keys in [method.filter.initial] are written as "initial.attitude".
    meaning : str
    default : str
        The estimator's default value, with its unit.
    stated : str
        Value stated in the run file; empty if none is stated.
    least, largest : str
        Limits of the value, with units; empty if the parameter is not a quantity.
    choices : tuple of str
        Possible values if the parameter is not a quantity.
    """

    key: str
    meaning: str
    default: str
    stated: str
    least: str = ""
    largest: str = ""
    choices: tuple[str, ...] = ()


def filter_fields(run: Run) -> tuple[FilterField, ...]:
    """Return the filter parameters of a run, or an empty tuple if the method has no filter.

    Raises
    ------
    InputError
        The run file can no longer be read.
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
    """Return the section [method.filter] of a run file with some parameters changed.

    Parameters
    ----------
    path : Path
    changes : mapping of str to str
        New values by `FilterField.key`; an empty text restores the default.

    Raises
    ------
    InputError
        A key does not exist, or the run file cannot be read.
    """
    section = _stated_section(path)
    initial: dict[str, Any] = dict(section.pop(_INITIAL, {}))
    for key, text in changes.items():
        place, _, name = key.rpartition(".")
        model = FilterInitialSection if place == _INITIAL else FilterSection
        if place not in ("", _INITIAL) or name not in model.model_fields or name == _INITIAL:
            raise InputError(f"{key!r} is not a filter parameter", key=key)
        own = initial if place else section
        own.pop(name, None)
        if text:
            # Other texts are passed on unchanged, and the check of the run file then rejects them.
            own[name] = {"true": True, "false": False}.get(text, text)
    return section | ({_INITIAL: initial} if initial else {})


def filter_errors(path: Path, changes: Mapping[str, str]) -> dict[str, str]:
    """Return an error message for each changed parameter with an invalid value, by key.

    The parameters are checked in the same way as in a run file. A message that does not concern a
    single parameter has the key "".
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
        return words.removeprefix(error.key).lstrip(": ") if error.key else words
    return None


def _stated_section(path: Path) -> dict[str, Any]:
    method: Any = read_toml(path, "run file").get("method", {})
    return dict(method.get("filter", {}))


__all__ = ["FILTER_KEY", "FilterField", "changed_section", "filter_errors", "filter_fields"]
