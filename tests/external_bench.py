"""The example of a bench and a method of another package, as an installed package gives it."""

import importlib.util
import shutil
import sys
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType

from inercal.benches.kind_definition import KINDS
from inercal.methods import METHODS

FOLDER = Path(__file__).parents[1] / "examples" / "own_bench"


def load_example_module() -> ModuleType:
    """Return its module, which its classes find by its name."""
    if "tilt_table" not in sys.modules:
        spec = importlib.util.spec_from_file_location("tilt_table", FOLDER / "tilt_table.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules["tilt_table"] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules["tilt_table"])
    return sys.modules["tilt_table"]


@contextmanager
def register_example_bench(folder: Path) -> Generator[Path]:
    """Give a copy of its run file in a folder, its kind and its method being known."""
    module = load_example_module()
    shutil.copy(FOLDER / "tilt.toml", folder)
    with KINDS.with_("tilt_table", module.KIND), METHODS.with_("tilt_means", module.METHOD):
        yield folder / "tilt.toml"
