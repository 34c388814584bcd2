"""Families of messages of recordings, files, units, sections and calibrations."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from inercal.basics.units import parse_quantity
from inercal.calibration import Calibration
from inercal.calibration.files import load
from inercal.methods import METHODS
from inercal.physics import frames
from inercal.physics.sensors import Noise, inverse, triad
from inercal.recordings import Mark, Recording
from inercal.recordings.data.rest_marks import marks_from_file
from inercal.recordings.io.audit import audit, require_accepted
from inercal.recordings.io.read import Columns, read_recording, read_table
from inercal.recordings.io.time_stamps import times_from_counter
from inercal.recordings.io.write import write_recording
from inercal.recordings.segments import check_marks, find_rests, marks_from_labels, require_still

COLUMNS = Columns((("x", "x", "g"), ("y", "y", "g")), time="t")
TRIAD = triad()


def read(folder: Path, *changes: tuple[int, str], columns: Columns = COLUMNS) -> Recording:
    """Read a log of 20 rows with some lines, counted from 1, replaced."""
    lines = ["t,x,y", *(f"{k / 100},{k % 7},{k % 5}" for k in range(20))]
    for number, line in changes:
        lines[number - 1] = line
    path = folder / "log.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return read_recording(path, columns)


def made(**changes: object) -> Recording:
    """Return 1000 samples of noise of a triad, with labels."""
    data = np.random.default_rng(1).normal(size=(1000, 3))
    labels = np.repeat(["a", "b"], 500)
    base = Recording(
        np.arange(1000) / 100, data, TRIAD.channels, ("g",) * 3, labels, source="log.csv"
    )
    return replace(base, **changes)  # type: ignore[arg-type]


def marks(folder: Path, content: str) -> object:
    (folder / "marks.csv").write_text(content, encoding="utf-8")
    return marks_from_file(folder / "marks.csv")


def counted(folder: Path) -> object:
    columns = replace(COLUMNS, time="t", time_unit="sample", rate_hz=100.0, modulus=16)
    return read(folder, columns=columns)


def moved() -> object:
    data = made().data * 1e-3
    data[250:500] += 1.0
    return require_still(made(data=data), TRIAD, [Mark("a", 0, 500), Mark("b", 500, 1000)])


def calibration() -> Calibration:
    return Calibration(triad().with_coefficients("k2"), np.full(3, 0.01), np.eye(3))


CASES: dict[str, Callable[[Path], object]] = {
    "quantity of another dimension": lambda _: parse_quantity("2 mm", "rad"),
    "quantity without unit": lambda _: parse_quantity("5", "m"),
    "unknown unit": lambda _: parse_quantity("5 khz", "Hz"),
    "missing file": lambda folder: read_table(folder / "none.csv"),
    "word among numbers": lambda folder: read(folder, (9, "0.07,ERR,2")),
    "row with too few columns": lambda folder: read(folder, (21, "0.19,2")),
    "missing column": lambda folder: read(folder, (1, "t,X,y")),
    "number that is not finite": lambda folder: read(folder, (9, "0.07,nan,2")),
    "time that decreases": lambda folder: read(folder, (9, "0.01,1,2")),
    "unit of time": lambda folder: read(folder, columns=replace(COLUMNS, time_unit="ms")),
    "counter with fractions": counted,
    "late packet": lambda _: times_from_counter([0, 1, 3, 2, 4], 256, 100.0),
    "constant channel": lambda _: require_accepted(
        audit(made(data=np.tile([1.0, 2.0, 3.0], (1000, 1))))
    ),
    "suffix of a written file": lambda folder: write_recording(made(), folder / "run.mat"),
    "marks without a column": lambda folder: marks(folder, "label,start\nx_p,540\n"),
    "label that returns": lambda _: marks_from_labels(made(labels=np.tile(["a", "b"], 500))),
    "overlapping marks": lambda _: check_marks(
        [Mark("a", 0, 10), Mark("b", 5, 20)], made(), ("a", "b")
    ),
    "section that moves": lambda _: moved(),
    "recording without rests": lambda _: find_rests(made(data=np.ones((1000, 3))), TRIAD),
    "negative noise": lambda _: Noise(white=-1.0),
    "unknown coefficient": lambda _: triad().with_coefficients("missalignment"),
    "reading beyond the fold": lambda _: inverse(
        calibration().sensor, np.full((1, 3), -30.0), np.full(3, 0.01)
    ),
    "missing calibration": lambda folder: load(folder / "none.json"),
    "matrix of nonlinear terms": lambda _: calibration().affine_correction(),
    "singular matrix": lambda _: frames.decompose_symmetric(np.zeros((3, 3))),
    "unknown registered name": lambda _: METHODS.find("none"),
}
