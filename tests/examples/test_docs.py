"""The pages say what the code says: keys, defaults, tables, findings, snippets, links."""

import re
import tomllib
from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from tests.external_bench import load_example_module, register_example_bench
from tests.store import calibration_generator

import inercal
from inercal.basics.errors import InputError
from inercal.basics.units import Measured, format_value_and_uncertainty, parse_quantity
from inercal.benches import Hand
from inercal.benches.kind_definition import KINDS, Kind
from inercal.calibration.comparison import compare
from inercal.calibration.next_steps import WRONG_SOAK
from inercal.cli import calibration_view, store_view
from inercal.laboratory.store import FileEntry, Register, RunEntry
from inercal.methods import METHODS, Method
from inercal.physics.sensors import SI_UNITS
from inercal.physics.sensors.coefficient_tables import ACCELEROMETER, GYRO, ErrorTerm
from inercal.pipeline import calibrate, simulate_files
from inercal.recordings.io.write import write_recordings
from inercal.runfile import read, schema
from inercal.runfile.noise_data_sheet import DataSheetFile

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted([*DOCS.glob("**/*.md"), *ROOT.glob("*.md")])
SECTIONS: dict[str, type[BaseModel]] = {
    "[sensor]": schema.SensorSection,
    "[sensor.accelerometer] and [sensor.gyro]": schema.ReadoutSection,
    "[bench], by hand": KINDS["hand"].section,
    "[bench], on a centrifuge": KINDS["centrifuge"].section,
    "[bench], on a dividing head": KINDS["dividing_head"].section,
    "[bench], on a rate table": KINDS["rate_table"].section,
    "[bench], on a rate platform": KINDS["rate_platform"].section,
    "[bench], on a turntable": KINDS["turntable"].section,
    "[data]": schema.DataSection,
    "[method]": schema.MethodSection,
    "[job]": schema.JobSection,
    "[specification]": schema.SpecificationSection,
    "[environment]": schema.EnvironmentSection,
    "[method.search]": schema.SearchSection,
    "[method.filter]": schema.FilterSection,
    "[method.filter.initial]": schema.FilterInitialSection,
}
# Of [data] a kind of bench has keys of its own, which stand in a table of their own.
KEYS = {heading: dict(section.model_fields) for heading, section in SECTIONS.items()} | {
    f"[data], {words}": {
        key: field
        for key, field in KINDS[kind].data.model_fields.items()
        if key not in schema.DataSection.model_fields or (field.is_required() and key != "file")
    }
    for kind, words in (
        ("hand", "by hand"),
        ("centrifuge", "on a centrifuge"),
        ("dividing_head", "on a dividing head"),
        ("rate_table", "on a rate table"),
        ("rate_platform", "on a rate platform"),
        ("turntable", "on a turntable"),
    )
}


def page(name: str) -> str:
    return (DOCS / name).read_text(encoding="utf-8")


def section(text: str, heading: str) -> str:
    """Return the text between a heading and the next one of any level."""
    return re.split(r"^#+ ", text.split(f"# {heading}\n", 1)[1], maxsplit=1, flags=re.M)[0]


def rows(text: str) -> Iterator[list[str]]:
    """Return the cells of the rows of the tables, heads and rules left out."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    rules = {k for k, line in enumerate(lines) if set(line) <= set("|-:")}
    for k, line in enumerate(lines):
        if not {k, k + 1} & rules:
            yield [cell.strip() for cell in line.strip("|").split("|")]


def default(field: FieldInfo) -> str:
    """Return a default as the page shows it."""
    if field.is_required():
        return "required"
    value: Any = field.get_default(call_default_factory=True)
    if value is None or value == {}:
        return "none"
    if isinstance(value, str):
        return f'`"{value}"`'
    if isinstance(value, bool):
        return f"`{str(value).lower()}`"  # as TOML writes it
    return f"`{list(value)}`".replace("'", '"') if isinstance(value, tuple) else f"`{value}`"


@pytest.mark.parametrize("heading", KEYS)
def test_run_file_page_has_every_key_of_the_schema_with_its_default(heading: str):
    written = {
        cells[0]: cells[1] for cells in rows(section(page("reference/run-file.md"), heading))
    }
    assert written == {f"`{name}`": default(field) for name, field in KEYS[heading].items()}


def test_run_file_page_has_every_method_and_estimator():
    keys = {c[0]: c[3] for c in rows(section(page("reference/run-file.md"), "[method]"))}
    assert set(re.findall(r"`(\w+)`", keys["`name`"])) == set(METHODS)
    for name, one in METHODS.items():
        assert name in keys["`estimator`"], name
        assert set(one.estimators) <= set(re.findall(r"`(\w+)`", keys["`estimator`"])), name


def test_examples_of_quantities_on_the_run_file_page_can_be_read():
    likes = {
        "scale": "LSB/(m/s²)",
        "full_scale": "m/s²",
        "white": "m/s²/√Hz",
        "bias_instability": "m/s²",
        "random_walk": "m/s²/√s",
        "quantisation": "m/s²",
        "gravity": "m/s²",
        "latitude": "rad",
        "height": "m",
        "tilt": "rad",
        "turn_angle": "rad",
        "turn_tilt": "rad",
        "timebase": "1",
        "radius": "m",
        "stretch": "1/(m/s²)",
        "lean": "rad",
        "rate_error": "1",
        "dwell_rate": "1",
        "dwell_tilt": "rad",
        "indexing": "rad",
        "mounting": "rad",
        "rate": "Hz",
        "accelerometer": "m/s²",
        "turn": "rad",
        "seconds": "s",
        "turn_seconds": "s",
        "time_limit": "s",
        "goal": "1",
        "scale_error": "1",
        "cross_axis": "1",
        "bias": "m/s²",
    }
    read = 0
    for name, _, example, *_ in rows(page("reference/run-file.md")):
        first = re.match(r'`"(-?\d[^"]*)"`', example)
        if first and name.strip("`") in likes:
            assert isinstance(parse_quantity(first[1], likes[name.strip("`")]), Measured)
            read += 1
    assert read >= len(likes) - 1  # [data] accelerometer names columns


@pytest.mark.parametrize(
    ("heading", "table"), [("Accelerometer", ACCELEROMETER), ("Gyro", GYRO)], ids=["acc", "gyro"]
)
def test_model_page_has_the_lines_of_the_coefficient_tables(
    heading: str, table: tuple[ErrorTerm, ...]
):
    expected = [
        [
            f"`{c.name}`",
            c.symbol,
            c.unit,
            SI_UNITS[c.unit],
            f"`{c.basis.text}`",
            c.group,
            c.meaning,
        ]
        for c in table
    ]
    assert list(rows(section(page("reference/model.md"), heading))) == expected


def test_uncertainty_page_lists_every_nuisance_of_the_bench():
    text = section(page("reference/uncertainty.md"), "What it includes")
    listed = [(name, cells[2]) for cells in rows(text) for name in re.findall(r"`(\w+)`", cells[0])]
    expected = [(p.name, p.scope) for p in Hand(Measured(9.81, 0.0)).parameters]
    assert sorted(listed) == sorted(expected)


def test_recordings_page_lists_every_finding_that_the_code_makes():
    source = "\n".join(p.read_text(encoding="utf-8") for p in (ROOT / "src").glob("**/*.py"))
    made = {*re.findall(r'Finding\(\s*[^,]+,\s*"(\w+)"', source), WRONG_SOAK}
    listed = {
        cells[0].strip("`")
        for cells in rows(section(page("how-to/recordings.md"), "The audit"))
        if re.fullmatch(r"`\w+`", cells[0])
    }
    assert listed == made


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_toml_on_a_page_is_a_part_of_a_run_file(path: Path):
    for text in re.findall(r"```toml\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.S):
        content = tomllib.loads(text)
        if "qualification" in content:
            assert set(content) <= {"qualification", "measurement"}
        elif "datasheet" in content:
            DataSheetFile.model_validate(content)
        elif "frame" not in content:  # of packets, which tests/host reads
            assert set(content) <= set(schema.RunSchema.model_fields)


@pytest.mark.parametrize("path", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_of_a_page_lead_somewhere(path: Path):
    for target in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if target.startswith("http"):
            continue
        file, _, anchor = target.partition("#")
        there = (path.parent / file).resolve() if file else path
        assert there.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.*)$", there.read_text(encoding="utf-8"), flags=re.M)
            slugs = [re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings]
            assert anchor in slugs, target


def test_readme_and_front_page_have_the_same_table_of_methods_and_name_each_of_them():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    heading = "Which method for which bench"
    table = list(rows(section(page("index.md"), heading)))
    assert [
        [cell.replace("](docs/", "](") for cell in row] for row in rows(section(readme, heading))
    ] == table
    named = {name for *_, names in table for name in re.findall(r"`(\w+)`", names)}
    assert named == set(METHODS)


def snippets(name: str) -> list[str]:
    return re.findall(r"```python\n(.*?)```", page(name), flags=re.S)


def test_the_snippets_of_the_calibration_page_apply_and_verify_a_file(tmp_path: Path):
    run = inercal.calibrate(ROOT / "examples/six_position/run.toml").calibration
    file = inercal.save(run, tmp_path / "run.calibration.json")
    apply, share, verify = (s.replace("run.calibration.json", str(file)) for s in snippets(
        "reference/calibration-file.md"
    ))  # fmt: skip
    scope: dict[str, Any] = {}
    exec(apply, scope)
    matrix, offset = run.affine_correction()
    np.testing.assert_allclose(scope["matrix"], matrix, rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(scope["offset"], offset, rtol=1e-12)
    shared: dict[str, Any] = {}
    exec(share, shared)
    assert (np.diag(shared["own"]) < np.diag(run.covariance)).any()
    exec(verify, {})


def test_the_snippet_of_the_budget_page_prints_contributions_largest_first(
    capsys: pytest.CaptureFixture[str],
):
    (text,) = snippets("how-to/budget.md")
    exec(text, {})
    sizes = [float(line.split()[-1]) for line in capsys.readouterr().out.splitlines()]
    assert len(sizes) == 5
    assert sizes == sorted(sizes, reverse=True)


def test_the_snippet_of_data_in_memory_gives_the_calibration_of_the_example():
    (text,) = snippets("how-to/first-calibration.md")
    scope: dict[str, Any] = {}
    exec(text, scope)
    found = scope["outcome"].calibration
    example = calibrate(ROOT / "examples/six_position/run.toml").calibration
    np.testing.assert_array_equal(found.values, example.values)


@pytest.mark.slow
def test_numbers_in_the_ferraris_guide_are_those_of_the_recording(data_dir: Path, tmp_path: Path):
    text = page("how-to/ferraris.md")
    example = ROOT / "examples" / "ferraris_recordings" / "session_a.toml"
    shown = example.read_text(encoding="utf-8")
    assert shown in text
    run_file = tmp_path / "session_a.toml"
    located = shown.replace("../../../shared/data", str(data_dir))
    run_file.write_text(located, encoding="utf-8")
    found = {"ml": calibrate(run_file).calibration}
    run_file.write_text(located + 'estimator = "classical"\n', encoding="utf-8")
    found["classical"] = calibrate(run_file).calibration
    table = [cells for cells in rows(section(text, "6. Read the result")) if len(cells) == 7]
    assert len(table) == 6
    for name, _, *cells, _ in table:
        full = name.strip("`")
        for k, calibration in enumerate((found["ml"], found["classical"])):
            si = calibration.sensor.coefficient(full).si
            u = 2 * calibration.uncertainty(full) / si
            assert (cells[2 * k], cells[2 * k + 1]) == format_value_and_uncertainty(
                calibration.value(full) / si, u
            )


def test_the_register_page_names_every_field_of_what_is_printed(tmp_path: Path):
    text = section(page("how-to/register.md"), "For programs")
    named = set(re.findall(r"`(\w+)`", text))
    rng = np.random.default_rng(1)
    with Register(str(tmp_path / "r.db"), by="Ada") as register:
        for years in (0.0, 1.0, 2.0):
            made = calibration_generator.content(calibration_generator.DRIFTING, years, rng)
            path = calibration_generator.write(tmp_path / f"{years}.calibration.json", made)
            register.enter_calibration(path)
        entry, history = register.calibration(1), register.history(1)
        rows = register.coefficients(1)
        (sensor,) = register.sensors()
    first, second = (one.calibration for one in history.entries[:2])
    objects = (
        store_view.entry_object(sensor),
        store_view.calibration_object(entry, rows) | {"content": {}},
        store_view.history_object(history),
        calibration_view.comparison_object(compare(first, second), ("1", "2")),
        dict.fromkeys(one.name for one in fields(RunEntry)),
        dict.fromkeys(FileEntry._fields),
    )

    def keys(found: Any) -> set[str]:
        if isinstance(found, dict):
            return set(found).union(*map(keys, found.values()))
        return set().union(*map(keys, found)) if isinstance(found, list) else set()

    assert keys(list(objects)) <= named


def test_the_snippet_of_the_register_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setenv("INERCAL_REGISTER", str(tmp_path / "r.db"))
    made = calibration_generator.content(
        calibration_generator.DRIFTING, 0.0, np.random.default_rng(1)
    )
    file = calibration_generator.write(tmp_path / "run.calibration.json", made)
    (text,) = snippets("how-to/register.md")
    exec(text.replace("run.calibration.json", str(file)), {})
    assert capsys.readouterr().out.startswith("{'too few': ('ax.k0', ")


OWN = ROOT / "examples" / "own_bench"


@pytest.fixture
def tilted(tmp_path: Path) -> Iterator[Path]:
    """Return a copy of the example's run file, its kind and its method being known."""
    with register_example_bench(tmp_path) as path:
        yield path


def test_excerpts_on_the_pages_of_ones_own_are_those_of_the_examples():
    files = [OWN / "tilt_table.py", OWN / "pyproject.toml", OWN / "tilt.toml"]
    source = "\n".join(
        path.read_text(encoding="utf-8")
        for path in (*files, ROOT / "tests" / "rest_bias_method.py")
    )
    excerpts = [*snippets("how-to/own-bench.md"), *snippets("how-to/own-method.md")]
    excerpts = [text for text in excerpts if not text.startswith(("import ", "from "))]
    excerpts += re.findall(r"```toml\n(.*?)```", page("how-to/own-bench.md"), flags=re.S)
    for name in ("own-bench", "own-method"):
        excerpts += re.findall(r"```text\n(\[project.*?)```", page(f"how-to/{name}.md"), flags=re.S)
    assert len(excerpts) >= 18
    for text in excerpts:
        assert text in source, text


@pytest.mark.parametrize(
    ("name", "heading", "one"),
    [("own-bench", "All fields of Kind", Kind), ("own-method", "All fields of Method", Method)],
    ids=["kind", "method"],
)
def test_the_pages_of_ones_own_have_every_field_and_say_which_are_needed(
    name: str, heading: str, one: type[Any]
):
    cells = list(rows(section(page(f"how-to/{name}.md"), heading)))
    needed = [f.default is MISSING and f.default_factory is MISSING for f in fields(one)]
    assert [(c[0], c[1] == "needed") for c in cells] == [
        (f"`{f.name}`", must) for f, must in zip(fields(one), needed, strict=True)
    ]


def test_the_tests_on_the_page_of_a_bench_of_ones_own_pass():
    load_example_module()
    (text,) = (one for one in snippets("how-to/own-bench.md") if one.startswith("import"))
    scope: dict[str, Any] = {}
    exec(text, scope)
    tests = [one for name, one in scope.items() if name.startswith("test_")]
    assert len(tests) == 4
    for one in tests:
        one()


def test_the_page_of_a_bench_of_ones_own_shows_what_its_run_gives(tilted: Path):
    run = read(tilted)
    write_recordings({run.file(name): made for name, made in simulate_files(run).items()})
    calibration = calibrate(run).calibration
    text = page("how-to/own-bench.md")
    shown = re.findall(r"│ (a\w\.\w+) +│[^│]+│ +(\S+) │ +(\S+) │ \S+ +│ +(\S+) │", text)
    assert len(shown) == 4
    for name, *cells in shown:
        si, u = calibration.sensor.coefficient(name).si, calibration.uncertainty(name)
        value = calibration.value(name)
        error = (value - run.truth.get(name, 0.0)) / u
        assert cells == [*format_value_and_uncertainty(value / si, 2 * u / si), f"{error:+.2f}"]


def test_mistakes_in_the_run_file_of_ones_own_bench_are_answered_as_the_page_says(tilted: Path):
    right = tilted.read_text(encoding="utf-8")
    text = section(page("how-to/own-bench.md"), "4. State the sections of the run file")
    changes = [
        re.findall(r"`([^`]*)`", f"{change} {message}")
        for change, message in rows(text)
        if "→" in change
    ]
    assert len(changes) == 6
    for old, new, message in changes:
        assert right.count(old) == 1
        tilted.write_text(right.replace(old, new), encoding="utf-8")
        with pytest.raises(InputError) as refused:
            read(tilted)
        assert message in str(refused.value)


def test_the_estimator_on_the_page_of_a_method_of_ones_own_is_judged_as_it_says(tilted: Path):
    (text,) = (one for one in snippets("how-to/own-method.md") if one.startswith("from"))
    scope: dict[str, Any] = {}
    exec(text, scope)
    run_file = tilted.read_text(encoding="utf-8")
    other = 'name = "tilt_both"\nestimator = "exact"'
    tilted.write_text(run_file.replace('name = "tilt_means"', other), encoding="utf-8")
    with METHODS.with_("tilt_both", scope["BOTH"]):
        run = read(tilted)
        write_recordings({run.file(name): made for name, made in simulate_files(run).items()})
        verdict = calibrate(run).verdict
    assert verdict.grade == "unreliable"
    (printed,) = re.findall(r"```text\n(The best .*?)```", page("how-to/own-method.md"), flags=re.S)
    assert " ".join(printed.split()) in verdict.statements
