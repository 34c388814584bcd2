"""Several look on, one operates, anyone may stop; who comes late sees what there was."""

import asyncio
import json
import os
import signal
from collections.abc import Iterator
from errno import EMFILE
from pathlib import Path
from threading import Event, Thread

import pytest
from tests.host.web.pages import PATIENCE, SIMULATED, Page, Served, as_header, scripted

from inercal.host.journal import Journal
from inercal.host.run_folder import JOURNAL, LOG
from inercal.host.run_log import RunLog
from inercal.host.tasks import RunOptions
from inercal.host.web import app, folders, live_socket, run_request, viewers
from inercal.host.web.run_request import PROCESS_RECORD, RunRequest, write_process_record


@pytest.fixture
def ada(served: Served) -> Iterator[Page]:
    with served.page() as page:
        page.operate("Ada")
        yield page


def test_who_comes_is_greeted_and_told_that_nothing_goes_on(served: Served):
    with served.page() as page:
        assert [page.next()["kind"] for _ in range(3)] == ["hello", "people", "idle"]
        assert page.heard[1] == {"kind": "people", "viewers": 1, "operator": None, "yours": False}


def test_one_operates_and_hands_it_over(served: Served, ada: Page):
    with served.page() as other:
        assert other.until("people", viewers=2)["operator"] == "Ada"
        other.say("operate", name="Bob")
        assert other.until("refused")["words"] == "Ada operates"
        ada.say("leave")
        other.until("people", operator=None)
        other.operate("Bob")
        ada.until("people", operator="Bob", yours=False)


def test_who_only_looks_on_commands_nothing(served: Served, ada: Page):
    ada.start()
    with served.page() as other:
        for command in ("start", "resume", "pause", "go on", "abort", "put away"):
            other.say(command, plan="demo", run="x")
            assert "operator" in other.until("refused")["words"], command
    ada.until("samples")


def test_an_operator_who_was_gone_for_a_moment_operates_again(served: Served):
    cookies = served.viewer("of-this-browser")
    with served.page(cookies=cookies) as page:
        page.operate("Ada")
    with served.page() as other:
        other.say("operate", name="Bob")
        assert "may be back" in other.until("refused")["words"]
        with served.page(cookies=cookies) as page:
            page.until("people", operator="Ada", yours=True)


def test_an_operators_browser_has_its_place_back_while_its_old_connection_seems_open(
    served: Served,
):
    cookies = served.viewer("of-this-browser")
    with served.page(cookies=cookies) as page, served.page(cookies=cookies) as again:
        page.operate("Ada")
        again.operate("Ada")
        page.until("people", operator="Ada", yours=False)


def test_the_operators_page_has_its_place_back_at_once_though_its_old_connection_seems_open(
    served: Served,
):
    cookies = served.viewer("of-this-browser")
    with served.page(cookies=cookies, tab="a") as page:
        page.operate("Ada")
        with served.page(cookies=cookies, tab="b") as other:
            other.until("people", operator="Ada", yours=False)
            with served.page(cookies=cookies, tab="a") as again:
                again.until("people", operator="Ada", yours=True)
            page.until("people", operator="Ada", yours=False)
        with served.page(cookies=served.viewer("of-another"), tab="a") as thief:
            thief.until("people", operator="Ada", yours=False)


def test_only_an_operator_who_leaves_is_news(served: Served, ada: Page):
    with served.page() as other:
        other.until("people", viewers=2)
        other.say("leave")
        other.say("pause")
        other.until("refused")
        assert [one["kind"] for one in other.heard].count("people") == 1
        ada.say("leave")
        other.until("people", operator=None)


def test_every_viewer_hears_the_server_beat_while_nothing_goes_on(
    served: Served, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(live_socket, "_HEARTBEAT_INTERVAL", 0.01)
    with served.page() as page, served.page() as other:
        for _ in range(3):
            assert page.until("beat") == other.until("beat") == {"kind": "beat"}


def messages_of(viewer: viewers.Viewer, count: int) -> list[str]:
    """Return the next messages, which are there."""

    async def taken() -> list[str]:
        return [await asyncio.wait_for(viewer.next_message(), PATIENCE) for _ in range(count)]

    return asyncio.run(taken())


def test_of_people_and_beats_a_slow_viewer_is_told_the_latest():
    viewer = viewers.Viewer(1, None)
    for k in range(100):
        viewer.send("people", f"people {k}")
        viewer.send("beat", "beat")
    viewer.send("event", "event")
    assert messages_of(viewer, 3) == ["people 99", "beat", "event"]
    viewer.send("people", "people again")
    assert messages_of(viewer, 1) == ["people again"]


def test_a_viewer_is_sent_the_state_and_alarms_before_samples_and_history():
    viewer = viewers.Viewer(1, None)
    viewer.send("coarse", "coarse")
    viewer.send("event", "info", urgent=False)
    viewer.send_history(iter(["past 1", "past 2"]))
    viewer.send("state", "old")
    viewer.send("state", "state")
    viewer.send("event", "alarm")
    assert messages_of(viewer, 6) == ["alarm", "state", "info", "coarse", "past 1", "past 2"]


def test_states_that_keep_coming_leave_room_for_the_past():
    viewer = viewers.Viewer(1, None)
    viewer.send_history(f"past {k}" for k in range(9))
    told: list[str] = []
    for _ in range(12):
        viewer.send("state", "state")
        viewer.send("estimates", "estimates")
        told += messages_of(viewer, 1)
    assert [told.count(one) for one in ("state", "estimates")] == [3, 3]
    assert told[0] == "state"


def test_a_batch_that_is_on_its_way_is_followed_by_what_is_urgent_alone():
    viewer = viewers.Viewer(1, None)
    viewer.send("plan", "x" * viewers._FIRST_BATCH)
    assert messages_of(viewer, 1)
    viewer.send("state", "s1")
    (mark,) = messages_of(viewer, 1)
    viewer.send("state", "s2")
    viewer.send("event", "alarm")
    assert messages_of(viewer, 1) == ["alarm"]
    assert viewer._take() is None
    viewer.acknowledge(json.loads(mark)["n"] + 1)  # not the mark that is waited for
    assert viewer._take() is None
    viewer.acknowledge(json.loads(mark)["n"])
    assert messages_of(viewer, 1) == ["s2"]


def test_a_link_that_answers_at_once_is_sent_all_samples_and_a_slow_one_means_of_them(
    monkeypatch: pytest.MonkeyPatch,
):
    now = 0.0
    monkeypatch.setattr(viewers, "monotonic", lambda: now)
    viewer = viewers.Viewer(1, None)
    told: list[str] = []
    for took in (0.01, 0.5, 1.5, 0.5):
        viewer.send("plan", "x" * viewers._MAX_BATCH)
        mark = messages_of(viewer, 2)[1]
        now += took
        viewer.acknowledge(json.loads(mark)["n"])
        for kind in ("coarse", "samples"):
            viewer.send(kind, kind)
        told += messages_of(viewer, 1)
    assert told == ["samples", "samples", "coarse", "coarse"]


def test_an_end_comes_behind_the_last_state_and_a_new_plan_in_its_place():
    viewer = viewers.Viewer(1, None)
    viewer.send("state", "state")
    viewer.send("done", "done")
    viewer.send("coarse", "of the run before")
    viewer.send("state", "of the run before")
    viewer.send("plan", "plan")
    viewer.send("state", "next")
    assert messages_of(viewer, 4) == ["state", "done", "plan", "next"]
    assert viewer._take() is None


def test_an_operator_who_stays_away_is_followed_by_another(
    served: Served, monkeypatch: pytest.MonkeyPatch
):
    with served.page() as page:
        page.operate("Ada")
    with served.page() as other:
        other.until("people", operator="Ada", viewers=1)
        monkeypatch.setattr(viewers, "OPERATOR_GRACE", 0.0)
        other.operate("Bob")


def test_all_are_told_when_the_place_of_an_operator_who_stays_away_is_free(
    served: Served, ada: Page, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(viewers, "OPERATOR_GRACE", 0.1)
    with served.page() as other:
        other.until("people", operator="Ada", viewers=2)
        ada.close()
        other.until("people", operator="Ada", viewers=1)
        other.until("people", operator=None, viewers=1)


def test_after_a_while_an_operators_browser_has_to_take_the_place_again(
    served: Served, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(viewers, "OPERATOR_GRACE", 0.0)
    cookies = served.viewer("of-this-browser")
    with served.page(cookies=cookies) as page:
        page.operate("Ada")
    served.wait(lambda: not served.hub.people.viewers)
    with served.page(cookies=cookies) as page:
        page.until("people", yours=False)
        assert served.ask("/api/probe", "POST", PROBE, as_header(cookies)).status == 403
        page.operate("Bob")


def test_any_viewer_may_stop_the_run(served: Served, ada: Page):
    ada.start()
    with served.page() as other:
        other.until("state")
        other.say("stop")
        assert other.until("done")["words"] == "stopped by the operator"
    ada.until("done", state="interrupted")


def begun_elsewhere(served: Served, name: str = "other") -> Path:
    """Return the folder of a run that this server knows nothing of."""
    folder = served.runs.folder / name
    folder.mkdir()
    Journal.create(folder / JOURNAL, "demo.toml", ("table", "imu", ""), 0.02, 3).close()
    return folder


@pytest.fixture
def signalled(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Return which process is sent what, instead of sending it."""
    sent: list[tuple[int, int]] = []
    monkeypatch.setattr(folders, "kill", lambda process, what: sent.append((process, what)))
    return sent


@pytest.mark.parametrize("asked", [{}, {"run": "other"}])
def test_a_stop_reaches_a_run_that_another_server_started(
    served: Served, signalled: list[tuple[int, int]], asked: dict[str, str]
):
    noted = write_process_record(begun_elsewhere(served), None)
    with served.page() as page:
        page.say("stop", **asked)
        served.wait(lambda: signalled)
        assert signalled == [(os.getpid(), signal.SIGINT)]
        page.say("stop", run="another")
        assert page.until("refused")["words"].startswith("there is no active run to stop")
    os.close(noted)


def test_while_a_run_to_be_stopped_is_sought_others_are_heard(
    served: Served, signalled: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch
):
    noted = write_process_record(begun_elsewhere(served), None)
    sought, others, there = Event(), Event(), served.runs.active_folders

    def slowly() -> list[Path]:
        sought.set()
        assert others.wait(PATIENCE)
        return there()

    monkeypatch.setattr(served.runs, "active_folders", slowly)
    with served.page() as page, served.page() as other:
        page.say("stop")
        try:
            assert sought.wait(PATIENCE)
            other.operate("Bob")
            assert signalled == []
        finally:
            others.set()
        served.wait(lambda: signalled)
    os.close(noted)


def test_a_stop_of_a_terminals_run_is_refused_and_hits_no_process_of_an_old_note(
    served: Served, signalled: list[tuple[int, int]]
):
    folder = begun_elsewhere(served)
    os.close(write_process_record(folder, None))
    with served.page() as page:
        page.say("stop")
        assert page.until("refused")["words"].startswith("there is no active run to stop")
        with RunLog(folder / LOG):
            page.say("stop")
            assert page.until("refused")["words"].startswith("this page cannot stop the run")
    assert (folder / PROCESS_RECORD).exists()
    assert signalled == []


def test_commands_of_the_operator_reach_the_run(served: Served, ada: Page):
    ada.start(sensor="  MIMU #17 ")
    assert (ada.heard[-1]["sensor"], ada.heard[-1]["by"]) == ("MIMU #17", "Ada")
    assert ada.heard[-1]["speed"] == 5.0
    ada.say("pause")
    ada.until("state", paused="paused by the operator")
    ada.say("go on")
    ada.until("state", paused="")
    ada.say("start", plan="demo", table={"id": "simulated"}, imu={"id": "simulated"})
    assert "another run is active" in ada.until("refused")["words"]
    ada.say("put away")
    assert "still active" in ada.until("refused")["words"]
    ada.say("abort")
    ada.until("done", words="aborted")
    served.wait(lambda: served.hub.run_process is None)
    ada.say("put away")
    ada.until("idle")
    ada.say("pause")
    assert "no run is active" in ada.until("refused")["words"]


def test_a_note_of_the_operator_reaches_the_run_with_who_wrote_it(served: Served, ada: Page):
    ada.say("note", text="too early")
    assert "no run is active" in ada.until("refused")["words"]
    ada.start()
    ada.say("note", text="  the door was opened ")
    # The scripted run says which command it does not know.
    assert ada.until("event", level="alarm")["words"] == "what is note Ada: the door was opened?"
    for text in ("  ", "x" * 401, "two\nlines", 7, None):
        ada.say("note", text=text)
        assert "1 to 400 printable characters" in ada.until("refused")["words"]
    with served.page() as other:
        other.say("note", text="me too")
        assert "operator" in other.until("refused")["words"]


def test_a_run_that_the_disk_has_no_room_for_is_refused_before_it_begins(
    served: Served, ada: Page, monkeypatch: pytest.MonkeyPatch
):
    said = served.ask("/api/setup").json
    needed = said["plans"][0]["bytes"]
    assert 2e7 < needed < 2e8  # 23 minutes of 200 Hz
    assert said["free"] > needed
    monkeypatch.setattr(served.runs, "free_space", lambda: needed - 1)
    ada.say("start", plan="demo", sensor=None, **SIMULATED)
    assert "are free on the disk: delete files" in ada.until("refused")["words"]
    assert list(served.runs.folder.iterdir()) == []
    monkeypatch.setattr(served.runs, "free_space", lambda: needed)
    ada.start()


def test_the_ambient_temperature_goes_with_the_order_and_is_a_number(tmp_path: Path):
    orders: list[RunRequest] = []

    def start(order: RunRequest) -> run_request.RunProcess:
        orders.append(order)
        return scripted(order)

    with Served(tmp_path, start=start) as served, served.page() as page:
        page.operate()
        for wrong in ("warm", 1000, True, float("nan")):
            page.say("start", plan="demo", sensor=None, ambient=wrong, **SIMULATED)
            assert "from -90 to 100 °C" in page.until("refused")["words"]
        page.start(ambient=21.5)
        page.say("abort")
        page.until("done")
    assert [order.ambient for order in orders] == [21.5]
    assert RunRequest.from_json(orders[0].json_line) == orders[0]


def test_limits_that_the_server_was_given_are_those_of_each_run(tmp_path: Path):
    orders: list[RunRequest] = []

    def start(order: RunRequest) -> run_request.RunProcess:
        orders.append(order)
        return scripted(order)

    options = RunOptions(None, (288.15, 313.15), 30.0)
    with Served(tmp_path, start=start, options=options) as served, served.page() as page:
        page.operate()
        page.start()
        page.say("abort")
        page.until("done")
    assert [order.options for order in orders] == [options]


@pytest.mark.slow
def test_who_comes_late_is_told_how_the_run_stands_and_then_what_was_before(
    served: Served, ada: Page
):
    ada.start()
    for _ in range(3):
        ada.until("estimates")
    now = ada.until("state")["time"]
    with served.page() as late:
        late.until("events")
        while sum(one["kind"] == "estimates" for one in late.heard) < 3:
            late.next()
        kinds = [message["kind"] for message in late.heard]
        assert kinds[:5] == ["hello", "people", "plan", "phase", "state"]
        told = next(one for one in late.heard if one["kind"] == "events")
        assert [one["n"] for one in told["events"]] == [1, 2, 3]
        assert min(kinds.index("events"), kinds.index("estimates")) > kinds.index("state")
        times = [one["t"][0] for one in late.heard if one["kind"] in ("samples", "coarse")]
        assert min(times) < now
    ada.say("abort")
    ada.until("done")
    with served.page() as late:
        late.until("done", words="aborted")


def test_a_run_goes_on_when_all_pages_are_closed(served: Served):
    with served.page() as page:
        page.operate()
        page.start()
    served.wait(lambda: not served.hub.people.viewers)
    with served.page() as page:
        first = page.until("state")["time"]
        assert page.until("state")["time"] > first
        page.say("stop")
        page.until("done")


def test_a_process_that_cannot_be_started_is_said_and_what_was_shown_stays(
    served: Served, ada: Page, monkeypatch: pytest.MonkeyPatch
):
    ada.start()
    ada.say("abort")
    ada.until("done", words="aborted")
    served.wait(lambda: served.hub.run_process is None)

    def fails(*_: object, **__: object) -> None:
        raise OSError(EMFILE, os.strerror(EMFILE))

    monkeypatch.setattr(run_request, "Popen", fails)
    ada.say("start", plan="demo", sensor=None, **SIMULATED)
    words = ada.until("refused")["words"]
    assert "Too many open files" in words
    with served.page() as late:
        late.until("done", words="aborted")
    monkeypatch.undo()
    ada.start()


def test_a_process_that_ends_without_a_word_is_an_interrupted_run(served: Served, ada: Page):
    ada.start()
    assert served.hub.run_process is not None
    begun_elsewhere(served, served.hub.run_process.order.name)
    served.hub.run_process.send_line("fall")
    done = ada.until("done")
    assert done["state"] == "interrupted"
    assert "status 7" in done["words"]
    assert "can be resumed" in done["words"]


def test_a_process_that_ends_before_there_is_a_journal_leaves_nothing_to_resume(
    served: Served, ada: Page
):
    ada.start()
    assert served.hub.run_process is not None
    served.hub.run_process.send_line("fall")
    done = ada.until("done")
    assert done["state"] == "not begun"
    assert done["words"] == "the run's process has ended (status 7) before anything moved"


def test_to_end_the_server_is_to_stop_the_run(tmp_path: Path):
    with Served(tmp_path) as served:
        page = served.page()
        page.operate()
        page.start()
    assert page.closed() == 1012
    (done,) = (one for one in page.heard if one["kind"] == "done")
    assert done["words"] == "stopped by the operator"


def test_a_page_that_takes_nothing_misses_pictures_and_no_event(served: Served, ada: Page):
    ada.start()
    with served.page(slow=True) as slow:
        served.wait(lambda: 2 in served.hub.people.viewers)
        viewer = served.hub.people.viewers[2]
        big = json.dumps({"kind": "samples", "y": "x" * 100_000})

        def flood() -> None:
            for k in range(2000):
                viewer.send("samples", big)
                if k % 10 == 0:
                    viewer.send("event", json.dumps({"kind": "event", "words": f"flood {k}"}))

        served.soon(flood)
        slow.until("event", words="flood 1990")
        events = [one["words"] for one in slow.heard if "flood" in one.get("words", "")]
        assert events == [f"flood {10 * k}" for k in range(200)]
        big_ones = sum(len(str(one.get("y", ""))) > 1000 for one in slow.heard)
        assert big_ones < 200
    ada.until("samples")


def test_the_setup_says_what_there_is(served: Served):
    said = served.ask("/api/setup").json
    assert [plan["id"] for plan in said["plans"]] == ["demo"]
    assert said["plans"][0]["trouble"] == ""
    assert said["plans"][0]["steps"] > 10
    assert said["sensors"] == []
    assert said["tables"][0] == said["imus"][0] == {"id": "simulated", "what": "simulated bench"}
    assert {"fixed", "xsens"} <= {preset["name"] for preset in said["presets"]}
    assert said["register"].endswith("register.db")


def test_only_the_operators_browser_may_ask_the_devices(served: Served):
    mine = served.viewer("mine")
    cookies = as_header(mine)
    body = json.dumps({"plan": "demo", "table": {"id": "simulated"}, "imu": {"id": "port-99"}})
    with served.page(cookies=mine) as page:
        assert served.ask("/api/probe", "POST", body.encode(), cookies).status == 403
        page.operate()
        said = served.ask("/api/probe", "POST", body.encode(), cookies)
        assert said.status == 200
        assert said.json["table"] == {"ok": True, "lines": ["simulated: made when the run starts"]}
        assert said.json["imu"]["ok"] is False
        assert "no IMU 'port-99'" in said.json["imu"]["lines"][0]
        assert served.ask("/api/probe", "POST", b"[]", cookies).status == 400
        other = as_header(served.viewer("other"))
        assert served.ask("/api/probe", "POST", body.encode(), other).status == 403
        page.start()
        assert served.ask("/api/probe", "POST", body.encode(), cookies).status == 409


PROBE = json.dumps({"plan": "demo", **SIMULATED}).encode()


@pytest.fixture
def mine(served: Served) -> Iterator[Page]:
    with served.page(cookies=served.viewer("mine")) as page:
        page.operate()
        yield page


@pytest.mark.usefixtures("mine")
def test_the_devices_of_a_run_without_this_page_are_not_asked(served: Served):
    cookies = as_header(served.viewer("mine"))
    with RunLog(begun_elsewhere(served) / LOG):
        said = served.ask("/api/probe", "POST", PROBE, cookies)
        assert said.status == 409
        assert said.json["words"].startswith("run other is active outside this page")
    assert served.ask("/api/probe", "POST", PROBE, cookies).status == 200


def test_no_run_begins_while_the_devices_are_asked(
    served: Served, mine: Page, monkeypatch: pytest.MonkeyPatch
):
    asked, answer = Event(), Event()

    def probe(*_: object) -> dict[str, str]:
        asked.set()
        assert answer.wait(PATIENCE)
        return {}

    monkeypatch.setattr(app, "probe_devices", probe)
    cookies = as_header(served.viewer("mine"))
    asking = Thread(target=served.ask, args=("/api/probe", "POST", PROBE, cookies))
    asking.start()
    try:
        assert asked.wait(PATIENCE)
        mine.say("start", plan="demo", sensor=None, **SIMULATED)
        assert "the devices are still being probed" in mine.until("refused")["words"]
        assert served.ask("/api/probe", "POST", PROBE, cookies).status == 409
    finally:
        answer.set()
        asking.join(PATIENCE)
    mine.start()
