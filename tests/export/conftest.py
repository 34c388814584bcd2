"""Fixtures of exports: a package for ROS 2 imported with a stand-in for ROS, and few samples."""

import importlib
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from tests.export.ros_exports import NAME, Loaded
from tests.export.ros_stand_in import World, modules

from inercal.export import Export


@pytest.fixture
def few_samples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the error of an export be computed at all corners of the range and few other motions."""
    monkeypatch.setattr("inercal.export.ranges._SAMPLES", 300)


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Loaded]:
    """Write a package and import one of its modules, with a world in which a node acts."""

    def loaded(made: Export, module: str = "node", **parameters: Any) -> tuple[ModuleType, World]:
        folder = tmp_path / "package"
        made.write(folder)
        place = folder / NAME / "__init__.py"
        spec = importlib.util.spec_from_file_location(
            NAME, place, submodule_search_locations=[str(place.parent)]
        )
        assert spec is not None
        world = World(parameters)
        for name, one in modules(world).items():
            monkeypatch.setitem(sys.modules, name, one)
        sys.modules[NAME] = importlib.util.module_from_spec(spec)
        return importlib.import_module(f"{NAME}.{module}"), world

    yield loaded
    for name in [one for one in sys.modules if one.split(".")[0] == NAME]:
        del sys.modules[name]
