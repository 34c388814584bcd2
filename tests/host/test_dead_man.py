"""The dead-man of a jog, by a clock that the test sets."""

from threading import Event

import pytest

from inercal.host.manual import dead_man
from inercal.host.manual.dead_man import DeadMan


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(dead_man, "monotonic", lambda: now[0])
    return now


def test_a_press_lives_while_it_is_held_and_dies_for_good(clock: list[float]):
    with DeadMan(lambda: None, timeout=0.25) as dead:
        dead.begin(7)
        for _ in range(20):
            clock[0] += 0.2
            dead.hold(7)
        assert dead.is_live(7)
        assert dead.count == 20
        clock[0] += 0.26
        assert not dead.is_live(7)
        dead.hold(7)  # it was held up on its way
        dead.begin(7)
        assert not dead.is_live(7)


def test_another_press_neither_keeps_the_first_nor_is_kept_by_it(clock: list[float]):
    with DeadMan(lambda: None, timeout=0.25) as dead:
        dead.begin(1)
        dead.begin(2)
        clock[0] += 0.2
        dead.hold(1)
        clock[0] += 0.1
        assert not dead.is_live(1)
        assert not dead.is_live(2)


def test_a_release_ends_a_press_at_once(clock: list[float]):
    with DeadMan(lambda: None, timeout=0.25) as dead:
        dead.begin(1)
        dead.release()
        dead.hold(1)
        assert not dead.is_live(1)


def test_a_motion_that_is_not_stopped_in_time_is_overdue():
    overdue = Event()
    with DeadMan(overdue.set, timeout=0.01) as dead:
        dead.begin(1)
        dead.set_moving(True)
        assert overdue.wait(10.0)


def test_a_motion_that_is_stopped_in_time_is_not_overdue(clock: list[float]):
    overdue = Event()
    with DeadMan(overdue.set, timeout=0.25) as dead:
        dead.begin(1)
        dead.set_moving(True)
        dead.set_moving(False)
        clock[0] += 1.0
        dead.release()  # wakes the thread
        assert not overdue.wait(0.1)
