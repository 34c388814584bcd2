"""The wheel in an environment of its own, without the optional parts, then with the report's."""

import os
import re
import subprocess
import sys
from pathlib import Path
from zipfile import ZipFile

import pytest

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "six_position" / "run.toml"
LIMITS = ROOT / "docs" / "explanation" / "limits.md"
LARGEST = 2_670_000  # bytes
MB = 1e6
UV = Path(sys.executable).with_name("uv")


def run(*command: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
    clean = {k: v for k, v in os.environ.items() if not k.startswith(("PYTHON", "VIRTUAL_ENV"))}
    return subprocess.run(
        list(map(str, command)),
        cwd=folder,
        env={**clean, "UV_PYTHON_DOWNLOADS": "never"},
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    made = run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", folder, folder=ROOT)
    assert made.returncode == 0, made.stderr
    (path,) = folder.glob("*.whl")
    return path


def environment(folder: Path, wheel: str) -> Path:
    """Return the scripts of a new environment with the wheel, from packages that uv has stored."""
    made = run(UV, "venv", "--quiet", "--python", sys.executable, "new", folder=folder)
    assert made.returncode == 0, made.stderr
    scripts = folder / "new" / "bin"
    options = ("--quiet", "--offline", "--python", scripts / "python")
    done = run(UV, "pip", "install", *options, wheel, folder=folder)
    if done.returncode:
        pytest.skip(f"uv has not stored the packages: {done.stderr.strip().splitlines()[-1]}")
    return scripts


@pytest.mark.slow
def test_the_wheel_without_extras_calibrates_and_names_the_missing_report(
    wheel: Path, tmp_path: Path
):
    scripts = environment(tmp_path, str(wheel))
    done = run(scripts / "inercal", "calibrate", EXAMPLE, "--out", "out", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "ax.k0" in done.stdout
    assert "inercal[report]" in done.stderr
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["run.calibration.json"]
    checked = run(
        scripts / "inercal", "self-check", "--method", "tumble", "--method", "ferraris", "--json",
        folder=tmp_path,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stdout + checked.stderr
    for verb in ("show", "compare"):
        files = [tmp_path / "out" / "run.calibration.json"] * (1 + (verb == "compare"))
        assert run(scripts / "inercal", verb, *files, folder=tmp_path).returncode == 0


@pytest.mark.slow
def test_the_wheel_is_small_typed_and_has_no_tests(wheel: Path):
    assert wheel.stat().st_size < LARGEST
    with ZipFile(wheel) as archive:
        names = archive.namelist()
    assert "inercal/py.typed" in names
    assert {name.split("/")[0].split("-")[0] for name in names} == {"inercal"}


@pytest.mark.slow
def test_the_page_of_limits_states_the_size_of_the_wheel(wheel: Path):
    (stated,) = re.findall(
        r"wheel of inercal has a size of (\S+) MB", LIMITS.read_text(encoding="utf-8")
    )
    assert float(stated) == pytest.approx(wheel.stat().st_size / MB, abs=0.02)


@pytest.mark.evidence
def test_the_wheel_with_extras_runs_the_demonstration(wheel: Path, tmp_path: Path):
    scripts = environment(tmp_path, f"{wheel}[report,host,io]")
    done = run(scripts / "inercal", "demo", "--quick", "--out", "demo", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    (error,) = re.findall(r"^normalised squared error .*: (\S+) ", done.stdout, flags=re.M)
    assert 0 < float(error) < 2
    done = run(scripts / "inercal", "calibrate", EXAMPLE, "--out", "out", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "run.report.html").exists()
