"""A batch gives each sensor the row that it has alone, whatever is wrong with the others."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import slow
from tests.benches.generated_runs import simulate_run, write_run
from tests.fleet.lines import TEMPLATE, readings

from inercal.basics.small_files import read_toml
from inercal.fleet import batch
from inercal.fleet.batch import Work, result_row
from inercal.fleet.inputs import Version
from inercal.fleet.line import Line, SensorRow
from inercal.pipeline import similar_runs

MOST = 1e-9  # u
NUMBERS = ("value", "std", "covariance", "chi2", "birge")
PASSING = ("created", "seconds", "calibration")  # the last contains the date and the numbers
Columns = dict[str, Any]


class Kept:
    """Takes the rows of a batch."""

    def __init__(self) -> None:
        self.rows: list[dict[str, Any]] = []

    def write(self, rows: list[dict[str, Any]]) -> None:
        self.rows += rows


def changed(columns: Columns, axis: str, part: slice, change: Callable[[Any], Any]) -> Columns:
    readings_of = columns[axis].copy()
    readings_of[part] = change(readings_of[part])
    return columns | {axis: readings_of}


def without_face(columns: Columns) -> Columns:
    kept = columns["face"] != "y_a"
    return {name: column[kept] for name, column in columns.items()}


EACH = 100
FACE = slice(2 * EACH, 3 * EACH)  # y_p
TILT = np.radians(5.0)
WHOLE = slice(None)
VIOLATIONS: Mapping[str, Callable[[Columns], Columns]] = {
    "none": lambda c: c,
    "tilt": lambda c: changed(c, "x", FACE, lambda x: x + np.sin(TILT)),
    "sign": lambda c: changed(c, "y", WHOLE, lambda y: -y),
    "saturated": lambda c: changed(c, "z", WHOLE, lambda z: np.minimum(z, 0.9)),
    "wrong mean": lambda c: changed(c, "y", FACE, lambda y: y + 0.02),
    "small wrong mean": lambda c: changed(c, "y", FACE, lambda y: y + 0.003),
    "moving": lambda c: changed(c, "z", FACE, lambda z: z + np.linspace(0, 0.05, EACH)),
    "coarse": lambda c: changed(c, "x", WHOLE, lambda x: np.round(x, 3)),
    "missing face": without_face,
    "shorter": lambda c: {name: np.delete(column, FACE.start) for name, column in c.items()},
    "text": lambda c: c | {"x": c["face"]},
    "good": lambda c: c,
}


def compare(line: Line, monkeypatch: pytest.MonkeyPatch) -> tuple[list[dict[str, Any]], int]:
    """Compare the rows of a batch with those of single calibrations; return them and a count.

    The count is that of the sensors that were solved together.
    """
    counts: list[int] = []
    solve = similar_runs.solve_each

    def counted(estimate: Callable[[], Any]) -> Any:
        found = solve(estimate)
        counts.append(sum(one is not None for one in found))
        return found

    monkeypatch.setattr(similar_runs, "solve_each", counted)
    work = [Work(row, line.digest(row), Version(0, "")) for row in line.rows]
    out: Any = Kept()
    batch.compute_batch(line, out, work)
    for row, one in zip(out.rows, work, strict=True):
        alone = result_row(line, one)
        assert row.keys() == alone.keys()
        for key in row.keys() - {*NUMBERS, *PASSING}:
            assert row[key] == alone[key], (one.row.id, key)
        if row["status"] != "done":
            continue
        u = np.array(alone["std"])
        scale = np.outer(u, u)[np.tril_indices(len(u))]
        assert np.max(np.abs(np.subtract(row["value"], alone["value"])) / u) <= MOST
        assert np.max(np.abs(np.subtract(row["std"], alone["std"])) / u) <= MOST
        off = np.abs(np.subtract(row["covariance"], alone["covariance"])) / scale
        assert np.max(off) <= MOST
        assert row["chi2"] == pytest.approx(alone["chi2"], rel=MOST, abs=MOST)
        assert row["birge"] == pytest.approx(alone["birge"], rel=MOST)
    return out.rows, sum(counts)


@pytest.mark.slow
def test_good_and_bad_recordings_together_have_the_rows_that_they_have_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "run.toml").write_text(TEMPLATE, encoding="utf-8")
    for k, (name, change) in enumerate(VIOLATIONS.items()):
        np.savez(tmp_path / f"{name}.npz", **change(readings(k, EACH)[0]))
    (tmp_path / "damaged.npz").write_bytes((tmp_path / "none.npz").read_bytes()[:9000])
    names = [*VIOLATIONS, "damaged", "absent"]
    template = read_toml(tmp_path / "run.toml", "run file")
    line = Line(tmp_path, template, tuple(SensorRow(name, f"{name}.npz") for name in names))
    rows, together = compare(line, monkeypatch)
    grades = {row["id"]: row.get("grade", "failed") for row in rows}
    assert (grades["none"], grades["good"]) == ("consistent", "consistent")
    assert grades["wrong mean"] not in ("consistent", "failed")
    assert {name for name, grade in grades.items() if grade == "failed"} >= {
        "missing face", "moving", "text", "damaged", "absent",
    }  # fmt: skip
    assert together >= 6


@pytest.mark.slow
@pytest.mark.parametrize("method", ["ferraris", "rates_and_poses", slow("centrifuge_norm")])
def test_each_method_of_means_gives_the_rows_of_single_calibrations(
    method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    path = write_run(method, tmp_path)
    template = read_toml(path, "run file")
    made = tmp_path / template["data"].pop("file")
    del template["sensor"]["name"]
    names = [f"S{k}" for k in range(3)]
    for k, name in enumerate(names):
        simulate_run(path, k)
        with np.load(made) as archive:
            columns = dict(archive)
        if k == 1:
            some = slice(len(columns["time"]) // 3, len(columns["time"]) // 2)
            columns = changed(
                columns, template["data"]["accelerometer"][0], some, lambda x: 1.01 * x
            )
        np.savez(tmp_path / f"{name}.npz", **columns)
    line = Line(tmp_path, template, tuple(SensorRow(name, f"{name}.npz") for name in names))
    rows, together = compare(line, monkeypatch)
    assert [rows[k]["grade"] for k in (0, 2)] == ["consistent"] * 2
    assert together >= 2
