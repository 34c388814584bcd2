"""Names and notes that control a terminal or a spreadsheet do nothing in exported files."""

from dataclasses import replace

import pytest
from tests.export.calibrations import COUNTS, OPTIONS, make_calibration, make_magnetometer

from inercal.basics.errors import InputError
from inercal.basics.visible_text import spreadsheet_cell
from inercal.export import TARGETS, export_calibration

HOSTILE = "\x1b]0;owned\x07\u202e=cmd()"


@pytest.mark.parametrize("to", list(TARGETS))
def test_no_control_character_of_a_name_is_exported(to: str):
    magnetic = set(TARGETS.find(to).holds) == {"m"}
    calibration = make_magnetometer() if magnetic else make_calibration(readouts=COUNTS)
    calibration = replace(calibration, sensor=replace(calibration.sensor, name=HOSTILE))
    try:
        made = export_calibration(
            calibration, to, options=OPTIONS.get(to), source=f"{HOSTILE}.json"
        )
    except InputError:
        pytest.skip(f"{to} needs options of its own")
    text = "".join([made.text, *made.beside, *made.beside.values()])
    assert not {"\x1b", "\x07", "\u202e"} & set(text)


@pytest.mark.parametrize("text", ["=1+1", "+A1", "-A1", "@SUM(A1)", "=cmd|' /C calc'!A0"])
def test_no_cell_begins_like_a_formula(text: str):
    assert spreadsheet_cell(text)[0] == "'"
    assert spreadsheet_cell(text)[1:] == text


@pytest.mark.parametrize("text", ["-0.25", "+1e-3", "-inf", "ax.k0", "", "position -x"])
def test_numbers_and_names_stay(text: str):
    assert spreadsheet_cell(text) == text
