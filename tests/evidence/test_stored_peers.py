"""The stored comparison with other programs is found again, and its differences are explained."""

import importlib.util
from pathlib import Path

import pytest

if importlib.util.find_spec("imucal") is None:
    pytest.skip("imucal is not installed", allow_module_level=True)
from tests.evidence import peers
from tests.evidence.stored_runs import page_text

ROWS = peers.stored()


def test_the_page_is_that_of_the_comparison():
    assert page_text(peers.PAGE) == peers.page(ROWS)


def test_only_the_gyros_of_recordings_by_hand_differ_by_more_than_u():
    apart = {
        (row.recording, row.quantity[:2])
        for row in ROWS
        if abs(row.ours - row.theirs) > 1.1 * row.expanded
    }
    assert apart <= {(name, f"g{a}") for name in peers.HAND_HELD.values() for a in "xyz"}


def test_the_algorithm_of_imu_tk_written_anew_finds_what_imu_tk_found():
    found = [row for row in ROWS if row.recording == peers.HAND_HELD["xsens"]]
    assert len(found) == 9
    for row in found:
        assert row.published is not None
        assert abs(row.theirs - row.published) < 0.3 * row.expanded


@pytest.mark.parametrize("session", ["A", "B"])
def test_imucal_and_inercal_find_the_same_again(session: str, tmp_path: Path, data_dir: Path):
    if not (data_dir / "ferraris_imucal").is_dir():
        pytest.skip("no recordings of imucal")
    for row in peers.ferraris_rows(session, tmp_path, data_dir):
        (before,) = [r for r in ROWS if r[:2] == row[:2]]
        assert row.theirs == pytest.approx(before.theirs, abs=1e-6 * row.expanded)
        assert row.ours == pytest.approx(before.ours, abs=1e-6 * row.expanded)
