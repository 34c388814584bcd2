"""A calibration compared with the same numbers as another program states them."""

from functools import cache
from pathlib import Path
from typing import Literal

import pytest
from tests.export.calibrations import LINEAR, OPTIONS, make_calibration

import inercal
from inercal.basics.errors import InputError
from inercal.calibration import Calibration
from inercal.calibration.comparison import compare, match_frame_and_form
from inercal.export import export_calibration
from inercal.physics.sensors import Form

Frame = Literal["mount", "triangular", "symmetric"]
TERMS: tuple[tuple[Frame, Form], ...] = (
    ("mount", "reference"),
    ("triangular", "tilted"),
    ("symmetric", "tilted"),
)
# How many coefficients a format and a calibration in an unrestricted frame both state.
STATED = {"imucal": 33, "kalibr": 27, "px4": 9, "ardupilot": 9, "imu_tk": 12}


@cache
def in_terms(frame: Frame, form: Form) -> Calibration:
    own = make_calibration(*LINEAR, size=1e-2)
    return (own if frame == "mount" else own.in_frame(frame)).in_form(form)


def read_back(folder: Path, own: Calibration, to: str) -> Calibration:
    if to == "kalibr":
        pytest.importorskip("yaml")
    made = export_calibration(own, to, options=OPTIONS.get(to))
    path = folder / f"sensor{made.target.suffix}"
    path.write_text(made.text, encoding="utf-8")
    return inercal.import_calibration(path, to, like=own)


@pytest.mark.slow
@pytest.mark.parametrize("to", STATED)
def test_equal_numbers_give_a_chi_square_of_zero(to: str, tmp_path: Path):
    """In each frame and form, and in either order; targets of single precision leave 1e-5."""
    for frame, form in TERMS:
        own = in_terms(frame, form)
        imported = read_back(tmp_path, own, to)
        for pair in ((own, imported), (imported, own)):
            compared = compare(*pair)
            assert compared.joint_test is not None
            assert compared.joint_test.chi2 < 1e-4
            # Three misalignments are 0 by the definition of a triangular frame.
            assert STATED[to] - 3 <= len(compared.names) <= STATED[to]


@pytest.mark.parametrize("to", ["kalibr", "px4"])
def test_a_changed_coefficient_is_found_among_those_that_both_state(to: str, tmp_path: Path):
    own = in_terms("triangular", "reference")
    imported = read_back(tmp_path, own, to)
    k = imported.sensor.coefficients.index("ay.k1")
    imported.values[k] += 10 * own.uncertainty("ay.k1")
    compared = compare(own, imported)
    beyond = [
        name
        for name, en in zip(compared.names, compared.normalised_errors, strict=True)
        if abs(en) > 1
    ]
    assert beyond == ["ay.k1"]
    assert any("k0" in one or "delta_o" in one for one in compared.exclusions)


def test_terms_that_a_file_lacks_are_not_taken_into_another_form(tmp_path: Path):
    """The scale factor of the tilted form contains misalignments, which PX4 does not state."""
    own = in_terms("mount", "tilted")
    with pytest.raises(InputError):
        match_frame_and_form(read_back(tmp_path, own, "px4"), own)
