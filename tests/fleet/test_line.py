"""The template of a line and its table of sensors."""

import re
from pathlib import Path

import pytest
from tests.fleet.lines import TEMPLATE, make_line, write_table
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.fleet.line import read_line

ROOT = Path(__file__).parents[2]


def write_line(folder: Path, template: str, table: str) -> Path:
    (folder / "run.toml").write_text(template, encoding="utf-8")
    (folder / "sensors.csv").write_text(table, encoding="utf-8")
    return folder


def test_the_table_of_a_line_is_written_from_its_folders_as_on_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    page = (ROOT / "docs" / "how-to" / "fleet.md").read_text(encoding="utf-8")
    for path in ("data/2026-11-24/QK26-1064.csv", "data/2026-11-25/QK26-1029.csv"):
        (tmp_path / path).parent.mkdir(parents=True)
        (tmp_path / path).touch()
    monkeypatch.chdir(tmp_path)
    exec(re.findall(r"```python\n(.*?)```", page, re.S)[0], {})
    (tmp_path / "run.toml").write_text(TEMPLATE, encoding="utf-8")
    rows = read_line(tmp_path).rows
    assert [(row.id, row.columns["measured"]) for row in rows] == [
        ("QK26-1064", "2026-11-24"),
        ("QK26-1029", "2026-11-25"),
    ]
    assert rows[1].recording == "data/2026-11-25/QK26-1029.csv"


def test_values_are_substituted_not_text(tmp_path: Path):
    template = TEMPLATE.replace("[sensor]\n", '[sensor]\nname = "{lot}/{id}"\n', 1)
    template += 'window = "{window:number}"\n'
    table = 'id,recording,lot,window\n"a ""quoted"" name",r/1.npz,L7,0.5\n'
    line = read_line(write_line(tmp_path, template, table))
    sections = line.sections(line.rows[0])
    assert sections["sensor"]["name"] == 'L7/a "quoted" name'
    assert sections["method"]["window"] == 0.5
    assert sections["data"]["file"] == "r/1.npz"
    assert line.template["method"]["window"] == "{window:number}"


def test_a_date_in_the_template_is_that_of_every_run(tmp_path: Path):
    """TOML writes dates without quotes."""
    template = TEMPLATE + "\n[job]\nmeasured = 2026-11-25\ncustomer = '{lot}'\n"
    line = read_line(write_line(tmp_path, template, "id,recording,lot\na,1,L7\n"))
    assert line.placeholders >= {"lot"}
    run = line.run(line.rows[0])
    assert (run.job["measured"], run.job["customer"]) == ("2026-11-25", "L7")


def test_a_dotted_column_replaces_a_key_where_it_is_not_empty(tmp_path: Path):
    table = "id,recording,bench.gravity,sensor.accelerometer.unit\na,1,9.79 m/s²,\nb,2,,m/s²\n"
    line = read_line(write_line(tmp_path, TEMPLATE, table))
    first, second = map(line.sections, line.rows)
    assert first["bench"]["gravity"] == "9.79 m/s²"
    assert first["sensor"]["accelerometer"]["unit"] == "g"
    assert second["bench"]["gravity"] == "9.81 m/s² ± 0.1 mm/s²"
    assert second["sensor"]["accelerometer"]["unit"] == "m/s²"


def test_a_cell_that_is_a_list_gives_the_key_a_list(tmp_path: Path):
    columns = ("AccX", "AccY", "AccZ")
    cell = '"[""AccX"", ""AccY"", ""AccZ""]"'
    table = f"id,recording,data.accelerometer,job.notes\na,1,{cell},[as found\n"
    (tmp_path / "AccX").touch()
    line = read_line(write_line(tmp_path, TEMPLATE, table))
    sections = line.sections(line.rows[0])
    assert sections["data"]["accelerometer"] == list(columns)
    assert sections["job"]["notes"] == "[as found"
    assert line.run(line.rows[0]).data.accelerometer == columns
    before = line.digest(line.rows[0])
    (tmp_path / "AccX").write_text("changed", encoding="utf-8")  # as a file that a list may name
    assert line.digest(line.rows[0]) != before


def test_a_parquet_table_is_that_of_csv(tmp_path: Path):
    pa = pytest.importorskip("pyarrow")
    import pyarrow.parquet as pq

    folder = make_line(tmp_path, 2)
    as_csv = read_line(folder).rows
    pq.write_table(
        pa.table({"id": [one.id for one in as_csv], "recording": [r.recording for r in as_csv]}),
        folder / "sensors.parquet",
    )
    (folder / "sensors.csv").unlink()
    assert read_line(folder).rows == as_csv


@pytest.mark.parametrize(
    ("table", "named"),
    [
        ("id,file\na,1\n", "recording"),
        ("id,recording\na,1\na,2\n", "a"),
        ("id,recording,lot,lot\na,1,x,y\n", "lot"),
        ("id,recording\n,1\n", "id"),
        ("id,recording\n../A,1\n", "../A"),
        ("id,recording\n..,1\n", ".."),
        ("id,recording\na,\n", "recording"),
    ],
)
def test_a_table_that_misleads_is_refused(tmp_path: Path, table: str, named: str):
    with refused(file="sensors.csv", names=(named,)):
        read_line(write_line(tmp_path, TEMPLATE, table))


@pytest.mark.parametrize("table", ["", "id,recording\n", "id,recording\na,1,2\n"])
def test_a_table_without_sensors_or_with_other_cells_is_refused(tmp_path: Path, table: str):
    with refused(file="sensors.csv"):
        read_line(write_line(tmp_path, TEMPLATE, table))


def test_a_placeholder_without_a_column_is_refused(tmp_path: Path):
    template = TEMPLATE.replace('"0.1 °"', '"{tilt}"')
    with refused(file="run.toml", names=("tilt",)):
        read_line(write_line(tmp_path, template, "id,recording\na,1\n"))


def test_a_folder_that_is_no_line_is_refused(tmp_path: Path):
    with refused(file=tmp_path / "none"):
        read_line(tmp_path / "none")
    with pytest.raises(InputError):
        read_line(tmp_path)
    (tmp_path / "run.toml").write_text(TEMPLATE, encoding="utf-8")
    with refused(file=tmp_path):
        read_line(tmp_path)
    write_table(tmp_path, [("a", "b")])
    assert read_line(tmp_path).rows[0].id == "a"


def test_only_a_column_that_is_used_changes_the_digest(tmp_path: Path):
    tables = (
        "id,recording\na,1\n",
        "id,recording,remark,bench.tilt\na,1,new,\n",
        "id,recording,lot\na,1,L2\n",
        "id,recording,bench.tilt\na,1,0.2 °\n",
    )
    lines = [read_line(write_line(tmp_path, TEMPLATE, table)) for table in tables]
    first, remarked, grouped, tilted = (one.digest(one.rows[0]) for one in lines)
    assert remarked == first
    assert len({first, grouped, tilted}) == 3
