"""What repeated sessions say, and what they are refused for."""

from dataclasses import replace

import numpy as np
import pytest
from tests.refusals import refused
from tests.repeatability.laboratory import KIND, Laboratory, draw
from tests.repeatability.sessions import sessions_of

from inercal.basics.errors import InputError
from inercal.laboratory.repeatability import RepeatedSession, repeat
from inercal.laboratory.repeatability.repeated_sessions import advice_lines, required_sessions
from inercal.laboratory.repeatability.session_findings import outlier_sessions
from inercal.physics.sensors import Readout


def drawn_sessions(
    k: int, seed: int = 1, laboratory: Laboratory | None = None
) -> list[RepeatedSession]:
    rng = np.random.default_rng(seed)
    return sessions_of(draw(laboratory or Laboratory(), k, rng))


def test_what_sessions_share_is_not_averaged():
    few, many = (repeat(drawn_sessions(k)) for k in (4, 40))
    np.testing.assert_allclose(many.mean.shared_std, few.mean.shared_std, rtol=0.05)
    expected = np.array([0.0, 10e-6, 20e-6])[KIND]
    np.testing.assert_allclose(many.mean.shared_std, expected, rtol=0.05, atol=1e-12)
    assert np.all(many.mean.scatter_std < 0.6 * few.mean.scatter_std)


@pytest.mark.slow
def test_another_determination_in_each_session_is_averaged():
    sessions = [
        replace(one, calibration=replace(one.calibration, shared=tuple(
            replace(error, determination=f"{k:064x}") for error in one.calibration.shared or ())))
        for k, one in enumerate(drawn_sessions(40))
    ]  # fmt: skip
    found, common = repeat(sessions), repeat(drawn_sessions(40))
    tilted = KIND == 2
    assert np.all(found.mean.shared_std[tilted] < 0.3 * common.mean.shared_std[tilted])


def test_files_that_state_nothing_are_taken_as_fully_shared():
    rng = np.random.default_rng(1)
    drawn = draw(Laboratory(), 10, rng)
    found = repeat(sessions_of(drawn, stated=False))
    np.testing.assert_allclose(found.mean.shared_std, np.sqrt(np.diag(drawn.covariance)), rtol=1e-6)
    assert len(found.fit.matched.unstated) == 10


@pytest.mark.slow
def test_the_rotation_of_the_mounting_is_told_from_the_sensor():
    found = repeat(drawn_sessions(60))
    by_name = {one.effect.name: one for one in found.components}
    rotation = by_name["rotation of the mounting"]
    assert rotation.sd == pytest.approx(40e-6, rel=0.25)
    assert by_name["misalignment of accelerometers"].sd < 10e-6
    assert by_name["bias of accelerometers"].low < 60e-6 < by_name["bias of accelerometers"].high
    # The bench answers for the mounting unless the user says otherwise.
    own, with_mount = found, repeat(drawn_sessions(60), mount_owner="sensor")
    moved = KIND == 2
    assert np.all(with_mount.next_use.expanded[moved] > 1.5 * own.next_use.expanded[moved])
    np.testing.assert_allclose(
        with_mount.next_use.expanded[~moved], own.next_use.expanded[~moved], rtol=1e-6
    )


@pytest.mark.slow
def test_days_and_turn_ons_are_told_apart():
    laboratory = Laboratory(day=(200.0, 100.0, 0.0))
    days = np.repeat(np.arange(12), 4)
    drawn = draw(laboratory, 48, np.random.default_rng(2), days)
    found = repeat(sessions_of(drawn, days))
    sd = {one.effect.level: one.sd for one in found.components if "bias" in one.effect.name}
    assert sd["turn-on"] == pytest.approx(60e-6, rel=0.2)
    assert sd["day"] == pytest.approx(200e-6, rel=0.4)
    same_day = repeat(sessions_of(drawn, days), scope="turn-on")
    assert np.all(same_day.next_use.expanded[KIND == 0] < 0.7 * found.next_use.expanded[KIND == 0])


def test_one_day_says_nothing_of_the_next():
    sessions = [replace(one, day="Monday") for one in drawn_sessions(10)]
    with pytest.raises(InputError, match="day to day"):
        repeat(sessions)
    assert repeat(sessions, scope="turn-on").scope == "turn-on"


@pytest.mark.parametrize("count", [0, 1])
def test_one_session_has_no_scatter(count: int):
    with pytest.raises(InputError, match="two or more"):
        repeat(drawn_sessions(2)[:count])


def test_two_of_one_recording_are_refused():
    source = {"recording sha256": "a" * 64}
    first, second = (
        replace(one, calibration=replace(one.calibration, provenance=source))
        for one in drawn_sessions(2)
    )
    with pytest.raises(InputError, match="recording"):
        repeat([first, second])


@pytest.mark.slow
def test_a_session_that_lies_apart_is_named():
    sessions = drawn_sessions(8)
    off = sessions[3].calibration
    values = off.values + np.where(KIND == 0, 5e-3, 0.0)
    sessions[3] = replace(sessions[3], calibration=replace(off, values=values))
    found = repeat(sessions)
    assert list(outlier_sessions(found.fit, "bench")) == ["session 3"]
    assert any("session 3" in line for line in found.findings)
    quiet = sum(len(outlier_sessions(repeat(drawn_sessions(8, s)).fit, "bench")) for s in range(40))
    assert quiet <= 3


@pytest.mark.slow
def test_an_axis_that_scatters_more_is_named_and_takes_its_own_scatter():
    found = repeat(drawn_sessions(20, laboratory=Laboratory(odd=5.0)))
    assert any("ax.k0 scatters more" in line for line in found.findings)
    assert found.next_use.expanded[0] > 1.4 * found.next_use.expanded[4]


def test_advice_names_the_sessions_that_are_needed():
    assert [required_sessions(x, 1) for x in (0.0, 0.25, 1.0)] == [7, 10, 24]  # of the note
    assert [required_sessions(x, 3) for x in (0.0, 0.25, 1.0)] == [3, 4, 9]
    assert any("there are 2" in line for line in advice_lines(repeat(drawn_sessions(2))))


def test_another_turn_on_of_the_same_day_has_no_new_mounting():
    days = np.repeat(np.arange(4), 3)
    drawn = draw(Laboratory(), 12, np.random.default_rng(3), days)
    by_bench, by_sensor = (
        repeat(sessions_of(drawn, days), scope="turn-on", mount_owner=owner)
        for owner in ("bench", "sensor")
    )
    np.testing.assert_allclose(by_sensor.scatter, by_bench.scatter, rtol=1e-9)
    assert not any(
        one.effect.is_in_next_use("turn-on")
        for one in by_sensor.components
        if one.effect.level == "mount"
    )


def with_uncertainty(one: RepeatedSession, factor: float) -> RepeatedSession:
    """Return a session whose own noise is some times larger, by its file and in truth."""
    calibration = one.calibration
    columns = sum(
        (np.outer(e.covariance, e.covariance) / e.std**2 for e in calibration.shared or ()),
        np.zeros_like(calibration.covariance),
    )
    own = calibration.covariance - columns
    rng = np.random.default_rng(int(one.day) + 5)
    values = calibration.values + factor * np.sqrt(np.diag(own)) * rng.standard_normal(12)
    return replace(
        one, calibration=replace(calibration, values=values, covariance=factor**2 * own + columns)
    )


def test_sessions_of_two_sensors_are_refused_by_serial_number_and_named_by_name():
    first, *others = drawn_sessions(3)
    with refused(key="[job] serial_number"):
        repeat([
            replace(one, calibration=replace(one.calibration, job={"serial number": str(k // 2)}))
            for k, one in enumerate([first, *others])
        ])  # fmt: skip
    sensor = replace(first.calibration.sensor, name="TRIAD-2")
    renamed = replace(first, calibration=replace(first.calibration, sensor=sensor))
    assert any("TRIAD-2" in line for line in repeat([renamed, *others]).findings)
    assert not any("TRIAD" in line for line in repeat([first, *others]).findings)


def test_a_session_with_readings_in_g_is_used_with_the_others():
    first, *others = drawn_sessions(3)
    sensor = first.calibration.sensor
    axes = tuple(replace(one, readout=Readout(1 / 9.80665, 0.0, "g")) for one in sensor.axes)
    in_g = replace(first.calibration, sensor=replace(sensor, axes=axes))
    found = repeat([replace(first, calibration=in_g), *others])
    np.testing.assert_array_equal(found.values, repeat([first, *others]).values)


def mixed_sessions(count: int, good: int, seed: int = 4) -> list[RepeatedSession]:
    """Return sessions without scatter, of which all but the last `good` are 50 times worse."""
    drawn = drawn_sessions(count, seed, Laboratory(turn_on=(0, 0, 0), mount=0))
    return [with_uncertainty(one, 50.0) if k < count - good else one for k, one in enumerate(drawn)]


@pytest.mark.parametrize("good", [1, 2])
@pytest.mark.parametrize("seed", range(6))
def test_poor_sessions_do_not_spoil_good_ones(good: int, seed: int):
    sessions = mixed_sessions(2 + good, good, seed)
    found = repeat(sessions, mount_owner="sensor")
    best = 2 * np.sqrt(np.diag(sessions[-1].calibration.covariance))
    counts = found.fit.alone.counts_in_next_use
    assert np.all(found.next_use.expanded[~counts] < 2.5 * best[~counts])
    assert counts.sum() <= 7  # of 12 at 20 %
    named = [line for line in found.findings if "own scatter" in line]
    own = np.diag(found.scatter)[counts]
    assert bool(named) or not np.any(own > 1.01 * found.fit.variances.variance.max())


def test_one_good_session_says_that_its_scatter_is_not_seen():
    found = repeat(mixed_sessions(3, 1))
    assert found.fit.unseen
    assert not repeat(drawn_sessions(3)).fit.unseen


@pytest.mark.slow
def test_own_scatter_is_named_where_it_is_added():
    for seed in range(10):
        found = repeat(drawn_sessions(5, seed), mount_owner="sensor")
        line = next((x for x in found.findings if "own scatter" in x), "")
        pooled = {
            place: one.sd for one in found.components for place in one.effect.places
            if one.effect.level != "mount"
        }  # fmt: skip
        for j in np.flatnonzero(KIND < 2):
            adds = np.sqrt(found.scatter[j, j]) > 1.001 * pooled[int(j)]
            assert (f"{found.names[j]} " in line) == adds
