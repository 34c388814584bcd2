"""Files of every schema so far are read: each is stored as a version of inercal wrote it."""

import json
import re
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import inercal
from inercal.benches.qualification.result import load as load_qualification
from inercal.calibration.check_standard import load_check_standard
from inercal.calibration.files import load
from inercal.calibration.specification import load_next_use
from inercal.pipeline.bundles import reproduce_bundle

STORED = Path(__file__).with_name("stored")
_SCHEMA = re.compile(r'"inercal/(\w+)/(\d+)"')


def stored(name: str) -> Path:
    (path,) = STORED.glob(f"{name}.*")
    return path


def content(name: str) -> Any:
    return json.loads(stored(name).read_text(encoding="utf-8"))


def test_a_file_of_every_schema_that_the_code_names_is_stored():
    source = Path(inercal.__file__).parent
    named = {
        f"{kind}_{number}"
        for path in source.rglob("*.py")
        for kind, number in _SCHEMA.findall(path.read_text(encoding="utf-8"))
    }
    assert {path.name.split(".")[0] for path in STORED.iterdir()} == named


def test_the_page_of_what_stays_stable_lists_every_stored_schema():
    text = (Path(__file__).parents[2] / "docs" / "reference" / "stability.md").read_text("utf-8")
    for path in STORED.iterdir():
        kind, number = path.name.split(".")[0].rsplit("_", 1)
        assert f"`inercal/{kind}/{number}`" in text


def test_a_calibration_has_the_numbers_of_its_file():
    found, written = load(stored("calibration_2")), content("calibration_2")
    rows = written["coefficients"]
    assert [one["name"] for one in rows] == list(found.sensor.coefficients)
    np.testing.assert_array_equal([one["value"] for one in rows], found.values)
    np.testing.assert_array_equal(written["covariance"], found.covariance)
    upright = found.sensor.axes[0].readout.scale * np.array([[9.8, 0.0, 0.0]])
    corrected = found.correct(upright, w=np.zeros((1, 3)))
    assert np.linalg.norm(corrected.f) == pytest.approx(9.8, abs=0.3)


def test_a_calibration_keeps_shared_errors_order_and_conformity():
    found = load(stored("calibration_2"))
    assert found.shared
    assert found.validity is not None
    assert found.job["customer"] == "Basin No. 3"
    assert found.conformity is not None
    assert found.verdict is not None


def test_a_qualification_has_the_covariance_of_its_file():
    found, written = load_qualification(stored("qualification_1")), content("qualification_1")
    np.testing.assert_array_equal(found.covariance, written["covariance"])


def test_a_scatter_between_uses_has_the_covariance_of_its_file():
    found, written = load_next_use(stored("repeatability_1")), content("repeatability_1")
    np.testing.assert_array_equal(found.covariance, written["scatter"])


def test_a_control_chart_says_which_run_is_doubtful():
    found = load_check_standard(stored("control_1"))
    assert len(found.points) == len(content("control_1")["points"])
    assert not found.state(date(2026, 3, 21), None).warnings
    assert found.state(date(2026, 3, 24), None).warnings


def test_a_bundle_is_computed_again():
    assert reproduce_bundle(stored("bundle_1")).reproduced
