"""Fixtures shared by all tests."""

import gc
import os
from collections.abc import Generator
from pathlib import Path

import pytest
from _pytest.doctest import DoctestModule
from tests.array_approx import compare_arrays_at_once
from tests.base_seeds import SEEDS
from tests.drawn_share import draw, read_commit
from tests.reports import report_file


@pytest.hookimpl(wrapper=True)
def pytest_collect_file() -> Generator[None, list[pytest.Collector], list[pytest.Collector]]:
    """Look for no doctests in tests: there are none, and to look takes as long as all else."""
    collectors = yield
    return [one for one in collectors if not isinstance(one, DoctestModule)]


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that takes a share of the tests."""
    parser.addoption(
        "--one-in",
        type=int,
        default=1,
        metavar="N",
        help="run one test function in N, drawn anew for each commit",
    )


def pytest_report_header(config: pytest.Config) -> str | None:
    """State which share of the tests is drawn."""
    one_in = config.getoption("one_in")
    if one_in == 1:
        return None
    return f"tests: one function in {one_in}, drawn by commit {read_commit(config.rootpath)}"


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is not drawn."""
    one_in = int(config.getoption("one_in") or 1)
    if one_in > 1:
        items[:], others = draw(items, one_in, read_commit(config.rootpath))
        config.hook.pytest_deselected(items=others)


def pytest_configure(config: pytest.Config) -> None:
    """Compare arrays as a whole, and compile each kernel in one of the processes side by side."""
    compare_arrays_at_once()
    if hasattr(config, "workerinput"):
        from tests.shared_compilation import compile_each_kernel_once

        compile_each_kernel_once(config.rootpath / ".pytest_cache" / "kernels")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """Look for no garbage in what is imported and collected, now or later: it stays to the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.collect()
        gc.freeze()


@pytest.fixture(scope="session")
def data_dir() -> Path:
    """Folder of real recordings, which are not part of the project."""
    root = Path(__file__).parents[1]
    folder = Path(os.environ.get("INERCAL_DATA", root.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data at {folder}; set INERCAL_DATA to its folder")
    return folder


@pytest.fixture(scope="session")
def reports_dir() -> Path:
    """Folder of inputs rebuilt from public reports, which are not part of the project."""
    return report_file("")


@pytest.fixture(params=SEEDS)
def seed(request: pytest.FixtureRequest) -> int:
    """Return a base seed."""
    return request.param
