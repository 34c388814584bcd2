"""The template of a driver, installed as a package in an environment of its own."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copytree, which

import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "own_driver"
UV = which("uv", path=str(Path(sys.executable).parent)) or which("uv")

pytestmark = pytest.mark.slow  # `tests/host/test_driver_check.py` checks the template in fast tests


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the Python of a new environment that sees inercal, with the template installed."""
    if UV is None:
        pytest.skip("uv, which makes the environment, is not installed")
    folder = tmp_path_factory.mktemp("own_driver")
    package = copytree(FOLDER, folder / "package")
    found = folder / "new" / "bin" / "python"
    program(UV, "venv", "--quiet", "--python", sys.executable, "new", folder=folder)
    (site,) = (folder / "new" / "lib").glob("*/site-packages")
    shared = [str(ROOT / "src"), *(path for path in sys.path if path.endswith("site-packages"))]
    (site / "inercal_of_the_tests.pth").write_text("\n".join(shared))
    options = ("--quiet", "--offline", "--no-deps", "--no-build-isolation", "--python", found)
    program(UV, "pip", "install", *options, package, folder=folder)
    return found


def program(
    *command: str | Path, folder: Path, status: int = 0
) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        list(map(str, command)), cwd=folder, env=environment(), capture_output=True, text=True,
        encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.returncode == status, done.stdout + done.stderr
    return done


def environment() -> dict[str, str]:
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    return {**clean, "UV_PYTHON_DOWNLOADS": "never"}


@contextmanager
def simulator(python: Path, folder: Path) -> Iterator[str]:
    """Run the simulator as a process, ten times as fast as a real spindle."""
    with subprocess.Popen(
        [python, "-m", "spindle_simulator", "--port", "0", "--pace", "10"], cwd=folder,
        env=environment(), stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdin
        assert process.stdout
        yield process.stdout.readline().strip().removeprefix("at tcp")
        process.stdin.close()


def test_the_installed_driver_is_found_by_its_address_and_passes_all_checks(
    python: Path, tmp_path: Path
):
    with simulator(python, tmp_path) as place:
        address = f"spindle{place}"
        inercal = (python, "-m", "inercal", "bench")
        seen = program(*inercal, "devices", "--table", address, "--json", folder=tmp_path)
        assert json.loads(seen.stdout)["table"]["identity"] == "SPINDLE-1"
        options = (address, "--pace", "10", "--json")
        done = program(*inercal, "check-driver", *options, folder=tmp_path)
    results = json.loads(done.stdout)
    assert len(results) == 13
    assert all(one["passed"] for one in results)


@pytest.mark.evidence
def test_a_failed_check_ends_with_status_1(python: Path, tmp_path: Path):
    with simulator(python, tmp_path) as place:
        # A pace of 1 is wrong for this simulator, so its clock is too fast.
        options = ("-m", "inercal", "bench", "check-driver", f"spindle{place}", "--json")
        done = program(python, *options, folder=tmp_path, status=1)
    failed = [one["name"] for one in json.loads(done.stdout) if not one["passed"]]
    assert failed == ["clock"]


@pytest.mark.evidence
def test_the_templates_own_tests_pass(python: Path, tmp_path: Path):
    (tmp_path / "test_spindle.py").write_bytes((FOLDER / "test_spindle.py").read_bytes())
    program(python, "-m", "pytest", "-q", "test_spindle.py", folder=tmp_path)


def test_a_mistyped_scheme_is_answered_with_the_installed_ones(python: Path, tmp_path: Path):
    options = ("-m", "inercal", "bench", "check-driver", "spindel://127.0.0.1")
    done = program(python, *options, folder=tmp_path, status=2)
    assert done.stderr.count("\n") == 1
    assert "spindle://HOST:4000" in done.stderr
