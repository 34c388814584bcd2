"""The simulated chamber: its equations, its door and its faults."""

from math import inf, isnan

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from tests.base_seeds import evidence
from tests.refusals import refused

from inercal.host.equipment import open_chamber
from inercal.host.link import LinkLost
from inercal.host.sim.chamber import SimulatedChamber, open_simulated
from inercal.host.sim.server import ManualClock

START = 298.15


def chamber(clock: ManualClock, **options: float) -> SimulatedChamber:
    return SimulatedChamber(clock, **options)


def solved(
    goal: float, lag: float, case_lag: float, ramp: float, until: float
) -> NDArray[np.float64]:
    """Return air and case temperature from the differential equations, with small steps."""

    def slope(_: float, state: NDArray[np.float64]) -> list[float]:
        air, case = state
        return [float(np.clip((goal - air) / lag, -ramp, ramp)), (air - case) / case_lag]

    found = solve_ivp(slope, (0, until), [START, START], rtol=1e-9, atol=1e-9, max_step=until / 500)
    return found.y[:, -1]


@pytest.mark.parametrize("goal", [353.15, 233.15, evidence(300.0)])
@pytest.mark.parametrize("case_lag", [600.0, 120.0, 30.0])
@pytest.mark.parametrize("until", [200.0, 900.0, 4000.0])
def test_air_and_case_follow_the_differential_equations(goal: float, case_lag: float, until: float):
    clock = ManualClock()
    one = chamber(clock, case_lag=case_lag)
    one.set_temperature(goal)
    clock.now = until
    expected = solved(goal, 120.0, case_lag, 0.05, until)
    assert [one.read().temperature, one.case_temperature] == pytest.approx(expected, abs=2e-5)


def test_the_result_does_not_depend_on_how_often_the_chamber_is_read():
    clock = ManualClock()
    often, seldom = chamber(clock), chamber(clock)
    for one in (often, seldom):
        one.set_temperature(340.0)
    for time in np.arange(0.0, 3000.0, 7.3):
        clock.now = float(time)
        often.read()
    assert often.read().temperature == pytest.approx(seldom.read().temperature, abs=1e-9)
    assert often.case_temperature == pytest.approx(seldom.case_temperature, abs=1e-9)


def test_a_chamber_at_room_temperature_stays_there_exactly():
    clock = ManualClock()
    one = chamber(clock)
    clock.now = 1e5
    assert (one.read().temperature, one.case_temperature) == (START, START)


def test_the_air_never_changes_faster_than_the_ramp_and_the_case_lags_behind():
    clock = ManualClock()
    one = chamber(clock, ramp=0.1)
    one.set_temperature(373.15)
    air: list[float] = []
    for k in range(400):
        clock.now = 10.0 * k
        air.append(one.read().temperature)
        assert one.case_temperature <= air[-1]
    change = np.diff(air) / 10
    assert change.max() == pytest.approx(0.1)
    assert change.min() >= 0
    assert air[-1] == pytest.approx(373.15, abs=1e-6)


def test_after_a_stop_and_with_an_open_door_the_air_goes_to_the_room():
    clock = ManualClock()
    one = chamber(clock)
    one.set_temperature(373.15)
    clock.now = 5000.0
    one.stop()
    clock.now = 5600.0  # five lags, which are one lag of a closed chamber that is off
    assert one.read().temperature - START == pytest.approx(75 * np.exp(-1), rel=1e-6)
    one.set_temperature(373.15)
    clock.now = 10_000.0
    one.fault("door")
    assert one.read().door_open is True
    clock.now = 10_120.0
    assert one.read().temperature - START == pytest.approx(75 * np.exp(-1), rel=1e-3)
    one.fault("door off")
    clock.now = 20_000.0
    state = one.read()
    assert state.door_open is False
    assert state.temperature == pytest.approx(373.15, abs=1e-6)


def test_over_temperature_heats_to_the_limiter_and_stays_tripped_until_reset():
    clock = ManualClock()
    one = chamber(clock, high=330.0)
    one.set_temperature(320.0)
    one.fault("overtemperature")
    warmest = 0.0
    for k in range(400):
        clock.now = 10.0 * k
        state = one.read()
        warmest = max(warmest, state.temperature)
        assert (state.alarms == ()) == (k < 84), (k, state)  # 41.85 K at 0.05 K/s take 837 s
    assert 339.0 < warmest < 340.0
    one.fault("overtemperature off")
    assert one.read().alarms == ()
    clock.now = 20_000.0
    assert one.read().temperature == pytest.approx(320.0, abs=1e-6)


def test_a_failed_sensor_is_an_alarm_and_no_temperature():
    one = chamber(ManualClock())
    one.fault("sensor")
    state = one.read()
    assert isnan(state.temperature)
    assert state.alarms == ("sensor failure",)
    one.fault("sensor off")
    assert one.read().temperature == START


def test_a_silent_chamber_is_a_lost_link_for_every_request():
    one = chamber(ManualClock())
    one.fault("silent on")
    for act in (one.read, one.stop, lambda: one.set_temperature(300.0)):
        with refused(LinkLost):
            act()
    one.fault("silent off")
    assert one.read().temperature == START


@pytest.mark.parametrize("temperature", [0.0, 203.0, 423.2, inf, float("nan")])
def test_an_impossible_set_point_is_refused_and_changes_nothing(temperature: float):
    one = chamber(ManualClock())
    one.set_temperature(310.0)
    with refused(key="temperature"):
        one.set_temperature(temperature)
    assert one.set_point == 310.0


@pytest.mark.parametrize("words", ["", "fire", "door ajar", "door on on"])
def test_an_unknown_fault_is_refused(words: str):
    with refused(key="fault", names=(words,)):
        chamber(ManualClock()).fault(words)


def test_the_address_sim_opens_a_chamber_on_the_time_of_the_bench():
    with open_chamber("sim") as one:
        assert one.read().temperature == START
    clock = ManualClock()
    one = open_simulated("sim:", time=clock)
    one.set_temperature(310.0)
    clock.now = 100.0
    assert one.read().temperature == pytest.approx(START + 5.0)
    for address in ("sim:?pace=0", "sim:?pace=x", "sim:9", "sim:?speed=2"):
        with refused():
            open_chamber(address)
