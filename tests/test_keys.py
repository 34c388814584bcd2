"""Names made of parts, and that nothing else takes them apart."""

import ast
import pickle
from collections.abc import Iterator
from copy import deepcopy

import pytest
from tests.source_trees import source_trees

from inercal.basics.keys import CoefficientName, ErrorName, ObservationName

# Modules, files and numbers are taken apart at their dots; no names of this project.
OTHER_TEXT = {
    # Sections of a run file, "sensor.gyro".
    "basics/run_file_advice.py",
    "basics/keys.py",
    "basics/errors.py",
    # Names of files.
    "cli/certificate_commands.py",
    "cli/import_command.py",
    "export/readers.py",
    "basics/units/quantity.py",
    "host/web/app.py",
    "runfile/filter_fields.py",
    # Columns of a log, "topic[1].field", and keys of a run file, "data.rate".
    "pipeline/drafts/__init__.py",
    "pipeline/drafts/column_names.py",
    "pipeline/drafts/draft_entries.py",
    "fleet/line.py",
    "pipeline/drafts/stated_keys.py",
    "recordings/io/dataflash.py",
    "recordings/io/message_columns.py",
    "recordings/io/ulog.py",
    # Names of modules, and a cookie, "number.signature".
    "recordings/io/isolation.py",
    "host/web/access.py",
}


@pytest.mark.parametrize(
    ("text", "axis", "term"), [("ax.k0", "ax", "k0"), ("k0", "", "k0"), ("wx.g_i", "wx", "g_i")]
)
def test_a_coefficient_is_an_axis_and_a_term(text: str, axis: str, term: str) -> None:
    name = CoefficientName(text)
    assert name.parts == (axis, term)
    assert not axis or CoefficientName.of(axis, term) == name


@pytest.mark.parametrize(
    ("text", "name", "place", "vector"),
    [
        ("radius", "radius", "", "radius"),
        ("pose_x[XY30]", "pose_x", "XY30", "pose[XY30]"),
        ("lean_2[a [b]]", "lean_2", "a [b]", "lean[a [b]]"),
        ("azimuth_z", "azimuth_z", "", "azimuth_z"),
        ("speed[86 rpm]", "speed", "86 rpm", "speed[86 rpm]"),
    ],
)
def test_an_error_is_a_name_and_a_place(text: str, name: str, place: str, vector: str) -> None:
    error = ErrorName(text)
    assert error.parts == (name, place)
    assert error.vector == vector
    assert not place or ErrorName.at(name, place) == error


def test_an_observation_is_a_channel_and_a_row() -> None:
    one = ObservationName("ax[XY30 at 90 rpm]")
    assert (one.channel, one.row) == ("ax", "XY30 at 90 rpm")


@pytest.mark.parametrize("name", [CoefficientName("ax.k0"), ErrorName("pose_x[XY30]")])
def test_keys_equal_their_text(name: str) -> None:
    text = str(name)
    assert {name: 1}[text] == 1
    assert hash(name) == hash(text)
    for copy in (deepcopy(name), pickle.loads(pickle.dumps(name))):
        assert (type(copy), copy) == (type(name), text)


def _splits(tree: ast.AST) -> Iterator[int]:
    """Yield the lines at which text is taken apart at a dot or a bracket."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(
                func=ast.Attribute(attr="partition" | "rpartition" | "split" | "rsplit"),
                args=[ast.Constant(value="." | "[" | "]"), *_],
            ):
                yield node.lineno
            case _:
                pass


@pytest.mark.slow
def test_no_other_module_splits_keys() -> None:
    found = [
        f"{path}:{line}"
        for path, tree in source_trees().items()
        if path not in OTHER_TEXT
        for line in _splits(tree)
    ]
    assert found == []
