"""The glossary, and words that stand in no public name."""

import ast
import re
from pathlib import Path

import pytest
from tests.source_trees import source_trees

from inercal.physics.glossary import find_term, glossary, glossary_markdown
from inercal.physics.sensors.coefficient_tables import TABLES

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "glossary.md"
# Our own words for what has a name in the field: none stands in a public name.
BANNED = frozenset(
    [
        "felt",
        "teller",
        "lanes",
        "kept",
        "people",
        "going",
        "carrying",
        "told",
        "asked",
        "ending",
        "keeper",
        "driven",
        "heard",
        "entering",
        "drawn",
        "gathered",
        "gather",
        "passage",
        "passages",
        "slip",
        "slips",
        "stands",
        "tremor",
        "alike",
        "wording",
        "fresh",
        "natural",
        "way",
        "thrown",
        "own",
        "say",
        "says",
        "saying",
        "goes",
        "lean",
        "leans",
        "lain",
        "sought",
    ]
)
NAMED = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


def words(text: str) -> set[str]:
    return {word.lower() for word in WORD.findall(text)}


def public_names() -> dict[str, str]:
    """Return every public class, function and method with the file that it stands in."""
    names: dict[str, str] = {}
    for path, tree in source_trees().items():
        bodies = [tree.body]
        while bodies:
            for node in bodies.pop():
                if not isinstance(node, NAMED) or node.name.startswith("_"):
                    continue
                names[node.name] = path
                bodies += [node.body] if isinstance(node, ast.ClassDef) else []
    return names


@pytest.mark.slow
def test_no_banned_word_stands_in_a_public_name():
    found = {f"{name}, {where}" for name, where in public_names().items() if words(name) & BANNED}
    assert sorted(found) == []


def test_every_coefficient_is_in_the_glossary():
    for table in TABLES.values():
        for coefficient in table:
            assert find_term(coefficient.symbol).symbol == coefficient.symbol
    listed = {term for group in glossary() for term in group.terms}
    assert {(term.name, term.unit) for term in listed} >= {
        (coefficient.name, coefficient.unit) for table in TABLES.values() for coefficient in table
    }


def test_no_term_is_defined_twice():
    general = [term for group in glossary()[: -len(TABLES)] for term in group.terms]
    names = [term.name for term in general]
    symbols = [term.symbol for term in general if term.symbol]
    assert len(set(names)) == len(names)
    # Lower-case r and p serve twice in the field too.
    assert {one for one in symbols if symbols.count(one) > 1} <= {"r"}


def test_the_page_of_the_documentation_is_the_glossary():
    assert PAGE.read_text(encoding="utf-8") == glossary_markdown()
