"""Six positions and steady rates against the independent generator."""

from collections.abc import Callable
from dataclasses import replace
from math import radians

import numpy as np
import pytest
from tests.accuracy import turntable as made_by
from tests.base_seeds import SEEDS, evidence
from tests.methods.turntable_cases import (
    BENCH,
    Array,
    Score,
    discrete,
    errors,
    observations,
    score,
    sensor,
    steps,
    truth,
)
from tests.refusals import refused

from inercal.basics.errors import InputError, NotObserved
from inercal.estimation import Gaussian
from inercal.methods.turntable_discrete import least_squares
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations

QUIET = made_by.Grade(0, 0, 0, 0)
PLAIN = made_by.Table(harmonics=(0, 0), white=0, square=0, lean=0, azimuth=0, latency=0)


def _worked(name: str) -> bool:
    return name != "warm-up"


def rows(draw: made_by.Draw, made: Sensor, chosen: Callable[[str], bool] = _worked) -> Observations:
    whole = observations(draw, made)
    at = [k for k, name in enumerate(whole.labels) if chosen(name)]
    return replace(
        whole,
        labels=tuple(whole.labels[k] for k in at),
        mean=whole.mean[:, at],
        covariance=whole.covariance[at],
        duration=whole.duration[at],
        samples=whole.samples[at],
        time=whole.time[at],
    )


def scores(grade: made_by.Grade, seeds: int, base: int) -> tuple[Score, Score]:
    made, off, covariance = sensor(grade), list[Array](), list[Array]()
    for k in range(0, seeds, 10):
        draw = made_by.draw(1000 * base + k, 10, discrete(), grade, hz=50.0)
        seen = rows(draw, made)
        found = least_squares(seen, made, BENCH, steps(discrete(), seen.labels))
        assert found.converged.all()
        one = errors(found, draw, made)
        off.append(one[0])
        covariance.append(one[1])
    both = np.concatenate(off), np.concatenate(covariance)
    return score(*both, made.coefficients, "g"), score(*both, made.coefficients, "a")


@pytest.mark.slow
def test_without_noise_and_with_a_perfect_table_the_truth_comes_out():
    made = sensor()
    draw = made_by.draw(3, 2, discrete(10.0), QUIET, PLAIN, hz=50.0)
    seen = rows(draw, made)
    found = least_squares(seen, made, BENCH, steps(discrete(10.0), seen.labels))
    off = np.abs(errors(found, draw, made)[0])
    assert (off / found.std[:, :24]).max() < 0.01
    assert found.chi2.max() < 0.2  # a delay of 0 where 0 ± 5 ms is stated and no noise at all


def test_a_table_of_means_over_steady_whole_turns_says_the_same_as_samples():
    made = sensor()
    draw = made_by.draw(5, 1, discrete(), hz=50.0)
    seen = rows(draw, made)
    plan = steps(discrete(), seen.labels)
    followed = least_squares(seen, made, BENCH, plan)
    means, seconds = seen.mean.copy(), seen.duration.copy()
    for k, name in enumerate(seen.labels):
        if name[-1] in "+-":
            first = np.flatnonzero(draw.labels == name)[0] + 100
            means[:, k, 3:] = draw.rates[:, first : first + 1200].mean(axis=1)  # two turns
            seconds[k] = 24.0
    covariance = seen.covariance * (seen.duration / seconds)[:, None, None]
    table = replace(seen, mean=means, covariance=covariance, duration=seconds, track=None)
    stated = least_squares(table, made, BENCH, plan)
    assert np.abs((stated.value - followed.value)[0, :24] / stated.std[0, :24]).max() < 2.5
    assert (np.abs(errors(stated, draw, made)[0]) / stated.std[:, :24]).max() < 4


def test_a_known_delay_of_the_readback_changes_little_from_rest_to_rest():
    made = sensor()
    draw = made_by.draw(6, 1, discrete(), hz=50.0)
    seen = rows(draw, made)
    plan = steps(discrete(), seen.labels)
    late = replace(BENCH, latency=replace(BENCH.latency, value=5e-3))
    one, other = (least_squares(seen, made, bench, plan) for bench in (BENCH, late))
    assert np.abs((one.value - other.value)[0, :24] / one.std[0, :24]).max() < 0.2


def test_positions_alone_leave_scale_and_misalignment_of_gyros_open():
    made = sensor(made_by.GRADES["C"])
    draw = made_by.draw(7, 1, discrete(), made_by.GRADES["C"], hz=25.0)
    seen = rows(draw, made, lambda name: name[-1] in "pa")
    with pytest.raises(NotObserved) as refusal:
        least_squares(seen, made, BENCH, steps(discrete(), seen.labels))
    free = {word for text in refusal.value.directions for word in text.split() if "." in word}
    assert "gx.scale" in free
    assert not any("ax." in name for name in free)


@pytest.mark.slow
def test_a_prior_takes_the_place_of_what_is_missing():
    made = sensor()
    draw = made_by.draw(7, 1, discrete(), hz=25.0)
    seen = rows(draw, made, lambda name: name[:3] not in ("x_p", "x_a"))
    wanted = [n for n in made.coefficients if n[0] == "g"]
    plan = steps(discrete(), seen.labels)
    known = [n for n in made.coefficients if n in ("ax.k0", "ax.k1", "gx.scale", "gy.delta_p")]
    assert len(known) == 4
    with pytest.raises(NotObserved) as refusal:
        least_squares(seen, made, BENCH, plan)
    assert any("gx.scale" in text for text in refusal.value.directions)
    prior = Gaussian.independent(made.coefficients, truth(draw, made.coefficients)[0], 1e-3)
    found = least_squares(seen, made, BENCH, plan, [prior])
    assert (found.std[0, : len(made.coefficients)] < 1.01e-3).all()
    assert set(wanted) < set(found.names)


def test_steps_that_are_not_the_rows_and_other_axes_are_refused():
    made = sensor()
    draw = made_by.draw(7, 1, discrete(), hz=25.0)
    seen = rows(draw, made)
    plan = steps(discrete(), seen.labels)
    with pytest.raises(InputError):
        least_squares(seen, made, BENCH, plan[::-1])
    two = replace(BENCH, axes="zx")
    with refused(names=seen.labels[:1]):
        least_squares(replace(seen, track=None), made, two, plan)
    far = replace(seen, time=seen.time + 1e5)
    with refused(names=seen.labels[:1]):
        least_squares(far, made, BENCH, plan)


@pytest.mark.slow
def test_terms_by_gravity_come_out_of_the_same_rows():
    made = sensor(made_by.T, "g")
    device = made_by.Device(by_g=radians(10) / 3600 / made_by.G)
    draw = made_by.draw(8, 10, discrete(), device=device, hz=50.0)
    seen = rows(draw, made)
    found = least_squares(seen, made, BENCH, steps(discrete(), seen.labels))
    at = [k for k, n in enumerate(made.coefficients) if ".g_" in n]
    places = [("xyz".index(made.coefficients[k][1]), made.coefficients[k][-1]) for k in at]
    assert len(at) == 9
    true = np.stack([draw.by_g[:, i, (i + "ipo".index(way)) % 3] for i, way in places], axis=1)
    off = found.value[:, at] - true
    assert 0.5 < np.mean((off / found.std[:, at]) ** 2) < 1.7


@pytest.mark.slow
@pytest.mark.parametrize("base", SEEDS)
@pytest.mark.parametrize(
    ("grade", "gyro", "acc"),
    [
        ("T", (0.0068, 8.7, 1.6), (14.6, 8.7, 4.3)),
        evidence("I", (0.0030, 7.7, 1.3), (12.6, 5.8, 4.1)),
        ("C", (0.055, 24, 4.8), (36, 27, 6.7)),
    ],
)
def test_errors_are_those_of_the_note_and_as_stated(
    grade: str, gyro: tuple[float, ...], acc: tuple[float, ...], base: int
):
    found = scores(made_by.GRADES[grade], 60, base)
    for one, most in zip(found, (gyro, acc), strict=True):
        assert 0.85 < one.nees < 1.2
        assert (np.array(one[:3]) < 1.15 * np.array(most)).all(), one
