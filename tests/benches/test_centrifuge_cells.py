"""A centrifuge table with one impossible cell, or with attitudes that do not suffice."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.runfile.key_sweep import EXAMPLES, example, toml

from inercal import calibrate
from inercal.basics.errors import InercalError, NotObserved
from inercal.benches.centrifuge.kind import KIND
from inercal.runfile import read

LINES = (EXAMPLES / "centrifuge" / "lab.csv").read_text(encoding="utf-8").splitlines()
FREE = tuple(("bench", key, None) for key in ("indexing", "mounting"))


def written(folder: Path, lines: list[str]) -> Path:
    (folder / "lab.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    path = folder / "run.toml"
    content = example("centrifuge/lab.toml", *FREE, ("data", "attitude", None))
    path.write_text(toml(content), encoding="utf-8")
    return path


def test_a_reading_without_its_decimal_mark_is_refused_with_its_row(tmp_path: Path):
    head = next(k for k, line in enumerate(LINES) if line.startswith("position"))
    cells = LINES[head + 2].split(",")
    place = LINES[head].split(",").index("ay")
    cells[place] = cells[place].replace(".", "")
    path = written(tmp_path, [*LINES[: head + 2], ",".join(cells), *LINES[head + 3 :]])
    with refused(file="lab.csv") as caught:
        KIND.observe(read(path))
    assert "ay" in str(caught.value)
    assert "1 at 80 rpm" in str(caught.value)


def test_a_rate_that_is_ten_times_too_large_is_refused_with_its_row(tmp_path: Path):
    lines = [line.replace("1,10,20,80,", "1,10,20,800,") for line in LINES]
    assert lines != LINES
    with refused(file="lab.csv") as caught:
        KIND.observe(read(written(tmp_path, lines)))
    assert "1 at 800 rpm" in str(caught.value)


def test_too_few_rows_name_the_coefficients_that_they_do_not_determine(tmp_path: Path):
    head = next(k for k, line in enumerate(LINES) if line.startswith("position"))
    path = written(tmp_path, LINES[: head + 6])
    with pytest.raises(NotObserved) as caught:
        calibrate(path)
    assert "az.k2" in caught.value.names
    assert str(caught.value).index("az.k2") < str(caught.value).index("(")


def test_a_fit_without_an_end_names_the_coefficients_that_are_not_determined(tmp_path: Path):
    """The y axis senses almost nothing in attitudes that are turned about it."""
    rng, lines = np.random.default_rng(1), ["position,rpm,ax,ay,az"]
    for k, angle in enumerate(np.radians([0.0, 90.0, 180.0])):
        for rpm in range(40, 241, 40):
            out, g = 1.5 * (rpm * np.pi / 30) ** 2 / 9.80665, 1.0006
            x = -out * np.cos(angle) - g * np.sin(angle)
            z = -out * np.sin(angle) + g * np.cos(angle)
            y = 5e-5 * x + 0.002
            read_ = 0.1 * np.array([x + 0.004, y, z - 0.003]) + 1e-6 * rng.standard_normal(3)
            lines.append(f"{k},{rpm}," + ",".join(f"{one:.7f}" for one in read_))
    path = written(tmp_path, lines)
    with pytest.raises(InercalError) as caught:
        calibrate(path)
    assert {"ay.k1", "ay.k2"} <= set(caught.value.names), str(caught.value)
