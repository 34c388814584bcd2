"""What may be asked of a table by hand: a few commands, and nothing else in them."""

from math import inf, nan, radians
from typing import Any

import pytest
from tests.refusals import refused

from inercal.host.manual.commands import GoCommand, JogCommand, command_fields, parse_command

ALL: list[dict[str, Any]] = [
    {"what": "servo", "axis": "inner", "on": False},
    {"what": "home", "axis": "inner"},
    {"what": "go", "axis": "inner", "angle": -30.0, "rate": 10.0},
    {"what": "jog", "axis": "inner", "rate": -5.0, "press": 7},
    {"what": "hold", "press": 7},
    {"what": "release"},
    {"what": "halt"},
]


def test_angles_and_rates_are_in_si():
    assert parse_command(ALL[2]) == GoCommand("inner", radians(-30), radians(10))
    assert parse_command(ALL[3]) == JogCommand("inner", radians(-5), 7)


@pytest.mark.parametrize("asked", ALL, ids=lambda asked: asked["what"])
def test_a_command_is_told_as_it_was_asked_for_and_takes_its_fields_alone(asked: dict[str, Any]):
    assert command_fields(parse_command(asked)) == pytest.approx(asked)
    with refused(key=asked["what"], names=("more",)):
        parse_command(asked | {"more": 1})
    for name in asked.keys() - {"what"}:
        with refused(key=asked["what"], names=(name,)):
            parse_command({key: value for key, value in asked.items() if key != name})


@pytest.mark.parametrize("value", [nan, inf, "5", None, True, 1e7, [5]])
def test_what_is_no_number_within_reason_is_refused(value: object):
    with refused(key="rate"):
        parse_command({"what": "jog", "axis": "inner", "rate": value, "press": 1})


@pytest.mark.parametrize("asked", [{}, {"what": "kill"}, {"what": ["go"]}, {"what": None}])
def test_another_command_is_refused(asked: dict[str, Any]):
    with refused(key="what"):
        parse_command(asked)


@pytest.mark.parametrize("press", [-1, 1.0, True, "1", 1 << 60])
def test_a_press_is_a_whole_number(press: object):
    with refused(key="press"):
        parse_command({"what": "hold", "press": press})


@pytest.mark.parametrize("axis", ["", "x" * 41, "a\nb", 1])
def test_an_axis_is_a_short_line(axis: object):
    with refused(key="axis"):
        parse_command({"what": "home", "axis": axis})
