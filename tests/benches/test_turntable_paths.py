"""The paths of a three-axis table, and paths read from a file."""

from math import degrees, pi, radians
from pathlib import Path

import numpy as np
import pytest
from tests.accuracy import turntable as made
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.benches.turntable.attitude import reference_attitude
from inercal.benches.turntable.paths import PATHS, discrete_path, fast_path, paper_path, read_path
from inercal.benches.turntable.simulation import path_profile, turntable_path_duration
from inercal.physics.plan import Position, Rotation

BENCH = Turntable(Measured(9.81, 0.0), radians(38))
AXES = BENCH.names
HEADER = "label,kind,outer [°],middle [°],inner [°],seconds [s],axis,angle [°],rate [°/s]\n"
GOOD = (
    HEADER
    + "warm-up,position,0,0,0,120,,,\n"
    + "p1,position,0,90,-45,90,,,\n"
    + "x+,rotation,,,,,middle,720,10\n"
    + "z-,rotation,0,0,0,,outer,-1080,30\n"
)


def test_positions_are_those_of_the_generator():
    held = [step for step in paper_path() if isinstance(step, Position)]
    assert held[0].label == "warm-up"
    for step, (name, angles, seconds) in zip(held[1:11], made.positions(), strict=True):
        assert (step.label, step.seconds) == (name, seconds)
        assert step.angles == tuple(map(radians, angles))
    assert (held[-1].label, held[-1].seconds) == ("rest", 72)


def test_turns_are_those_of_the_generator():
    for steps, path in (
        (paper_path(), made.turns()),
        (fast_path(), made.turns(1080.0, 30.0, back=True)),
    ):
        turns = [step for step in steps if isinstance(step, Rotation)]
        for step, turn in zip(turns, (t for t in path if len(t) == 4), strict=True):
            assert (step.label, step.axis) == turn[:2]
            assert degrees(step.angle) == pytest.approx(turn[2])
            assert degrees(step.rate) == pytest.approx(turn[3])


def test_paths_take_the_time_that_is_told_of_them():
    minutes = {
        name: turntable_path_duration(BENCH, path(90.0)) / 60 for name, path in PATHS.items()
    }
    assert minutes["paper"] == pytest.approx(22.6, abs=0.1)
    assert minutes["fast"] == pytest.approx(minutes["paper"], abs=0.2)
    assert minutes["discrete"] == pytest.approx(19, abs=0.3)


def test_discrete_has_each_axis_up_and_down_and_turns_about_it():
    steps = discrete_path()
    way = path_profile(BENCH, steps)
    found: dict[str, float] = {}
    for label, end in zip(way.labels, way.ends, strict=True):
        if label.endswith(("_p", "_a")):
            (mat,) = reference_attitude(BENCH, way.evaluate(np.array([end]))[0])
            axis = "xyz".index(label[0])
            found[label] = mat[2, axis]
    assert found == pytest.approx({f"{a}_{s}": v for a in "xyz" for s, v in (("p", 1), ("a", -1))})
    turns = [step for step in steps if isinstance(step, Rotation)]
    assert len(turns) == 12
    assert {step.axis for step in turns} == {0}
    assert sum(step.angle for step in turns) == 0


@pytest.mark.parametrize("name", PATHS)
def test_labels_come_once(name: str):
    labels = [step.label for step in PATHS[name](90.0)]
    assert len(set(labels)) == len(labels)


def written(folder: Path, text: str) -> Path:
    path = folder / "path.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file_is_read_as_steps(tmp_path: Path):
    steps = read_path(written(tmp_path, GOOD), AXES)
    assert steps == (
        Position("warm-up", (0.0, 0.0, 0.0), 120.0),
        Position("p1", (0.0, pi / 2, -pi / 4), 90.0),
        Rotation("x+", 1, 4 * pi, radians(10)),
        Rotation("z-", 0, -6 * pi, radians(30), (0.0, 0.0, 0.0)),
    )
    assert turntable_path_duration(BENCH, steps) > 210


def test_units_are_those_of_the_header(tmp_path: Path):
    text = "label,kind,outer [rad],seconds [min],axis,angle [rev],rate [rpm]\n"
    text += "a,position,1.5,2,,,\nb,rotation,,,outer,3,5\n"
    held, turned = read_path(written(tmp_path, text), ("outer",))
    assert held == Position("a", (1.5,), 120.0)
    assert isinstance(turned, Rotation)
    assert turned.angle == pytest.approx(6 * pi)
    assert turned.rate == pytest.approx(pi / 6)


def test_positions_alone_need_no_other_columns(tmp_path: Path):
    text = "label,kind,outer [°],middle [°],inner [°],seconds [s]\np,position,1,2,3,4\n"
    assert len(read_path(written(tmp_path, text), AXES)) == 1


@pytest.mark.parametrize(
    ("old", "new", "line", "key"),
    [
        ("p1,position", "p1,hold", 3, "kind"),
        ("p1,position", "warm-up,position", 3, "label"),
        ("p1,position", ",position", 3, "label"),
        ("0,90,-45", "0,,-45", 3, "angles"),
        ("0,90,-45,90", ",,,90", 3, "angles"),
        ("-45,90,", "-45,,", 3, "seconds"),
        ("-45,90,", "-45,-90,", 3, "seconds"),
        ("-45,90,,,", "-45,90,,30,", 3, "angle"),
        ("middle,720", "third,720", 4, "axis"),
        (",,middle", "7,,middle", 4, "angles"),
        (",middle,720", "9,middle,720", 4, "seconds"),
        ("720,10", "0,10", 4, "angle"),
        ("720,10", "720,-10", 4, "rate"),
        ("720,10", "720,", 4, "rate"),
        ("720,10", "inf,10", 4, "angle"),
    ],
)
def test_a_wrong_step_is_named_with_its_line_and_column(
    tmp_path: Path, old: str, new: str, line: int, key: str
):
    assert old in GOOD
    with refused(file="path.csv", line=line, key=key):
        read_path(written(tmp_path, GOOD.replace(old, new, 1)), AXES)


@pytest.mark.parametrize(
    ("old", "new", "column"),
    [
        ("rate [°/s]", "rate", "rate"),
        ("rate [°/s]", "speed [°/s]", "speed [°/s]"),
        ("rate [°/s]", "angle [rad]", "angle"),
        ("kind", "sort [s]", "sort [s]"),
    ],
)
def test_a_wrong_column_is_named(tmp_path: Path, old: str, new: str, column: str):
    with refused(file="path.csv", line=None, names=(column,)):
        read_path(written(tmp_path, GOOD.replace(old, new, 1)), AXES)


@pytest.mark.parametrize(
    ("old", "new"), [("-45,90,", "-45,soon,"), ("rate [°/s]", "rate [m]")], ids=["number", "unit"]
)
def test_cells_and_units_that_are_none_are_refused(tmp_path: Path, old: str, new: str):
    with pytest.raises(InputError):
        read_path(written(tmp_path, GOOD.replace(old, new, 1)), AXES)


def test_a_file_without_kinds_is_refused(tmp_path: Path):
    with refused(file="path.csv", names=("kind",)):
        read_path(written(tmp_path, "label,outer [°]\np,1\n"), ("outer",))
    with refused(file="path.csv", names=("label",)):
        read_path(written(tmp_path, "kind,outer [°]\nposition,1\n"), ("outer",))
    with pytest.raises(InputError):
        read_path(tmp_path / "none.csv", AXES)
