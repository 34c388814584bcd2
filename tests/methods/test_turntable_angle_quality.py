"""Filters weigh interpolated angles by how well they are known, and use none that are false."""

from typing import Any

import numpy as np
import pytest
from tests.host.synthetic_log import LAYOUT, PATH, Bench, run_file

from inercal.basics.errors import InputError
from inercal.benches.turntable import require_turntable
from inercal.host.assembly import SampleAssembler
from inercal.methods.turntable_kalman._filter_steps import MAX_REJECTIONS, is_rejected
from inercal.methods.turntable_kalman.filter import RunningFilter
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS, FilterKind
from inercal.recordings import AngleQuality, Track
from inercal.runfile import Run

ARCSEC = np.radians(1 / 3600)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return run_file(tmp_path_factory.mktemp("run"), PATH)


@pytest.fixture(scope="module")
def track(run: Run) -> Track:
    made = SampleAssembler(run, LAYOUT)
    for frame in Bench(run, seed=1).frames():
        made.feed(frame)
    block = made.take()
    assert block is not None
    return block.track


def followed(run: Run, track: Track, kind: FilterKind, cuts: int = 1) -> RunningFilter[Any]:
    bench = require_turntable(run)
    made = FILTER_CONFIGS["full"].filter(kind, run.sensor, bench, track)
    going = made.begin(track)
    for part in np.array_split(np.arange(track.time.size), cuts):
        going.step(track.slice(int(part[0]), int(part[-1]) + 1))
    return going


def with_angles(track: Track, at: slice, error: float) -> Track:
    angles = track.angles.copy()
    angles[at] += error
    return Track(track.time, track.reading, angles, track.hold, None, track.angle_quality)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["w", "f"])
def test_an_isolated_false_angle_is_not_used(run: Run, track: Track, kind: FilterKind):
    """One epoch of 60″ in the first rest, where nothing but the noise of the readback is open."""
    at = int(np.searchsorted(track.time, 22.0))
    true = followed(run, track, kind).estimate
    going = followed(run, with_angles(track, slice(at, at + 20), 60 * ARCSEC), kind)
    assert going.rejections >= 1
    sd = np.sqrt(np.diagonal(true.covariance))
    assert np.max(np.abs(going.estimate.value - true.value) / sd) < 0.1
    assert going.state.nis / going.dof < 1.1


def test_angles_that_stay_elsewhere_are_used_and_show_in_the_nis(run: Run, track: Track):
    at = int(np.searchsorted(track.time, 22.0))
    going = followed(run, with_angles(track, slice(at, None), 3000 * ARCSEC), "w")
    assert going.rejections >= MAX_REJECTIONS
    assert going.state.nis / going.dof > 10


@pytest.mark.parametrize("kind", ["w", "f"])
def test_pieces_have_the_same_epochs_where_angles_are_not_usable(
    run: Run, track: Track, kind: FilterKind
):
    rng = np.random.default_rng(4)
    gain = np.where(rng.random(track.time.size) < 0.9, np.inf, 1.0)
    quality = AngleQuality(gain, np.zeros(track.time.size))
    seldom = Track(track.time, track.reading, track.angles, track.hold, None, quality)
    whole, parts = followed(run, seldom, kind), followed(run, seldom, kind, 37)
    assert whole.state.dof == parts.state.dof > 100
    assert whole.estimate.value.tobytes() == parts.estimate.value.tobytes()
    assert whole.estimate.covariance.tobytes() == parts.estimate.covariance.tobytes()


def test_a_track_without_quality_is_filtered_without_a_limit(run: Run, track: Track):
    plain = Track(track.time, track.reading, track.angles, track.hold)
    at = int(np.searchsorted(track.time, 22.0))
    assert followed(run, with_angles(plain, slice(at, at + 20), 60 * ARCSEC), "w").rejections == 0


def test_the_distance_is_that_of_the_whole_innovation():
    rng = np.random.default_rng(2)
    for _ in range(50):
        root = rng.standard_normal((6, 6))
        p, h, variance = root @ root.T, rng.standard_normal((3, 6)), rng.random(3) + 0.1
        s = h @ p @ h.T + np.diag(variance)
        innovation = np.linalg.cholesky(s) @ rng.standard_normal(3)
        distance = float(np.sqrt(innovation @ np.linalg.solve(s, innovation)))
        for share, beyond in ((0.999, True), (1.001, False)):
            count, work = np.zeros(2, np.int64), (np.empty((6, 6)), np.empty(6), np.empty(6))
            gate = share * distance
            assert is_rejected(innovation, h, p, variance, gate, count, *work) == beyond
            assert count.tolist() == [beyond, beyond]


def test_a_quality_of_other_samples_is_refused(track: Track):
    with pytest.raises(InputError):
        Track(
            track.time, track.reading, track.angles, track.hold, None,
            AngleQuality(np.ones(3), np.zeros(3)),
        )  # fmt: skip


def test_samples_with_known_angles_are_those_of_finite_deviation(track: Track):
    sd = np.where(np.arange(track.time.size) % 3 == 0, np.inf, 0.0)
    quality = AngleQuality(np.ones(track.time.size), sd)
    some = Track(track.time, track.reading, track.angles, track.hold, None, quality)
    known = some.with_known_angles
    assert known.time.tolist() == track.time[np.isfinite(sd)].tolist()
    assert known.angle_variance(1.0).tolist() == [1.0] * known.time.size
    plain = Track(track.time, track.reading, track.angles, track.hold)
    assert plain.with_known_angles is plain
