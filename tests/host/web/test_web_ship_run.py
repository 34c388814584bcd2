"""A ship-model plan through the page: who operates confirms the mountings, and nobody else."""

from dataclasses import replace
from pathlib import Path

import pytest
from tests.host.test_ship_run import MOUNTINGS, ship
from tests.host.web.pages import COMPILING, RUNNING, SIMULATED, Served

from inercal.host.journal import Journal
from inercal.host.web.run_process import RunProcess
from inercal.host.web.run_request import RunRequest
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
                other.say("mounted", number=asked["number"])
                other.until("refused", RUNNING)
                page.say("mounted", number="first")
                page.until("refused")
            page.say("mounted", number=asked["number"])
        done = page.until("done", RUNNING)
        assert done["state"] == "done", done
        folder = tmp_path / "runs" / plan["run"]
    with Journal(folder / "run.journal") as journal:
        confirmed = [one for one in journal.events() if "confirms" in one.words]
    assert [one.words.split()[0] for one in confirmed] == ["Ada"] * len(MOUNTINGS)
    assert all(one.time is not None for one in confirmed)
    found = calibrate(read(folder / "ship.toml")).calibration
    told = dict(zip(done["final"]["names"], done["final"]["values"], strict=True))
    size = found.sensor.coefficient("ax.k0").si
    assert told["ax.k0"] == pytest.approx(found.value("ax.k0") / size, rel=1e-6)
