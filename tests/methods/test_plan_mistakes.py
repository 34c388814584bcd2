"""The usual mistakes with columns, signs, units and marks are named where they are made."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from tests.accuracy.ferraris import DEGREE, FerrarisSession, Handling, mems, record
from tests.accuracy.inercal_inputs import make_bench, make_observations

from inercal.basics.errors import InputError
from inercal.methods import METHODS
from inercal.physics.plan import HandStep
from inercal.physics.sensors import imu
from inercal.recordings import Finding
from inercal.recordings.segments import check_against_plan

HANDS = Handling(
    gravity_sd=2e-4,
    latitude=47 * DEGREE,
    tilt=0.5 * DEGREE,
    turn_tilt=1.0 * DEGREE,
    turn_angle=2.0 * DEGREE,
    timebase=1e-4,
)
SENSOR = METHODS["ferraris"].prepare(imu())
AX, AY, AZ, GX, GY, GZ = range(6)


def session(angle: float = 2 * np.pi) -> FerrarisSession:
    rng = np.random.default_rng(90)
    return record(mems(rng), HANDS, rng, angle=angle)


def findings(
    made: FerrarisSession, plan: tuple[HandStep, ...] | None = None
) -> tuple[Finding, ...]:
    steps = METHODS["ferraris"].plan() if plan is None else plan
    seen = make_observations(made, SENSOR, steps, 0)
    return check_against_plan(seen, SENSOR, steps, HANDS.gravity)


def columns(*order: int) -> Callable[[FerrarisSession], FerrarisSession]:
    return lambda made: replace(made, data=made.data[..., list(order)])


def times(*factors: float) -> Callable[[FerrarisSession], FerrarisSession]:
    return lambda made: replace(made, data=made.data * np.array(factors))


def marks(**labels: str) -> Callable[[FerrarisSession], FerrarisSession]:
    """Give a label the section that another one has."""

    def change(made: FerrarisSession) -> FerrarisSession:
        return replace(made, marks={**made.marks, **{a: made.marks[b] for a, b in labels.items()}})

    return change


def test_a_session_as_planned_has_no_findings():
    assert findings(session()) == ()
    assert findings(session(-2 * np.pi), METHODS["ferraris"].plan(angle=-2 * np.pi)) == ()


@pytest.mark.parametrize(
    ("mistake", "section", "hint"),
    [
        (columns(AY, AX, AZ, GX, GY, GZ), "x_p", "swapped"),
        (columns(AX, AZ, AY, GX, GY, GZ), "y_p", "swapped"),
        (times(1, 1, -1, 1, 1, 1), "z_p", "reversed"),
        (columns(AX, AY, AZ, GX, GZ, GY), "y_rot", "swapped"),
        (columns(GX, GY, GZ, AX, AY, AZ), "x_p", "swapped"),
        (times(1, 1, 1, *[1 / DEGREE] * 3), "x_rot", "°/s taken for rad/s"),
        (times(1, 1, 1, *[DEGREE] * 3), "x_rot", "rad/s taken for °/s"),
        (marks(y_a="y_p"), "y_a", "mark"),
        (marks(x_p="z_p", z_p="x_p"), "x_p", "mark"),
        (marks(y_rot="z_rot", z_rot="y_rot"), "y_rot", "mark"),
        (marks(z_rot="z_p"), "z_rot", "mark"),
    ],
)
def test_a_mistake_is_refused_by_its_section(
    mistake: Callable[[FerrarisSession], FerrarisSession], section: str, hint: str
):
    with pytest.raises(InputError) as refused:
        findings(mistake(session()))
    message = str(refused.value)
    assert f"section {section} " in message
    assert hint in message
    assert "\n" not in message


def test_turns_the_other_way_are_warned_of_one_by_one():
    found = findings(session(-2 * np.pi))
    assert [(f.severity, f.what) for f in found] == [("warning", "direction")] * 3
    assert ["x_rot" in found[0].message, "y_rot" in found[1].message] == [True, True]
    assert "-360 °" in found[2].message


def test_one_reversed_gyro_is_warned_of_and_its_scale_is_negative():
    made = times(1, 1, 1, 1, -1, 1)(session())
    found = findings(made)
    assert [f.what for f in found] == ["direction"]
    assert "y_rot" in found[0].message
    steps = METHODS["ferraris"].plan()
    estimate = METHODS["ferraris"].estimator("ml")(
        make_observations(made, SENSOR, steps, 0), SENSOR, make_bench(HANDS), steps
    )
    assert estimate.select(["gy.scale"]).value[0] == pytest.approx(-2, abs=0.1)


def test_a_warning_in_the_message_gives_the_angle_the_gyros_saw():
    found = findings(session(-2 * np.pi))
    seen = [
        float(text) for text in found[0].message.split("integrate to (")[1].split(")")[0].split(",")
    ]
    assert seen[0] == pytest.approx(-360, abs=20)
