"""Base cells: their p-values, and how they are stored beside cells that stay."""

import math
from pathlib import Path

import pytest
from tests.evidence import stored_counts, unobservable_causes, violation_table
from tests.evidence.graded_calibration import TOTAL
from tests.evidence.violation_cells import BASE, Cell, Count, base_cells, count_answers


@pytest.mark.slow
def test_p_values_of_a_base_cell_are_those_of_its_devices():
    cell = next(base_cells("tumble", 3))
    parts = [count_answers((cell, range(k, k + 1))) for k in range(3)]
    whole = count_answers((cell, range(3)))
    assert list(whole.p_values[TOTAL]) == sorted(p for one in parts for p in one.p_values[TOTAL])
    assert len(set(whole.p_values[TOTAL])) == 3


def test_uniform_p_values_are_told_from_those_of_too_small_residuals():
    middles = tuple((k + 0.5) / 900 for k in range(900))
    pressed = tuple(p**0.8 for p in middles)
    found = violation_table.uniformity(Count(p_values={TOTAL: middles, "norms": pressed}))
    assert found[TOTAL] > 0.99
    assert found["norms"] < 0.01


@pytest.mark.slow
def test_base_cells_replace_their_like_and_leave_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    before = stored_counts.read_counts()
    data = tmp_path / "violations.json"
    data.write_bytes(stored_counts.DATA.read_bytes())
    monkeypatch.setattr(stored_counts, "DATA", data)
    monkeypatch.setattr(stored_counts, "PAGE", tmp_path / "violations.md")
    monkeypatch.setattr(unobservable_causes, "PAGE", tmp_path / "hidden.md")
    new = Count(consistent=2, nees=1.0, p_values={TOTAL: (0.1234, 0.5)})
    cells = list(base_cells("tumble", 2))
    stored_counts.write_counts(dict.fromkeys(cells, new))

    def others(counts: list[tuple[Cell, Count]]) -> list[str]:
        # As text: NaN is not equal to itself.
        return [repr(one) for one in counts if (one[0].case, one[0].at) != ("tumble", BASE)]

    after = stored_counts.read_counts()
    assert others(after) == others(before)
    assert [one for one in after if (one[0].case, one[0].at) == ("tumble", BASE)] == [
        (cell, new) for cell in cells
    ]
    rows = (tmp_path / "violations.md").read_text(encoding="utf-8")
    assert "| tumble, base cases only |" in rows
    assert not any(
        math.isnan(one.nees) for one in violation_table.base_counts(dict(after)).values()
    )
