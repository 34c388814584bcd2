"""A method that the page has never heard of, brought by a package, live through a whole run."""

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from tests import rest_bias_method
from tests.host.simulated_runs import SHORT, plan
from tests.host.web.pages import COMPILING, RUNNING, SIMULATED, Served

from inercal.calibration import Calibration
from inercal.calibration.files import load
from inercal.host.tasks import RunOptions
from inercal.host.web.run_request import RunProcess, RunRequest
from inercal.methods import METHODS
from inercal.pipeline import calibrate
from inercal.runfile import read

NAMES = ["gx.bias", "gy.bias", "gz.bias"]


class Whole(NamedTuple):
    """What the page heard, the run's calibration, and the one made again of its recording."""

    heard: list[dict[str, Any]]
    stored: Calibration
    again: Calibration

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [one for one in self.heard if one["kind"] == kind]


def installed(folder: Path) -> Path:
    """Install the method as a package does, for processes that look in the folder."""
    info = folder / "rest_biases-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: rest-biases\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(
        "[inercal.methods]\nrest_biases = rest_biases:METHOD\n", encoding="utf-8"
    )
    shutil.copy(str(rest_bias_method.__file__), folder / "rest_biases.py")
    return folder


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Whole]:
    folder = tmp_path_factory.mktemp("served")
    site = installed(folder / "site")
    with pytest.MonkeyPatch.context() as patch:
        # Run, table and IMU are processes of their own; this one's installation is not touched.
        patch.setenv("PYTHONPATH", f"{site}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
        with METHODS.with_("rest_biases", rest_bias_method.METHOD):
            plan(folder / "plans", SHORT, [('name = "turntable_kalman"', 'name = "rest_biases"')])
            with Served(folder, start=seeded) as served, served.page() as page:
                page.operate("Ada")
                page.say("start", plan="plan", sensor="toy", **SIMULATED)
                run = page.until("plan", COMPILING)["run"]
                page.until("done", COMPILING + RUNNING)
                left = folder / "runs" / run
                again = calibrate(read(left / "plan.toml")).calibration
                yield Whole(page.heard, load(left / "plan.calibration.json"), again)


def seeded(order: RunRequest) -> RunProcess:
    return RunProcess(replace(order, seed=3, options=RunOptions(50.0)))


@pytest.mark.slow
def test_a_run_by_a_method_from_outside_ends_well(whole: Whole):
    (done,) = whole.of("done")
    assert done["state"] == "done", done
    assert whole.stored.method == "rest_biases"
    words = [one["words"] for one in whole.of("event")]
    assert "the live estimate is identical to that of the recording" in words
    assert whole.stored.values.tolist() == whole.again.values.tolist()
    assert whole.stored.covariance.tolist() == whole.again.covariance.tolist()


@pytest.mark.slow
def test_its_estimate_is_on_the_page_from_its_first_rest_to_the_end(whole: Whole):
    (told,) = whole.of("plan")
    assert [one["name"] for one in told["coefficients"]] == NAMES
    assert [one["live"] for one in whole.of("state")][-1] == "on"
    assert "ended" not in [one["live"] for one in whole.of("state")]
    estimates = whole.of("estimates")
    assert len(estimates) > 1
    first, last = estimates[0], estimates[-1]
    sizes = [whole.stored.sensor.coefficient(name).si for name in NAMES]
    # As many digits as the page shows.
    np.testing.assert_allclose(np.array(last["values"]) * sizes, whole.stored.values, rtol=1e-6)
    assert np.all(np.array(last["u2"]) < np.array(first["u2"]))
    assert set(last["nis"]) == {"all"}
    assert 0.9 < last["nis"]["all"]["ratio"] < 1.1
