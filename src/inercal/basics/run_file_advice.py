"""Advice as data: what to set in a run file, or what to do at the bench."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from inercal.basics.errors import InputError


@dataclass(frozen=True)
class Change:
    """One key of a run file and the value to give it: text, number or list, as TOML has them."""

    section: str
    key: str
    value: Any


@dataclass(frozen=True)
class Advice:
    """One piece of advice.

    Parameters
    ----------
    reason : str
        What it is for: the name of a cause.
    changes : tuple of Change
        Keys of the run file; none where the advice is something to do.
    action : str
        What to do at the bench; empty where keys change.
    chi2 : float or None
        χ² of the residuals after the changes, as `ScoreTestSet.chi2`; None where nothing of it is
        promised.
    """

    reason: str
    changes: tuple[Change, ...] = ()
    action: str = ""
    chi2: float | None = None

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The words that are added to [method] also."""
        return tuple(
            word
            for one in self.changes
            if (one.section, one.key) == ("method", "also")
            for word in one.value
        )


def with_changes(sections: Mapping[str, Any], changes: tuple[Change, ...]) -> dict[str, Any]:
    """Return the sections of a run file with changed keys; the section "sensor.gyro" is nested.

    Raises
    ------
    InputError
        A section whose place has a value.
    """
    result = dict(sections)
    for change in changes:
        place = result
        for name in change.section.split("."):
            inner: object = place.get(name, {})
            if not isinstance(inner, Mapping):
                raise InputError(f"[{change.section}] is no section", key=change.section)
            place[name] = dict(cast(Mapping[str, Any], inner))
            place = place[name]
        place[change.key] = change.value
    return result
