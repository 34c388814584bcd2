"""The notebooks of the examples, run by a kernel of their own, and the pages made of them."""

import json
import re
from pathlib import Path
from typing import Any

import nbformat
import numpy as np
import pytest
from tools.notebook_pages import PAGES, run_notebook

from inercal.pipeline import calibrate

EXAMPLES = Path(__file__).parents[2] / "examples"
NOTEBOOKS = sorted(EXAMPLES.glob("**/*.ipynb"))


def computed(name: str, expression: str) -> Any:
    """Return what an expression is at the end of a notebook."""
    notebook = run_notebook(
        EXAMPLES / f"{name}.ipynb", f"import json\nprint(json.dumps({expression}))"
    )
    return json.loads(notebook.cells[-1].outputs[0]["text"])


@pytest.fixture(scope="module")
def quickstart() -> nbformat.NotebookNode:
    return run_notebook(EXAMPLES / "quickstart.ipynb")


@pytest.mark.slow
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


@pytest.mark.slow
def test_the_methods_of_the_notebook_agree_on_one_sensor():
    found = computed(
        "compare_methods",
        "{'grades': [one.verdict.grade for one in made.values()], "
        "'p': [p.iloc[i, j] for i in range(7) for j in range(i)], "
        "'errors': [float((one.value(name) - parse_quantity(truth[name], SI_UNITS["
        "one.sensor.coefficient(name).unit]).value) / one.uncertainty(name)) for one in "
        "made.values() for name in shown if name in one.sensor.coefficients]}",
    )
    assert set(found["grades"]) <= {"consistent", "reservations"}
    assert len(found["p"]) == 21
    assert min(found["p"]) > 1e-3
    errors = np.array(found["errors"])  # in u
    assert np.abs(errors).max() < 4
    assert 0.4 < np.sqrt((errors**2).mean()) < 1.7


@pytest.mark.slow
def test_the_noise_of_the_notebook_mends_the_verdict_of_the_data_sheet():
    found = computed(
        "noise_to_filter",
        "{'white': [gyro.value('N'), device['gyro'].white], "
        "'flicker': [gyro.value('B'), device['gyro'].bias_instability], "
        "'rms': list((errors**2).mean() ** 0.5), "
        "'grades': [one.verdict.grade for one in outcomes.values()], "
        "'larger': list(plan['measured'] / plan['data sheet'])}",
    )
    for value, truth in (found["white"], found["flicker"]):
        assert value == pytest.approx(truth, rel=0.3)
    data_sheet, measured = found["rms"]
    assert 0.25 < measured < 0.8  # of U, k = 2: one half is expected
    assert data_sheet > 1.2 * measured
    assert found["grades"][1] == "consistent"
    assert found["grades"][0] != "consistent"
    assert min(found["larger"]) > 1


def test_no_output_is_stored_in_a_notebook():
    for path in NOTEBOOKS:
        notebook = nbformat.read(path, as_version=4)
        assert not any(cell.get("outputs") for cell in notebook.cells), path


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_the_page_of_a_notebook_has_its_text_and_code_in_order(path: Path):
    text = (PAGES / f"{path.stem}.md").read_text(encoding="utf-8")
    at = 0
    for cell in nbformat.read(path, as_version=4).cells:
        code = cell.cell_type == "code"
        found = text.find(f"```python\n{cell.source}\n```" if code else cell.source, at)
        assert found >= at, f"{cell.source}: run make notebooks"
        at = found + len(cell.source)
    for picture in re.findall(r"\]\((\S+)\.png\)", text):
        for end in ("", "-dark"):
            assert (PAGES / f"{picture}{end}.png").is_file()
