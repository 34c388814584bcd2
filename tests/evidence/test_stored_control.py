"""The stored run lengths of control charts, and a sample of them worked out anew."""

import re
from math import sqrt

import numpy as np
import pytest
from tests.base_seeds import chosen
from tests.evidence.control import (
    CHARTS,
    LENGTH,
    PAGE,
    SHIFTS,
    day_rows,
    laboratory_points,
    lengths_of,
    single_row,
)

TABLE = PAGE.read_text(encoding="utf-8")
NOTED = {  # run lengths after 0, 0.5, 1, 2 standard deviations, of published tables
    "Shewhart": (370, 155, 44, 6.3),
    "EWMA, λ = 0.2": (371, 36, 9.8, 3.6),
    "CUSUM, k = 0.5": (370, 35, 9.9, 3.9),
}


def stored(begin: str) -> list[str]:
    """Return the cells of the stored line that begins so."""
    (line,) = [one for one in TABLE.splitlines() if one.startswith(f"| {begin} |")]
    return [cell.strip() for cell in line.strip("|").split("|")]


def lengths(name: str) -> list[float]:
    return [float(cell.partition(" ±")[0]) for cell in stored(name)[2:]]


@pytest.mark.parametrize("name", NOTED)
def test_stored_run_lengths_are_those_of_tables(name: str):
    for found, expected in zip(lengths(name), NOTED[name], strict=True):
        assert found == pytest.approx(expected, rel=0.045)


@pytest.mark.parametrize("name", CHARTS)
def test_stored_charts_have_the_run_length_of_their_limits(name: str):
    assert lengths(name)[0] == pytest.approx(LENGTH, rel=4 / sqrt(9000))


def test_stored_references_and_days_are_worked_out_anew():
    assert f"{single_row(20, 100_000)}" in TABLE
    each, means = (float(row.split("|")[2].partition("±")[0]) for row in day_rows(600))
    assert each == pytest.approx(float(stored("each session")[1].split()[0]), rel=0.2)
    assert means == pytest.approx(float(stored("means of days")[1].split()[0]), rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("name", chosen(CHARTS, list(CHARTS)[::2]))
def test_a_sample_of_run_lengths_agrees_with_what_is_stored(seed: int, name: str):
    runs = 400
    for shift, expected in zip(SHIFTS, lengths(name), strict=True):
        found = lengths_of(name, shift, 100 + seed, runs)
        assert abs(found.mean() - expected) < 4.5 * found.std() / sqrt(runs)


@pytest.mark.slow
def test_a_sample_of_laboratories_agrees_with_what_is_stored():
    rows = re.findall(r"^\| 20 \| (\d) \| ([\d.]+) \| ([\d.]+) \|", TABLE, flags=re.M)
    for step, some, _ in (rows[0], rows[2]):
        found = np.array(laboratory_points(20, float(step), (9, 60))).any(axis=1).mean()
        share = float(some) / 100
        assert abs(found - share) < 4 * sqrt(max(share * (1 - share), 0.02) / 60)
