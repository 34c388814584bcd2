"""Store advice as data: changes to a run file, or actions at the bench."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

from inercal.basics.errors import InputError


@dataclass(frozen=True)
class Change:
    """One key of a run file and its new value: a text, number or list, as in TOML."""

    section: str
    key: str
    value: Any


@dataclass(frozen=True)
class Advice:
    """One piece of advice.

    Parameters
    ----------
    reason : str
        Name of the cause that the advice addresses.
    changes : tuple of Change
        Changes to keys of the run file; empty if the advice is an action.
    action : str
        Action at the bench; empty if keys change.
    chi2 : float or None
        Predicted χ² of the residuals after the changes, as in `ScoreTestSet.chi2`; None if there is
        no prediction.
    """

    reason: str
    changes: tuple[Change, ...] = ()
    action: str = ""
    chi2: float | None = None

    @property
    def coefficients(self) -> tuple[str, ...]:
        """The words to add to the key `also` in [method]."""
        added = (one.value for one in self.changes if (one.section, one.key) == ("method", "also"))
        return tuple(word for words in added for word in words)


def with_changes(sections: Mapping[str, Any], changes: tuple[Change, ...]) -> dict[str, Any]:
    """Return the sections of a run file with changed keys; "sensor.gyro" is a nested section.

    Raises
    ------
    InputError
        A name that should be a section already has a value that is not a section.
    """
    result = dict(sections)
    for change in changes:
        place = result
        for name in change.section.split("."):
            inner: object = place.get(name, {})
            if not isinstance(inner, Mapping):
                raise InputError(f"[{change.section}] is not a section", key=change.section)
            place[name] = dict(cast(Mapping[str, Any], inner))
            place = place[name]
        place[change.key] = change.value
    return result
