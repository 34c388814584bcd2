"""The folder of inputs rebuilt from public reports, which is not part of the project."""

import os
from pathlib import Path

import pytest


def report_file(name: str) -> Path:
    """Return an input by its name; skip the test where the folder is missing."""
    root = Path(__file__).parents[1]
    folder = Path(os.environ.get("INERCAL_REPORTS", root.parent / "shared" / "reports"))
    if not folder.is_dir():
        pytest.skip(f"no inputs of reports at {folder}; set INERCAL_REPORTS to their folder")
    return folder / name
