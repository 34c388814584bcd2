"""Limits that are judged by the U of the next use: a certificate states that judgement."""

from dataclasses import replace
from math import inf
from pathlib import Path

import numpy as np
import pytest
from tests.certificate.conftest import Laboratory
from tests.certificate.dcc_xml import etree
from tests.certificate.pdf_text import page_texts, squeezed
from tests.repeatability.example import repeat_example

import inercal
from inercal.calibration import Calibration
from inercal.calibration.files import load
from inercal.calibration.specification import Conformity
from inercal.estimation.uncertainty.conformity import DecisionRule
from inercal.laboratory.certificate.results import acceptance_risk, judge_results, make_results

SPECIFICATION = """
[specification]
uncertainty = "next_use"
repeatability = "TRIAD-7.repeatability.json"

[specification.limits]
bias = "± {bias:.0f} µg"
"""


@pytest.fixture(scope="module")
def calibration_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a calibration that passes by the U of its session and not by that of the next use."""
    folder = tmp_path_factory.mktemp("repeat")
    repeat_example(folder)
    session = load(folder / "session_4.calibration.json")
    biases = [k for k, name in enumerate(session.sensor.coefficients) if name.endswith(".k0")]
    largest = max(abs(session.values[k]) + 2.2 * session.std[k] for k in biases)
    limit = largest / session.sensor.coefficient("ax.k0").si
    run = folder / "limits.toml"
    text = (folder / "session_4.toml").read_text(encoding="utf-8")
    run.write_text(text + SPECIFICATION.format(bias=limit), encoding="utf-8")
    return inercal.save(inercal.calibrate(run).calibration, folder / "run.calibration.json")


@pytest.fixture
def calibration(calibration_file: Path) -> Calibration:
    return load(calibration_file)


def conformity(calibration: Calibration, capability: float = 0.0, dof: float = inf) -> Conformity:
    """Return the judgement of a certificate, with one smallest U of all biases, SI."""
    smallest = {f"{axis}.k0": capability for axis in ("ax", "ay", "az")} if capability else None
    found = judge_results(make_results(calibration, smallest, dof))
    assert found is not None
    return found


@pytest.mark.slow
def test_the_certificate_keeps_the_judgement_by_the_next_use(calibration: Calibration):
    stated = calibration.conformity
    assert stated is not None
    assert conformity(calibration) == stated
    assert stated.result == "conditional pass"
    # Degrees of freedom of the session change neither the U of the next use nor its risk.
    assert conformity(calibration, dof=3.0) == stated
    part = replace(stated, rule=DecisionRule(factor=0.83))
    assert acceptance_risk(part, 3.0) == pytest.approx(0.0485, rel=3e-3)
    assert acceptance_risk(replace(part, uncertainty="session"), 3.0) < 0.045
    # By the U of the session the same limits are kept with a margin.
    session = replace(calibration, conformity=replace(stated, uncertainty="session"))
    assert conformity(session).accepted


def test_a_capability_that_raises_u_raises_that_of_the_next_use(calibration: Calibration):
    stated = calibration.conformity
    assert stated is not None
    session = calibration.std[list(calibration.sensor.coefficients).index("ax.k0")]
    smallest = 40 * session
    raised = conformity(calibration, smallest)
    assert raised.uncertainty == "next_use"
    for before, after in zip(stated.limits, raised.limits, strict=True):
        own = calibration.uncertainty(before.name)
        expected = np.sqrt(before.std**2 + (smallest / 2) ** 2 - own**2)
        assert after.std == pytest.approx(expected, rel=1e-9)
        assert after.guard == pytest.approx(2 * expected, rel=1e-9)
    worst = min(one.probability for one in stated.limits)
    assert min(one.probability for one in raised.limits) < worst
    assert raised.probability < stated.probability


def test_pages_and_dcc_name_the_next_use(
    calibration_file: Path, laboratory: Laboratory, tmp_path: Path
):
    stated = load(calibration_file).conformity
    assert stated is not None
    laboratory.calibration = calibration_file
    laboratory.change('bias = "20 µg"', 'bias = "1 µg"')
    job = tmp_path / "job.toml"
    job.write_text(
        '[job]\ncustomer = "Basin No. 3"\ncustomer_address = "Kiel"\nserial_number = "7"\n'
        'condition = "new"\nmeasured = 2026-11-25\n',
        encoding="utf-8",
    )
    pdf = laboratory.issue("--job", job)
    text = "".join(page_texts(pdf))
    assert squeezed("for the next use of the sensor") in text
    assert squeezed("Overall result: conditional pass") in text
    root = etree.parse(pdf.with_suffix(".xml")).getroot()
    words = {"pass": "pass", "conditional pass": "conditionalPass"}
    found = [one.text for one in root.iterfind(".//{*}metaData/{*}conformity")]
    assert found == [words[stated.result], *(words[one.result] for one in stated.limits)]
