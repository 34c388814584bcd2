"""`inercal compile`: afterwards a copy of the package compiles nothing."""

import json
import os
import subprocess
import sys
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest

import inercal

ROOT = Path(__file__).parents[1]
START = """
import sys
from numba.core import event
with event.install_recorder("numba:compile") as recorder:
    from inercal.cli.app import main
    try:
        main()
    except SystemExit as stop:
        assert not stop.code or stop.code == 3, stop.code
print([one.data["dispatcher"].py_func.__qualname__ for _, one in recorder.buffer], file=sys.stderr)
"""


def run_program(parent: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the program of a package in a folder."""
    environment = os.environ | {"PYTHONPATH": str(parent)}
    environment.pop("NUMBA_CACHE_DIR", None)
    return subprocess.run(
        [sys.executable, "-c", START, *map(str, arguments)],
        env=environment,
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
    )


@pytest.mark.evidence
def test_after_compile_no_method_compiles(tmp_path: Path):
    own = tmp_path / "installed"
    source = Path(inercal.__file__).parent
    copytree(source, own / "inercal", ignore=ignore_patterns("__pycache__"))
    compiled = run_program(own, "compile", "--json")
    assert compiled.returncode == 0, compiled.stderr
    answer = json.loads(compiled.stdout)
    assert answer["folder"] == str(own / "inercal")
    assert answer["not_compiled"] == []
    assert answer["kernels"] == len(list(own.rglob("*.nbc"))) > 50
    examples = ("hand_held/simulated", "turntable/mimu", "systematic/imu", "ferraris_simulated/run")
    for example in examples:
        run = copytree((ROOT / "examples" / example).parent, tmp_path / example) / "run.toml"
        run = run.with_name(f"{Path(example).name}.toml")
        verbs = [("simulate", run), ("calibrate", run, "--out", tmp_path)]
        if example == "systematic/imu":  # its other estimator has a kernel of its own
            text = run.read_text(encoding="utf-8")
            other = run.with_name("by_filter.toml")
            changed = text.replace("[method]\n", '[method]\nestimator = "kalman"\n')
            other.write_text(changed, encoding="utf-8")
            verbs.append(("calibrate", other, "--out", tmp_path))
        for verb in verbs:
            done = run_program(own, *verb)
            assert done.stderr.splitlines()[-1] == "[]", done.stderr
