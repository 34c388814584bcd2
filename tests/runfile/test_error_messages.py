"""What the schema of the run file refuses is one line: the key, what is there, what is possible."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel
from tests.runfile.run_file_texts import FERRARIS, changed

from inercal.benches.rate_table.settings import RateTableData, RateTableSection
from inercal.cli.app import main
from inercal.errors import InputError
from inercal.runfile import read, schema

EXAMPLES = Path(__file__).parents[2] / "examples"
ON_TABLE = """\
[sensor.accelerometer]
unit = "g"

[bench]
kind = "rate_table"
latitude = "31 °"
radius = "250 mm"

[data]
file = "log.csv"

[method]
name = "ship_multi_angle"
"""
KEYS = {
    "sensor": schema.SensorSection,
    "sensor.accelerometer": schema.ReadoutSection,
    "bench": RateTableSection,
    "data": RateTableData,
    "method": schema.MethodSection,
    "method.search": schema.SearchSection,
    "method.filter": schema.FilterSection,
    "method.filter.initial": schema.FilterInitialSection,
}


def refusal(folder: Path, text: str, method: Mapping[str, object] | None = None) -> str:
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read(path, method)
    message = str(refused.value)
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def stated(text: str, section: str, line: str) -> str:
    """Return the run file with one key stated in a section, in the place of what was stated."""
    key = line.partition(" ")[0]
    heading, lines = f"[{section}]", text.split("\n")
    if heading not in lines:
        return f"{text}\n{heading}\n{line}\n"
    at = lines.index(heading) + 1
    end = next((i for i in range(at, len(lines)) if lines[i].startswith("[")), len(lines))
    kept = [old for old in lines[at:end] if not old.startswith(f"{key} =")]
    return "\n".join([*lines[:at], line, *kept, *lines[end:]])


@pytest.mark.parametrize(
    ("section", "line", "said"),
    [
        (
            "bench",
            "radius = 0.25",
            '0.25 is a number; give text with its unit, such as "250 mm ± 0.3 mm"',
        ),
        ("bench", "speed = 0.05", '0.05 is a number; give text with its unit, such as "0.05 %"'),
        (
            "bench",
            'radius = ["1 m"]',
            'it is a list; give text with its unit, such as "250 mm ± 0.3 mm"',
        ),
        ("bench", "latitude = 31", '31 is a number; give text with its unit, such as "48.1 °"'),
        ("data.sd", "gyro = 0.3", '0.3 is a number; give text with its unit, such as "5 °/h"'),
        ("method.search", "goal = 5", '5 is a number; give text with its unit, such as "5 %"'),
        (
            "method.search",
            "time_limit = 20",
            '20 is a number; give text with its unit, such as "20 s"',
        ),
        ("sensor", "name = 5", '5 is a number; give text in quotes, such as "sensor"'),
        (
            "sensor",
            "name = true",
            'true is neither text nor number; give text in quotes, such as "sensor"',
        ),
        ("method.search", 'seed = "abc"', "'abc' is not a whole number"),
        ("method.search", "seed = 1.5", "1.5 is not a whole number"),
        ("method.search", "seed = -1", "-1; it must be 0 or more"),
        ("sensor.accelerometer", 'offset = "abc"', "'abc' is not a number"),
        ("method", 'reverse = "both"', "'both'; it is true or false"),
        ("sensor", 'frame = "sym"', "'sym'; it is mount or symmetric"),
        ("sensor", "frame = [1]", "a list; it is mount or symmetric"),
        ("bench", "kind = 5", "5; it is hand, centrifuge, dividing_head, rate_table or turntable"),
        ("data", "time = 1.5", "1.5 is a number; give a column, by its name or its number"),
        ("data", "accelerometer = [1.5, 2, 3]", "1.5 is a number; give a column, by its name or"),
        ("data", 'gyro = ["a", "b"]', "2 in the list; it takes 3"),
        ("method", "rates = 60", '60 is a number; give a list, such as ["60 rpm", "120 rpm"]'),
        ("data", "sd = 5", "5 is a number; give a section, [data.sd]"),
        ("method.prior_from", "file = 5", "5 is a number; give a section, [method.prior_from.file"),
    ],
)
def test_a_value_of_another_kind_is_said_with_what_is_possible(
    tmp_path: Path, section: str, line: str, said: str
):
    key = line.partition(" ")[0]
    message = refusal(tmp_path, stated(ON_TABLE, section, line))
    assert message.startswith(f"[{section}] {key}: {said}")


def test_a_list_of_another_length_is_said(tmp_path: Path):
    text = (EXAMPLES / "centrifuge" / "lab.toml").read_text(encoding="utf-8")
    message = refusal(tmp_path, stated(text, "data", 'attitude = ["a", "b", "c"]'))
    assert message.startswith("[data] attitude: 3 in the list; it takes 2")


@pytest.mark.parametrize(
    ("key", "kinds"),
    [
        ("angle", '"dividing_head"'),
        ("attitude", '"centrifuge"'),
        ("table", '"turntable"'),
        ("accept_moving", '"hand" or "dividing_head"'),
    ],
)
def test_a_column_of_another_bench_is_answered_with_its_kind(tmp_path: Path, key: str, kinds: str):
    message = refusal(tmp_path, stated(ON_TABLE, "data", f'{key} = "a"'))
    assert message == f"[data] {key} goes with [bench] kind = {kinds}"


@pytest.mark.parametrize("value", ["1979-05-27", "[[]]", "{ odd = [] }", "1.5", '"odd"'])
@pytest.mark.parametrize(
    ("section", "key"),
    [(section, key) for section, model in KEYS.items() for key in model.model_fields],
)
def test_no_wrong_type_is_refused_in_the_words_of_a_library(
    tmp_path: Path, section: str, key: str, value: str
):
    path = tmp_path / "run.toml"
    text = stated(ON_TABLE, section, f"{key} = {value}")
    path.write_text(text.replace(f"[sensor.{key}]", "[spare]"), encoding="utf-8")
    with pytest.raises(InputError) as refused:
        read(path)
    assert "Input" not in str(refused.value)
    assert "valid" not in str(refused.value)
    assert "\n" not in str(refused.value)


def quantities(model: type[BaseModel]) -> dict[str, Any]:
    return {
        name: field.examples[0]
        for name, field in model.model_fields.items()
        if field.examples and str(field.examples[0])[0].isdigit()
    }


@pytest.mark.parametrize("section", ["sensor.accelerometer", "bench"])
def test_what_a_complaint_gives_as_an_example_is_taken(tmp_path: Path, section: str):
    text = ON_TABLE
    for key, example in quantities(KEYS[section]).items():
        if key != "scale":  # for an output in LSB
            text = stated(text, section, f'{key} = "{example}"')
    # All sections are read before the columns that are missing are missed.
    assert refusal(tmp_path, text).startswith("[data] arm_rate is missing")


def test_a_key_that_is_missing_is_named_with_its_section_and_an_example(tmp_path: Path):
    message = refusal(tmp_path, changed(ON_TABLE, ('radius = "250 mm"\n', "")))
    assert message == '[bench] radius is missing, such as "250 mm ± 0.3 mm"'


def test_beside_a_key_that_is_missing_the_misspelt_one_is_named(tmp_path: Path):
    message = refusal(tmp_path, changed(ON_TABLE, ("radius =", "radus =")))
    assert message.startswith(
        '[bench] radius is missing, such as "250 mm ± 0.3 mm"; unknown key bench.radus; did '
        "you mean radius?; "
        "possible here: "
    )
    message = refusal(tmp_path, changed(ON_TABLE, ("[data]", "[date]")))
    assert message == (
        "[data] is missing; unknown section [date]; did you mean data?; "
        "possible here: sensor, bench, data, method"
    )


def test_a_bench_without_kind_says_so_of_keys_of_another(tmp_path: Path):
    message = refusal(tmp_path, changed(ON_TABLE, ('kind = "rate_table"\n', "")))
    assert message == (
        "unknown key bench.radius; possible here: gravity, latitude, height, name, kind, tilt, "
        "turn_angle, turn_tilt, timebase; kind is missing, so hand is taken; "
        'radius goes with kind = "centrifuge" or "rate_table"'
    )


def test_a_bench_with_its_kind_says_where_a_key_of_another_goes(tmp_path: Path):
    message = refusal(tmp_path, changed(ON_TABLE, ('"rate_table"', '"hand"')))
    assert "kind is missing" not in message
    assert message.endswith('; radius goes with kind = "centrifuge" or "rate_table"')


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (
            "[sensor.gyros]\nx = 1",
            "unknown section [sensor.gyros]; did you mean gyro?; possible here: name, form",
        ),
        (
            "[sensors]\nx = 1",
            "unknown section [sensors]; did you mean sensor?; possible here: sensor, bench, data",
        ),
        (
            '[data.sd]\n"a b" = "1 g"',
            'unknown key data.sd."a b"; possible here: accelerometer, gyro',
        ),
        ('[method.prior]\n"a\\nb" = 5', r'[method.prior] "a\nb": 5 is a number; give text with'),
    ],
)
def test_unknown_names_are_refused_with_those_that_are_possible(
    tmp_path: Path, more: str, said: str
):
    assert refusal(tmp_path, f"{FERRARIS}\n{more}\n").startswith(said)


@pytest.mark.parametrize(
    "section", ["[specification]", '[specification]\n"ax.k0" = "1 mg"', "[specification.ax]"]
)
def test_the_reserved_section_of_limits_is_refused_as_such(tmp_path: Path, section: str):
    said = refusal(tmp_path, f"{FERRARIS}\n{section}\n")
    assert said.startswith("section [specification] is reserved for limits per coefficient")
    assert "does not judge" in said
    assert "possible here" not in said


@pytest.mark.parametrize("section", ["sensor", "bench", "data", "method"])
def test_a_value_in_the_place_of_a_section_is_refused(tmp_path: Path, section: str):
    kept = [part for part in FERRARIS.split("\n\n") if not part.startswith(f"[{section}")]
    text = f"{section} = 5\n\n" + "\n\n".join(kept)
    said = f"{section}: 5 is a number; give a section, [{section}]"
    assert refusal(tmp_path, text) == said
    assert refusal(tmp_path, text, {"name": "ferraris"}) == said


def test_a_long_value_is_cut(tmp_path: Path):
    message = refusal(tmp_path, stated(ON_TABLE, "sensor", f'frame = "{"x" * 1000}"'))
    assert len(message) < 120


def test_a_wrong_type_is_one_line_and_status_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "run.toml"
    path.write_text(stated(ON_TABLE, "bench", "radius = 0.25"), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["inercal", "calibrate", str(path), "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as status:
        main()
    assert status.value.code == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    assert said.endswith(
        '[bench] radius: 0.25 is a number; give text with its unit, such as "250 mm ± 0.3 mm"'
    )
