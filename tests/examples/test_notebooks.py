"""The notebooks of the examples, run from begin to end by a kernel of their own."""

import warnings
from pathlib import Path

import nbformat
import numpy as np
import pytest
from nbclient import NotebookClient

from inercal.pipeline import calibrate

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(scope="module")
def quickstart() -> nbformat.NotebookNode:
    notebook = nbformat.read(EXAMPLES / "quickstart.ipynb", as_version=4)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of the kernel's own packages
        NotebookClient(notebook, timeout=120, kernel_name="python3").execute()
    return notebook


def test_the_quickstart_shows_the_coefficients_of_the_example(quickstart: nbformat.NotebookNode):
    shown = [
        output["data"]
        for cell in quickstart.cells
        if cell.cell_type == "code"
        for output in cell.outputs
        if "data" in output
    ]
    example = calibrate(EXAMPLES / "six_position" / "run.toml").calibration
    for name in example.sensor.coefficients:
        assert f"<td>{name}</td>" in shown[0]["text/html"]
        assert name in shown[1]["text/html"]
    assert any("image/png" in data for data in shown)
    corrected = example.correct(np.array([[0.0123, -0.0041, 1.0132]])).f.round(4)
    assert shown[-1]["text/plain"] == repr(corrected)


def test_no_output_is_stored_in_a_notebook():
    for path in EXAMPLES.glob("**/*.ipynb"):
        notebook = nbformat.read(path, as_version=4)
        assert not any(cell.get("outputs") for cell in notebook.cells), path
