"""Marks from files and from a label column, and what is refused of them."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from tests.refusals import refused

from inercal.pipeline.run_calibration import section_notes
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.data import EstimatorInput
from inercal.recordings.data.rest_marks import marks_after_audit, marks_from_file
from inercal.recordings.segments import RestDetection, check_marks, marks_from_labels

JSON = '{"x_p": {"start": 540, "end": 1271}, "x_a": {"start": 1400, "end": 2000}}'
TABLE = "label,start,end\nx_p,540,1271\nx_a,1400,2000\n"
MARKS = (Mark("x_p", 540, 1271), Mark("x_a", 1400, 2000))
NEEDED = ("x_p", "x_a", "y_p")


def written(folder: Path, content: str | bytes, name: str = "marks.json") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def recording(n: int = 3000, labels: list[str] | None = None, first_row: int = 0) -> Recording:
    n = n if labels is None else len(labels)
    return Recording(
        np.arange(n) / 100,
        np.zeros((n, 1)),
        ("x",),
        ("g",),
        None if labels is None else np.array(labels),
        source="log.csv",
        first_row=first_row,
    )


def test_json_and_a_table_give_the_same_marks(tmp_path: Path):
    assert marks_from_file(written(tmp_path, JSON)) == MARKS
    assert marks_from_file(written(tmp_path, TABLE, "marks.csv")) == MARKS


def test_labels_that_are_numbers_stay_as_written(tmp_path: Path):
    table = written(tmp_path, "label,start,end\n1,0,5\n02,7,9\n", "marks.csv")
    assert [mark.label for mark in marks_from_file(table)] == ["1", "02"]


def test_an_object_may_hold_more_than_start_and_end(tmp_path: Path):
    more = '{"x_p": {"start": 540, "end": 1271, "by": "hand"}}'
    assert marks_from_file(written(tmp_path, more)) == MARKS[:1]


@pytest.mark.parametrize(
    ("content", "names"),
    [
        ("", ()),
        ('{"x_p": {"start": 540, "end": ', ()),
        (b"\xff\xfe\x00junk", ()),
        ("[" * 100_000, ()),
        ("[1, 2]", ()),
        ('{"x_p": [540, 1271]}', ["x_p"]),
        ('{"x_p": {"start": 540}}', ["x_p"]),
        ('{"x_p": {"start": 540, "end": null}}', ["x_p"]),
        ('{"x_p": {"start": 540, "end": "late"}}', ["x_p"]),
        ('{"x_p": {"start": 540.5, "end": 1271}}', ["x_p"]),
        ('{"x_p": {"start": 540, "end": NaN}}', ["x_p"]),
        ('{"x_p": {"start": 540, "end": Infinity}}', ["x_p"]),
        ('{"x_p": {"start": 1, "end": 2}, "x_p": {"start": 3, "end": 4}}', ()),
    ],
    ids=lambda value: str(value)[:40],
)
def test_json_that_marks_nothing_is_refused(
    tmp_path: Path, content: str | bytes, names: Sequence[str]
):
    with refused(file="marks.json", names=names):
        marks_from_file(written(tmp_path, content))


@pytest.mark.parametrize(
    ("content", "names"),
    [
        ("label,start\nx_p,540\n", ["end"]),
        ("label,start,end\nx_p,540,late\n", ["x_p"]),
        ("label,start,end\nx_p,540,12.5\n", ["x_p"]),
        ("label,start,end\nx_p,540,\n", ["x_p"]),
        ("label,start,end\nx_p,540,inf\n", ["x_p"]),
        ("", ()),
    ],
)
def test_a_table_that_marks_nothing_is_refused(tmp_path: Path, content: str, names: Sequence[str]):
    with refused(file="marks.csv", names=names):
        marks_from_file(written(tmp_path, content, "marks.csv"))


@pytest.mark.parametrize("name", ["marks.json", "marks.csv"])
def test_a_missing_file_of_marks_is_named(tmp_path: Path, name: str):
    with refused(file=name):
        marks_from_file(tmp_path / name)


def test_a_label_column_gives_one_mark_for_each_unbroken_run():
    labels = ["", "x_p", "x_p", "", "x_a", "x_a", "y_p", " "]
    assert marks_from_labels(recording(labels=labels)) == (
        Mark("x_p", 1, 3),
        Mark("x_a", 4, 6),
        Mark("y_p", 6, 7),
    )


def test_a_label_that_fills_the_recording_is_one_mark():
    assert marks_from_labels(recording(labels=["x_p"] * 5)) == (Mark("x_p", 0, 5),)


def test_a_label_that_returns_is_refused_with_its_line():
    labels = ["x_p", "x_p", "", "x_a", "x_p"]
    with refused(line=6, names=["x_p"]):
        marks_from_labels(recording(labels=labels, first_row=2))


def test_without_a_label_column_there_are_no_marks_to_take():
    with refused(key="[data] label"):
        marks_from_labels(recording())


def test_marks_in_order_and_side_by_side_are_accepted():
    check_marks((Mark("x_a", 10, 20), Mark("x_p", 0, 10)), recording(), NEEDED)
    check_marks((Mark("x_p", 0, 3000),), recording(), NEEDED)


def test_marks_of_no_step_may_lie_anywhere():
    check_marks((Mark("x_p", 0, 10), Mark("warm-up", 5, 9999)), recording(), NEEDED)


@pytest.mark.parametrize(
    ("marks", "names"),
    [
        ([("x_p", 2990, 3001)], ["x_p"]),
        ([("x_p", -1, 10)], ["x_p"]),
        ([("x_p", 10, 10)], ["x_p"]),
        ([("x_p", 10, 5)], ["x_p"]),
        ([("x_a", 9, 20), ("x_p", 0, 10)], ["x_p", "x_a"]),
        ([("x_a", 3, 5), ("x_p", 0, 10)], ["x_p", "x_a"]),
        ([("x_p", 0, 10), ("x_p", 20, 30)], ["x_p"]),
        ([("X_P", 0, 10)], NEEDED),
        ([], NEEDED),
    ],
)
def test_impossible_marks_are_refused(marks: list[tuple[str, int, int]], names: Sequence[str]):
    with refused(names=names):
        check_marks([Mark(*mark) for mark in marks], recording(), NEEDED)


def test_marks_of_a_file_follow_its_samples_where_the_audit_dropped_some():
    kept = np.array([0, 1, 2, 5, 6, 7, 8, 9])  # of samples 0 to 9
    made = replace(recording(8), original=kept)
    marks = (Mark("x_p", 0, 4), Mark("x_a", 4, 7), Mark("y_p", 7, 10))
    moved = marks_after_audit(marks, made)
    assert moved == (Mark("x_p", 0, 3), Mark("x_a", 3, 5), Mark("y_p", 5, 8))
    assert marks_after_audit(marks, recording(10)) == marks


def test_marks_of_a_file_are_refused_where_the_audit_sorted_its_samples():
    made = replace(recording(4), original=np.array([2, 3, 0, 1]))
    with refused(file="log.csv", key="[data] marks"):
        marks_after_audit(MARKS, made)


@pytest.mark.parametrize("limits", [(5, 500), (-5, 4)])
def test_marks_beyond_a_file_are_refused_though_samples_were_dropped(limits: tuple[int, int]):
    made = replace(recording(8), original=np.array([0, 1, 2, 5, 6, 7, 8, 9]))
    with refused(names=["y_p"]):
        check_marks(marks_after_audit((Mark("y_p", *limits),), made), made, NEEDED)


@pytest.mark.parametrize(
    ("lost", "other", "pauses", "count"),
    [(0, 0, (), 0), (50, 0, (), 1), (0, 60, (), 1), (50, 60, (), 2), (50, 60, (0,), 1)],
)
def test_sections_that_are_not_used_whole_are_remarked(
    lost: int, other: int, pauses: tuple[int, ...], count: int
):
    time = 0.01 * np.arange(1000.0)
    time[200:] += 0.01 * lost
    marks = (Mark("one", 100, 300), Mark("two", 400, 600))
    found = RestDetection(marks, (), 0.1, Finding("note", "rests", ""), ((1, (610, 610 + other)),))
    made = Recording(time, np.zeros((1000, 1)), ("ax",), ("m/s²",))
    inputs = SimpleNamespace(recording=made, marks=marks, rests=found, pauses=pauses)
    assert len(list(section_notes(cast(EstimatorInput, inputs)))) == count
