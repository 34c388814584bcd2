"""What is told of a run that comes to nothing: whether anything is left that could be resumed."""

import os
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import pytest

from inercal.errors import InercalError
from inercal.host.folder import JOURNAL
from inercal.host.journal import Journal
from inercal.host.web import carry
from inercal.host.web.carry import RunController
from inercal.host.web.control import Control
from inercal.host.web.order import RunRequest, cut_short
from inercal.host.web.publish import Publisher

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
    monkeypatch.setattr(carry, "compiled", lambda *_: None)
    return RunRequest(
        str(tmp_path / "run"),
        str(files("inercal").joinpath("demo.toml")),
        table=f"pmac://{NOBODY}?motors=1,2,3&counts=3600000",
        imu=f"tcp://{NOBODY}?preset=fixed",
        register=str(tmp_path / "register.db"),
    )


def failed(order: RunRequest, publisher: Publisher) -> str:
    with pytest.raises(InercalError) as error:
        RunController(order, publisher, Control()).carry_out()
    return str(error.value)


def test_a_new_run_whose_devices_are_not_there_is_not_begun(
    order: RunRequest, publisher: Publisher
):
    words = failed(order, publisher)
    assert NOBODY in words
    done = cut_short(order, words)
    assert (done["state"], done["words"], done["report"]) == ("not begun", words, None)
    assert not Path(order.folder).exists()


def test_packets_without_a_temperature_are_refused_where_it_is_to_be_watched(
    order: RunRequest, publisher: Publisher
):
    order = replace(
        order, imu=f"tcp://{NOBODY}?preset=novatel", temperature=(288.15, 313.15), patience=30.0
    )
    words = failed(order, publisher)
    assert words == "packets of novatel carry no temperature that could be watched"
    assert cut_short(order, words)["state"] == "not begun"


def test_a_run_that_would_go_on_and_finds_no_devices_stays_interrupted(
    order: RunRequest, publisher: Publisher
):
    folder = Path(order.folder)
    folder.mkdir()
    demo = files("inercal").joinpath("demo.toml").read_bytes()
    (folder / "demo.toml").write_bytes(demo)
    addresses = order.table, order.imu, ""
    Journal.begin(folder / JOURNAL, "demo.toml", addresses, 0.02, 3).close()
    again = replace(order, plan=None)
    assert cut_short(again, failed(again, publisher))["state"] == "interrupted"
    assert (folder / JOURNAL).exists()
