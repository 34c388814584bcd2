"""What verbs import: heavy libraries only where their work needs them."""

import subprocess
import sys
from pathlib import Path
from shutil import copytree

import pytest
from tests.runfile.run_file_texts import SIX_POSITIONS, run_file

EXAMPLE = Path(__file__).parents[2] / "examples" / "six_position"
HEAVY = ("scipy.special", "scipy.optimize", "scipy.ndimage", "numba", "matplotlib", "pyarrow")
OTHER_VERBS = (
    "inercal.cli.store_commands",
    "inercal.cli.noise_command",
    "inercal.cli.init_command",
)
NEEDLESS = ("numpy.f2py", "numpy.testing", "numpy.random", "numpy.ma", "sqlite3", "rich.status")
NOWHERE = ("pint", "pandas", "h5py")
OTHER_METHODS = tuple(
    f"inercal.methods.{name}"
    for name in (
        "centrifuge_norm",
        "ship_multi_angle",
        "multi_position",
        "tumble",
        "turntable_kalman",
    )
)
WATCHED = HEAVY + NOWHERE + OTHER_METHODS + OTHER_VERBS + NEEDLESS
AFTER_CHECKS = ("scipy", "inercal.estimation.result", "inercal.calibration", "inercal.pipeline")


def heavy_imports(
    *arguments: str | Path,
    status: int = 0,
    watched: tuple[str, ...] = WATCHED,
    verbs: tuple[str, ...] = (),
) -> set[str]:
    """Return which watched modules the program has imported when it ends with this status.

    With `verbs` one process carries out each of them with these arguments.
    """
    commands = [list(map(str, (*verb, *arguments))) for verb in ([(v,) for v in verbs] or [()])]
    code = (
        "import sys\n"
        "from inercal.cli.app import main\n"
        "status = set()\n"
        f"for sys.argv[1:] in {commands!r}:\n"
        "    try:\n"
        "        main()\n"
        "    except SystemExit as stop:\n"
        "        status.add(stop.code or 0)\n"
        f"print([m for m in {watched!r} if m in sys.modules], *status, file=sys.stderr)\n"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", check=False)
    last = done.stderr.splitlines()[-1]
    assert last.endswith(f"] {status}"), done.stderr
    return {name for name in watched if f"'{name}'" in last}


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """Return a run file of six means."""
    return copytree(EXAMPLE, tmp_path / "run") / "run.toml"


@pytest.mark.slow
def test_calibrating_six_means_imports_no_compiler_no_optimiser_and_no_plots(
    table: Path, tmp_path: Path
):
    options = (table, "--out", tmp_path, "--no-report")
    assert heavy_imports("calibrate", *options) == set()


@pytest.mark.slow
def test_a_report_of_six_means_adds_the_plots_alone(table: Path, tmp_path: Path):
    plots = {"matplotlib", "numpy.ma"}
    assert heavy_imports("calibrate", table, "--out", tmp_path) == plots
    assert heavy_imports("report", table, "--out", tmp_path / "page.html") == plots


@pytest.mark.slow
def test_a_mistyped_run_file_is_refused_before_anything_heavy_is_imported(table: Path):
    text = table.read_text(encoding="utf-8")
    table.write_text(text.replace("latitude", "lattitude"), encoding="utf-8")
    verbs = ("calibrate", "report", "simulate", "budget", "measure")
    assert heavy_imports(table, status=2, verbs=verbs) == set()


def test_a_mistyped_run_file_is_refused_without_the_estimators(table: Path):
    text = table.read_text(encoding="utf-8")
    table.write_text(text.replace("latitude", "lattitude"), encoding="utf-8")
    assert heavy_imports("calibrate", table, status=2, watched=AFTER_CHECKS) == set()


@pytest.mark.slow
def test_a_simulation_of_six_positions_imports_nothing_heavy(tmp_path: Path):
    recording = tmp_path / "log.csv"
    options = (run_file(tmp_path, SIX_POSITIONS), "--out", recording)
    assert heavy_imports("simulate", *options) == {"numpy.random"}
    assert recording.is_file()
