"""Names in the source: one name for one public class, and files that a name tells apart."""

import ast
from collections import Counter
from pathlib import Path

import inercal

SOURCE = Path(inercal.__file__).parent
# Each kind of bench has these; private kernels are compiled files beside what they serve.
OF_EACH_KIND = {"bench.py", "kind.py", "reading.py", "report.py", "settings.py", "simulation.py"}
OF_EACH_PACKAGE = {"__init__.py", "_kernels.py"}
MOST = 2  # files of one name


def test_no_two_public_classes_share_a_name():
    names = Counter(
        node.name
        for path in SOURCE.rglob("*.py")
        for node in ast.parse(path.read_text(encoding="utf-8")).body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert sum(names.values()) > 300
    assert [name for name, count in names.items() if count > 1] == []


def test_no_file_name_stands_more_than_twice():
    names = Counter(
        path.name
        for path in SOURCE.rglob("*.py")
        if not (path.parent.parent == SOURCE / "benches" and path.name in OF_EACH_KIND)
    )
    often = {name for name, count in names.items() if count > MOST}
    assert often <= OF_EACH_PACKAGE
