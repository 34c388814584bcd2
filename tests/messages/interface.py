"""Families of messages of run files, the command line, plans, budgets, reports and registers."""

from collections.abc import Callable
from pathlib import Path

from tests.runfile.run_file_texts import FERRARIS, changed

from inercal.runfile import read


def run_file(*changes: tuple[str, str], more: str = "") -> Callable[[Path], object]:
    """Return the reading of a run file with these changes."""

    def refuse(folder: Path) -> object:
        path = folder / "run.toml"
        path.write_text(changed(FERRARIS, *changes) + more, encoding="utf-8")
        return read(path)

    return refuse


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
}
