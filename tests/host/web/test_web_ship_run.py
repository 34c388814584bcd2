"""A ship-model plan through the page: who operates confirms the mountings, and nobody else."""

from dataclasses import replace
from pathlib import Path

import pytest
from scipy.stats import chi2
from tests.host.test_ship_run import MOUNTINGS, ship, squared_error
from tests.host.web.pages import COMPILING, RUNNING, SIMULATED, Served

from inercal.host.journal import Journal
from inercal.host.web.run_request import RunProcess, RunRequest
from inercal.pipeline import calibrate
from inercal.runfile import read


def seeded(order: RunRequest) -> RunProcess:
    """Start a run on a bench that is the same whenever this is tested."""
    return RunProcess(replace(order, seed=1))


@pytest.mark.slow
def test_a_ship_plan_waits_for_who_operates_and_ends_in_a_calibration(tmp_path: Path):
    ship(tmp_path / "plans")
    with Served(tmp_path, start=seeded) as served, served.page() as page, served.page() as other:
        page.operate("Ada")
        page.say("start", plan="ship", sensor=None, **SIMULATED)
        plan = page.until("plan", COMPILING)
        assert (plan["spins"], plan["live"]) == (True, False)
        for k, mounting in enumerate(MOUNTINGS):
            asked = None
            while asked is None or asked["mounting"] != mounting:
                asked = page.until("state", RUNNING)["mounting"]
            if k == 0:
                other.say("mounted", number=asked["number"], mounting=mounting)
                other.until("refused", RUNNING)
                for wrong in (
                    {"number": "first", "mounting": mounting},
                    {"number": asked["number"]},
                ):
                    page.say("mounted", **wrong)
                    page.until("refused")
            page.say("mounted", number=asked["number"], mounting=mounting)
            if mounting == "YX":
                # A run that goes on has another simulated bench, and asks for no mounting again.
                page.until("state", RUNNING, phase="work")
                page.say("abort")
                page.until("done", RUNNING, state="interrupted")
                page.say("resume", run=plan["run"])
                page.until("plan", COMPILING)
        done = page.until("done", RUNNING)
        assert done["state"] == "done", done
        assert done["verdict"]["level"] != "bad", done
        folder = tmp_path / "runs" / plan["run"]
    with Journal(folder / "run.journal") as journal:
        confirmed = [one for one in journal.events() if "confirms" in one.words]
    assert [one.words.split()[0] for one in confirmed] == ["Ada"] * len(MOUNTINGS)
    assert all(one.time is not None for one in confirmed)
    run = read(folder / "ship.toml")
    found = calibrate(run).calibration
    assert squared_error(found, run) < chi2.ppf(0.999, found.values.size)
    told = dict(zip(done["final"]["names"], done["final"]["values"], strict=True))
    size = found.sensor.coefficient("ax.k0").si
    assert told["ax.k0"] == pytest.approx(found.value("ax.k0") / size, rel=1e-6)
