"""Objects by name, of this package and of others."""

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.refusals import refused

from inercal.basics.registry import Registry
from inercal.methods import METHODS

OWN = {"plain": "json:dumps", "missing": "inercal.none:NONE"}


def registry() -> Registry[object]:
    return Registry("inercal.tests", "thing", OWN)


def install_metadata(folder: Path, package: str, **points: str) -> None:
    """Make a package's metadata as an installation leaves them."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    lines = "".join(f"{name} = {value}\n" for name, value in points.items())
    (info / "entry_points.txt").write_text(f"[inercal.tests]\n{lines}")


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Path]:
    sys.path.insert(0, str(tmp_path))
    yield tmp_path
    sys.path.remove(str(tmp_path))


def test_a_name_of_this_package_is_imported_on_first_use() -> None:
    import json

    things = registry()
    assert list(things) == ["plain", "missing"]
    assert things["plain"] is json.dumps
    with pytest.raises(ModuleNotFoundError):
        things.find("missing")


def test_an_entry_point_registers_an_object(site: Path) -> None:
    install_metadata(site, "theirs", loads="json:loads")
    things = registry()
    assert list(things) == ["plain", "missing", "loads"]
    assert things.find("loads") is sys.modules["json"].loads


def test_a_package_may_not_take_a_name_of_this_one(site: Path) -> None:
    install_metadata(site, "theirs", plain="json:loads")
    with refused(names=["plain"]):
        registry().find("loads")


def test_two_packages_with_one_name_are_refused(site: Path) -> None:
    install_metadata(site, "first", loads="json:loads")
    install_metadata(site, "second", loads="json:load")
    with refused(names=["loads"]):
        registry().find("loads")


def test_an_entry_point_that_cannot_be_loaded_is_refused(site: Path) -> None:
    install_metadata(site, "theirs", broken="json:nothing")
    with refused(names=["broken"]):
        registry().find("broken")


@pytest.mark.parametrize("text", ["THING = 3", "THING = missing", "THING = ("])
def test_a_module_with_an_error_or_another_kind_of_object_is_refused(site: Path, text: str) -> None:
    (site / "bad_thing.py").write_text(text)
    install_metadata(site, "theirs", bad="bad_thing:THING")
    with refused(names=["bad"]):
        Registry("inercal.tests", "thing", {}, str).find("bad")
    sys.modules.pop("bad_thing", None)


def test_an_unknown_name_is_refused() -> None:
    with refused(names=["other"]):
        registry().find("other")


def test_with_registers_an_entry_temporarily() -> None:
    things = registry()
    with things.with_("more", 3):
        assert things.find("more") == 3
    assert "more" not in things
    with refused(names=["plain"]), things.with_("plain", 3):
        pass


def test_methods_have_the_names_they_are_registered_by() -> None:
    assert [method.name for method in METHODS.values()] == list(METHODS)
