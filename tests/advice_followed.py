"""Advice of a verdict, followed: the run file is written anew with the keys that it names.

The run file is read and written as text here, apart from the product.
"""

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import inercal
from inercal.basics.errors import InercalError
from inercal.basics.run_file_advice import Advice
from inercal.pipeline import Outcome


@dataclass(frozen=True)
class Followed:
    """What came of a piece of advice.

    Parameters
    ----------
    advice : Advice
    refused : str
        Why the run with the changes was refused; empty where it was accepted.
    before, after : float
        χ² of the residuals.
    explained : float or None
        By how much the named cause lowers χ², where the advice is on it.
    """

    advice: Advice
    refused: str
    before: float
    after: float
    explained: float | None

    @property
    def kept(self) -> bool:
        """Whether the run was accepted, and χ² fell as promised within 10 %."""
        if self.refused:
            return False
        if self.advice.chi2 is None:
            return True
        fall, promised = self.before - self.after, self.before - self.advice.chi2
        near = abs(fall - promised) <= 0.1 * abs(promised) + 1e-6
        # The size is that of a deviation, which costs a unit of χ² for each component.
        return near and (self.explained is None or fall >= 0.9 * self.explained - 6)


def follow_all(run_file: Path, outcome: Outcome) -> list[Followed]:
    """Follow every piece of advice of a verdict that changes keys, each by itself."""
    verdict, found = outcome.verdict, list[Followed]()
    before = outcome.estimate.score_tests.chi2
    for k, advice in enumerate(one for one in verdict.advice if one.changes):
        content = tomllib.loads(run_file.read_text(encoding="utf-8"))
        for change in advice.changes:
            place = content
            for name in change.section.split("."):
                place = place.setdefault(name, {})
            place[change.key] = change.value
        changed = run_file.with_name(f"{run_file.stem}.advice{k}.toml")
        changed.write_text("".join(_lines(content)), encoding="utf-8")
        suspect = verdict.suspect
        explained = suspect.chi2 if suspect and suspect.name == advice.reason else None
        try:
            after = inercal.calibrate(changed).estimate.score_tests.chi2
        except InercalError as error:
            found.append(Followed(advice, str(error), before, before, explained))
        else:
            found.append(Followed(advice, "", before, after, explained))
    return found


def _lines(content: Mapping[str, Any], name: str = "") -> list[str]:
    """Return TOML of a section and its sections."""
    values = {k: v for k, v in content.items() if not isinstance(v, Mapping)}
    lines = [f"[{name}]\n"] if name else []
    lines += [f"{json.dumps(k, ensure_ascii=False)} = {_value(v)}\n" for k, v in values.items()]
    for key, inner in content.items():
        if isinstance(inner, Mapping):
            lines += _lines(inner, f"{name}.{key}" if name else key)
    return lines


def _value(value: object) -> str:
    if isinstance(value, list):
        return f"[{', '.join(_value(one) for one in value)}]"
    return json.dumps(value, ensure_ascii=False) if isinstance(value, str | bool) else repr(value)
