"""A table operated by hand: the dead-man of a jog, the interlocks, and the journal.

All times are of the bench within the test's process, every servo cycle of which is seen.
"""

from collections.abc import Sequence
from math import degrees, radians
from pathlib import Path

import pytest
from tests.base_seeds import evidence
from tests.host.by_hand import Act, ByHand, Moment, pmac_of
from tests.host.simulated_runs import plan

from inercal.host.manual.commands import LIMIT_MARGIN
from inercal.runfile import Run

INNER = 2  # its place
RATE = 20.0  # °/s of a jog
ACCELERATION = 15.0  # °/s², of the demonstration's bench
STOP = 0.3  # s from the last message of a held key to the stop
SERVO_LAG = 0.1  # s by which an axis follows its profile


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return plan(tmp_path_factory.mktemp("plan"))


@pytest.fixture
def my(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ByHand:
    return ByHand(run, tmp_path, monkeypatch)


def holds(my: ByHand, begin: float, end: float, press: int = 1) -> list[tuple[float, Act]]:
    """Return the messages of a key that is held, ten a second."""
    count = int((end - begin) / 0.1)
    return [(begin + 0.1 * k, my.ask("hold", press=press)) for k in range(1, count + 1)]


def on(my: ByHand, *axes: str) -> list[tuple[float, Act]]:
    return [(0.1, my.ask("servo", axis=axis, on=True)) for axis in axes]


def jog(axis: str, my: ByHand, at: float = 1.0, rate: float = RATE, press: int = 1):
    return at, my.ask("jog", axis=axis, rate=rate, press=press)


def brakes_at(trace: Sequence[Moment], axis: int, since: float) -> float:
    """Return when an axis begins to slow down for good, s."""
    fast = [one.time for one in trace if one.time >= since and abs(one.rates[axis]) > 0.9 * RATE]
    return max(fast)


def rests_from(my: ByHand, axis: int) -> float:
    """Return the last time at which an axis turned."""
    return max(one.time for one in my.trace if abs(one.rates[axis]) > 0.5)


@pytest.mark.slow
@pytest.mark.parametrize("last", [2.53, *map(evidence, (2.5, 2.57, 2.61))])
def test_a_jog_whose_messages_cease_brakes_within_0_3_s(my: ByHand, last: float):
    held = [*holds(my, 1.0, 2.4), (last, my.ask("hold", press=1))]
    my.operate(*on(my, "inner"), jog("inner", my), *held, until=6)
    # Down to 0.9 of the rate, which is where braking is seen, takes a tenth of the deceleration.
    assert last < brakes_at(my.trace, INNER, 1.0) < last + STOP + 0.1 * RATE / ACCELERATION
    assert rests_from(my, INNER) < last + STOP + RATE / ACCELERATION + SERVO_LAG
    assert any("no message about the held key" in words for words in my.said("warning"))


def test_a_key_that_is_let_go_stops_at_once_and_late_messages_revive_nothing(my: ByHand):
    late = [(2.0 + 0.05 * k, my.ask("hold", press=1)) for k in range(1, 20)]
    again = (3.0, my.ask("jog", axis="inner", rate=RATE, press=1))
    script = [*holds(my, 1.0, 1.9), (2.0, my.ask("release")), *late, again]
    my.operate(*on(my, "inner"), jog("inner", my), *script, until=6)
    assert rests_from(my, INNER) < 2.0 + 0.05 + RATE / ACCELERATION + SERVO_LAG
    assert any("not started" in words for words in my.said("info"))


@pytest.mark.slow
def test_an_angle_or_a_rate_beyond_the_limits_is_refused_before_anything_moves(my: ByHand):
    my.limit(2, -30, 30)
    script = [
        (1.0, my.ask("home", axis="middle")),
        (10.0, my.ask("go", axis="middle", angle=31, rate=10)),
        (10.2, my.ask("go", axis="middle", angle=10, rate=1000)),
        (10.4, my.ask("jog", axis="middle", rate=1000, press=1)),
        (10.6, my.ask("go", axis="outer", angle=10, rate=10)),
        (10.8, my.ask("go", axis="azimuth", angle=10, rate=10)),
    ]
    my.operate(*on(my, "middle"), *script, until=12)
    assert all(abs(rate) < 0.5 for one in my.trace if one.time > 9.9 for rate in one.rates)
    refused = my.said("warning")
    assert len(refused) == 5
    for words, reason in zip(
        refused, ("soft limits", "rate", "rate", "servo is off", "no axis"), strict=True
    ):
        assert reason in words


@pytest.mark.slow
@pytest.mark.parametrize("sign", [-1, evidence(1)])
def test_a_jog_into_a_limit_stops_before_it_though_the_key_is_held(my: ByHand, sign: int):
    my.limit(3, -10, 10)
    begun = jog("inner", my, rate=sign * RATE)
    again = jog("inner", my, 9.0, sign * RATE, 2)
    my.operate(*on(my, "inner"), begun, *holds(my, 1.0, 8.0), again, until=10)
    furthest = max(sign * one.angles[INNER] for one in my.trace)
    assert 10 - 2 * degrees(LIMIT_MARGIN) < furthest < 10
    assert not any("limit" in words for words in my.said("alarm"))
    assert any("its limit is at" in words for words in my.said("warning"))


@pytest.mark.slow
def test_a_fault_of_one_axis_stops_all_and_is_in_the_journal(my: ByHand):
    fault = (2.0, lambda host: host.bench.fault("amplifier 2"))
    then = (4.0, my.ask("jog", axis="middle", rate=5, press=2))
    script = [*on(my, "inner", "middle"), jog("inner", my), *holds(my, 1.0, 5.0)]
    ended = my.operate(*sorted([*script, fault, then], key=lambda one: one[0]), until=6)
    assert rests_from(my, INNER) < 2.0 + 0.1 + RATE / ACCELERATION + SERVO_LAG
    (alarm,) = my.said("alarm")
    assert "middle" in alarm
    assert "amplifier" in alarm
    assert any("amplifier" in words for words in my.said("warning"))  # the jog is refused
    assert ended == "the script is over"  # it is mended by hand


def test_a_following_error_ends_the_session_with_the_table_at_rest(my: ByHand):
    jam = (1.5, lambda host: host.bench.fault("jammed 3"))
    other = (1.0, my.ask("home", axis="middle"))
    script = [*on(my, "inner", "middle"), jog("inner", my), other, *holds(my, 1.0, 4.0), jam]
    ended = my.operate(*sorted(script, key=lambda one: one[0]), until=9)
    assert "following error" in ended
    assert ended in my.said("alarm")
    assert all(abs(rate) < 0.5 for rate in my.trace[-1].rates)


@pytest.mark.slow
def test_a_frozen_encoder_is_found_by_the_gyros(
    run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    my = ByHand(run, tmp_path, monkeypatch, imu=True)
    home = [(0.5, my.ask("home", axis=axis)) for axis in ("outer", "middle", "inner")]
    freeze = (62.0, lambda host: host.bench.fault("frozen 3"))
    script = [*on(my, "outer", "middle", "inner"), *home, jog("inner", my, 60.0)]
    script += sorted([*holds(my, 60.0, 70.0), freeze], key=lambda one: one[0])
    ended = my.operate(*script, until=71)
    assert "inner" in ended
    assert ended in my.said("alarm")


def test_a_servo_is_switched_off_by_axis_and_a_halt_leaves_it_off(my: ByHand):
    script = [
        *on(my, "inner", "middle"),
        (1.0, my.ask("servo", axis="middle", on=False)),
        (2.0, my.ask("jog", axis="inner", rate=RATE, press=1)),
        (2.1, my.ask("servo", axis="inner", on=False)),
        (2.2, my.ask("halt")),
    ]
    my.operate(*script, until=5)
    state = my.session.state
    assert state is not None
    assert [axis.enabled for axis in state.axes] == [False, False, True]
    assert any("moving" in words for words in my.said("warning"))


def test_a_hand_may_turn_an_axis_whose_servo_is_off(my: ByHand):
    def push(host: ByHand) -> None:
        pmac_of(host.bench.device).table.state[INNER].rate = radians(90.0)  # three times the limit

    pushes = [(1.0 + 0.03 * k, push) for k in range(20)]
    ended = my.operate(*on(my, "middle"), *pushes, until=3)
    assert ended == "the script is over"
    assert not my.said("alarm")
    state = my.session.state
    assert state is not None
    assert [axis.enabled for axis in state.axes] == [False, True, False]


@pytest.mark.slow
def test_the_journal_has_every_command_by_whom_and_when_and_the_end(my: ByHand):
    script = [
        (0.1, my.ask("servo", axis="middle", on=True)),
        (0.5, my.ask("home", axis="middle")),
        (10.0, my.ask("go", axis="middle", angle=3, rate=10)),
        (12.0, my.ask("jog", axis="middle", rate=-2, press=1)),
        (12.2, my.ask("release")),
        (13.0, my.ask("halt")),
        (14.0, my.ask("servo", axis="middle", on=False)),
    ]
    my.operate(*script, until=15)
    said = [(event.time, event.words) for event in my.events if event.words.startswith("Ada: ")]
    asked = ["servo on", "home", "go to 3°", "jog at -2 °/s", "halt", "servo off"]
    times = [0.1, 0.5, 10.0, 12.0, 13.0, 14.0]
    assert len(said) == len(asked)
    for (time, words), what, when in zip(said, asked, times, strict=True):
        assert what in words
        assert time == pytest.approx(when, abs=0.05)
    assert any("released by Ada" in event.words for event in my.events)
    assert "the script is over" in my.events[-1].words
