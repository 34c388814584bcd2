"""What the filters' innovations say: nothing of what is as stated, and much of what is not."""

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from math import radians, sqrt

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy import turntable
from tests.methods.turntable_cases import TABLE, bench, columns, observations, sensor, track, truth
from tests.refusals import refused

from inercal.benches import Turntable
from inercal.estimation import Estimate, Gaussian
from inercal.methods.turntable_kalman import METHOD
from inercal.methods.turntable_kalman.accelerometers import AccelerometerFilter
from inercal.physics.sensors import Sensor

Array = NDArray[np.float64]
DEG_H = radians(1) / 3600
PATH = [
    ("warm-up", (0, 0, 0), 40.0),
    *turntable.positions(20.0),
    *turntable.turns(720.0, 30.0, back=True),
]
LEAST = 0.78  # of NIS per component where all is as stated, at 50 Hz and by chance


@cache
def drawn(
    seed: int = 1, table: turntable.Table = TABLE, by_g: float = 0.0, hz: float = 50.0
) -> turntable.Draw:
    device = turntable.Device(by_g=by_g * DEG_H / turntable.G)
    return turntable.draw(1000 * seed, 2, PATH, table=table, device=device, hz=hz)


@cache
def found(
    draw: turntable.Draw,
    of: Sensor | None = None,
    stated: Turntable | None = None,
    estimator: str = "full",
) -> Estimate:
    made = of or sensor()
    return METHOD.estimator(estimator)(observations(draw, made), made, stated or bench(), ())


def nis(estimate: Estimate) -> list[float]:
    return [group.chi2 / group.dof for group in estimate.groups]


def enlarged(estimate: Estimate) -> list[bool]:
    """Return whether the innovations of gyros and accelerometers exceed what was stated."""
    return [group.enlarged for group in estimate.groups]


@pytest.mark.slow
def test_innovations_are_as_stated_where_all_is_as_stated(seed: int):
    draw = drawn(seed)
    estimate = found(draw)
    for group, mean in zip(estimate.groups, nis(estimate), strict=True):
        assert abs(mean - 1) < 3 * sqrt(2 / group.dof)
    assert enlarged(estimate) == [False, False]
    assert estimate.consistent


@pytest.mark.parametrize("white", [0.0, 10.0])
@pytest.mark.slow
def test_noise_of_the_readback_as_stated_is_within_it_at_any_size(white: float):
    table = turntable.Table(white=white * turntable.ARCSEC)
    draw = drawn(4, table)
    rough, fine = found(draw, stated=bench(table)), found(drawn(4))
    assert enlarged(rough) == [False, False]
    assert min(nis(rough)) > LEAST
    names = sensor().coefficients
    off = (rough.value - fine.value)[:, : len(names)]
    scatter = rough.covariance[0, :24, :24]
    if white:
        assert np.all(rough.std[:, :24] > fine.std[:, :24])
        assert np.mean(off**2 / np.diagonal(scatter)) < 1.5


def _understated() -> Sensor:
    return sensor(turntable.grade(0.05, 0.5, 30, 15))


def _overstated() -> Sensor:
    return sensor(turntable.grade(0.2, 0.5, 120, 15))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("of", "stated", "by_g"),
    [
        (_understated, bench, 0.0),
        (sensor, lambda: bench(azimuth=replace(bench().azimuth, value=radians(90))), 0.0),
        (sensor, lambda: bench(latitude=-bench().latitude), 0.0),
        (sensor, bench, 10.0),
    ],
    ids=["noise twice the stated", "azimuth 90° off", "the other hemisphere", "10 °/h/g"],
)
def test_what_is_not_as_stated_is_beyond_it(
    of: Callable[[], Sensor], stated: Callable[[], Turntable], by_g: float
):
    estimate = found(drawn(5, by_g=by_g), of(), stated())
    # Noise alone is the accelerometers' too.
    assert enlarged(estimate) == [True, of is _understated]
    assert not estimate.consistent


@pytest.mark.slow
def test_noise_that_is_half_the_stated_is_less():
    estimate = found(drawn(5), _overstated())
    assert max(nis(estimate)) < LEAST
    assert estimate.consistent
    assert estimate.notes[:2] != found(drawn(5)).notes[:2]


@pytest.mark.slow
def test_innovations_far_beyond_what_was_stated_are_in_doubt():
    estimate = found(drawn(5), sensor(turntable.grade(0.02, 0.5, 12, 15)))
    assert max(nis(estimate)) > 4
    assert np.all(estimate.largest_birge_ratio > 2)
    assert np.all(found(drawn(5)).largest_birge_ratio == 1)


@pytest.mark.parametrize(
    ("estimator", "too_sure"),
    [("drift", "of the gyros are"), ("paper", "of the gyros and accelerometers are")],
)
@pytest.mark.slow
def test_the_sources_r_tests_nothing_and_says_so(estimator: str, too_sure: str):
    estimate = found(drawn(1, turntable.Table(latency=0.0)), estimator=estimator)
    stated_r = [note for note in estimate.notes[:2] if "″" in note]  # R, in arc seconds
    assert len(stated_r) == 2
    # One note more than where the table has nothing that the states lack.
    exact = bench(square=0.0, harmonics=())
    plain = found(drawn(1, turntable.Table(latency=0.0)), stated=exact, estimator=estimator)
    [left] = [note for note in estimate.notes[2:] if too_sure in note]
    assert not any(too_sure in note for note in plain.notes[2:])
    assert "right angles" in left


@pytest.mark.slow
def test_gyros_that_feel_forces_do_not_spoil_the_accelerometers():
    draw = drawn(6, by_g=200.0)
    estimate = found(draw, sensor(turntable.T, "g"))
    assert enlarged(estimate) == [False, False]
    names = [name for name in sensor().coefficients if name[0] == "a"]
    one = estimate.select(names)
    off = one.value - truth(draw, names)
    nees = np.einsum("ti,tij,tj->t", off, np.linalg.inv(one.covariance), off) / 12
    assert np.mean(nees) < 1 + 3 * sqrt(2 / 24)


def test_the_covariance_of_what_both_filters_find_is_one():
    estimate = found(drawn(1))
    covariance = estimate.covariance[0] / np.outer(estimate.std[0], estimate.std[0])
    assert np.linalg.eigvalsh(covariance).min() > -1e-12
    assert len(set(estimate.names)) == len(estimate.names)


@pytest.mark.slow
def test_gravitys_share_is_not_enlarged_by_innovations():
    g = bench().gravity
    stated = bench(gravity=replace(g, sd=1e-3 * g.value))
    sharp, loose = (
        found(drawn(5), _understated(), one).select(["ax.k1", "ay.k1"]) for one in (bench(), stated)
    )
    added = loose.covariance - sharp.covariance
    assert added == pytest.approx(np.full((2, 2, 2), 1e-6), rel=1e-3)


@pytest.mark.slow
def test_a_prior_of_both_triads_without_correlation_is_taken_apart():
    names = ("gx.scale", "ax.k1")
    seen, made = observations(drawn(1)), sensor()
    apart = Gaussian.independent(names, truth(drawn(1), names)[0], (1e-6, 1e-6))
    first = replace(seen, track=track(drawn(1)).trial(0))
    estimate = METHOD.estimator("full")(first, made, bench(), (), (apart,))
    assert np.all(estimate.select(names).std < 1.01e-6)
    covariance = np.array([[1e-6, 1e-7], [1e-7, 1e-6]])
    with refused(names=names):
        METHOD.estimator("full")(
            seen, made, bench(), (), (Gaussian(names, np.zeros(2), covariance),)
        )


def test_turns_that_are_too_small_name_what_rests_on_the_guess():
    small = [("warm-up", (0, 0, 0), 40.0), *turntable.turns(0.3, 1.0)]
    draw = turntable.draw(7, 1, small, hz=50.0)
    made = sensor().select_axes("w")
    seen = observations(draw)
    whole = replace(seen, track=replace(track(draw), reading=track(draw).reading[..., 3:]))
    at = [seen.channels.index(name) for name in made.channels]
    whole = replace(
        whole,
        mean=seen.mean[..., at],
        covariance=seen.covariance[:, at][:, :, at],
        channels=made.channels,
    )
    estimate = METHOD.estimator("full")(whole, made, bench(), ())
    [note] = [note for note in estimate.notes if re.search(r"g[xyz]\.scale", note)]
    assert re.search(r"\d %", note)
    assert not any(re.search(r"g[xyz]\.scale", note) for note in found(drawn(1)).notes)


@pytest.mark.slow
def test_a_recording_at_rest_needs_no_gyros_for_accelerometers():
    one = track(drawn(2)).trial(0)
    still = replace(one, reading=np.where(np.arange(6) < 3, one.reading, 0.0))
    results = []
    for each in (one, still):
        ours = AccelerometerFilter.from_track(sensor(), bench(), each)
        results.append(ours.step(ours.start(each), each)[0].theta)
    assert np.array_equal(*results)
    by = columns(sensor().select_axes("f").coefficients)
    assert np.max(np.abs(results[0] - drawn(2).acc[0] @ by)) < 1e-2
