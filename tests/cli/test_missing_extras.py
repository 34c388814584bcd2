"""Without any extra, each verb does its work or names the missing extra in one line."""

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from shutil import copy, copytree
from typing import Any

import pytest
import typer

from inercal.basics.errors import missing_extra
from inercal.cli.app import app

ROOT = Path(__file__).parents[2]
CALIBRATION = "out/run.calibration.json"
DATABASE = "--register register.db"
EXTRAS = [
    "PIL", "alembic", "dask", "distributed", "fsspec", "h5py", "jinja2", "lxml", "matplotlib",
    "msgpack", "openpyxl", "pandas", "psycopg", "pyarrow", "pyhanko", "pymodbus", "pyulog",
    "pyvisa", "rosbags", "s3fs", "serial", "signxml", "sqlalchemy", "starlette", "tomlkit",
    "typst", "uvicorn", "websockets", "yaml",
]  # fmt: skip
# In this order; the verbs after `calibrate` read its result.
ARGUMENTS = {
    "demo": "--quick --out demo",
    "init": "positions.csv --yes --report --out drafted.toml",
    "calibrate": "run.toml --no-report --out out",
    "show": CALIBRATION,
    "compare": f"{CALIBRATION} {CALIBRATION}",
    "plan": "run.toml --out sheet.csv",
    "measure": "run.toml --out measured.csv",
    "budget": "run.toml --trials 2 --out out",
    "noise": "run.toml --report",
    "simulate": "run.toml --out simulated.parquet",
    "apply": f"{CALIBRATION} run.toml --out corrected.parquet",
    "predict": f"{CALIBRATION} --sweep 'fx=0 g…1 g' --out sweep.html",
    "repeat": f"{CALIBRATION} {CALIBRATION} --out repeated",
    "prior": f"{CALIBRATION} {CALIBRATION}",
    "qualify": "gravity.toml",
    "control": f"{CALIBRATION} {CALIBRATION} --out charts",
    "export": f"{CALIBRATION} --to kalibr --out imu.yaml",
    "import": "imu.yaml --from kalibr --out imported.json",
    "report": "run.toml",
    "bundle": "run.toml --out bundle.zip",
    "reproduce": "ship-model --out reproduced",
    "compile": "--help",  # what it compiles needs no extra
    "self-check": "--help",  # the same
    "bench run": "run.toml --table pmac://localhost:1 --imu serial:/dev/null --out bench",
    "bench resume": "out",
    "bench simulate": "run.toml",
    "bench serve": "--port 0",
    "bench devices": "",
    "bench check-driver": "watlow-f4t://localhost:1",
    "certificate issue": f"{CALIBRATION} --lab lab.toml --draft",
    "certificate verify": CALIBRATION,
    "certificate copy": f"1 {DATABASE}",
    "certificate list": DATABASE,
    "fleet calibrate": "line",
    "fleet status": "line",
    "fleet report": "line",
    "fleet export": "line table.csv",
    "store list": DATABASE,
    "store show": f"1 {DATABASE}",
    "store history": f"triad {DATABASE}",
    "store diff": f"{CALIBRATION} {CALIBRATION}",
    "store import": f"{CALIBRATION} {DATABASE}",
    "store backup": f"copy.db {DATABASE}",
    "store restore": f"copy.db {DATABASE}",
}
NAMING = {
    "fleet status": "fleet", "fleet report": "report", "fleet export": "fleet",
    "store list": "store", "certificate issue": "certificate", "report": "report",
    "bench serve": "host",
}  # fmt: skip
PROGRAM = """
import json, os, shlex, sys, traceback
from contextlib import redirect_stderr, redirect_stdout
from importlib.machinery import PathFinder
from io import StringIO

class Bare(PathFinder):
    @classmethod
    def find_spec(cls, name, *where):
        return None if name.partition(".")[0] in extras else super().find_spec(name, *where)

commands, extras = map(json.loads, sys.argv[1:])
sys.meta_path = [Bare if one is PathFinder else one for one in sys.meta_path]
sys.stdin = open(os.devnull)
from inercal.cli.app import main
ended = {}
for verb, arguments in commands.items():
    sys.argv = ["inercal", *verb.split(), *shlex.split(arguments)]
    error = StringIO()
    with redirect_stdout(StringIO()), redirect_stderr(error):
        try:
            main()
        except SystemExit:
            pass
        except BaseException:
            traceback.print_exc()
    ended[verb] = error.getvalue()
print(json.dumps(ended))
"""


def verbs(command: Any, path: str = "") -> Iterator[str]:
    """Yield the names of all verbs below a command."""
    groups: dict[str, Any] = getattr(command, "commands", {})
    if not groups:
        yield path.strip()
    for name in groups:
        yield from verbs(groups[name], f"{path} {name}")


def test_every_verb_is_tried():
    assert list(ARGUMENTS) == list(verbs(typer.main.get_command(app)))


@pytest.mark.slow
def test_without_extras_no_verb_ends_in_a_traceback(tmp_path: Path):
    copytree(ROOT / "examples" / "six_position", tmp_path, dirs_exist_ok=True)
    copytree(ROOT / "examples" / "fleet", tmp_path / "line")
    copy(ROOT / "examples" / "qualify" / "gravity.toml", tmp_path)
    command = [sys.executable, "-c", PROGRAM, json.dumps(ARGUMENTS), json.dumps(EXTRAS)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert not done.returncode, done.stderr
    ended: dict[str, str] = json.loads(done.stdout)
    assert not {verb: text for verb, text in ended.items() if "Traceback" in text}
    for verb, extra in NAMING.items():
        assert ended[verb].count("\n") == 1, (verb, ended[verb])
        assert f"pip install 'inercal[{extra}]'" in ended[verb], (verb, ended[verb])


@pytest.mark.parametrize(
    ("module", "extra"),
    [("lxml.etree", "certificate"), ("yaml", "kalibr"), ("serial", "host"), ("psycopg", "store"),
     ("numpy", None), (None, None)],
)  # fmt: skip
def test_the_extra_of_a_missing_module_is_known(module: str | None, extra: str | None):
    found = missing_extra(ImportError("missing", name=module))
    assert (found and found.names) == (extra and (extra,))
