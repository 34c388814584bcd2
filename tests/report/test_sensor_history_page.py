"""The page of a history: whole, safe, self-contained; its figures show what the numbers say."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.report.page_tags import parsed
from tests.store.calibration_generator import DRIFTING, content, hashed, ten, write

from inercal.laboratory.store import Register, SensorHistory
from inercal.report import write_history
from inercal.report.sensor_history_page import sensor_history_page, summary_lines

# Of what the number of figures does not matter to.
SMALL = replace(DRIFTING, axes=("ax", "gx"))


@pytest.fixture(scope="module")
def register(tmp_path_factory: pytest.TempPathFactory) -> Register:
    return Register(str(tmp_path_factory.mktemp("register") / "register.db"), by="Ada")


@pytest.fixture(scope="module")
def history(register: Register, tmp_path_factory: pytest.TempPathFactory) -> SensorHistory:
    register.enter_calibrations(ten(tmp_path_factory.mktemp("ten")))
    return register.history(DRIFTING.sensor)


@pytest.fixture(scope="module")
def text(history: SensorHistory) -> str:
    return sensor_history_page(history)


@pytest.mark.slow
def test_the_page_is_whole_and_names_each_thing_once(text: str):
    tags = parsed(text)
    assert len(tags.ids) == len(set(tags.ids))
    for target in re.findall(r'(?:href="#|url\(#)([^")]*)', text):
        assert target in tags.ids


def test_the_page_needs_nothing_but_itself(text: str):
    assert len(text.encode()) < 1_000_000
    assert "default-src 'none'" in text
    assert not re.search(r"<(script|link|img|iframe|object)\b", text)
    assert not re.search(r'(?:src|href)="(?!#)', text)
    assert "#010a" not in text  # stand-in colours


def test_each_axis_has_a_figure_with_a_panel_a_coefficient(text: str, history: SensorHistory):
    figures = re.findall(r'<svg.*?aria-label="([^"]*)".*?</svg>', text, flags=re.S)
    assert len(figures) == 6
    for course in history.trends:
        (label,) = [one for one in figures if f"{course.name} " in one]
        assert f"{course.name} {course.verdict}" in label
        assert f"{course.name}, {course.unit}: {course.verdict}" in text


def test_points_beyond_u_have_a_shape_of_their_own(history: SensorHistory):
    for name in ("ax.k0", "ay.k0"):
        one = replace(history, trends=(history.trend(name),))
        svg = sensor_history_page(one)
        svg = svg[svg.index("<svg") : svg.index("</svg>")]
        # Markers are drawn once for each shape, and used once for each point.
        shapes = re.findall(r"<g clip-path[^>]*>\s*((?:<use [^>]*/>\s*)+)</g>", svg)
        counts = sorted(len(re.findall("<use", shape)) for shape in shapes)
        beyond = int(np.sum(np.abs(history.trend(name).normalised_errors) > 1))
        assert beyond in counts or not beyond
        assert 10 - beyond in counts
    assert int(np.sum(np.abs(history.trend("ax.k0").normalised_errors) > 1)) > 0


def test_the_tables_hold_each_value_with_its_u_and_a_star_beyond(text: str, history: SensorHistory):
    course = history.trend("ax.k0")
    plain = " ".join("".join(parsed(text).text).split())
    assert f"{course.values[0] / course.si:.0f} ± 40" in plain
    cells = re.findall(r"<td>([^<]*±[^<]*)</td>", text)
    assert len(cells) == 240
    assert sum(cell.endswith(" *") for cell in cells) == history.exceedances


def test_the_summary_counts_what_the_verdicts_say(text: str, history: SensorHistory):
    counts = {verdict: len(names) for verdict, names in history.verdicts.items()}
    assert f"{counts['drifts']} drifting" in summary_lines(history)[0]
    assert f"Drifting: {', '.join(history.verdicts['drifts'])}." in summary_lines(history)[1]
    assert all(line in text for line in summary_lines(history))
    assert f"in {history.exceedances} of {history.comparison_count}" in text


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2])
def test_a_short_history_is_drawn_too(register: Register, tmp_path: Path, count: int):
    truth = replace(SMALL, sensor=f"short {count}")
    register.enter_calibrations(ten(tmp_path, truth)[:count])
    found = sensor_history_page(register.history(truth.sensor))
    parsed(found)
    assert ("only one calibration" in found) == (count == 1)


@pytest.mark.slow
def test_names_of_all_kinds_are_text_and_nothing_else(register: Register, tmp_path: Path):
    rng = np.random.default_rng(1)
    name = '<script>alert("1")</script> & $x^2$ 加'
    for k in range(3):
        made = content(SMALL, float(k), rng, method="<b>", estimator="&amp;")
        made["sensor"]["name"] = name
        made["sensor"]["axes"][0]["name"] = '"><i>x</i> $a_b$'
        for row in made["coefficients"]:
            row["name"] = row["name"].replace("ax.", '"><i>x</i> $a_b$.')
        register.enter_calibration(write(tmp_path / f"{k}.json", hashed(made)))
    found = sensor_history_page(register.history(name))
    tags = parsed(found)
    assert "<script" not in found
    assert "<i>" not in found
    assert name in "".join(tags.text)
    assert len(tags.ids) == len(set(tags.ids))


@pytest.mark.slow
def test_calibrations_of_one_moment_are_drawn(register: Register, tmp_path: Path):
    rng = np.random.default_rng(1)
    truth = replace(SMALL, sensor="at once")
    for k in range(3):
        made = content(truth, 0.0, rng)
        made["provenance"]["recording sha256"] = str(k)
        register.enter_calibration(write(tmp_path / f"{k}.json", hashed(made)))
    history = register.history("at once")
    assert all(course.line is None for course in history.trends)
    parsed(sensor_history_page(history))


def test_the_page_is_written_whole(history: SensorHistory, tmp_path: Path):
    one = replace(history, trends=(history.trend("ax.k0"),))
    path = write_history(one, tmp_path / "history.html")
    assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
