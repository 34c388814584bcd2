"""A whole run through the page on a simulated bench, while others do their worst."""

import socket
from contextlib import suppress
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pytest
from tests.host.simulated_runs import plan, quick
from tests.host.web.pages import COMPILING, RUNNING, SIMULATED, Page, Served, sockets
from websockets.exceptions import InvalidStatus

from inercal.calibration.files import load
from inercal.host.journal import Journal
from inercal.host.tasks import RunOptions
from inercal.host.web.run_request import RunProcess, RunRequest
from inercal.laboratory.store import Register
from inercal.physics.sensors import G0
from inercal.pipeline import calibrate
from inercal.runfile import read

NAME = "MIMU #17"
NOTE = "the door was opened"
FILTER = {"initial.accelerometer_bias": "20 mg"}


class Whole(NamedTuple):
    """A run through the page: what the page heard, and what there is afterwards."""

    heard: list[dict[str, Any]]
    folder: Path
    register: str
    answers: dict[str, Any]

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [one for one in self.heard if one["kind"] == kind]


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    folder = tmp_path_factory.mktemp("served")
    plan(folder / "plans", quick())
    with (
        pytest.MonkeyPatch.context() as patch,
        Served(folder, start=seeded) as served,
        served.page() as page,
    ):
        # A viewer that answers late, as this one does on a slow machine, would be sent means.
        patch.setattr("inercal.host.web.viewers._FAST", inf)
        page.operate("Ada")
        page.say("start", plan="plan", sensor=NAME, ambient=21.5, filter=FILTER, **SIMULATED)
        run = page.until("plan", COMPILING)["run"]
        page.until("estimates", COMPILING)
        page.say("pause")
        page.until("state", paused="paused by the operator")
        page.say("note", text=NOTE)
        page.until("event", level="note", words=f"Ada: {NOTE}")
        send_nonsense(served)
        page.say("go on")
        send_too_much(served)
        done = page.until("done", RUNNING)
        hear_last_samples(page)
        answers = {what: served.ask(done[what]) for what in ("report", "calibration", "history")}
        answers["setup"] = served.ask("/api/setup")
        return Whole(page.heard, folder / "runs" / run, served.register, answers)


def seeded(order: RunRequest) -> RunProcess:
    """Start a run on a bench that is the same whenever this is tested."""
    return RunProcess(replace(order, seed=3, options=RunOptions(50.0)))


def hear_last_samples(page: Page) -> None:
    """Read on until the samples of the end have come: the end itself overtakes them."""
    last = next(one["time"] for one in reversed(page.heard) if one["kind"] == "estimates")
    samples = next(one for one in reversed(page.heard) if one["kind"] == "samples")
    while samples["t"][-1] < last - 1.5:
        samples = page.until("samples")


def send_nonsense(served: Served) -> None:
    """Send what the page refuses for what it is."""
    with pytest.raises(InvalidStatus):
        served.page(origin="http://evil.example")
    for path in ("/static/../app.py", "/runs/%2e%2e/report", "/history/..%2f1"):
        assert served.ask(path).status == 404
    with served.page() as other:
        for message in ("{", '{"do": "abort"}', '{"do": "start"}', "[" * 4000):
            other.connection.send(message)
            other.until("refused")
        other.connection.send(b"\xff" * 100)
        assert other.closed() == 1003


def send_too_much(served: Served) -> None:
    """Send what the page refuses for its size."""
    own = f"Host: {served.host}\r\nOrigin: http://{served.host}\r\nContent-Length: 100000000\r\n"
    with socket.create_connection(("127.0.0.1", served.port), 20) as connection:
        connection.sendall(f"POST /api/probe HTTP/1.1\r\n{own}\r\n".encode())
        with suppress(ConnectionError):
            for _ in range(1000):
                connection.sendall(b"x" * 100_000)
    for one in sockets(served.port, 1000):
        one.close()


def test_a_run_through_the_page_ends_with_report_calibration_and_history(whole: Whole):
    (done,) = whole.of("done")
    assert done["state"] == "done", done
    assert done["verdict"]["level"] in ("good", "care")
    report, calibration, history = (
        whole.answers[what] for what in ("report", "calibration", "history")
    )
    assert [one.status for one in (report, calibration, history)] == [200, 200, 200]
    assert NAME in report.body.decode()
    assert NAME in history.body.decode()
    assert "default-src 'none'" in report.headers["content-security-policy"]
    assert calibration.json["sensor"]["name"] == NAME
    made = load(whole.folder / "plan.calibration.json")
    sizes = np.array([made.sensor.coefficient(name).si for name in made.sensor.coefficients])
    u2 = 2 * np.sqrt(np.diagonal(made.covariance)) / sizes
    np.testing.assert_allclose(done["final"]["u2"], u2, rtol=1e-6)
    (shown,) = whole.answers["setup"].json["runs"]
    assert (shown["id"], shown["sensor"]) == (whole.folder.name, NAME)
    assert (shown["state"], shown["report"]) == ("done", True)


def test_what_the_operator_wrote_is_in_journal_calibration_and_report(whole: Whole):
    with Journal(whole.folder / "run.journal") as journal:
        notes = [event for event in journal.events() if event.level == "note"]
    words = ["Ada: the ambient temperature is 21.5 °C", f"Ada: {NOTE}"]
    assert [one.words for one in notes] == words
    assert notes[1].time is not None
    kept = load(whole.folder / "plan.calibration.json").conditions
    assert kept["note 1"] == words[0]
    assert kept[f"note 2, {notes[1].time:.0f} s"] == words[1]
    report = whole.answers["report"].body.decode()
    assert all(one in report for one in words)


def test_a_changed_filter_parameter_is_in_run_file_journal_and_report(whole: Whole):
    config = read(whole.folder / "plan.toml").filter
    assert config is not None
    assert dict(config.initial) == pytest.approx({"accelerometer_bias": 20e-3 * G0})
    with Journal(whole.folder / "run.journal") as journal:
        words = [event.words for event in journal.events()]
    assert any("Ada" in one and "accelerometer_bias 20 mg" in one for one in words)
    changed = load(whole.folder / "plan.calibration.json").conditions["filter keys changed"]
    assert "accelerometer_bias 20 mg" in changed
    assert changed in whole.answers["report"].body.decode()


def test_its_result_is_that_of_its_recording(whole: Whole):
    again = calibrate(read(whole.folder / "plan.toml")).calibration
    made = load(whole.folder / "plan.calibration.json")
    assert made.values.tolist() == again.values.tolist()
    assert made.covariance.tolist() == again.covariance.tolist()
    words = [one["words"] for one in whole.of("event")]
    assert "the live estimate is identical to that of the recording" in words


def test_no_packet_is_lost_whatever_others_do(whole: Whole):
    imu = whole.of("state")[-1]["imu"]
    assert imu["packets"] > 200 * 280
    assert (imu["lost"], imu["failed"], imu["thrown"], imu["no_angle"]) == (0, 0, 0, 0)
    alarms = [one["words"] for one in whole.of("event") if one["level"] == "alarm"]
    assert alarms == []


def test_the_page_is_told_what_the_run_is_of(whole: Whole):
    (told,) = whole.of("plan")
    run = read(whole.folder / "plan.toml")
    assert told["sensor"] == run.sensor.name == NAME
    assert told["simulated"] is True
    assert told["axes"] == ["outer", "middle", "inner"]
    assert [one["name"] for one in told["channels"]] == list(run.sensor.channels)
    assert [one["unit"] for one in told["channels"]] == ["g"] * 3 + ["°/s"] * 3
    assert [one["label"] for one in told["steps"]] == [one.label for one in run.steps]
    assert {one["what"] for one in told["steps"]} == {"hold", "turn"}
    assert [one["name"] for one in told["coefficients"]] == list(run.sensor.coefficients)


def test_estimates_converge_to_the_calibration(whole: Whole):
    estimates = whole.of("estimates")
    first, last = estimates[0], estimates[-1]
    made = load(whole.folder / "plan.calibration.json")
    sizes = [made.sensor.coefficient(name).si for name in made.sensor.coefficients]
    np.testing.assert_allclose(np.array(last["values"]) * sizes, made.values, rtol=1e-5, atol=1e-12)
    shrunk = np.array(last["u2"]) / np.array(first["u2"])
    assert np.all(shrunk <= 1)
    assert np.median(shrunk) < 0.2
    assert all(0.3 < last["nis"][kind]["ratio"] < 3 for kind in ("w", "f"))


def test_live_estimation_waits_for_a_rest_and_is_on_to_the_end(whole: Whole):
    told = [one["live"] for one in whole.of("state")]
    assert list(dict.fromkeys(told)) == ["waits", "on"]


def test_samples_follow_one_another_and_are_those_of_the_recording(whole: Whole):
    """They are shown from the first packet on; the recording begins when the axes have zeros."""
    times = np.concatenate([one["t"] for one in whole.of("samples")])
    assert np.all(np.diff(times) > 0)
    begun = next(one["time"] for one in whole.of("event") if one["words"].startswith("step 1 of"))
    assert times[0] < 1.0 < begun
    file: Any
    with h5py.File(whole.folder / "recording.h5") as file:
        recorded = file["time"][:]
    # Both are of the IMU's clock: the run's time is ahead of the recording's by when that began.
    last = whole.of("estimates")[-1]["time"]
    assert last - recorded[-1] == pytest.approx(begun, abs=2.0)
    assert times[-1] == pytest.approx(last, abs=1.5)
    for one in whole.of("samples"):
        assert [len(column) for column in one["y"]] == [len(one["t"])] * 6
    level = np.concatenate([one["y"][2] for one in whole.of("samples")])
    first_hold = (times > begun + 1) & (times < begun + 4)
    assert first_hold.any()
    np.testing.assert_allclose(level[first_hold], 1.0, atol=0.1)


def test_state_samples_estimates_and_events_have_one_time_base(whole: Whole):
    """What is told within one look at the run is of the same time, but for what still comes."""
    newest = {"samples": 0.0, "estimates": 0.0}
    behind: dict[str, list[float]] = {kind: [] for kind in newest}
    for one in whole.heard:
        if one["kind"] == "samples":
            newest["samples"] = one["t"][-1]
        elif one["kind"] == "estimates":
            newest["estimates"] = one["time"]
        elif one["kind"] == "state":
            for kind, time in newest.items():
                if time:
                    behind[kind].append(one["time"] - time)
    for kind, lags in behind.items():
        assert min(lags) > -0.1, kind
        assert np.median(lags) < 60.0, kind  # at 50 times real time half a second of the wall is 25
    steps = [one for one in whole.of("event") if one["words"].startswith("step ")]
    assert all(0 < one["time"] <= whole.of("state")[-1]["time"] for one in steps)
    assert [one["n"] for one in whole.of("event")] == list(range(1, 1 + len(whole.of("event"))))


def test_the_end_tells_the_uncertainties_of_the_calibration_file(whole: Whole):
    (done,) = whole.of("done")
    made = load(whole.folder / "plan.calibration.json")
    sizes = np.array([made.sensor.coefficient(name).si for name in made.sensor.coefficients])
    assert done["final"]["names"] == list(made.sensor.coefficients)
    np.testing.assert_allclose(np.array(done["final"]["values"]) * sizes, made.values, rtol=1e-6)
    np.testing.assert_allclose(np.array(done["final"]["u2"]) * sizes, 2 * made.std, rtol=1e-6)


def test_attitudes_of_table_and_navigation_go_side_by_side(whole: Whole):
    told = [one["attitude"] for one in whole.of("state") if one["attitude"]]
    assert told[0]["navigation"] is None  # the table's is known before the filters begin
    seen = [one for one in told if one["navigation"]]
    assert len(seen) > 5
    for one in seen:
        table = np.array(one["table"]).reshape(3, 3)
        navigation = np.array(one["navigation"]).reshape(3, 3)
        np.testing.assert_allclose(table @ table.T, np.eye(3), atol=1e-6)
        np.testing.assert_allclose(navigation, table, atol=0.05)
        assert len(one["apart"]) == len(one["velocity"]) == 3


def test_the_register_has_the_run_and_who_made_it(whole: Whole):
    with Register(whole.register) as register:
        (sensor,) = register.sensors()
        assert (sensor.name, sensor.calibrations, sensor.by) == (NAME, 1, "Ada")
        (run,) = register.runs()
        assert (run.state, run.by) == ("done", "Ada")
