"""The page of the dependencies is that of the installed packages."""

import platform
import sys
from importlib.metadata import requires

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from tests.examples.test_docs import rows, section
from tools.dependencies_page import PAGE, core_packages, extras, package

TEXT = PAGE.read_text(encoding="utf-8")
SYSTEM = f"{sys.platform} {platform.machine()}, Python {sys.version_info[0]}.{sys.version_info[1]}"
pytestmark = pytest.mark.skipif(
    SYSTEM not in TEXT, reason=f"the page is of another system than {SYSTEM}"
)


def test_the_page_lists_every_extra_with_what_it_asks_for():
    listed = {
        cells[0].strip("`"): (cells[1].split(", "), int(cells[2]))
        for cells in rows(section(TEXT, "Extras"))
    }
    assert listed == {name: (asked, len(added)) for name, (asked, added) in extras().items()}, (
        "run make dependencies"
    )


@pytest.mark.slow
def test_every_package_stands_with_its_version_and_licence():
    names = core_packages().union(*(added for _, added in extras().values()))
    listed = {
        canonicalize_name(cells[0]): (cells[1], cells[2])
        for cells in rows(section(TEXT, "Licences"))
    }
    assert listed == {
        name: (found.version, found.licence) for name in names for found in [package(name)]
    }, "run make dependencies"


def test_every_package_states_a_licence():
    assert not [cells for cells in rows(section(TEXT, "Licences")) if cells[2] == "not stated"]


def test_the_core_needs_the_packages_that_the_page_names():
    direct = {Requirement(one).name for one in requires("inercal") or () if "extra ==" not in one}
    assert direct == {"numba", "numpy", "pydantic", "rich", "scipy", "threadpoolctl", "typer"}
    words = section(TEXT, "The core")
    assert all(f"`{name}`" in words for name in direct)
