"""A simulated bench is the same whoever drives it: the page and the command line find the same."""

import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.host.simulated_runs import HEAD, INERCAL, plan, quick
from tests.host.web.pages import COMPILING, RUNNING, SIMULATED, Served

from inercal.basics.arrays import Array
from inercal.calibration.files import load
from inercal.host.assembly.table_polls import HOLD_POLL_FACTOR, POLL_INTERVAL
from inercal.host.bench_simulator import BenchSimulator
from inercal.host.web.run_request import RunProcess, RunRequest
from inercal.physics.plan import Position
from inercal.pipeline import calibrate
from inercal.recordings.io.hdf5 import read_group
from inercal.runfile import read

SEED = 3
FASTER = (
    'acceleration = ["15 °/s²"]',
    'acceleration = ["40 °/s²"]',
)
# Six positions and turns of half the rate: another path than that of the demonstration.
SLOWER = HEAD + (
    "warm-up,position,0,0,0,24,,,\n"
    "y up,position,0,90,0,8,,,\n"
    "y down,position,0,270,0,8,,,\n"
    "z down,position,0,180,0,8,,,\n"
    "x down,position,0,0,90,8,,,\n"
    "x up,position,0,0,-90,8,,,\n"
    "slanted,position,90,45,0,8,,,\n"
    "x+,rotation,0,0,0,,middle,360,20\n"
    "x-,rotation,,,,,middle,-360,20\n"
    "y+,rotation,,,,,inner,360,20\n"
    "y-,rotation,,,,,inner,-360,20\n"
    "z+,rotation,,,,,outer,360,20\n"
    "z-,rotation,,,,,outer,-360,20\n"
)
PLANS = {"demo": (quick(), ()), "faster": (quick(), (FASTER,)), "slower": (SLOWER, ())}


def seeded(order: RunRequest) -> RunProcess:
    return RunProcess(replace(order, seed=SEED))


def by_the_page(folder: Path) -> Path:
    """Carry the plan out through the page; return the run's folder."""
    with Served(folder, start=seeded) as served, served.page() as page:
        page.operate("Ada")
        page.say("start", plan="plan", sensor=None, **SIMULATED)
        run = page.until("plan", COMPILING)["run"]
        page.until("done", COMPILING + RUNNING)
        return folder / "runs" / run


def by_the_command_line(folder: Path) -> Path:
    """Carry the plan out by `inercal bench run`; return the run's folder."""
    with BenchSimulator(folder / "plans" / "plan.toml", SEED) as bench:
        addresses = ["--table", bench.table, "--imu", bench.imu, "--clock", str(bench.clock)]
        command = [*INERCAL, "bench", "run", str(folder / "plans" / "plan.toml"), *addresses]
        subprocess.run(
            [*command, "--out", str(folder / "run")], check=True, capture_output=True, timeout=600
        )
    return folder / "run"


@pytest.mark.parametrize(
    "name",
    [
        *(pytest.param(name, marks=pytest.mark.evidence) for name in ("faster", "demo", "slower")),
    ],
)
def test_page_and_command_line_find_the_same(tmp_path: Path, name: str):
    path, replaced = PLANS[name]
    steps_of_plan = plan(tmp_path / "plans", path, replaced).table_steps
    held = sum(step.seconds for step in steps_of_plan if isinstance(step, Position))
    one, other = by_the_page(tmp_path), by_the_command_line(tmp_path)
    polls = list[Array]()
    for folder in (one, other):
        group = read_group(folder / "recording.h5", "bench", ("time",))
        polls.append(group.arrays["time"])
    assert (polls[0] == polls[1]).all()
    # Polls fall on the bench's time, and as often as one setting says.
    steps = np.diff(polls[0])
    in_hold = HOLD_POLL_FACTOR * POLL_INTERVAL
    for wanted, least in ((POLL_INTERVAL, 1000), (in_hold, 0.9 * held / in_hold)):
        assert np.sum(np.abs(steps - wanted) < 1e-3) > least
    assert steps.max() < 1.1 * in_hold
    first, second = (load(folder / "plan.calibration.json") for folder in (one, other))
    sd = np.sqrt(np.diagonal(first.covariance))
    assert np.max(np.abs(first.values - second.values) / sd) < 1e-12
    np.testing.assert_allclose(first.covariance, second.covariance, rtol=1e-12)
    for group in calibrate(read(one / "plan.toml")).estimate.groups:
        assert 0.9 < group.chi2 / group.dof < 1.1, group.name
