"""Advice on what to do about a cause of large residuals."""

from collections.abc import Collection, Sequence
from typing import Protocol, cast

from inercal.basics.run_file_advice import Advice, Change
from inercal.calibration.best_cause import SuspectedCause

CHANGE_PREFIX = "change "  # start of the name of a candidate for a change within one row


class Advisor(Protocol):
    """An advisor that tries its advice: it makes sure that a run file with the changes works."""

    def on_cause(self, cause: SuspectedCause) -> Advice:
        """Return keys that make the model include a cause, or else an action at the bench."""
        ...

    def on_coefficients(self, names: Sequence[str]) -> Advice | None:
        """Return the key that makes the method estimate undetectable coefficients, if it can."""
        ...

    def on_changes(self, advice: Advice) -> Advice | None:
        """Complete the keys in the advice of a method; None if the advice cannot be followed."""
        ...


class PlainAdvisor:
    """An advisor without a run, which cannot try its advice.

    Parameters
    ----------
    possible : collection of str
        Full names of the coefficients that the method can estimate.
    row_word : str
        Word for a row of the data, used in sentences.
    """

    def __init__(self, possible: Collection[str], row_word: str) -> None:
        self._possible, self._row_word = possible, row_word

    def on_cause(self, cause: SuspectedCause) -> Advice:
        """Return the key that makes the method estimate the coefficient, or an action."""
        if cause.kind == "coefficient" and set(cause.components) <= set(self._possible):
            return Advice(cause.name, (also((cause.name,)),), chi2=cause.remaining_chi2)
        return Advice(cause.name, action=action_on(cause, self._row_word))

    def on_coefficients(self, names: Sequence[str]) -> Advice | None:
        """Return the key that makes the method estimate these coefficients."""
        return Advice(", ".join(names), (also(names),)) if names else None

    def on_changes(self, advice: Advice) -> Advice | None:
        """Return the advice unchanged."""
        return advice


def also(words: str | Sequence[str]) -> Change:
    """Return the [method] key `also`, which adds coefficients by their words, or "auto"."""
    return Change("method", "also", words if isinstance(words, str) else tuple(words))


def action_on(cause: SuspectedCause, row_word: str) -> str:
    """Describe what to do at the bench about a cause that no run-file key can include."""
    if cause.kind == "coefficient":
        return "use a method that estimates this coefficient; U does not include its effect"
    if cause.name == "latitude":
        return "check the latitude and its sign, and the names and signs of the gyros' columns"
    if cause.kind == "bench":
        return "measure it again, or state it with its true uncertainty"
    if cause.units[:1] == ("T",):
        again = f"this {row_word}" if cause.kind == "row" else "the recording"
        return f"keep iron, magnets and currents away, and repeat {again}"
    if cause.kind == "row":
        return f"look at the readings of “{cause.name}”, and repeat this {row_word}"
    if cause.name.startswith(CHANGE_PREFIX):
        return f"check whether the sensor was touched; repeat this {row_word} or remove it"
    return "let the sensor settle before the run, or repeat the first positions at the end"


def changes_text(changes: Sequence[Change]) -> str:
    """Return changes as text for a run file: '[method] also = ["k2"]'."""
    return " and ".join(f"[{one.section}] {one.key} = {_toml(one.value)}" for one in changes)


def _toml(value: object) -> str:
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(_toml(one) for one in cast(Sequence[object], value))}]"
    return str(value).lower() if isinstance(value, bool) else str(value)
