"""The lines of a verdict on a page: what the data cannot show is a list with meanings."""

from inercal.calibration.verdict import UNDETECTED_END, UNDETECTED_START
from inercal.report.calibration_page import VerdictLine, verdict_lines


def test_causes_that_the_data_cannot_show_have_meaning_and_size():
    line = (
        f"{UNDETECTED_START} (in brackets the size that shifts a coefficient by 5 u{UNDETECTED_END}"
        "k2 (120 µg/g²), az.k0_prime (500 µg), scale2 (14000 ppm/(rad/s)), "
        "drift of gyros (130 °/h), wrong readings of one position or turn; "
        "the method can estimate k2, k3 ([method] also)"
    )
    plain, folded = verdict_lines(("expanded uncertainties, at most: 3 µg", line))
    assert plain == VerdictLine("expanded uncertainties, at most: 3 µg")
    assert folded.text == "the method can estimate k2, k3 ([method] also)"
    assert folded.causes == (
        ("k2", "second-order nonlinearity", "120 µg/g²"),
        ("az.k0_prime", "bias asymmetry", "500 µg"),
        ("scale2", "second-order nonlinearity", "14000 ppm/(rad/s)"),
        ("drift of gyros", "", "130 °/h"),
        ("wrong readings of one position or turn", "", ""),
    )
