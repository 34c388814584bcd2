"""The stored counts of faults in systematic calibrations; a sample is worked out again."""

import json

import pytest
from tests.base_seeds import chosen
from tests.evidence import systematic_violations as stored
from tests.evidence.stored_runs import page_text

FOUND = json.loads(stored.DATA.read_text(encoding="utf-8"))
CELLS = [(fault, grade) for fault in stored.FAULTS for grade in ("N", "T")]
VISIBLE = 6.0  # η
AGAIN = (
    "latitude 1° off",
    "creep of 10″ after each turn",
    "one sample lost in a turn",
    "lever arms left out",
    "y of the gyros reversed",
)


def test_every_fault_is_counted_with_all_its_devices():
    assert FOUND["seeds"] == list(stored.SEEDS)
    for fault, grade in CELLS:
        one = FOUND["faults"][fault][grade]
        wanted = stored.BASE_DEVICES if fault == "none" else stored.DEVICES
        assert sum(one[word] for word in stored.GRADES) == wanted


def test_faults_that_are_visible_are_said():
    cells = [FOUND["faults"][fault][grade] for fault, grade in CELLS]
    seen = [one for one in cells if one["eta"] is not None and one["eta"] >= VISIBLE]
    devices = stored.DEVICES * len(seen)
    assert len(seen) >= 10
    assert sum(one["consistent"] for one in seen) <= 0.05 * devices


def test_healthy_devices_are_called_consistent():
    healthy = [FOUND["faults"]["none"][grade] for grade in "NT"]
    # Two tests at 1 %, and rarer ones: of 60 devices six or more come in one of a thousand
    assert sum(stored.BASE_DEVICES - one["consistent"] for one in healthy) <= 5
    assert all(one["eta"] < 0.5 and one["refused"] == 0 for one in healthy)


def test_what_leaves_nothing_in_the_residuals_is_not_said():
    for grade in "NT":
        one = FOUND["faults"]["gravity 40 ppm off"][grade]
        assert one["eta"] < 1
        assert one["error"] > 5  # and it harms


@pytest.mark.parametrize(
    "fault",
    [
        "gyros clipped at 0.9 of the rate",
        "y of the gyros reversed",
        "x and z of the accelerometers exchanged",
    ],
)
def test_gross_mistakes_are_refused(fault: str):
    assert all(FOUND["faults"][fault][grade]["refused"] == stored.DEVICES for grade in "NT")


def test_the_page_is_that_of_the_counts():
    assert page_text(stored.PAGE) == stored.page(FOUND)


@pytest.mark.slow
@pytest.mark.parametrize("fault", chosen(AGAIN, AGAIN[:2]))
def test_a_sample_of_devices_is_graded_as_before(fault: str):
    counted = FOUND["faults"][fault]["N"]
    answers = [stored.answer((fault, "N", seed, 0)) for seed in (1, 2)]
    assert all(counted[one.grade] > 0 for one in answers)


@pytest.mark.slow
def test_the_visibility_of_a_fault_is_that_stored():
    fault = "creep of 2″ after each turn"
    assert stored.visibility((fault, "N")) == pytest.approx(
        FOUND["faults"][fault]["N"]["eta"], rel=0.01
    )
