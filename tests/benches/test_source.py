"""What the source may not do: ask for the class of a bench outside benches/."""

import ast
from pathlib import Path

import pytest

import inercal
from inercal.benches.kind_definition import KINDS

SOURCE = Path(inercal.__file__).parent


def asked(tree: ast.AST) -> set[str]:
    """Return the names in second arguments of `isinstance` and `issubclass`, and in `type() is`."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id in ("isinstance", "issubclass"):
                found |= names_in(node.args[1])
        elif isinstance(node, ast.Compare) and any(isinstance(o, ast.Is) for o in node.ops):
            found |= set().union(*map(names_in, node.comparators))
    return found


def names_in(node: ast.AST) -> set[str]:
    """Return the names in an expression."""
    return {one.id for one in ast.walk(node) if isinstance(one, ast.Name)}


@pytest.mark.slow
def test_no_module_outside_benches_asks_for_the_class_of_a_bench():
    classes = {kind.bench.__name__ for kind in KINDS.values()}
    assert len(classes) == len(KINDS)
    outside = [p for p in SOURCE.rglob("*.py") if SOURCE / "benches" not in p.parents]
    assert len(outside) > 300
    for path in outside:
        text = path.read_text(encoding="utf-8")
        if any(name in text for name in classes):
            assert not asked(ast.parse(text)) & classes, path


def test_no_kind_imports_another():
    for name in KINDS:
        for path in (SOURCE / "benches" / name).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            others = [other for other in KINDS if f"inercal.benches.{other}." in text]
            assert set(others) <= {name}, path
