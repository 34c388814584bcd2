"""Families of messages of run files, the command line, plans, budgets, reports and registers."""

from collections.abc import Callable
from pathlib import Path

from tests.runfile.run_file_texts import FERRARIS, changed

from inercal.cli.options import run_options
from inercal.cli.outputs import PAGE, WORKSHEET, check_outputs, require_same_run
from inercal.laboratory.store import Register
from inercal.laboratory.store.connection import resolve_address
from inercal.pipeline import simulate
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.pipeline.design import rehearse_plan
from inercal.runfile import read


def occupied(folder: Path) -> Path:
    """Return a file that exists."""
    path = folder / "sheet.csv"
    path.write_text("filled", encoding="utf-8")
    return path


def write_run_file(folder: Path, *changes: tuple[str, str], more: str = "") -> Path:
    """Return a run file with these changes."""
    path = folder / "run.toml"
    path.write_text(changed(FERRARIS, *changes) + more, encoding="utf-8")
    return path


def run_file(*changes: tuple[str, str], more: str = "") -> Callable[[Path], object]:
    """Return the reading of a run file with these changes."""
    return lambda folder: read(write_run_file(folder, *changes, more=more))


CASES: dict[str, Callable[[Path], object]] = {
    "no run file": lambda folder: read(folder / "run.toml"),
    "TOML grammar": run_file(('rate = "50 Hz"', 'rate = "50 Hz')),
    "missing section": run_file(("[data]", "[spare]")),
    "missing key": run_file(('file = "log.csv"\n', "")),
    "unknown key": run_file(('turn_tilt = "0.3 °"', 'turn_tlt = "0.3 °"')),
    "key of another bench": run_file(('time = "time"', 'time = "time"\nangle = "angle"')),
    "wrong type": run_file(('rate = "50 Hz"', "rate = 50")),
    "unknown word": run_file(("[sensor]\n", '[sensor]\nframe = "sym"\n')),
    "unit without a scale": run_file(('scale = "2048 LSB/g"\n', "")),
    "not positive": run_file(('rate = "50 Hz"', 'rate = "0 Hz"')),
    "option of another plan": run_file(('turn = "360 °"', "positions = 8")),
    "prior without uncertainty": run_file(more='[method.prior]\n"az.k0" = "3 mg"\n'),
    "truth of an unknown coefficient": run_file(('"ax.k0" = "32 mg"', '"ax.k0" = "32 °/s"')),
    "simulation without a rate": lambda folder: simulate(
        write_run_file(folder, ('rate = "50 Hz"\n', ""))
    ),
    "plan that is fixed": lambda folder: rehearse_plan(read(write_run_file(folder))),
    "budget without noise": lambda folder: experiment_from_run(
        read(write_run_file(folder, ('white = "100 µg/√Hz"\n', "")))
    ),
    "file that exists": lambda folder: check_outputs({occupied(folder): WORKSHEET}, force=False),
    "damaged result": lambda folder: require_same_run(occupied(folder), Path("run.toml"), "imu"),
    "file of another kind": lambda folder: check_outputs({occupied(folder): PAGE}),
    "output that is an input": lambda folder: check_outputs(
        {folder / "sheet.csv": PAGE}, [occupied(folder)]
    ),
    "option of a temperature": lambda _: run_options(None, 1.0, "40:15"),
    "address of a register": lambda _: resolve_address("mysql://host/lab"),
    "file of a register": lambda folder: Register(str(folder / "none" / "register.db")),
    "sensor of a register": lambda folder: Register(str(folder / "register.db")).sensor("x"),
}
