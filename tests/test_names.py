"""Names in the source: one name for one public class."""

import ast
from collections import Counter

from tests.source_trees import source_trees


def test_no_two_public_classes_share_a_name():
    names = Counter(
        node.name
        for tree in source_trees().values()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    )
    assert sum(names.values()) > 300
    assert [name for name, count in names.items() if count > 1] == []
