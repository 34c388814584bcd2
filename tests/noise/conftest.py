"""Fixtures of the tests of noise."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def reports_dir() -> Path:
    """Folder of failing inputs rebuilt from public reports, which are not part of the project."""
    root = Path(__file__).parents[2]
    folder = Path(os.environ.get("INERCAL_REPORTS", root.parent / "shared" / "reports"))
    if not folder.is_dir():
        pytest.skip(f"no reports at {folder}; set INERCAL_REPORTS to their folder")
    return folder
