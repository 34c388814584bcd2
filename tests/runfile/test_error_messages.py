"""An error of the run file's schema is one line that names the key and what is possible."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from pydantic import BaseModel
from tests.refusals import refused
from tests.runfile.run_file_texts import FERRARIS, changed

from inercal.basics.errors import InputError
from inercal.benches.kind_definition import KINDS
from inercal.benches.rate_table.kind import RateTableData, RateTableSection
from inercal.cli.app import main
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


def refuse(
    folder: Path, text: str, key: str | None, method: Mapping[str, object] | None = None
) -> str:
    """Expect one line about a key of a run file; return it without the name of the file."""
    path = folder / "run.toml"
    path.write_text(text, encoding="utf-8")
    with refused(InputError, file=path, key=key) as refusal:
        read(path, method)
    message = str(refusal.value)
    assert "\n" not in message
    return message.removeprefix(f"{path}: ")


def stated(text: str, section: str, line: str) -> str:
    """Return the run file with one key of a section replaced, or added."""
    key = line.partition(" ")[0]
    heading, lines = f"[{section}]", text.split("\n")
    if heading not in lines:
        return f"{text}\n{heading}\n{line}\n"
    at = lines.index(heading) + 1
    end = next((i for i in range(at, len(lines)) if lines[i].startswith("[")), len(lines))
    kept = [old for old in lines[at:end] if not old.startswith(f"{key} =")]
    return "\n".join([*lines[:at], line, *kept, *lines[end:]])


@pytest.mark.parametrize(
    ("section", "line", "possible"),
    [
        ("bench", "radius = 0.25", '"250 mm ± 0.3 mm"'),
        ("bench", "speed = 0.05", '"0.05 %"'),
        ("bench", 'radius = ["1 m"]', '"250 mm ± 0.3 mm"'),
        ("bench", "latitude = 31", '"48.1 °"'),
        ("data.sd", "gyro = 0.3", '"5 °/h"'),
        ("method.search", "goal = 5", '"5 %"'),
        ("method.search", "time_limit = 20", '"20 s"'),
        ("sensor", "name = 5", '"sensor"'),
        ("sensor", "name = true", '"sensor"'),
        ("method.search", 'seed = "abc"', "whole number"),
        ("method.search", "seed = 1.5", "whole number"),
        ("method.search", "seed = -1", "0"),
        ("sensor.accelerometer", 'offset = "abc"', "number"),
        ("method", 'reverse = "both"', "false"),
        ("sensor", 'frame = "sym"', "symmetric"),
        ("sensor", "frame = [1]", "symmetric"),
        ("bench", "kind = 5", "turntable"),
        ("data", "time = 1.5", "column"),
        ("data", "accelerometer = [1.5, 2, 3]", "column"),
        ("method", "rates = 60", '["60 rpm", "120 rpm"]'),
        ("data", "sd = 5", "[data.sd]"),
        ("method.prior_from", "file = 5", "[method.prior_from.file]"),
    ],
)
def test_a_value_of_another_type_is_refused_with_its_key_and_a_possible_value(
    tmp_path: Path, section: str, line: str, possible: str
):
    key = line.partition(" ")[0]
    message = refuse(tmp_path, stated(ON_TABLE, section, line), f"[{section}] {key}")
    assert possible in message


def test_a_list_of_another_length_is_refused(tmp_path: Path):
    text = (EXAMPLES / "centrifuge" / "lab.toml").read_text(encoding="utf-8")
    refuse(tmp_path, stated(text, "data", 'attitude = ["a", "b", "c"]'), "[data] attitude")


@pytest.mark.parametrize(
    ("key", "kinds"),
    [
        ("angle", ['"dividing_head"']),
        ("attitude", ['"centrifuge"']),
        ("table", ['"turntable"']),
        ("accept_moving", ['"hand"', '"dividing_head"']),
    ],
)
def test_a_column_of_another_bench_is_refused_with_the_kinds_that_have_it(
    tmp_path: Path, key: str, kinds: list[str]
):
    message = refuse(tmp_path, stated(ON_TABLE, "data", f'{key} = "a"'), f"[data] {key}")
    assert [f'"{kind}"' for kind in KINDS if f'"{kind}"' in message] == kinds


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
    with refused(InputError, file=path) as refusal:
        read(path)
    message = str(refusal.value)
    assert refusal.value.key is not None
    assert "Input" not in message
    assert "valid" not in message
    assert "\n" not in message


def quantities(model: type[BaseModel]) -> dict[str, Any]:
    return {
        name: field.examples[0]
        for name, field in model.model_fields.items()
        if field.examples and str(field.examples[0])[0].isdigit()
    }


@pytest.mark.parametrize("section", ["sensor.accelerometer", "bench"])
def test_every_example_that_an_error_prints_is_accepted(tmp_path: Path, section: str):
    text = ON_TABLE
    for key, example in quantities(KEYS[section]).items():
        if key != "scale":  # for an output in LSB
            text = stated(text, section, f'{key} = "{example}"')
    # All sections are valid: only columns that this bench needs are missing.
    refuse(tmp_path, text, "[data] arm_rate")


def test_a_missing_key_is_named_with_its_section(tmp_path: Path):
    refuse(tmp_path, changed(ON_TABLE, ('radius = "250 mm"\n', "")), "[bench] radius")


@pytest.mark.parametrize(
    ("old", "new", "key", "misspelt"),
    [
        ("radius =", "radus =", "[bench] radius", "bench.radus"),
        ("[data]", "[date]", "[data]", "[date]"),
    ],
)
def test_a_missing_key_is_named_together_with_the_misspelt_key(
    tmp_path: Path, old: str, new: str, key: str, misspelt: str
):
    assert misspelt in refuse(tmp_path, changed(ON_TABLE, (old, new)), key)


@pytest.mark.parametrize("kind", ["", 'kind = "hand"\n'])
def test_a_key_of_another_kind_of_bench_is_refused_with_those_kinds(tmp_path: Path, kind: str):
    text = changed(ON_TABLE, ('kind = "rate_table"\n', kind))
    message = refuse(tmp_path, text, "[bench] radius")
    assert message.endswith('"centrifuge" or "rate_table"')
    assert ("kind is missing" in message) == (not kind)


@pytest.mark.parametrize(
    ("more", "key", "possible"),
    [
        ("[sensor.gyros]\nx = 1", "[sensor.gyros]", "gyro?"),
        ("[sensors]\nx = 1", "[sensors]", "sensor?"),
        ('[data.sd]\n"a b" = "1 g"', "[data.sd] a b", "accelerometer, gyro"),
        ('[method.prior]\n"a\\nb" = 5', r'[method.prior] "a\nb"', "text with"),
    ],
)
def test_unknown_names_are_refused_with_the_possible_names(
    tmp_path: Path, more: str, key: str, possible: str
):
    assert possible in refuse(tmp_path, f"{FERRARIS}\n{more}\n", key)


@pytest.mark.parametrize("section", ["sensor", "bench", "data", "method"])
def test_a_value_instead_of_a_section_is_refused(tmp_path: Path, section: str):
    kept = [part for part in FERRARIS.split("\n\n") if not part.startswith(f"[{section}")]
    text = f"{section} = 5\n\n" + "\n\n".join(kept)
    message = refuse(tmp_path, text, section)
    assert refuse(tmp_path, text, section, {"name": "ferraris"}) == message


def test_deviations_of_means_are_refused_for_a_recording(tmp_path: Path):
    refuse(tmp_path, f'{FERRARIS}\n[data.sd]\naccelerometer = "1 mg"\n', "[data] sd")


def test_a_long_value_is_cut(tmp_path: Path):
    text = stated(ON_TABLE, "sensor", f'frame = "{"x" * 1000}"')
    assert len(refuse(tmp_path, text, "[sensor] frame")) < 140


def test_a_wrong_type_is_one_line_and_status_two(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "run.toml"
    path.write_text(stated(ON_TABLE, "bench", "radius = 0.25"), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["inercal", "calibrate", str(path), "--out", str(tmp_path)])
    with pytest.raises(SystemExit) as status:
        main()
    assert status.value.code == 2
    printed = capsys.readouterr().err.strip()
    assert len(printed.splitlines()) == 1
    assert f"{path}: [bench] radius: " in printed
