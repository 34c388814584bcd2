"""When a soak is stable, and what ends a run in a chamber: with a simulated chamber and time."""

from collections.abc import Iterator
from dataclasses import replace
from math import nan
from pathlib import Path

import pytest
from tests.host.soak_runs import soak_run
from tests.refusals import refused

from inercal.host.equipment import ChamberPort, ChamberState
from inercal.host.link import LinkLost
from inercal.host.packets import read_layout
from inercal.host.sim.chamber import SimulatedChamber
from inercal.host.soaks import SoakControl, require_chamber
from inercal.recordings.environment import ChamberProfile, Environment, SoakCriteria

ZERO = 273.15
TICK = 0.05  # s
STEPS = 10
CRITERIA = SoakCriteria(
    tolerance=0.5,
    drift=0.5 / 60,
    steady_time=60.0,
    longest_wait=3000.0,
    limits=(ZERO - 40, ZERO + 80),
    max_rate=10 / 60,
)
SOAKS = Environment("soaks", profile=ChamberProfile((ZERO - 20, ZERO + 25)), criteria=CRITERIA)


class Bench:
    """A chamber, its control, and the time."""

    def __init__(self, environment: Environment = SOAKS, *, has_thermometer: bool = True):
        self.time, self.number, self.ended = 0.0, 0, False
        self.words: str | None = None
        self.said: list[tuple[str, str]] = []
        self.recorded: list[tuple[float, float, float]] = []
        self.chamber = SimulatedChamber(lambda: self.time, case_lag=200.0)
        self.sensor: float | None = None  # instead of the temperature of the case
        self.control = SoakControl(
            ChamberPort(lambda: self.chamber, synchronous=True),
            environment,
            STEPS,
            lambda level, words: self.said.append((level, words)),
            lambda *row: self.recorded.append(row),
            has_thermometer,
        )

    def tick(self) -> None:
        self.time += TICK
        sensor = self.chamber.case_temperature if self.sensor is None else self.sensor
        self.words = self.control.update(self.time, self.number, sensor, ended=self.ended)
        self.ended = self.ended or self.words is not None

    def ticks(self, seconds: float) -> Iterator[None]:
        until = self.time + seconds
        while self.time < until and not self.words:
            self.tick()
            yield

    def wait(self, seconds: float) -> None:
        for _ in self.ticks(seconds):
            pass

    def wait_until_stable(self) -> None:
        for _ in self.ticks(7200):
            if self.control.may_begin(self.number):
                return
        raise AssertionError(self.words)


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_a_step_begins_only_when_chamber_and_sensor_are_stable(bench: Bench):
    bench.wait_until_stable()
    assert bench.chamber.set_point == ZERO - 20
    last = [row for row in bench.recorded if row[0] > bench.time - 59]
    assert all(abs(kelvin - (ZERO - 20)) <= 0.5 for _, kelvin, _ in last)
    # The case follows with 200 s, so its drift in K/s is its distance divided by this time.
    assert abs(bench.chamber.case_temperature - (ZERO - 20)) < 200 * CRITERIA.drift
    assert not bench.control.may_begin(STEPS)


@pytest.mark.slow
def test_the_next_soak_begins_with_its_first_step(bench: Bench):
    bench.wait_until_stable()
    bench.number = STEPS
    bench.tick()
    assert bench.chamber.set_point == ZERO + 25
    assert not bench.control.may_begin(STEPS)
    bench.wait_until_stable()
    assert bench.chamber.case_temperature == pytest.approx(ZERO + 25, abs=200 * CRITERIA.drift)


@pytest.mark.slow
def test_without_a_thermometer_the_stated_time_counts():
    profile = ChamberProfile((ZERO - 20, ZERO + 25), wait=1200.0)
    bench = Bench(replace(SOAKS, profile=profile), has_thermometer=False)
    bench.sensor = nan
    bench.wait_until_stable()
    within = next(time for time, kelvin, _ in bench.recorded if abs(kelvin - (ZERO - 20)) <= 0.5)
    assert bench.time - within == pytest.approx(1200.0, abs=2.0)


@pytest.mark.slow
def test_a_sensor_that_drifts_ends_the_run_after_the_longest_wait(bench: Bench):
    bench.sensor = ZERO + 20
    for _ in bench.ticks(3100):
        bench.sensor -= 0.6 / 60 * TICK  # more than 0.5 K/min
    assert bench.words is not None
    assert bench.time == pytest.approx(3000, abs=2)
    assert "drifts by 0.6 K/min" in bench.words


def test_a_soak_that_is_lost_must_become_stable_again(bench: Bench):
    bench.wait_until_stable()
    bench.chamber.set_temperature(ZERO - 19)
    bench.wait(200.0)
    assert not bench.control.may_begin(0)
    assert any(level == "warning" and "no longer stable" in words for level, words in bench.said)
    bench.chamber.set_temperature(ZERO - 20)
    bench.wait_until_stable()


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "named"), [("door", "door"), ("sensor", "sensor failure")])
def test_a_chamber_that_reports_a_fault_ends_the_run_within_a_second(
    bench: Bench, fault: str, named: str
):
    bench.wait_until_stable()
    bench.chamber.fault(fault)
    bench.wait(1.0)
    assert bench.words is not None
    assert named in bench.words
    bench.tick()
    assert bench.chamber.set_point is None


@pytest.mark.parametrize("place", ["chamber", "sensor"])
@pytest.mark.parametrize("kelvin", [ZERO - 41, ZERO + 81])
def test_a_temperature_beyond_the_limits_ends_the_run_within_a_second(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, place: str, kelvin: float
):
    bench.wait(10.0)
    if place == "sensor":
        bench.sensor = kelvin
    else:
        monkeypatch.setattr(bench.chamber, "read", lambda: ChamberState(kelvin))
    bench.wait(1.0)
    assert bench.words is not None
    assert f"the {place} is at" in bench.words


def test_a_single_wrong_temperature_is_no_reason_to_stop(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
):
    bench.wait(10.0)
    bench.sensor = ZERO + 500
    bench.wait(0.25)
    bench.sensor = None
    bench.wait(5.0)
    with monkeypatch.context() as patched:
        patched.setattr(bench.chamber, "read", lambda: ChamberState(ZERO + 300))
        bench.wait(0.25)
    bench.wait(5.0)
    assert bench.words is None


def test_a_temperature_that_runs_away_ends_the_run_within_a_second(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
):
    bench.wait(70.0)
    start, before = bench.time, bench.chamber.read().temperature
    # 1 K/s; 10 K/min are allowed.
    monkeypatch.setattr(bench.chamber, "read", lambda: ChamberState(before + bench.time - start))
    bench.wait(1.0)
    assert bench.words is not None
    assert "10 K/min" in bench.words


@pytest.mark.slow
def test_the_chamber_at_its_own_rate_with_noise_is_not_too_fast():
    environment = replace(SOAKS, criteria=replace(CRITERIA, max_rate=3.5 / 60))
    bench = Bench(environment)
    bench.wait_until_stable()
    assert bench.words is None


@pytest.mark.slow
def test_a_chamber_without_a_reply_is_a_trouble_within_a_second_until_it_replies(bench: Bench):
    bench.wait_until_stable()
    bench.chamber.fault("silent")
    bench.wait(1.0)
    assert bench.control.trouble is not None
    assert bench.words is None
    bench.chamber.fault("silent off")
    bench.wait(0.5)
    assert bench.control.trouble is None
    assert not bench.control.may_begin(0)
    assert bench.chamber.set_point == ZERO - 20


def test_at_the_end_the_chamber_is_stopped(bench: Bench):
    bench.wait(10.0)
    bench.ended = True
    bench.tick()
    assert bench.chamber.set_point is None
    reported = list(bench.said)
    assert [level for level, words in reported if "stopped" in words] == ["info"]
    bench.control.close()
    assert bench.said == reported


def test_a_chamber_that_cannot_be_stopped_is_an_alarm(bench: Bench):
    bench.wait(10.0)
    bench.chamber.fault("silent")
    bench.control.close()
    level, words = bench.said[-1]
    assert level == "alarm"
    assert "by hand" in words


def test_a_temperature_that_the_chamber_cannot_reach_ends_the_run():
    profile = ChamberProfile((ZERO - 90, ZERO + 25))
    criteria = replace(CRITERIA, limits=(ZERO - 100, ZERO + 80))
    bench = Bench(replace(SOAKS, profile=profile, criteria=criteria))
    bench.wait(1.0)
    assert bench.words is not None
    assert "cannot go to" in bench.words


class SlowChamber(SimulatedChamber):
    """A chamber that a thread reads; it is lost once."""

    opened = 0
    lost = False

    def read(self) -> ChamberState:
        if self.lost:
            raise LinkLost("gone")
        return super().read()


def test_a_thread_reads_a_real_chamber_and_opens_it_again():
    chambers = [SlowChamber(lambda: 0.0), SlowChamber(lambda: 0.0)]
    left = list(chambers)
    port = ChamberPort(lambda: left.pop(0), synchronous=False)

    def reading() -> ChamberState:
        while (state := port.exchange()) is None:
            pass
        return state

    port.target = 300.0
    assert reading().temperature == 298.15
    chambers[0].lost = True
    with pytest.raises(LinkLost):
        reading()
    assert reading().temperature == 298.15
    assert chambers[1].set_point == 300.0  # the new connection is told again
    port.stop()
    assert chambers[1].set_point is None
    port.close()


def test_soaks_need_a_chamber_and_a_chamber_needs_soaks(tmp_path: Path):
    run, layout = soak_run(tmp_path / "plan"), read_layout("fixed")
    with refused(key="[environment] temperatures"):
        require_chamber(run, layout, "")
    without = replace(run, environment=replace(SOAKS, profile=ChamberProfile()))
    with refused(key="[environment] temperatures"):
        require_chamber(without, layout, "x:")


def test_packets_without_a_temperature_need_a_stated_wait(tmp_path: Path):
    run, novatel = soak_run(tmp_path / "plan"), read_layout("novatel")
    with refused(key="[environment] wait"):
        require_chamber(run, novatel, "x:")
    waits = replace(SOAKS, profile=replace(SOAKS.profile, wait=60.0))
    require_chamber(replace(run, environment=waits), novatel, "x:")
