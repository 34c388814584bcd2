"""Attitude and velocity by readings alone, against a dense oracle and against the truth."""

from math import degrees, radians

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation as Turn
from tests.host.synthetic_log import LAYOUT, PATH, Bench, Faults, run_file

from inercal.benches import Turntable
from inercal.benches.turntable.attitude import reference_attitude
from inercal.host.assembly import SampleAssembler
from inercal.host.live_estimator import NavigationSolution, Navigator
from inercal.methods.turntable.model import earth_rate_level_frame
from inercal.physics.sensors.inverse import inverse
from inercal.recordings import Track
from inercal.runfile import Run

Array = NDArray[np.float64]
ARCSEC = radians(1 / 3600)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run_file(tmp_path_factory.mktemp("run"), PATH)


def table(run: Run) -> Turntable:
    assert isinstance(run.bench, Turntable)
    return run.bench


def track_of(run: Run, bench: Bench) -> Track:
    made = SampleAssembler(run, LAYOUT)
    for frame in bench.frames():
        made.feed(frame)
    block = made.take()
    assert block is not None
    return block.track


@pytest.fixture(scope="module")
def quiet(run: Run) -> Track:
    return track_of(run, Bench(run, seed=1, quiet=True))


def truth(run: Run) -> Array:
    return np.array([run.truth[name] for name in run.sensor.coefficients])


def in_pieces(made: Navigator, track: Track, values: Array, size: int) -> list[NavigationSolution]:
    n = track.time.size
    cuts = range(0, n, size)
    return [made.feed(track.slice(k, min(k + size, n)), values) for k in cuts]


def dense(run: Run, track: Track, values: Array) -> tuple[Array, Array]:
    """Return attitude and velocity after each sample, by rotations of SciPy and matrices."""
    bench = table(run)
    felt = inverse(run.sensor, track.reading, values)
    c, v = np.eye(3), np.zeros(3)
    cs, vs = np.empty((track.time.size, 3, 3)), np.empty((track.time.size, 3))
    for i in range(track.time.size):
        begins = track.hold[i] >= 0 and (i == 0 or track.hold[i] != track.hold[i - 1])
        if i == 0 or begins or track.time[i] - track.time[i - 1] > 0.5:
            c, v = reference_attitude(bench, track.angles[i : i + 1])[0], np.zeros(3)
            cs[i], vs[i] = c, v
            continue
        dt = track.time[i] - track.time[i - 1]
        before, now = felt.w[i - 1], felt.w[i]
        turn = ((before + now) / 2 - c.T @ earth_rate_level_frame(bench)) * dt + np.cross(
            before, now
        ) * dt**2 / 12
        half = c @ Turn.from_rotvec(turn / 2).as_matrix()
        c = c @ Turn.from_rotvec(turn).as_matrix()
        pull = np.array([0, 0, bench.gravity.value])
        v = v + (half @ (felt.f[i - 1] + felt.f[i]) / 2 - pull) * dt
        if track.hold[i] >= 0:
            v = np.zeros(3)
        cs[i], vs[i] = c, v
    return cs, vs


@pytest.mark.slow
def test_attitude_and_velocity_are_those_of_the_dense_oracle(run: Run):
    faults = Faults(lost=0.02, silent=((44.0, 45.0),))
    track = track_of(run, Bench(run, seed=2, faults=faults))
    values = truth(run)
    cs, vs = dense(run, track, values)
    for end in (6300, track.time.size):
        part = track.slice(0, end)
        seen = in_pieces(Navigator(run.sensor, table(run)), part, values, 97)[-1]
        assert seen.attitude == pytest.approx(cs[end - 1], abs=1e-11)
        assert seen.velocity == pytest.approx(vs[end - 1], abs=1e-9)


@pytest.mark.slow
def test_pieces_change_nothing(run: Run, quiet: Track):
    values = truth(run)
    whole = Navigator(run.sensor, table(run)).feed(quiet, values)
    for size in (1, 100, 5000):
        # One by one out of a hold, along a move and into the next hold.
        part = quiet.slice(4700, 5700) if size == 1 else quiet
        one = in_pieces(Navigator(run.sensor, table(run)), part, values, size)[-1]
        other = whole if size > 1 else Navigator(run.sensor, table(run)).feed(part, values)
        assert one.attitude == pytest.approx(other.attitude, abs=1e-12)
        assert one.velocity == pytest.approx(other.velocity, abs=1e-12)


def test_true_coefficients_keep_the_attitude_and_false_ones_lose_it(run: Run, quiet: Track):
    holding = np.flatnonzero(quiet.hold[1:] > quiet.hold[:-1])
    before = quiet.slice(0, int(holding[-1]) + 1)  # from the turn to where its rest begins
    made = Navigator(run.sensor, table(run))
    good = in_pieces(made, before, truth(run), 100)[-1]
    assert not good.is_hold
    # The readback is some ms late in this log, but the table has come to rest.
    assert np.abs(good.rotation_error).max() < 10
    assert np.abs(good.velocity).max() < 0.02
    bad = in_pieces(Navigator(run.sensor, table(run)), before, np.zeros(24), 100)[-1]
    assert np.abs(bad.rotation_error).max() > 1000


def test_velocity_stays_zero_through_a_hold(run: Run, quiet: Track):
    seen = in_pieces(Navigator(run.sensor, table(run)), quiet, truth(run), 50)
    assert any(one.is_hold for one in seen)
    assert all((one.velocity == 0).all() for one in seen if one.is_hold)


@pytest.mark.parametrize(
    ("angles", "roll", "pitch", "heading"),
    [
        ((0, 0, 0), 0, 0, 0),
        ((-90, 0, 0), 0, 0, 90),
        ((0, 30, 0), 0, 30, 0),
        ((0, 0, 40), 40, 0, 0),
        ((10, 20, -30), -30, 20, 350),
    ],
)
def test_roll_pitch_and_heading_are_of_the_bodys_y_axis(
    run: Run, angles: tuple[float, ...], roll: float, pitch: float, heading: float
):
    """On a table of axes z, x, y the angles are heading (counter-clockwise), pitch and roll."""
    bench = table(run)
    assert bench.azimuth.value == 0
    still = Track(
        np.arange(2) / 200,
        np.zeros((2, 6)),
        np.radians([angles, angles]),
        np.zeros(2, np.int64),
    )
    seen = Navigator(run.sensor, bench).feed(still, np.zeros(24))
    assert (seen.roll, seen.pitch) == pytest.approx((roll, pitch), abs=1e-3)
    assert seen.heading % 360 == pytest.approx(heading % 360, abs=1e-3)
    assert degrees(np.linalg.norm(seen.rotation_error) * ARCSEC) < 1e-3
