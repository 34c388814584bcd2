"""The HTTP interface: its description, what scripts read by it, and that a token commands nothing.

The run says what `page_messages` makes of a real plan, state and calibration.
"""

import importlib.util
import json
import re
import socket
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from openapi_spec_validator import validate
from tests.host.web.pages import PATIENCE, Page, Served, as_header
from tests.host.web.test_web_page_messages import ANGLES, NAVIGATION
from tests.host.web.test_web_page_messages import state as state_told
from tests.refusals import refused
from tests.store.calibration_generator import DRIFTING, content, write
from tools.interface_page import DESCRIPTION, PAGE, description_text, interface_page
from typer.testing import CliRunner
from websockets.exceptions import InvalidStatus
from websockets.frames import Frame, Opcode

from inercal.basics.errors import InputError
from inercal.calibration.files import load
from inercal.cli.app import app as program
from inercal.host.journal import Journal
from inercal.host.web import page_messages
from inercal.host.web.access import Access
from inercal.host.web.interface import COMMANDS, READ_TOKEN, RECORDS, units_of
from inercal.host.web.run_request import RunProcess, RunRequest
from inercal.runfile import read

ROOT = Path(__file__).parents[3]
TOKEN, READING = "correct horse battery", "only looks and never touches"
BEARER = {"Authorization": f"Bearer {READING}"}
WORKER = str(Path(__file__).with_name("recorded_worker.py"))
EVENTS = (("info", "step 1 of 2 begins", 1.5), ("alarm", "µ: the IMU is silent", None))


class Told(NamedTuple):
    """A server with a run, and what the run has told."""

    served: Served
    session: dict[str, str]
    page: Page
    messages: dict[str, dict[str, Any]]

    def read(self, path: str) -> Any:
        answer = self.served.ask(path, headers=BEARER)
        assert answer.status == 200, answer.body
        return answer.json

    @property
    def run(self) -> str:
        return self.messages["phase"]["run"]

    def end(self) -> None:
        """Have the run end."""
        process = self.served.hub.run_process
        assert process is not None
        process.send_line("end")


def messages(order: RunRequest) -> dict[str, dict[str, Any]]:
    """Return what a run tells, by kind."""
    run = read(Path(str(order.plan)))
    told = state_told(run, "on", navigation=NAVIGATION, angles=ANGLES)
    count = len(run.sensor.coefficients)
    folder = f"/runs/{order.name}"
    final = page_messages.final_estimates(load(Path(order.folder) / "demo.calibration.json"))
    verdict = {"level": "good", "words": "consistent", "reasons": []}
    return {
        "plan": page_messages.plan_message(run) | {"run": order.name, "simulated": True},
        "phase": {"run": order.name, "words": "connecting to table and IMU"},
        "state": told,
        "estimates": {"time": 9.5, "values": [0.25] * count, "u2": [None, *[0.5] * (count - 1)],
                      "nis": {}},
        "done": {"run": order.name, "state": "done", "words": "Consistent.", "verdict": verdict,
                 "report": f"{folder}/report", "calibration": f"{folder}/calibration",
                 "history": None, "final": final},
    }  # fmt: skip


def fill(folder: Path) -> None:
    """Make the files of a run."""
    folder.mkdir()
    with Journal.create(folder / "run.journal", "demo.toml", ("", "", ""), 0.02, 2) as journal:
        for level, words, time in EVENTS:
            journal.record_event(level, words, time)
        journal.record_section(0, "R1", "done", 30.0)
        journal.set_state("done")
    (folder / "demo.toml").write_text('[sensor]\nname = "MIMU № 17"\n', encoding="utf-8")
    rng = np.random.default_rng(3)
    write(folder / "demo.calibration.json", content(DRIFTING, 0.0, rng))
    (folder / "demo.report.html").write_text("<!doctype html><p>a report", encoding="utf-8")


@contextmanager
def telling(folder: Path) -> Iterator[Told]:
    """Serve a run that has told everything but its end."""
    made: dict[str, dict[str, Any]] = {}

    def start(order: RunRequest) -> RunProcess:
        fill(Path(order.folder))
        made.update(messages(order))
        lines = folder / "lines"
        text = "".join(f"{kind} {json.dumps({'kind': kind} | one)}\n" for kind, one in made.items())
        lines.write_text(text, encoding="utf-8")
        return RunProcess(order, (sys.executable, WORKER, str(lines)))

    with Served(folder, TOKEN, start, read_token=READING) as served:
        (said,) = served.ask("/token", "POST", f"token={TOKEN}".encode()).cookies
        name, _, value = said.partition(";")[0].partition("=")
        session = {name: value}
        with served.page(cookies=session) as page:
            page.operate()
            page.start()
            page.until("estimates")
            yield Told(served, session, page, made)


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Told]:
    """Serve a run for the tests that only read."""
    with telling(tmp_path_factory.mktemp("told")) as told:
        yield told


@pytest.fixture
def own(tmp_path: Path) -> Iterator[Told]:
    """Serve a run for one test, which may end it."""
    with telling(tmp_path) as told:
        yield told


@pytest.fixture(scope="module")
def client() -> ModuleType:
    path = ROOT / "examples" / "live_page" / "client.py"
    spec = importlib.util.spec_from_file_location("live_page_client", path)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def operations(description: dict[str, Any]) -> list[tuple[str, str, dict[str, Any]]]:
    """Return method, path and content of each operation of a description."""
    paths = description["paths"].items()
    return [(method.upper(), path, one) for path, some in paths for method, one in some.items()]


def reads(operation: dict[str, Any]) -> bool:
    return {READ_TOKEN: []} in operation["security"]


def filled(path: str, run: str) -> list[str]:
    """Return the paths that a template means."""
    whats = ("report", "calibration") if "{what}" in path else ("",)
    return [path.replace("{name}", run).replace("{what}", what) for what in whats]


def strict(schemas: dict[str, Any]) -> dict[str, Any]:
    """Return schemas that permit no field but the stated ones."""
    own = {name: schemas[name] | {"additionalProperties": False} for name in RECORDS}
    return {"components": {"schemas": schemas | own}}


@pytest.mark.slow
def test_the_description_is_valid_openapi_and_has_every_command(told: Told):
    description = told.read("/api/openapi.json")
    validate(description)
    assert set(description["paths"]["/live"]["get"]["x-commands"]) == set(COMMANDS)
    paths = {path for _, path, _ in operations(description)}
    assert {"/api/setup", "/api/probe", "/api/filter", "/api/stop", "/live"} <= paths


def test_an_announcement_ends_when_a_state_follows(told: Told):
    answer = told.read("/api/state")
    assert answer["state"] is not None
    assert answer["phase"] is None


def test_the_pages_of_the_documentation_are_written_from_the_program_of_today():
    assert PAGE.read_text(encoding="utf-8") == interface_page(), "run make interface"
    assert DESCRIPTION.read_text(encoding="utf-8") == description_text(), "run make interface"


def test_every_answer_is_as_described_and_in_no_cache(told: Told):
    description = told.read("/api/openapi.json")
    schemas = strict(description["components"]["schemas"])
    checked = set[str]()
    for method, path, one in operations(description):
        schema = one["responses"].get("200", {}).get("content", {}).get("application/json", {})
        if not reads(one):
            continue
        for address in filled(path, told.run):
            answer = told.served.ask(address, method, headers=BEARER)
            assert answer.status == 200
            assert answer.headers["cache-control"] == "no-store"
            if "schema" in schema:
                Draft202012Validator(schemas | schema["schema"]).validate(answer.json)
                checked.add(path)
    assert checked >= {"/api/state", "/api/estimates", "/api/runs", "/api/runs/{name}/journal",
                       "/api/runs/{name}/result", "/api/setup"}  # fmt: skip


def test_the_example_client_exercises_every_operation(
    own: Told,
    client: ModuleType,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    asked = list[tuple[str, str]]()
    request = client.PageClient.request

    def recorded(self: Any, method: str, path: str, body: bytes | None = None) -> bytes:
        asked.append((method, path.partition("?")[0]))
        if path.endswith("/journal?after=0"):
            own.end()
        return request(self, method, path, body)

    monkeypatch.setattr(client.PageClient, "request", recorded)
    monkeypatch.setenv("INERCAL_READ_TOKEN", READING)
    out = tmp_path / "out"
    address = f"http://{own.served.host}"
    assert client.main([address, "--out", str(out), "--interval", "0"]) == 0
    printed = capsys.readouterr().out
    assert "the run has ended: done" in printed
    assert EVENTS[1][1] in printed
    assert load(out / f"{own.run}.calibration.json").sensor.name == DRIFTING.sensor
    assert json.loads((out / "result.json").read_text())["file"] == "calibration"

    reader = client.PageClient(address, READING)
    for method, path, one in operations(own.read("/api/openapi.json")):
        for filled_path in filled(path, own.run):
            if reads(one):
                assert (method, filled_path) in asked, f"the client does not read {path}"
            else:
                with pytest.raises(client.RequestRefused) as refusal:
                    reader.request(method, filled_path)
                assert refusal.value.status == 403


def test_the_client_says_in_one_line_what_is_refused(
    own: Told,
    client: ModuleType,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    for token in ("", "wrong" * 4):
        monkeypatch.setenv("INERCAL_READ_TOKEN", token)
        assert client.main([f"http://{own.served.host}"]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert "401" in line
        assert "<" not in line


def handshake(told: Told, headers: dict[str, str]) -> bytes:
    """Return a request to open the websocket, as the page sends it."""
    own = {"Host": told.served.host, "Origin": f"http://{told.served.host}", **headers}
    own |= {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
            "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ=="}  # fmt: skip
    lines = [f"{name}: {value}" for name, value in own.items()]
    return "\r\n".join(["GET /live HTTP/1.1", *lines, "", ""]).encode()


@pytest.mark.parametrize("cookies", ["none", "operator"])
def test_the_read_only_token_is_refused_for_every_command(
    told: Told, cookies: str, monkeypatch: pytest.MonkeyPatch
):
    """Even with the cookies of the operator's browser, and with frames sent without waiting."""
    executed = list[object]()
    hub = told.served.hub
    monkeypatch.setattr(hub, "execute", lambda *given: executed.append(given))
    monkeypatch.setattr(hub, "stop", lambda *given: executed.append(given))
    headers = BEARER | (as_header(told.session) if cookies == "operator" else {})
    commands = [
        (method, path)
        for method, path, one in operations(told.read("/api/openapi.json"))
        if not reads(one)
    ]
    assert {path for _, path in commands} == {"/api/stop", "/api/probe", "/api/filter", "/live"}
    for method, path in [*commands, ("POST", "/token"), ("GET", "/"), ("GET", "/glossary")]:
        assert told.served.ask(path, method, b"{}", headers).status == 403, path
    for name, command in COMMANDS.items():
        message = json.dumps({"do": name} | dict.fromkeys(command.fields, "x")).encode()
        frame = Frame(Opcode.TEXT, message).serialize(mask=True)
        with socket.create_connection(("127.0.0.1", told.served.port), PATIENCE) as connection:
            connection.sendall(handshake(told, headers) + frame)
            answer = b""
            while data := connection.recv(4096):
                answer += data
        assert answer.startswith(b"HTTP/1.1 403 "), name
    with pytest.raises(InvalidStatus) as refusal:
        told.served.page(cookies=told.session, headers=BEARER)
    assert refusal.value.response.status_code == 403
    assert executed == []
    assert hub.is_run_active
    told.served.was_refused("a read-only token permits only")


def test_without_the_header_the_handshake_of_these_tests_is_accepted(told: Told):
    with socket.create_connection(("127.0.0.1", told.served.port), PATIENCE) as connection:
        connection.sendall(handshake(told, as_header(told.session)))
        assert connection.recv(4096).startswith(b"HTTP/1.1 101 ")


def test_only_the_read_only_token_in_its_header_reads(told: Told):
    texts = ("Bearer ", "Bearer wrong", f"Bearer {TOKEN}", f"Basic {READING}", "Bearer \xff\xff")
    for headers in ({}, *({"Authorization": text} for text in texts), {"X-Token": READING}):
        assert told.served.ask("/api/state", headers=headers).status == 401
    assert told.served.ask(f"/api/state?token={READING.replace(' ', '+')}").status == 401


def test_the_token_is_also_refused_from_other_sites_and_hosts(tmp_path: Path):
    with Served(tmp_path, read_token=READING) as served:
        assert served.ask("/api/state", headers=BEARER).status == 200
        cross = {"Sec-Fetch-Site": "cross-site"}
        assert served.ask("/api/state", headers=BEARER | cross).status == 403
        assert served.ask("/api/state", headers=BEARER | {"Host": "evil.example"}).status == 421
        # On this machine a script needs no token to read; with the token it can only read.
        assert served.ask("/api/state").status == 200
        assert served.ask("/api/stop", "POST", b"", BEARER).status == 403
        assert served.ask("/api/stop", "POST", b"").status == 409


def test_a_script_with_an_old_token_locks_out_no_browser(own: Told):
    wrong = {"Authorization": "Bearer from before a restart"}
    codes = [own.served.ask("/api/state", headers=wrong).status for _ in range(11)]
    assert codes == [401] * 10 + [429]
    assert own.served.ask("/api/state", headers=BEARER).status == 429
    assert own.served.ask("/token", "POST", f"token={TOKEN}".encode()).status == 303


@pytest.mark.parametrize(("token", "reading"), [(TOKEN, TOKEN), (None, "short"), (TOKEN, "")])
def test_a_read_only_token_that_is_no_secret_is_refused(token: str | None, reading: str):
    with refused(InputError, key="read-only token"):
        Access(frozenset(), token, reading)


def test_state_and_estimates_are_those_of_the_page_with_units(told: Told):
    shown = told.read("/api/state")
    assert shown["state"] == told.messages["state"]
    assert (shown["activity"], shown["operator"], shown["viewers"]) == ("active", "Ada", 1)
    assert (shown["run"], shown["plan"], shown["end"]) == (told.run, "demo.toml", None)
    numbers = {name for name in told.messages["state"] if name in units_of("RunState")}
    assert numbers >= {"time", "remaining", "speed"}
    assert numbers <= set(shown["units"])
    found = told.read("/api/estimates")
    plan, estimates = told.messages["plan"], told.messages["estimates"]
    assert (found["source"], found["time"], found["coverage_factor"]) == ("live", 9.5, 2.0)
    rows = [(one["name"], one["unit"], one["value"], one["expanded_uncertainty"])
            for one in found["coefficients"]]  # fmt: skip
    expected = zip(plan["coefficients"], estimates["values"], estimates["u2"], strict=True)
    assert rows == [(c["name"], c["unit"], value, u2) for c, value, u2 in expected]


def test_after_the_end_the_estimates_are_those_of_the_calibration(own: Told):
    own.end()
    own.page.until("done")
    shown = own.read("/api/state")
    assert (shown["activity"], shown["end"]["state"]) == ("ended", "done")
    found = own.read("/api/estimates")
    made = load(own.served.runs.folder / own.run / "demo.calibration.json")
    assert found["source"] == "calibration"
    sizes = {name: made.sensor.coefficient(name) for name in made.sensor.coefficients}
    for one, value, std in zip(found["coefficients"], made.values, made.std, strict=True):
        size = sizes[one["name"]]
        assert one["unit"] == size.unit
        assert one["value"] * size.si == pytest.approx(value, rel=1e-6)
        assert one["expanded_uncertainty"] * size.si == pytest.approx(2 * std, rel=1e-6)


def test_a_result_is_what_the_command_line_shows(told: Told):
    file = told.served.runs.folder / told.run / "demo.calibration.json"
    shown = CliRunner().invoke(program, ["show", str(file), "--json"])
    assert shown.exit_code == 0
    assert told.read(f"/api/runs/{told.run}/result") == json.loads(shown.stdout)


def test_a_journal_is_read_whole_or_from_an_event_on(told: Told):
    path = f"/api/runs/{told.run}/journal"
    whole = told.read(path)
    assert [(one["level"], one["words"], one["time"]) for one in whole["events"]] == list(EVENTS)
    assert [one["n"] for one in whole["events"]] == [1, 2]
    assert (whole["steps"], whole["completed_steps"]) == (2, 1)
    assert told.read(f"{path}?after=1")["events"] == whole["events"][1:]
    for text in ("-1", "x", "1e3", "1" * 10, "%C2%B2", ""):
        assert told.served.ask(f"{path}?after={text}", headers=BEARER).status == 400
    times = [whole["begun"], *(one["at"] for one in whole["events"])]
    times += [told.read("/api/state")[name] for name in ("at", "received")]
    assert all(re.fullmatch(r"\d{4}-\d\d-\d\dT[\d:]{8}\.\d{3}\+00:00", one) for one in times)


def test_a_run_that_does_not_exist_is_not_looked_for_elsewhere(told: Told):
    (told.served.runs.folder.parent / "run.journal").write_bytes(b"")
    for name in ("x", "%2e%2e", "..%2f..", f"{told.run}%2f..", "*", "%00", "a" * 300):
        for what in ("journal", "result"):
            assert told.served.ask(f"/api/runs/{name}/{what}", headers=BEARER).status in (403, 404)


def test_a_run_without_a_calibration_has_no_result(own: Told):
    (own.served.runs.folder / own.run / "demo.calibration.json").unlink()
    answer = own.served.ask(f"/api/runs/{own.run}/result", headers=BEARER)
    assert answer.status == 404
    assert "demo.calibration.json" in answer.json["words"]


def test_an_idle_server_answers_too(tmp_path: Path):
    with Served(tmp_path) as served:
        shown = served.ask("/api/state").json
        assert (shown["activity"], shown["run"], shown["state"]) == ("idle", None, None)
        found = served.ask("/api/estimates").json
        assert (found["source"], found["coefficients"]) == (None, [])
        assert served.ask("/api/runs").json == {"runs": []}
