"""Advice on a cause: what of it can be followed is known by what runs the calibration again."""

from collections.abc import Collection, Sequence
from typing import Protocol, cast

from inercal.basics.run_file_advice import Advice, Change
from inercal.calibration.best_cause import SuspectedCause

CHANGE_PREFIX = "change "  # begins the name of a candidate that changes within one row


class Advisor(Protocol):
    """Gives advice that was tried: a run file with the changes is accepted."""

    def on_cause(self, cause: SuspectedCause) -> Advice:
        """Return the keys that count or estimate a cause; an action where none do."""
        ...

    def on_coefficients(self, names: Sequence[str]) -> Advice | None:
        """Return the key that estimates coefficients of which no test shows anything, if any."""
        ...

    def on_changes(self, advice: Advice) -> Advice | None:
        """Return the advice of a method with its key completed, if it can be followed."""
        ...


class PlainAdvisor:
    """An advisor without a run: it believes what the method can estimate.

    Parameters
    ----------
    possible : collection of str
        Full names of the coefficients that the method can estimate.
    row_word : str
        Word for a row of the data.
    """

    def __init__(self, possible: Collection[str], row_word: str) -> None:
        self._possible, self._row_word = possible, row_word

    def on_cause(self, cause: SuspectedCause) -> Advice:
        """Return the key that estimates a coefficient, or an action."""
        if cause.kind == "coefficient" and set(cause.components) <= set(self._possible):
            return Advice(cause.name, (also((cause.name,)),), chi2=cause.remaining_chi2)
        return Advice(cause.name, action=action_on(cause, self._row_word))

    def on_coefficients(self, names: Sequence[str]) -> Advice | None:
        """Return the key that estimates coefficients."""
        return Advice(", ".join(names), (also(names),)) if names else None

    def on_changes(self, advice: Advice) -> Advice | None:
        """Return the advice."""
        return advice


def also(words: str | Sequence[str]) -> Change:
    """Return the key that lets a method estimate more coefficients: words, or "auto"."""
    return Change("method", "also", words if isinstance(words, str) else tuple(words))


def action_on(cause: SuspectedCause, row_word: str) -> str:
    """Return what to do at the bench about a cause that no key counts."""
    if cause.kind == "coefficient":
        return "use a method that estimates this coefficient; U does not include its effect"
    if cause.kind == "bench":
        return "measure it again, or state it with its true uncertainty"
    if cause.kind == "row":
        return f"look at the readings of {cause.name}, and repeat this {row_word}"
    if cause.name.startswith(CHANGE_PREFIX):
        return f"check whether the sensor was touched; repeat this {row_word} or remove it"
    return "let the sensor settle before the run, or repeat the first positions at the end"


def changes_text(changes: Sequence[Change]) -> str:
    """Return changes as a run file has them: '[method] also = ["k2"]'."""
    return " and ".join(f"[{one.section}] {one.key} = {_toml(one.value)}" for one in changes)


def _toml(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(one) for one in cast(Sequence[object], value))}]"
    return str(value).lower() if isinstance(value, bool) else str(value)
