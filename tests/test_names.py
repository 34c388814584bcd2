"""Names in the source: one name for one public class."""

import ast
from collections import Counter
from pathlib import Path

import inercal

SOURCE = Path(inercal.__file__).parent


def test_no_two_public_classes_share_a_name():
    names = Counter(
        node.name
        for path in SOURCE.rglob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert sum(names.values()) > 300
    assert [name for name, count in names.items() if count > 1] == []
