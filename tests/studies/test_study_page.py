"""Names, the page, and the command line of studies."""

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.parallel import Executor, SerialExecutor
from inercal.cli.app import main
from inercal.studies import STUDIES, Study, reproduce, results_as_list, write_study

KEYS = ["claim", "printed", "expected", "computed", "uncertainty", "verdict"]
VERDICTS = {"reproduced", "not reproducible", "false"}


def test_an_unknown_study_is_refused_with_those_there_are():
    with refused(key="name", names=("ferris wheel",)):
        reproduce("ferris wheel")


@pytest.mark.parametrize(("trials", "seed", "key"), [(19, 0, "--trials"), (20, -1, "--seed")])
def test_invalid_trials_and_seeds_are_refused(trials: int, seed: int, key: str):
    with refused(key=key):
        reproduce("centrifuge", trials, seed)


def test_progress_messages_are_reported(monkeypatch: pytest.MonkeyPatch):
    class Stub:
        @staticmethod
        def run(
            trials: int, seed: int, say: Callable[[str], object], executor: Executor
        ) -> tuple[int, int]:
            assert isinstance(executor, SerialExecutor)
            say("half of it")
            return trials, seed

    monkeypatch.setattr("inercal.studies.import_module", lambda name: (Stub, name)[0])
    said: list[str] = []
    assert reproduce("centrifuge", 30, 7, said.append) == (30, 7)
    assert said == ["half of it"]
    assert set(STUDIES) == {
        "centrifuge", "dual-orthogonal", "one-sensor", "ship-model", "turntable"
    }  # fmt: skip


def test_every_finding_has_its_sentence_and_its_own_name(each_study: Study):
    titles = [finding.claim.title for finding in each_study.findings]
    assert len(set(titles)) == len(titles)
    for finding in each_study.findings:
        assert finding.computed_text in finding.explanation
        assert finding.expected_text in finding.explanation
        assert finding.reason in finding.explanation


def test_the_list_has_the_documented_keys_and_plain_numbers(each_study: Study):
    content = json.loads(json.dumps(results_as_list(each_study), allow_nan=False))
    assert len(content) == len(each_study.findings)
    for entry in content:
        assert list(entry) == KEYS
        assert isinstance(entry["claim"], str)
        assert entry["verdict"] in VERDICTS
        assert isinstance(entry["expected"], float)
        assert entry["printed"] in (entry["expected"], None)
        assert entry["computed"] is None or isinstance(entry["computed"], float)
        assert isinstance(entry["uncertainty"], float)


@pytest.fixture(scope="session")
def html(centrifuge_study: Study, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = write_study(centrifuge_study, tmp_path_factory.mktemp("page") / "new folder")
    assert path.name == "centrifuge.study.html"
    assert [p.name for p in path.parent.iterdir()] == [path.name]
    return path.read_text(encoding="utf-8")


@pytest.mark.slow
def test_the_page_has_every_section_table_chart_and_finding(centrifuge_study: Study, html: str):
    for section in centrifuge_study.sections:
        assert f'<section id="{section.name}">' in html
        for table in section.tables:
            assert f"<caption>{table.title}</caption>" in html.replace("&#39;", "'")
        for chart in section.charts:
            assert f'id="{chart.name}-' in html
    assert html.count("<svg ") == sum(len(s.charts) for s in centrifuge_study.sections) == 3
    assert html.count('class="tag ') == 2 * len(centrifuge_study.findings)
    for name in ("Table 1", "Table 2", "Table 3", "Fig. 4"):
        assert name in html


def test_the_page_shows_all_of_table_1_with_the_lost_signs_marked(html: str):
    body = html.split("All 180 entries, V", 1)[1].split("</table>")[0]
    assert body.count("<tr>") == 61
    assert body.count('class="far"') == 23
    assert body.count("sign of z") == 18
    assert body.count("sign of x") == 5
    assert "3.9291072" in body


def test_the_page_needs_nothing_but_itself_and_follows_the_readers_colours(html: str):
    assert not re.search(r'(src|href)="(?!#)', html)
    assert "default-src 'none'" in html
    assert not re.search(r"#010a0[0-9a-f]", html)
    assert "prefers-color-scheme: dark" in html


@pytest.fixture
def short_study(centrifuge_study: Study) -> Study:
    """Return the study without charts, whose drawing takes most of the time of a page."""
    sections = [replace(section, charts=()) for section in centrifuge_study.sections]
    return replace(centrifuge_study, sections=sections)


def test_a_page_that_cannot_be_written_leaves_nothing(short_study: Study, tmp_path: Path):
    (tmp_path / "file").write_text("")
    with refused(key="--out", file="file"):
        write_study(short_study, tmp_path / "file")
    (tmp_path / "centrifuge.study.html").mkdir()
    with pytest.raises(InputError):
        write_study(short_study, tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["centrifuge.study.html", "file"]


Said = Callable[..., tuple[str, str]]


@pytest.fixture
def run_reproduce(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Said:
    """Run the verb within this process; return standard output and standard error."""

    def run(*arguments: str | Path) -> tuple[str, str]:
        monkeypatch.setattr("sys.argv", ["inercal", "reproduce", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capsys.readouterr()
        assert stop.value.code in (0, None), err
        return out, err

    return run


@pytest.fixture
def reproduce_calls(
    monkeypatch: pytest.MonkeyPatch, short_study: Study
) -> list[tuple[str, int, int]]:
    """Replace `reproduce` by a finished study; return the list of its calls."""
    found: list[tuple[str, int, int]] = []

    def at_once(
        name: str, trials: int, seed: int, say: Callable[[str], object], executor: Executor
    ) -> Study:
        say("at once")
        found.append((name, trials, seed))
        return short_study

    monkeypatch.setattr("inercal.studies.reproduce", at_once)
    return found


def test_json_is_a_list_and_nothing_is_written(
    run_reproduce: Said,
    tmp_path: Path,
    centrifuge_study: Study,
    monkeypatch: pytest.MonkeyPatch,
    reproduce_calls: list[tuple[str, int, int]],
):
    monkeypatch.chdir(tmp_path)
    out, _ = run_reproduce("centrifuge", "--json", "--trials", "20", "--seed", "3")
    assert json.loads(out) == results_as_list(centrifuge_study)
    assert list(tmp_path.iterdir()) == []
    assert reproduce_calls == [("centrifuge", 20, 3)]


@pytest.mark.usefixtures("reproduce_calls")
def test_json_with_a_folder_writes_the_page_too(
    run_reproduce: Said, tmp_path: Path, centrifuge_study: Study
):
    out, _ = run_reproduce("centrifuge", "--json", "--out", tmp_path)
    assert json.loads(out) == results_as_list(centrifuge_study)
    assert (tmp_path / "centrifuge.study.html").is_file()


@pytest.mark.usefixtures("reproduce_calls")
def test_the_terminal_shows_every_claim_with_its_verdict(
    run_reproduce: Said, tmp_path: Path, centrifuge_study: Study
):
    out, _ = run_reproduce("centrifuge", "--out", tmp_path)
    assert f"wrote {tmp_path / 'centrifuge.study.html'}" in out.replace("\n", "")
    words = out.split()
    assert words.count("false") == sum(f.verdict == "false" for f in centrifuge_study.findings)
    assert words.count("reproducible") == sum("not" in f.verdict for f in centrifuge_study.findings)
    for finding in centrifuge_study.findings:
        assert finding.computed_text in out


def test_an_unknown_study_is_one_line_and_status_2(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setattr("sys.argv", ["inercal", "reproduce", "ferris"])
    with pytest.raises(SystemExit) as stop:
        main()
    out, err = capsys.readouterr()
    assert stop.value.code == 2
    assert out == ""
    names = "centrifuge, dual-orthogonal, one-sensor, ship-model, turntable"
    assert err.startswith(f"inercal: no study 'ferris'; the studies are {names}")
    assert err.count("\n") == 1
