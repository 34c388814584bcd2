"""The search for a path of a calibration by navigation."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.benches.turntable import require_turntable
from inercal.benches.turntable.paths import read_path
from inercal.benches.turntable.simulation import turntable_path_duration
from inercal.cli.app import app
from inercal.physics.plan import Position
from inercal.pipeline.design.path_search import path_table, search_path
from inercal.pipeline.design.turntable_path import path_uncertainties
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
RUN = EXAMPLES / "systematic" / "imu.toml"
SHORT = 500.0  # s
SILENT = lambda tried: None  # noqa: E731


@pytest.mark.slow
def test_a_found_path_turns_about_level_axes_within_limits_and_time(tmp_path: Path):
    run = read(RUN, {"path": "systematic", "seconds": "20 s"})
    bench = require_turntable(run)
    found = search_path(run, SHORT, 6, 1, SILENT)
    assert turntable_path_duration(bench, found.steps) <= SHORT
    quarters = np.array([one.angles for one in found.steps]) / np.radians(90)
    np.testing.assert_allclose(quarters, np.rint(quarters), atol=1e-9)
    assert quarters.min() >= 0 and quarters.max() <= 3  # noqa: PT018
    for before, change in zip(quarters, np.diff(quarters, axis=0), strict=False):
        assert np.abs(change).sum() == 1
        assert change[0] == 0
        # The inner axis is level where the middle one is at 0° or 180°.
        assert change[2] == 0 or round(before[1]) % 2 == 0
    # The file is read as it was meant.
    path = tmp_path / "path.csv"
    path.write_text(path_table(found.steps, bench.names), encoding="utf-8")
    read_again = read_path(path, bench.names)
    assert all(isinstance(one, Position) for one in read_again)
    np.testing.assert_allclose(
        [one.angles for one in read_again if isinstance(one, Position)], quarters * np.radians(90)
    )


@pytest.mark.slow
def test_the_search_lowers_the_uncertainties_and_says_by_how_much():
    run = read(RUN, {"path": "systematic", "seconds": "20 s"})
    first, found = (search_path(run, SHORT, trials, 1, SILENT) for trials in (1, 24))
    assert found.ratio < 0.99 * first.ratio
    u = [
        np.array([one.std for one in path_uncertainties(run, steps, 10.0)[0]])
        for steps in (found.steps, run.table_steps)
    ]
    assert found.ratio == pytest.approx(np.exp(np.mean(np.log(u[0] / u[1]))), rel=1e-6)


def test_what_cannot_be_searched_is_refused(tmp_path: Path):
    run = read(RUN)
    with refused(key="--optimise"):
        search_path(run, 60.0, 5, 0, SILENT)
    with refused(key="--optimise"):
        search_path(read(EXAMPLES / "turntable" / "mimu.toml"), SHORT, 5, 0, SILENT)
    kept = tmp_path / "path.csv"
    kept.write_text("mine", encoding="utf-8")
    for arguments in (
        ["--optimise", "5 kg"],
        ["--trials", "3"],
        ["--optimise", "5 min", "--out", str(tmp_path / "path.txt")],
        ["--optimise", "5 min", "--trials", "4", "--out", str(kept)],
    ):
        with refused():
            app(["plan", str(RUN), *arguments], standalone_mode=False)
    assert kept.read_text(encoding="utf-8") == "mine"
