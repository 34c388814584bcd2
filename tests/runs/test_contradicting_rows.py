"""A wrong entry, or a wrong column of angles, is named also if the fit fails because of it."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy.centrifuge import full_circle, sensed_motion
from tests.suspects.rate_platform_runs import arguments
from tests.suspects.rate_platform_runs import table as platform_table

from inercal.basics.errors import InputError
from inercal.benches.contradicting_rows import contradicting_rows
from inercal.pipeline import calibrate
from inercal.pipeline.run_calibration import observed
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
Rows = list[list[str]]
Edit = Callable[[Rows], None]
ARM, HEAD, SHIP = "centrifuge/lab", "dividing_head/lab", "rate_table/ship"
TUMBLE = "dividing_head/tumble"
NORMS = ("indexing =", "mounting =")


def changed(folder: Path, name: str, edit: Edit, leave_out: tuple[str, ...] = ()) -> Path:
    """Return an example's run file without some keys, beside its table with other cells."""
    source = EXAMPLES / f"{name}.toml"
    for other in source.parent.glob("*.*"):
        (folder / other.name).write_bytes(other.read_bytes())
    lines = source.read_text(encoding="utf-8").splitlines(keepends=True)
    path, table = folder / source.name, folder / f"{source.stem}.csv"
    path.write_text("".join(one for one in lines if not one.startswith(leave_out or "~")), "utf-8")
    text = table.read_text(encoding="utf-8").splitlines()
    first = 1 + next(k for k, line in enumerate(text) if not line.startswith("#"))
    rows = [line.split(",") for line in text[first:]]
    edit(rows)
    table.write_text("\n".join([*text[:first], *map(",".join, rows)]) + "\n", encoding="utf-8")
    return path


def cell(row: int, column: int, new: Callable[[str], str]) -> Edit:
    def edit(rows: Rows) -> None:
        rows[row][column] = new(rows[row][column])

    return edit


def columns(*which: int, new: Callable[[Rows], Rows]) -> Edit:
    def edit(rows: Rows) -> None:
        for row, cells in zip(rows, new([[row[k] for k in which] for row in rows]), strict=True):
            for k, text in zip(which, cells, strict=True):
                row[k] = text

    return edit


def negated(text: str) -> str:
    return text[1:] if text.startswith("-") else f"-{text}"


def tenfold(text: str) -> str:
    return f"{10 * float(text):.9g}"


def degrees_in_rad(rows: Rows) -> Rows:
    return [[f"{float(one) * 3.14159265 / 180:.5f}" for one in row] for row in rows]


def of_run(path: Path) -> tuple[str, tuple[str, ...]]:
    _, run, inputs, *_ = observed(read(path))
    return contradicting_rows(inputs.observations, run.sensor, run.bench, inputs.steps)


@pytest.mark.parametrize(
    ("name", "edit", "label", "correction", "leave_out"),
    [
        (ARM, cell(46, 3, lambda _: "41"), "", "a rate of 80 rpm", NORMS),
        (ARM, cell(45, 4, tenfold), "", "decimal point of ax", NORMS),
        (ARM, cell(46, 5, negated), "", "sign of ay", ()),
        (ARM, cell(46, 3, lambda _: "8"), "", "a rate of 80 rpm", ("attitude =", *NORMS)),
        (HEAD, cell(7, 1, lambda _: "30"), "f08", "an angle of 210°", ()),
        (HEAD, cell(7, 3, negated), "f08", "sign of b", ()),
        (HEAD, cell(7, 2, lambda text: text.replace("-1", "-6")), "f08", "digit of a", ()),
        (SHIP, cell(16, 3, negated), "", "sign of ay", ()),
        (SHIP, cell(16, 1, lambda _: "0"), "", "a rate of", ()),
    ],
)
def test_a_wrong_entry_is_named_with_its_correction(
    name: str, edit: Edit, label: str, correction: str, leave_out: tuple[str, ...], tmp_path: Path
):
    text, labels = of_run(changed(tmp_path, name, edit, leave_out))
    print(text, labels)
    assert len(labels) == 1
    assert label in labels[0]
    assert correction in text


@pytest.mark.parametrize(
    ("name", "edit", "words"),
    [
        (ARM, columns(1, 2, new=lambda rows: [*rows[-1:], *rows[:-1]]), "down by one row"),
        (ARM, columns(1, 2, new=lambda rows: [*rows[1:], *rows[:1]]), "up by one row"),
        (ARM, columns(1, 2, new=degrees_in_rad), "attitude_unit"),
        (ARM, columns(1, 2, new=lambda rows: [row[::-1] for row in rows]), "exchanged"),
        (TUMBLE, columns(0, new=lambda rows: [*rows[:1], *rows[:-1]]), "down by one row"),
    ],
)
def test_a_mistake_in_a_column_of_angles_is_named(
    name: str, edit: Edit, words: str, tmp_path: Path
):
    text, labels = of_run(changed(tmp_path, name, edit))
    assert words in text
    assert not labels


@pytest.mark.parametrize("leave_out", [(), ("attitude =", *NORMS)])
@pytest.mark.parametrize(("shift", "word"), [(1, "down"), (-1, "up")])
def test_a_moved_column_of_rates_is_named(
    shift: int, word: str, leave_out: tuple[str, ...], tmp_path: Path
):
    def generate(rows: Rows) -> None:
        speeds, angles = [40, 50, 60, 70, 80, 90, 100], full_circle()[::2]
        f, _ = sensed_motion(angles, [one * np.pi / 30 for one in speeds], radius=1.5)
        force = 0.1 * f.reshape(len(speeds), len(angles), 3).swapaxes(0, 1).reshape(-1, 3)
        pairs = [(one, speed) for one in angles for speed in speeds]
        written = np.roll([speed for _, speed in pairs], shift).tolist()
        rows[:] = [
            [f"{k}", *(f"{np.degrees(a):.3f}" for a in pairs[k][0]), f"{written[k]}"]
            + [f"{one:.7f}" for one in row]
            for k, row in enumerate(force.tolist())
        ]

    text, labels = of_run(changed(tmp_path, ARM, generate, leave_out))
    assert f"rates was moved {word}" in text
    assert not labels


@pytest.mark.parametrize(
    ("name", "leave_out"),
    [(ARM, ()), (ARM, ("attitude =", *NORMS)), (HEAD, ()), (TUMBLE, ()), (SHIP, ())],
)
def test_right_tables_contradict_nothing(name: str, leave_out: tuple[str, ...], tmp_path: Path):
    assert of_run(changed(tmp_path, name, lambda _: None, leave_out)) == ("", ())


def test_readings_that_stop_at_one_value_are_called_clipped(tmp_path: Path):
    def clip(rows: Rows) -> None:
        for row in rows:
            row[4:] = [f"{max(-2.0, min(2.0, float(one))):.7f}" for one in row[4:]]

    text, labels = of_run(changed(tmp_path, ARM, clip, NORMS))
    assert " 2," in text
    assert len(labels) > 3


def test_readings_clipped_by_little_at_the_largest_rate_are_named(tmp_path: Path):
    def clip(rows: Rows) -> None:
        peaks = [max(abs(float(one)) for one in row[4:]) for row in rows]
        most = 0.99 * sorted(peaks)[-6]
        for row in rows:
            row[4:] = [f"{max(-most, min(most, float(one))):.7f}" for one in row[4:]]

    text, labels = of_run(changed(tmp_path, ARM, clip, ("attitude =", *NORMS)))
    assert "clipped" in text
    assert len(labels) >= 6


def test_a_channel_that_stops_is_named_with_its_rows(tmp_path: Path):
    def stop(rows: Rows) -> None:
        for row in rows[20:]:
            row[6] = rows[20][6]

    text, labels = of_run(changed(tmp_path, ARM, stop))
    assert "az is always" in text
    assert len(labels) > 3


def test_a_wrong_angle_of_one_mounting_is_named_with_its_value(tmp_path: Path):
    def turn(rows: Rows) -> None:
        for row in rows:
            row[2] = "200" if row[1:3] == ["10", "20"] else row[2]

    text, labels = of_run(changed(tmp_path, ARM, turn))
    assert "θ = 20° instead of 200°" in text
    assert len(labels) == 3


def test_a_moved_column_of_mountings_is_named_before_the_fit(tmp_path: Path):
    moved = columns(0, new=lambda rows: [*rows[:1], *rows[:-1]])
    with pytest.raises(InputError, match="down by one row"):
        of_run(changed(tmp_path, SHIP, moved))


@pytest.mark.parametrize(
    ("one", "two"), [("XY", "YX"), ("XY", "ZY"), ("XY 30", "XY 60"), ("XY 135", "YX 30")]
)
def test_two_exchanged_mountings_are_named_even_if_the_fit_would_converge(
    one: str, two: str, tmp_path: Path
):
    swap = {one: two, two: one}
    exchanged = columns(0, new=lambda rows: [[swap.get(cell, cell)] for (cell,) in rows])
    with pytest.raises(InputError, match="were exchanged") as caught:
        calibrate(changed(tmp_path, SHIP, exchanged))
    words = str(caught.value).split()
    assert {one.replace(" ", ""), two.replace(" ", "")} < set(words)


@pytest.mark.parametrize(("position", "axis"), [("5", "ay"), ("11", "ax"), ("20", "az")])
@pytest.mark.parametrize("leave_out", [(), NORMS])
def test_an_axis_with_the_wrong_sign_in_one_mounting_is_named(
    position: str, axis: str, leave_out: tuple[str, ...], tmp_path: Path
):
    def edit(rows: Rows) -> None:
        at = ["ax", "ay", "az"].index(axis) + 4
        for row in rows:
            if row[0] == position:
                row[at] = negated(row[at])

    with pytest.raises(InputError, match=f"{axis} had the wrong sign .* {position} at"):
        calibrate(changed(tmp_path, ARM, edit, leave_out))


@pytest.mark.slow
def test_a_wrong_sign_is_named_as_the_cause_although_the_fit_converges(tmp_path: Path):
    found = calibrate(changed(tmp_path, ARM, cell(16, 4, negated))).verdict
    assert "wrong readings in 6 at 80 rpm" in " ".join(found.lines)


@pytest.mark.parametrize(("one", "two"), [("x", "y"), ("y", "z"), ("x", "z")])
def test_two_exchanged_settings_of_a_rate_platform_are_named(one: str, two: str):
    made = platform_table(np.random.default_rng(1))
    swap = {one: two, two: one}
    made["axis"] = np.array([swap.get(axis, axis) for axis in made["axis"].tolist()])
    with pytest.raises(InputError) as caught:
        calibrate(made, **arguments())
    assert caught.value.names == tuple(sorted((one, two)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "edit", "leave_out"),
    [
        (ARM, cell(45, 4, tenfold), NORMS),
        (HEAD, cell(7, 1, lambda _: "30"), ()),
        (SHIP, cell(16, 2, negated), ()),
    ],
)
def test_a_failing_fit_names_the_wrong_row(
    name: str, edit: Edit, leave_out: tuple[str, ...], tmp_path: Path
):
    path = changed(tmp_path, name, edit, leave_out)
    with pytest.raises(InputError) as caught:
        calibrate(path)
    assert caught.value.names == of_run(path)[1]
