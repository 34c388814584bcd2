"""Every section of a run file can be given to `inercal.calibrate` beside data in memory."""

import inspect
import tomllib
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests.benches.generated_runs import simulate_run, write_run
from tests.fleet.lines import readings
from tests.refusals import refused

import inercal
from inercal.pipeline import Outcome
from inercal.recordings.data import DataSection
from inercal.runfile.schema import RunSchema

REQUIRED = ("sensor", "bench", "data", "method")


class Example(NamedTuple):
    """A method, and a section with its keys for the run file."""

    method: str
    header: str = ""
    keys: str = ""


EXAMPLES: Mapping[str, Example] = {
    "environment": Example("temperature_ramp", "[environment]", 'lag = "3 s ± 2 s"'),
    "specification": Example("six_position", "[specification]", 'limits = { bias = "± 20 mg" }'),
    "job": Example(
        "six_position",
        "[job]",
        'lab = "lab.toml"\nnumber = "2026-117"\nmeasured = 2026-11-25\noperating_hours = 3',
    ),
}
LAB = 'laboratory = "Test Laboratory"\naddress = "Wharf 2, Kiel"\n'


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "lab.toml").write_text(LAB, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run_file(folder: Path, example: Example) -> tuple[Path, dict[str, Any], dict[str, Any]]:
    """Return a run file, its data by columns, and its sections; [data] without its file."""
    path = write_run(example.method, folder)
    text = path.read_text(encoding="utf-8")
    if example.header not in text:
        text += f"\n{example.header}\n"
    added = (
        text.replace(example.header, f"{example.header}\n{example.keys}\n")
        if example.keys
        else text
    )
    path.write_text(added, encoding="utf-8")
    file = simulate_run(path, 2).file("made.npz")
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    del content["data"]["file"]
    return path, dict(np.load(file)), content


def in_memory(data: Mapping[str, Any], content: Mapping[str, Any]) -> Outcome:
    sections = {name: one for name, one in content.items() if name != "data"}
    return inercal.calibrate(dict(data), **sections, **content["data"])


def test_every_section_is_a_parameter_and_no_key_of_data_has_its_name():
    parameters = inspect.signature(inercal.calibrate).parameters
    sections = set(RunSchema.model_fields)
    assert sections - {"data"} <= set(parameters)
    assert set(EXAMPLES) == sections - set(REQUIRED)
    assert not sections & set(DataSection.model_fields)


@pytest.mark.parametrize("section", EXAMPLES)
def test_a_section_counts_in_memory_as_in_a_run_file(section: str, folder: Path):
    path, data, content = run_file(folder, EXAMPLES[section])
    assert section in content
    of_file, found = inercal.calibrate(path).calibration, in_memory(data, content).calibration
    np.testing.assert_array_equal(found.values, of_file.values)
    np.testing.assert_array_equal(found.covariance, of_file.covariance)
    assert found.conditions == of_file.conditions
    assert found.job == of_file.job
    assert (found.conformity is None) == (of_file.conformity is None)
    if found.conformity is not None and of_file.conformity is not None:
        assert found.conformity.limits == of_file.conformity.limits
    del content[section]
    without = in_memory(data, content).calibration
    facts = [(one.bench_estimates, one.job, one.conformity) for one in (found, without)]
    same = np.array_equal(found.covariance, without.covariance)
    assert facts[0] != facts[1] or not same


@pytest.mark.slow
@pytest.mark.parametrize("method", ["dual_orthogonal", "ferraris", "rates_and_poses"])
def test_nested_keys_count_in_memory_as_in_a_run_file(method: str, folder: Path):
    path, data, content = run_file(folder, Example(method))
    found, of_file = in_memory(data, content).calibration, inercal.calibrate(path).calibration
    np.testing.assert_array_equal(found.values, of_file.values)


def test_values_may_be_of_python_and_numpy(folder: Path):
    _, data, content = run_file(folder, EXAMPLES["job"])
    content["job"] |= {"operating_hours": np.float64(3), "lab": folder / "lab.toml"}
    content["data"]["accelerometer"] = tuple(content["data"]["accelerometer"])
    job = in_memory(data, content).calibration.job
    assert job is not None
    assert "Test Laboratory" in str(job)
    assert date(2026, 11, 25).isoformat() in str(job)


def test_two_calls_with_the_same_sections_have_one_digest(folder: Path):
    _, data, content = run_file(folder, EXAMPLES["job"])
    one, two = (in_memory(data, content).calibration.provenance for _ in range(2))
    assert {**one, "created": ""} == {**two, "created": ""}
    assert one["recording"] == "data.npz"


def test_a_wrong_key_of_a_section_is_refused_by_its_name(folder: Path):
    _, data, content = run_file(folder, EXAMPLES["specification"])
    content["specification"] = {"limit": "1 mg"}
    with refused(key="[specification.limits]"):
        in_memory(data, content)
    with pytest.raises(TypeError):
        inercal.calibrate(data, job={"number": "1"})


@pytest.mark.parametrize(("white", "factor"), [(1.0, 0.1), (10.0, None)])
def test_a_stated_bias_instability_does_not_hide_a_white_noise_that_is_too_small(
    white: float, factor: float | None
):
    columns, _ = readings(2)  # 0.1 mg per sample at 100 Hz, 10 µg/√Hz
    noise = {"white": f"{white} µg/√Hz", "bias_instability": "5 µg"}
    outcome = inercal.calibrate(
        columns,
        method="six_position",
        sensor={"accelerometer": {"unit": "g", **noise}},
        bench={"gravity": "9.81 m/s² ± 0.1 mm/s²", "tilt": "0.1 °"},
        time="t",
        label="face",
        marks="labels",
        accelerometer=["x", "y", "z"],
    )
    found = [one.factor for one in outcome.findings if one.what == "noise"]
    assert found == ([] if factor is None else [pytest.approx(factor, rel=0.3)])
