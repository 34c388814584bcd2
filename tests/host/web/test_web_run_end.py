"""What is told of a run that comes to nothing: whether anything is left that could be resumed."""

import os
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

from inercal.basics.errors import InercalError
from inercal.host.journal import Journal
from inercal.host.run_folder import JOURNAL
from inercal.host.tasks import RunOptions
from inercal.host.web import worker
from inercal.host.web.run_request import RunRequest, premature_end_message
from inercal.host.web.worker import CommandRelay, RunController
from inercal.host.web.worker_process import Publisher

NOBODY = "127.0.0.1:1"


@pytest.fixture
def publisher() -> Iterator[Publisher]:
    nowhere = os.open(os.devnull, os.O_WRONLY)
    with Publisher(nowhere) as made:
        yield made
    os.close(nowhere)


@pytest.fixture
def order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunRequest:
    """Return the order of a new run on devices that are not there."""
    monkeypatch.setattr(worker, "precompile_run", lambda *_: None)
    return RunRequest(
        str(tmp_path / "run"),
        plan=str(files("inercal").joinpath("demo.toml")),
        table=f"pmac://{NOBODY}?motors=1,2,3&counts=3600000",
        imu=f"tcp://{NOBODY}?preset=fixed",
        register=str(tmp_path / "register.db"),
    )


def failed(order: RunRequest, publisher: Publisher) -> str:
    with pytest.raises(InercalError) as error:
        RunController(order, publisher, CommandRelay()).execute()
    return str(error.value)


@pytest.mark.slow
def test_a_new_run_whose_devices_are_not_there_is_not_begun(
    order: RunRequest, publisher: Publisher
):
    words = failed(order, publisher)
    assert NOBODY in words
    done = premature_end_message(order, words)
    assert (done["state"], done["words"], done["report"]) == ("not begun", words, None)
    assert not Path(order.folder).exists()


@pytest.mark.slow
def test_packets_without_a_temperature_are_refused_where_it_is_to_be_watched(
    order: RunRequest, publisher: Publisher
):
    order = replace(
        order,
        imu=f"tcp://{NOBODY}?preset=novatel",
        options=RunOptions(None, (288.15, 313.15), 30.0),
    )
    words = failed(order, publisher)
    assert words == "the packets of novatel contain no temperature; leave --temperature out"
    assert premature_end_message(order, words)["state"] == "not begun"


def test_a_run_that_would_go_on_and_finds_no_devices_stays_interrupted(
    order: RunRequest, publisher: Publisher
):
    folder = Path(order.folder)
    folder.mkdir()
    demo = files("inercal").joinpath("demo.toml").read_bytes()
    (folder / "demo.toml").write_bytes(demo)
    addresses = order.table, order.imu, ""
    Journal.create(folder / JOURNAL, "demo.toml", addresses, 0.02, 3).close()
    again = replace(order, plan=None)
    assert premature_end_message(again, failed(again, publisher))["state"] == "interrupted"
    assert (folder / JOURNAL).exists()
