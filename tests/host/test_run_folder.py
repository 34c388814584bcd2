"""The folder of a run: what it takes in, what it leaves alone, what is left where a run failed."""

import signal
from pathlib import Path

import pytest
from tests.host.simulated_runs import plan
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.cli.bench_commands import ended_by_signals
from inercal.host.journal import Journal
from inercal.host.run_folder import RunFolder, create_run, reopen_run
from inercal.host.web.folders import Runs
from inercal.runfile import read

TABLE, IMU = "pmac://10.0.0.5:1025?motors=1,2,3&counts=3600000", "tcp://10.0.0.5:99?preset=fixed"
CLOCK, OTHER_CLOCK = "clock://127.0.0.1:40000", "clock://127.0.0.1:40001"
ELSEWHERE, OTHER_IMU = TABLE.replace(".5:", ".6:"), IMU.replace(":99", ":98")


@pytest.mark.parametrize("name", ["plan.toml", "plan.report.html", "plan.calibration.json"])
def test_a_folder_that_holds_a_file_of_a_runs_name_is_refused_and_left_as_it_is(
    tmp_path: Path, name: str
):
    run = plan(tmp_path / "plan")
    out = tmp_path / "out"
    out.mkdir()
    (out / name).write_text("mine", encoding="utf-8")
    with refused(file="out", names=(name,)):
        create_run(out, run, (TABLE, IMU, ""))
    assert [(one.name, one.read_text(encoding="utf-8")) for one in out.iterdir()] == [
        (name, "mine")
    ]


def test_a_run_in_the_folder_of_its_own_plan_is_refused(tmp_path: Path):
    run = plan(tmp_path)
    before = {one.name: one.read_bytes() for one in tmp_path.iterdir()}
    with refused(file=tmp_path, names=("plan.toml",)):
        create_run(tmp_path, run, (TABLE, IMU, ""))
    assert {one.name: one.read_bytes() for one in tmp_path.iterdir()} == before


def test_filter_keys_that_are_changed_are_journalled(tmp_path: Path):
    for name, more in (("plain", ""), ("keys", '\n[method.filter]\nepoch = "0.2 s"\n')):
        run = plan(tmp_path / name)
        run.path.write_text(run.path.read_text(encoding="utf-8") + more, encoding="utf-8")
        made, journal = create_run(tmp_path / f"run {name}", read(run.path), (TABLE, IMU, ""))
        with journal:
            said = [one.words for one in journal.events()]
        copied = (made.path / run.path.name).read_text(encoding="utf-8")
        assert copied == run.path.read_text(encoding="utf-8")
        assert [words for words in said if "epoch 0.2 s (default 0.1 s)" in words] == said
        assert len(said) == (1 if more else 0)


def begun(tmp_path: Path, clock: str = CLOCK) -> RunFolder:
    made, journal = create_run(tmp_path / "run", plan(tmp_path / "plan"), (TABLE, IMU, clock))
    journal.close()
    return made


def test_a_run_that_checks_its_plan_or_calibrates_is_listed_as_running(tmp_path: Path):
    made, runs = begun(tmp_path), Runs(tmp_path)
    with made.locked():
        assert runs.find("run").state == "running"
        with refused(file="run"), made.locked():
            pass
    assert runs.find("run").state == "interrupted"


@pytest.mark.parametrize("why", [InputError("nobody is there"), KeyboardInterrupt()])
def test_of_a_run_that_was_not_begun_nothing_is_left(tmp_path: Path, why: BaseException):
    made = begun(tmp_path)
    (made.path / "note").touch()
    made.log.touch()
    with pytest.raises(type(why)), made.removed_on_failure("note"):
        raise why
    assert not made.path.exists()


def test_of_a_run_that_was_begun_all_is_left(tmp_path: Path):
    made = begun(tmp_path)
    made.log.write_bytes(b"something")
    before = sorted(made.path.iterdir())
    with pytest.raises(KeyboardInterrupt), made.removed_on_failure():
        raise KeyboardInterrupt
    assert sorted(made.path.iterdir()) == before


def test_a_simulated_run_goes_on_at_a_simulated_bench_wherever_that_is_now(tmp_path: Path):
    made = begun(tmp_path)
    for given, now in (
        (("", "", ""), (TABLE, IMU, CLOCK)),
        ((TABLE, OTHER_IMU, ""), (TABLE, OTHER_IMU, CLOCK)),
        ((ELSEWHERE, "", OTHER_CLOCK), (ELSEWHERE, OTHER_IMU, OTHER_CLOCK)),
    ):
        _, journal = reopen_run(made.path, given)
        with journal:
            assert journal.header().addresses == now


@pytest.mark.parametrize(
    ("clock", "given"), [(CLOCK, (ELSEWHERE, "", "")), ("", (ELSEWHERE, "", CLOCK))]
)
def test_what_was_begun_in_simulation_does_not_go_on_on_iron_nor_the_other_way_round(
    tmp_path: Path, clock: str, given: tuple[str, str, str]
):
    made = begun(tmp_path, clock)
    with refused(key="--clock", file=made.path):
        reopen_run(made.path, given)
    _, journal = reopen_run(made.path)
    with journal:
        assert journal.header().addresses == (TABLE, IMU, clock)


def test_a_folder_whose_journal_could_not_be_made_may_be_named_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def full(*_: object) -> Journal:
        raise InputError("no space left on device")

    with monkeypatch.context() as patched:
        patched.setattr(Journal, "create", full)
        with pytest.raises(InputError):
            begun(tmp_path)
    assert begun(tmp_path).path.exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_of_a_run_that_a_signal_ends_before_it_connects_nothing_is_left(
    tmp_path: Path, number: signal.Signals
):
    made, before = begun(tmp_path), signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), ended_by_signals(), made.removed_on_failure():
        signal.raise_signal(number)
    assert not made.path.exists()
    assert signal.getsignal(number) is before
