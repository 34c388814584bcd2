"""Define the terms of interface, reports and public names, with symbols, units and sources.

The terms are in `glossary.toml`, and the coefficients come from the coefficient tables.
docs/reference/glossary.md is the output of ``python -m inercal.physics.glossary``.
"""

import re
import tomllib
from functools import cache
from importlib.resources import files
from typing import NamedTuple

from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors.coefficient_tables import TABLES, ErrorTerm

_INTRODUCTION = """# Glossary

The terms of inercal's interface, reports and public names. Definitions are in our own words. The
source column shows where a term is defined or used in this sense: IEEE Std 528 (inertial sensor
terminology), 836 (precision centrifuge testing), 952 (fibre-optic gyros), 1293 (accelerometers),
1431 (Coriolis vibratory gyros), 1554 (inertial sensor test equipment), VIM (JCGM 200), GUM
(JCGM 100).
[The error model](model.md) gives the equations and signs.
"""


class Term(NamedTuple):
    """A glossary term.

    Parameters
    ----------
    name, text : str
        The term and its definition.
    symbol, unit, source : str
        Its symbol, unit and source, empty if there is none.
    """

    name: str
    text: str
    symbol: str = ""
    unit: str = ""
    source: str = ""

    @property
    def anchor(self) -> str:
        """The term's name in the form used in link addresses."""
        return re.sub(r"[^a-z0-9]+", "-", self.name.lower().replace("é", "e")).strip("-")


class TermGroup(NamedTuple):
    """The terms of one field; `prefix` keeps the anchors of coefficient groups distinct."""

    title: str
    terms: tuple[Term, ...]
    prefix: str = ""


@cache
def glossary() -> tuple[TermGroup, ...]:
    """Return all terms grouped by field, with the coefficients last."""
    content = tomllib.loads(files("inercal").joinpath("glossary.toml").read_text(encoding="utf-8"))
    groups = [
        TermGroup(group["title"], tuple(Term(**term) for term in group["terms"]))
        for group in content["group"]
    ]
    for kind, table in TABLES.items():
        terms, sensors = tuple(map(_coefficient_term, table)), QUANTITIES[kind].sensors
        groups.append(TermGroup(f"Coefficients of {sensors}", terms, f"{sensors}-"))
    return tuple(groups)


def _coefficient_term(coefficient: ErrorTerm) -> Term:
    text = f"{coefficient.meaning[0].upper()}{coefficient.meaning[1:]}."
    return Term(coefficient.name, text, coefficient.symbol, coefficient.unit)


@cache
def _terms_by_name() -> dict[str, Term]:
    named: dict[str, Term] = {}
    for group in glossary():
        for term in group.terms:
            named.setdefault(term.name, term)
            if term.symbol:
                named.setdefault(term.symbol, term)
    return named


def find_term(name: str) -> Term:
    """Return the term with the given name or symbol.

    Raises
    ------
    KeyError
        The glossary has no such term.
    """
    return _terms_by_name()[name]


def glossary_markdown() -> str:
    """Return the glossary page of the documentation as Markdown."""
    parts = [_INTRODUCTION]
    for group in glossary():
        heads = "| term | symbol | unit | definition | source |\n|---|---|---|---|---|"
        lines = (
            f"| {term.name} | {term.symbol} | {term.unit} | {term.text} | {term.source} |"
            for term in group.terms
        )
        parts.append(f"## {group.title}\n\n{heads}\n" + "\n".join(lines) + "\n")
    return "\n".join(parts)


if __name__ == "__main__":
    print(glossary_markdown(), end="")
