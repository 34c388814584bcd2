"""The verdict follows from the numbers, and from nothing else."""

from dataclasses import fields
from math import inf, nan, sqrt
from pathlib import Path
from typing import get_args

import pytest

from inercal import studies
from inercal.studies.claim import (
    LIMIT,
    Basis,
    Claim,
    ClaimResult,
    Relation,
    Verdict,
    judge_claim,
    normalized_deviation,
    shown,
)
from inercal.studies.study import read_section_text


def verdict(printed: float, computed: float, u: float, relation: Relation = "=") -> Verdict:
    return judge_claim(Claim("it", "here", printed, relation=relation), computed, u, "why").verdict


def test_the_limit_is_two_standard_uncertainties():
    assert LIMIT == 2.0
    assert verdict(1.0, 3.0, 1.0) == "reproduced"
    assert verdict(1.0, 3.0 + 1e-12, 1.0) == "false"
    assert verdict(1.0, -1.0, 1.0) == "reproduced"
    assert verdict(1.0, -1.0 - 1e-12, 1.0) == "false"


@pytest.mark.parametrize(("relation", "side"), [("≤", 1), ("≥", -1)])
def test_a_bound_is_judged_on_its_wrong_side_alone(relation: Relation, side: int):
    assert verdict(1.0, 1.0 - 1e9 * side, 1.0, relation) == "reproduced"
    assert verdict(1.0, 1.0 + 2.0 * side, 1.0, relation) == "reproduced"
    assert verdict(1.0, 1.0 + 2.001 * side, 1.0, relation) == "false"


def test_an_exact_number_must_be_equal():
    assert verdict(180.0, 180.0, 0.0) == "reproduced"
    assert verdict(180.0, 179.0, 0.0) == "false"
    assert normalized_deviation(180.0, 179.0, 0.0, "=") == inf
    assert verdict(13.0, 13.0, 0.0, "≥") == "reproduced"
    assert verdict(13.0, 12.0, 0.0, "≥") == "false"


@pytest.mark.parametrize("nothing", [nan, inf, -inf])
@pytest.mark.parametrize("relation", ["=", "≤", "≥"])
def test_a_value_that_is_not_finite_is_not_reproduced(nothing: float, relation: Relation):
    assert verdict(1.0, nothing, 1.0, relation) == "false"


def test_a_failed_result_is_not_reproducible_and_a_failed_statement_false():
    result = Claim("it", "Table 9", 1.0, kind="result")
    assert judge_claim(result, 2.0, 0.1, "why").verdict == "not reproducible"
    assert judge_claim(result, 1.1, 0.1, "why").verdict == "reproduced"
    assert verdict(1.0, 2.0, 0.1) == "false"


def test_rounding_of_the_printed_digits_counts():
    claim = Claim("it", "here", 1.28999, last_digit=1e-5)
    assert claim.rounding == pytest.approx(0.5e-5 / sqrt(3))
    assert judge_claim(claim, 1.28999 + 0.5e-5, 0.0, "why").verdict == "reproduced"
    assert judge_claim(claim, 1.28999 + 0.6e-5, 0.0, "why").verdict == "false"
    both = judge_claim(claim, 1.29, 3 * claim.rounding, "why")
    assert both.uncertainty == pytest.approx(claim.rounding * sqrt(10))


def test_a_verdict_cannot_be_set():
    assert {f.name for f in fields(ClaimResult)} == {"claim", "computed", "uncertainty", "reason"}
    assert "verdict" not in {f.name for f in fields(Claim)}
    assert isinstance(ClaimResult.verdict, property)


def test_the_sentence_carries_both_numbers_and_the_distance():
    finding = judge_claim(
        Claim("it", "here", 1e-4, "g", "≤", last_digit=1e-4), 3.1e-4, 0.0, "reasons"
    )
    assert finding.explanation == "In print ≤ 10⁻⁴ g, computed 3.1·10⁻⁴ g, 7.3 u apart: reasons."
    assert judge_claim(Claim("it", "here", 1.0, "g"), nan, 0.1, "reasons").explanation.startswith(
        "In print 1 g;"
    )


def test_numbers_are_written_as_people_read_them():
    numbers = (0.0, 0.5, -20.0, 130.0, 22634.0, 5.8e-3, -1e-5, inf, nan)
    assert [shown(x) for x in numbers] == [
        "0", "0.5", "−20", "130", "2.3·10⁴", "5.8·10⁻³", "−10⁻⁵", "infinitely many", "none",
    ]  # fmt: skip
    assert shown(5.700684e-5, 7) == "5.700684·10⁻⁵"


@pytest.mark.parametrize("basis", ["words", "derived"])
def test_the_printed_column_holds_printed_numbers_alone(basis: Basis):
    printed, implied = (
        judge_claim(Claim("it", "here", 2.0, relation="≤", basis=one), 3.0, 0.1, "why")
        for one in ("number", basis)
    )
    assert (printed.claim.printed, printed.printed_text) == (2.0, "≤ 2")
    assert (implied.claim.printed, implied.printed_text) == (None, "—")
    assert implied.expected_text == printed.expected_text == "≤ 2"
    assert implied.verdict == printed.verdict == "false"
    assert "In print" not in implied.explanation


FILES = sorted(
    path for path in Path(studies.__file__).parent.glob("*/*.toml") if path.stem != "study"
)


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}.{path.stem}")
def test_each_stored_claim_is_what_its_type_says(path: Path):
    stored = read_section_text(f"inercal.studies.{path.parent.name}", path.stem)
    for claim in stored.claims.values():
        assert isinstance(claim.expected, float)
        assert isinstance(claim.last_digit, float)
        assert claim.relation in get_args(Relation)
        assert claim.kind in ("result", "statement")
        assert claim.basis in get_args(Basis)
        assert all((claim.name, claim.where, stored.title, *stored.text))
