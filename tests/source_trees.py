"""The syntax trees of the package's modules, parsed once for all tests of a process."""

import ast
from functools import cache
from pathlib import Path

import inercal

SOURCE = Path(inercal.__file__).parent


@cache
def source_trees() -> dict[str, ast.Module]:
    """Return the tree of each module by its path in the package, in order of the paths."""
    return {
        path.relative_to(SOURCE).as_posix(): ast.parse(path.read_text(encoding="utf-8"))
        for path in sorted(SOURCE.rglob("*.py"))
    }
