"""No verb writes over an input, a device or a file of another kind; it says so in one line."""

import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import chdir
from pathlib import Path

import pytest
from tests.program import run_program
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file

EXAMPLES = Path(__file__).parents[2] / "examples"
SENSOR = "triad 3"
READ = ("run.toml", "head.toml", "means.toml", "run.calibration.json", "register.db",
        "board.params", "points.csv")  # fmt: skip
# Verbs that write one file, by --out; the inputs that each reads.
FILE_VERBS = {
    "report": (("report", "run.toml"), ("run.toml", "log.csv")),
    "apply": (
        ("apply", "run.calibration.json", "run.toml", "--force"),
        ("run.toml", "log.csv", "run.calibration.json"),
    ),
    "predict": (
        ("predict", "run.calibration.json", "--points", "points.csv", "--force"),
        ("run.calibration.json", "points.csv"),
    ),
    "export": (
        ("export", "run.calibration.json", "--to", "csv", "--force"),
        ("run.calibration.json",),
    ),
    "import": (
        ("import", "board.params", "--from", "px4", "--like", "run.calibration.json", "--force"),
        ("board.params", "run.calibration.json"),
    ),
    "simulate": (("simulate", "run.toml", "--force"), ("run.toml",)),
    "plan": (("plan", "dual-orthogonal", "--run", "head.toml", "--force"), ("head.toml",)),
    "measure": (("measure", "means.toml", "--force"), ("means.toml",)),
    "history": (("store", "history", SENSOR, "--register", "register.db"), ("register.db",)),
}
# Verbs that write files of their own names to a folder, and what they write first.
FOLDER_VERBS = {
    "calibrate": (("calibrate", "run.toml"), ("run.calibration.json", "run.report.html")),
    "budget": (("budget", "run.toml", "--trials", "2"), ("run.budget.json", "run.budget.html")),
    "reproduce": (("reproduce", "centrifuge", "--trials", "20"), ("centrifuge.study.html",)),
    "demo": (("demo", "--quick"), ()),
    "bench run": (("bench", "run", "table.toml", "--table", "no", "--imu", "no"), ()),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Make inputs of all verbs, links to them, and what is no place to write to."""
    folder = tmp_path_factory.mktemp("bench")
    with chdir(folder):
        run_file(folder, SIX_POSITIONS)
        shutil.copy(EXAMPLES / "dividing_head" / "pair.toml", "head.toml")
        shutil.copy(EXAMPLES / "six_position" / "run.toml", "means.toml")
        shutil.copy(EXAMPLES / "turntable" / "filter_keys.toml", "table.toml")
        shutil.copy(EXAMPLES / "export" / "board.params", "board.params")
        Path("points.csv").write_text("fx [g],fy [g]\n0,0\n")
        assert run_program("simulate", "run.toml").status == 0
        assert run_program("calibrate", "run.toml", "--register", "register.db").status == 0
        for name in (*READ, "log.csv"):
            os.link(name, f"hard-{name}")
            Path(f"soft-{name}").symlink_to(name)
        Path("photo.html").write_text("<html>mine</html>")
        Path("loop").symlink_to("loop")
        os.mkfifo("fifo")
        ends = os.openpty()
        Path("device").symlink_to(os.ttyname(ends[1]))
        Path("folder").mkdir()
        Path("forbidden").mkdir()
        Path("forbidden").chmod(0o500)
        yield folder
        for one in ends:
            os.close(one)
        Path("forbidden").chmod(0o700)


def content(folder: Path) -> dict[str, object]:
    """Return types, links and bytes by name."""
    return {
        str(path): path.read_bytes()
        if stat.S_ISREG(mode := path.lstat().st_mode)
        else (stat.S_IFMT(mode), os.readlink(path) if path.is_symlink() else "")
        for path in sorted(folder.rglob("*"))
    }


def refused(folder: Path, *arguments: str | Path) -> None:
    before = content(folder)
    code, _, error = run_program(*arguments)
    assert (code, error[:9]) == (2, "inercal: "), (arguments, error)
    assert error.rstrip("\n").isprintable()
    assert content(folder) == before, arguments


NO_NAMES = ("a" * 300, "a\nb.csv", "a\udcff.csv", "a\x1b[2J.csv", "run.toml/a.csv")


@pytest.mark.slow
@pytest.mark.parametrize("verb", FILE_VERBS)
def test_a_file_is_not_written_over_an_input_or_what_is_no_file(folder: Path, verb: str):
    arguments, inputs = FILE_VERBS[verb]
    places = ["fifo", "device", "loop", "folder", ".", *NO_NAMES]
    places += [how + name for name in inputs for how in ("", "hard-", "soft-")]
    if os.geteuid():
        places.append("forbidden/a.csv")
    for place in places:
        refused(folder, *arguments, "--out", place)


@pytest.mark.parametrize("verb", FOLDER_VERBS)
def test_a_folder_is_not_written_to_where_it_is_none(folder: Path, verb: str):
    arguments, _ = FOLDER_VERBS[verb]
    for place in ("fifo", "device", "loop", "run.toml", *NO_NAMES[:4]):
        refused(folder, *arguments, "--out", place)


@pytest.mark.parametrize("verb", ["calibrate", "budget", "reproduce"])
def test_files_of_a_folder_are_not_written_over_an_input_or_another_kind(folder: Path, verb: str):
    arguments, names = FOLDER_VERBS[verb]
    for name in names:
        place = folder / "folder" / name
        for make in (
            lambda path: os.link(folder / "log.csv", path),
            lambda path: path.symlink_to(folder / "run.toml"),
            lambda path: path.symlink_to(path),
            os.mkfifo,
            Path.mkdir,
            lambda path: path.write_text('{"photo": "<html>mine</html>"}'),
        ):
            make(place)
            refused(folder, *arguments, "--out", "folder")
            place.rmdir() if place.is_dir() else place.unlink()


@pytest.mark.parametrize("verb", FILE_VERBS)
def test_nothing_is_written_where_the_working_directory_was_deleted(
    folder: Path, tmp_path: Path, verb: str
):
    arguments, inputs = FILE_VERBS[verb]
    names = (*inputs, *READ)
    gone = tmp_path / "gone"
    gone.mkdir()
    before = content(folder)
    with chdir(gone):
        gone.rmdir()
        code, _, error = run_program(
            *(str(folder / one) if one in names else one for one in arguments), "--out", "a.html"
        )
    assert (code, error[:9]) == (2, "inercal: "), error
    assert error.rstrip("\n").isprintable()
    assert content(folder) == before


def test_a_page_of_another_origin_stays(folder: Path):
    refused(folder, "report", "run.toml", "--out", "photo.html")


@pytest.mark.slow
def test_own_files_are_written_again_and_links_written_through(folder: Path):
    with chdir(folder / "folder"):
        Path("link.html").symlink_to("page.html")
        for _ in range(2):
            assert run_program("report", "../run.toml", "--out", "link.html").status == 0
            assert run_program("calibrate", "../run.toml").status == 0
        assert Path("link.html").is_symlink()
        assert b"triad 3" in Path("page.html").read_bytes()
        for path in Path().iterdir():
            path.unlink()


@pytest.mark.slow
def test_a_table_of_the_same_columns_is_written_again_and_no_other(tmp_path: Path):
    run = shutil.copy(EXAMPLES / "rate_table" / "ship_recording.toml", tmp_path)
    arguments = ("calibrate", run, "--out", tmp_path, "--no-report")
    assert run_program("simulate", run).status == 0
    for _ in range(2):
        assert run_program(*arguments).status == 0
    table = tmp_path / "ship_recording.states.csv"
    table.write_text("mine,turns,seconds\n")
    refused(tmp_path, *arguments)


@pytest.mark.slow
@pytest.mark.parametrize("verb", ["report", "apply", "simulate", "plan"])
def test_a_missing_folder_is_made_for_a_file(folder: Path, verb: str, tmp_path: Path):
    arguments, _ = FILE_VERBS[verb]
    with chdir(folder):
        place = tmp_path / "a" / "b" / ("page.html" if verb == "report" else "result.csv")
        assert run_program(*arguments, "--out", place).status in (0, 3)
        assert place.exists()


def test_a_folder_that_was_made_goes_with_what_was_not_written(folder: Path, tmp_path: Path):
    with chdir(folder):
        wrong = tmp_path / "wrong.toml"
        wrong.write_text(Path("run.toml").read_text().replace("log.csv", "none.csv"))
        refused(tmp_path, "calibrate", wrong, "--out", tmp_path / "a" / "b")


@pytest.mark.slow
def test_a_calibration_of_this_run_file_is_replaced_and_its_predecessor_kept(tmp_path: Path):
    folder = shutil.copytree(EXAMPLES / "six_position", tmp_path / "run")
    arguments = ("calibrate", folder / "run.toml", "--out", tmp_path / "out", "--no-report")
    result = tmp_path / "out" / "run.calibration.json"
    assert run_program(*arguments).status == 0
    first = result.read_bytes()
    assert run_program(*arguments).status == 0
    assert (tmp_path / "out" / "run.calibration.json.previous").read_bytes() == first
    # The same name of a run file, and another sensor.
    text = (folder / "run.toml").read_text(encoding="utf-8")
    (folder / "run.toml").write_text(text.replace("SN 0417", "SN 0418"), encoding="utf-8")
    refused(tmp_path, *arguments)
    assert run_program(*arguments, "--force").status == 0
    result.write_text('{"schema": "inercal/calibration/2"}', encoding="utf-8")
    refused(tmp_path, *arguments)
