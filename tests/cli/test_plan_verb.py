"""`inercal plan` of a bench: what it prints and writes, and what it refuses."""

import csv
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from inercal.cli.app import main

EXAMPLES = Path(__file__).parents[2] / "examples"
EXAMPLE = EXAMPLES / "dividing_head" / "pair.toml"
SHIP = EXAMPLES / "rate_table" / "ship.toml"
SIX = EXAMPLES / "six_position" / "run.toml"
TURNS = EXAMPLES / "ferraris_simulated" / "run.toml"
ARM = EXAMPLES / "centrifuge" / "lab.toml"
RATES = ('name = "centrifuge_norm"', 'name = "centrifuge_norm"\nrates = ["60 rpm", "-90 rpm"]')

Program = Callable[..., tuple[int, str, str]]


@pytest.fixture
def program(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Program:
    """Run the program within this process; return its status, its output and its errors."""

    def run(*arguments: str | Path) -> tuple[int, str, str]:
        monkeypatch.setattr("sys.argv", ["inercal", "plan", *map(str, arguments)])
        monkeypatch.setenv("COLUMNS", "120")
        capsys.readouterr()
        with pytest.raises(SystemExit) as stop:
            main()
        printed = capsys.readouterr()
        return int(stop.value.code or 0), printed.out, printed.err

    return run


@pytest.fixture
def pair(tmp_path: Path) -> Path:
    return Path(shutil.copy(EXAMPLE, tmp_path / "run.toml"))


def changed(path: Path, *changes: tuple[str, str]) -> Path:
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text, encoding="utf-8")
    return path


def test_positions_in_order_and_what_they_will_give(pair: Path, program: Program):
    status, printed, errors = program("dual-orthogonal", "--run", pair)
    assert (status, errors) == (0, "")
    assert "24 positions, 12 min of holding in all" in printed
    numbers = re.findall(r"│ +(\d+) │ ([fr]\d\d) +│ (\S+) +│ (1, forward|2, reverse) +│", printed)
    assert [row[0] for row in numbers] == [str(k) for k in range(1, 25)]
    assert numbers[11:13] == [
        ("12", "f12", "330°", "1, forward"),
        ("13", "r12", "330°", "2, reverse"),
    ]
    assert re.search(r"a\.k0 +│ bias +│ +0\.35 │ µg", printed)
    assert re.search(
        r"b\.delta_o − a\.delta_o │ angle between the accelerometers │ +0\.028", printed
    )
    assert "Do not touch the pier" in printed
    assert {p.name for p in pair.parent.iterdir()} == {"run.toml"}


def test_one_object_with_steps_and_what_to_expect(pair: Path, program: Program):
    status, printed, _ = program("dual-orthogonal", "--run", pair, "--json")
    content = json.loads(printed)
    assert status == 0
    assert set(content) == {"steps", "seconds", "notes", "expected", "together"}
    assert content["steps"][13] == {
        "label": "r11",
        "what": "head at 300°, reverse",
        "angle_deg": pytest.approx(300),
        "sense": "reverse",
        "pass": 2,
        "autocollimator": "trim the head until it reads as at 0° in pass 1",
        "seconds": 30.0,
    }
    k0 = content["expected"][0]
    assert (k0["name"], k0["unit"]) == ("a.k0", "m/s²")
    assert 2 * k0["std"] / 9.80665e-6 == pytest.approx(0.35, abs=0.01)
    assert [one["name"] for one in content["together"]] == ["b.delta_o − a.delta_o"]


def test_options_take_the_place_of_the_run_files_positions_and_seconds(
    pair: Path, program: Program
):
    options = ("--positions", "16", "--seconds", "120")
    content = json.loads(program("dual-orthogonal", "--run", pair, *options, "--json")[1])
    assert len(content["steps"]) == 32
    assert content["seconds"] == 32 * 120
    assert content["steps"][1]["angle_deg"] == pytest.approx(22.5)
    _, printed, _ = program("dual-orthogonal", "--run", pair, *options)
    assert "22° 30′" in printed


def test_seconds_that_change_no_uncertainty_are_named_in_a_note(program: Program):
    run = EXAMPLES / "six_position" / "run.toml"
    said = [program("six-position", "--run", run, *more)[1] for more in ((), ("--seconds", "9"))]
    assert ["--seconds" in one for one in said] == [False, True]


def test_the_table_is_written_and_a_page_beside_it(pair: Path, program: Program, tmp_path: Path):
    changed(pair, ('angle = "angle"', 'angle = "angle"\nautocollimator = "ac"\nlevel = "lv"'))
    sheet, page = tmp_path / "sheet.csv", tmp_path / "sheet.html"
    status, printed, _ = program("dual-orthogonal", "--run", pair, "--out", sheet)
    assert status == 0
    assert f"wrote {sheet}" in printed.replace("\n", "")
    assert 'kind = "means"' in printed
    with sheet.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["label", "angle", "a", "b", "ac", "lv"]
    assert rows[1] == ["f02", "30", "", "", "", ""]
    assert len(rows) == 24
    text = page.read_text(encoding="utf-8")
    assert text.startswith("<!DOCTYPE html>")
    _, printed, _ = program("dual-orthogonal", "--run", pair, "--out", sheet, "--force", "--json")
    content = json.loads(printed)
    assert (content["sheet"], content["page"]) == (str(sheet), str(page))


@pytest.mark.parametrize("there", ["sheet.csv", "sheet.html"])
def test_what_was_filled_in_is_not_written_over(
    pair: Path, program: Program, tmp_path: Path, there: str
):
    (tmp_path / there).write_text("filled", encoding="utf-8")
    out = tmp_path / "sheet.csv"
    status, _, errors = program("dual-orthogonal", "--run", pair, "--out", out)
    assert status == 2
    assert f"{there} exists" in errors
    assert "--force" in errors
    assert (tmp_path / there).read_text(encoding="utf-8") == "filled"
    assert program("dual-orthogonal", "--run", pair, "--out", out, "--force")[0] == 0


def test_the_run_s_own_sheet_is_written_again_only_with_force(
    pair: Path, program: Program, tmp_path: Path
):
    run = changed(pair, ('file = "pair.csv"', 'file = "sheet.csv"'))
    out = tmp_path / "sheet.csv"
    assert program(run, "--out", out)[0] == 0
    out.write_text("filled", encoding="utf-8")
    assert program(run, "--out", out)[0] == 2
    assert out.read_text(encoding="utf-8") == "filled"
    assert program(run, "--out", out, "--force")[0] == 0
    assert len(table(out)) == 25
    # Other inputs are never written over.
    assert program(run, "--out", run.with_suffix(".toml"), "--force")[0] == 2


def test_nothing_is_written_where_the_plan_leaves_coefficients_open(
    pair: Path, program: Program, tmp_path: Path
):
    out = tmp_path / "sheet.csv"
    status, printed, errors = program(
        "dual-orthogonal", "--run", pair, "--positions", "4", "--out", out
    )
    assert (status, printed) == (2, "")
    assert "plan of 8 positions" in errors
    assert errors.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        (("dual-orthogonal",), "--run"),
        (("dual-orthogonal", "-r", "RUN", "-o", "a.html"), "--out a.html"),
        (("dual-orthogonal", "-r", "RUN", "--seconds", "0"), "--seconds 0.0"),
        (("multi-position", "-o", "a.csv"), "--out"),
        (("RUN", "--optimise", "20 min"), "--optimise"),
    ],
)
def test_refusals_are_one_line(
    pair: Path, program: Program, arguments: tuple[str, ...], where: str
):
    given = [str(pair) if word == "RUN" else word for word in arguments]
    status, printed, errors = program(*given)
    assert (status, printed, errors.count("\n")) == (2, "", 1)
    assert where in errors


@pytest.mark.slow
def test_plans_by_hand_have_their_own_defaults(program: Program):
    content = json.loads(program("multi-position", "--json")[1])
    assert len(content["steps"]) == 24
    assert {step["seconds"] for step in content["steps"]} == {3.0}


def test_states_of_a_rate_table_in_order_and_what_they_will_give(program: Program):
    status, printed, errors = program("ship-multi-angle", "--run", SHIP)
    assert (status, errors) == (0, "")
    assert "25 states, 62.5 min in all" in printed
    row = r"│ +10 │ XY30 +│ \+z up, tilted 30° \(\+x rises\) +│ +46 │ 150 s │"
    assert re.search(row + r" \+1.012 │ \+0.000 │ \+0.569 │", printed)
    assert re.search(r"ax\.k0 +│ bias +│ +610 │ µg", printed)
    assert "check the axes and signs" in printed.replace("\n", " ")


def test_one_object_of_a_rate_table(program: Program):
    status, printed, _ = program("ship-planar", "--run", SHIP, "--seconds", "60", "--json")
    content = json.loads(printed)
    assert status == 0
    assert set(content) == {"steps", "seconds", "notes", "expected"}
    assert content["seconds"] == 9 * 60
    first = content["steps"][1]
    assert (first["label"], first["mounting"], first["up"]) == ("XY_46", "XY", "+z up")
    assert first["rpm"] == pytest.approx(46)
    assert first["felt"] == pytest.approx([0.25 * (46 * 3.14159265 / 30) ** 2, 0, 9.7936])
    assert {one["unit"] for one in content["expected"]} == {"m/s²", "1", "rad"}


def test_the_table_of_a_rate_table_is_written_once(program: Program, tmp_path: Path):
    sheet = tmp_path / "sheet.csv"
    status, printed, _ = program("ship-multi-angle", "--run", SHIP, "--out", sheet)
    assert status == 0
    assert f"wrote {sheet}" in printed.replace("\n", "")
    assert 'kind = "means"' in printed
    with sheet.open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["mounting", "rpm", "ax", "ay", "az"]
    assert rows[1] == ["XY", "46", "", "", ""]
    assert [row[0] for row in rows[9:11]] == ["XY30", "XY30"]
    assert len(rows) == 25
    assert {path.name for path in tmp_path.iterdir()} == {"sheet.csv"}
    status, _, errors = program("ship-multi-angle", "--run", SHIP, "--out", sheet)
    assert status == 2
    assert "--force" in errors


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        (("ship-multi-angle",), "--run"),
        (("ship-planar", "-r", str(SHIP), "-o", "a.txt"), "--out a.txt"),
        (("ship-planar", "-r", str(SHIP), "--positions", "3"), "ship.toml: --positions: "),
        (("six-position",), "six-position"),
    ],
)
def test_refusals_of_a_rate_table_are_one_line(
    program: Program, arguments: tuple[str, ...], where: str
):
    status, printed, errors = program(*arguments)
    assert (status, printed, errors.count("\n")) == (2, "", 1)
    assert where in errors


def table(path: Path) -> list[list[str]]:
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.reader(file))


def test_a_run_file_is_planned_by_its_own_method(program: Program, tmp_path: Path):
    content = json.loads(program(SIX, "--json")[1])
    assert content == json.loads(program("six-position", "--run", SIX, "--json")[1])
    assert [step["label"] for step in content["steps"]] == [
        "x_p",
        "x_a",
        "y_p",
        "y_a",
        "z_p",
        "z_a",
    ]
    assert content["steps"][1]["what"] == "−x up"
    k0 = content["expected"][0]
    # 30 µg of each of two means, and what tilt takes from them.
    assert (k0["name"], k0["std"]) == ("ax.k0", pytest.approx(30e-6 * 9.80665 / 2**0.5, rel=0.02))
    status, printed, _ = program(SIX, "--out", tmp_path / "sheet.csv")
    assert status == 0
    assert f"inercal measure {tmp_path / 'sheet.csv'} --run {SIX}" in printed
    assert table(tmp_path / "sheet.csv")[:2] == [
        ["position", "acc_x", "acc_y", "acc_z"],
        ["x_p", "", "", ""],
    ]


def test_the_duration_of_a_turn_by_hand_is_left_to_the_operator(program: Program, tmp_path: Path):
    run = changed(
        Path(shutil.copy(TURNS, tmp_path)), ('label = "label"', 'label = "label"\nseconds = "T"')
    )
    status, printed, _ = program(run, "--out", tmp_path / "sheet.csv")
    assert status == 0
    assert "6 positions and 3 turns, 90 s in all" in printed
    header, *rows = table(tmp_path / "sheet.csv")
    assert header == ["label", "T", *(f"{a}_{b}" for a in ("acc", "gyr") for b in "xyz")]
    assert [row[:2] for row in rows[5:7]] == [["z_a", "12"], ["x_rot", ""]]


@pytest.mark.slow
def test_dwells_on_the_arm_are_grouped_by_attitude(program: Program, tmp_path: Path):
    run = changed(Path(shutil.copy(ARM, tmp_path)), RATES)
    status, printed, _ = program(run, "--out", tmp_path / "sheet.csv")
    assert status == 0
    assert "40 dwells in 20 attitudes" in printed
    header, *rows = table(tmp_path / "sheet.csv")
    assert header == ["position", "psi", "theta", "rpm", "ax", "ay", "az"]
    assert rows[:3] == [
        ["p01", "10", "20", "60", "", "", ""],
        ["p01", "10", "20", "-90", "", "", ""],
        ["p02", "10", "110", "60", "", "", ""],
    ]
    content = json.loads(program(run, "--json")[1])
    first = content["steps"][0]
    # In each attitude: 1 s of rest, 0 → 2π → −3π → 0 rad/s at 3 rad/s², 2 s of settling and ten
    # turns at each rate, 1 s of rest.
    dwells = [one["seconds"] for one in content["steps"]]
    assert sum(dwells) == pytest.approx(20 * (10 + 20 / 3))
    ramps = 10 * 3.14159265 / 3
    assert content["seconds"] == pytest.approx(sum(dwells) + 20 * (6 + ramps))
    changed(run, ("[data]\n", 'max_acceleration = "0.5 rad/s²"\n[data]\n'))
    slow = json.loads(program(run, "--json")[1])
    assert slow["seconds"] == pytest.approx(sum(dwells) + 20 * (6 + 6 * ramps))
    assert slow["expected"] == content["expected"]
    # The arm turns clockwise: outwards, less the centripetal acceleration; gravity along up.
    a = 1.5 * (60 * 3.14159265 / 30) ** 2
    assert sum(x**2 for x in first["felt"]) == pytest.approx(a**2 + 9.81262**2, rel=1e-4)


def test_a_table_by_hand_of_accelerometers_alone_is_written(program: Program, tmp_path: Path):
    run = changed(
        Path(shutil.copy(SIX, tmp_path)),
        ("six_position", "multi_position"),
        ('tilt = "0.1 °"', ""),
    )
    status, printed, _ = program(run, "--out", tmp_path / "sheet.csv", "--json")
    assert status == 0
    header, *rows = table(tmp_path / "sheet.csv")
    assert header == ["position", "acc_x", "acc_y", "acc_z"]
    assert len({row[0] for row in rows}) == len(rows)
    # 30 µg of each mean; a bias is seen by the third of the rows in which its axis is level or so.
    k0 = json.loads(printed)["expected"][0]
    sd = 30e-6 * 9.80665
    assert sd / len(rows) ** 0.5 < k0["std"] < 3 * sd / len(rows) ** 0.5


@pytest.mark.parametrize(
    ("example", "changes", "where"),
    [
        (ARM, (), "[method] rates"),
        (ARM, (RATES, ('sense = "clockwise"', 'platform = "counter-rotating"')), "platform"),
        (TURNS, (), "[data] seconds"),
        (SIX, (('label = "position"\n', ""),), "[data] label"),
    ],
)
def test_a_table_that_calibrate_could_not_read_is_not_written(
    program: Program,
    tmp_path: Path,
    example: Path,
    changes: tuple[tuple[str, str], ...],
    where: str,
):
    run = changed(Path(shutil.copy(example, tmp_path / "run.toml")), *changes)
    status, printed, errors = program(run, "--out", tmp_path / "sheet.csv")
    assert (status, printed, errors.count("\n")) == (2, "", 1)
    assert where in errors
    assert [path.name for path in tmp_path.iterdir()] == ["run.toml"]


@pytest.mark.parametrize("options", [("--positions", "3"), ("--positions", "2000")])
def test_a_plan_without_a_run_file_names_the_option_and_no_file(
    program: Program, options: tuple[str, str]
):
    status, printed, errors = program("multi-position", *options)
    assert (status, printed) == (2, "")
    assert errors.startswith(f"inercal: {' '.join(options)}: ")
    assert ".toml" not in errors


def test_a_column_of_temperature_is_in_the_table(program: Program, tmp_path: Path):
    run = changed(
        Path(shutil.copy(EXAMPLE, tmp_path / "run.toml")),
        ('angle = "angle"', 'angle = "angle"\ntemperature = "T"'),
    )
    assert program(run, "--out", tmp_path / "sheet.csv")[0] == 0
    assert table(tmp_path / "sheet.csv")[0][-1] == "T"
