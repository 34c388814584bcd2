"""Sections tested against themselves: what noise alone makes of the statistics, and what shows."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from numpy.typing import NDArray

from inercal.estimation.correlation import WHITE, Contrasts, NoiseCorrelation
from inercal.estimation.section_statistics import (
    SectionStatistics,
    analyse_sections,
    haar_contrasts,
)

Array = NDArray[np.float64]
SECONDS, SAMPLES = 10.0, 1000
NAMES = ("x", "y", "z")
LABELS = tuple("abcdef")


def white(rng: np.random.Generator, *, n: int = SAMPLES) -> list[Array]:
    """Return six sections of three channels, of standard deviations 1, 2 and 0.1."""
    return [rng.standard_normal((n, 3)) * [1.0, 2.0, 0.1] for _ in LABELS]


def markov(rng: np.random.Generator, tau: float) -> list[Array]:
    """Return sections of a first-order process, six slices of one long series."""
    keep = np.exp(-SECONDS / SAMPLES / tau)
    noise = rng.standard_normal((7 * SAMPLES, 3)) * np.sqrt(1 - keep**2)
    series = np.empty_like(noise)
    state = rng.standard_normal(3)
    for k, step in enumerate(noise):
        state = keep * state + step
        series[k] = state
    return [series[k * SAMPLES : (k + 1) * SAMPLES] for k in range(len(LABELS))]


def judged(sections: Sequence[Array], rounding: Array | None = None) -> SectionStatistics:
    return analyse_sections(cut(sections), LABELS, NAMES, rounding)


def cut(sections: Sequence[Array], seconds: float = SECONDS) -> Contrasts:
    return haar_contrasts(sections, np.full(len(sections), seconds))


def test_contrasts_of_white_noise_have_the_variance_of_a_sample() -> None:
    found = cut([np.random.default_rng(1).standard_normal((160_000, 3)) * 3.0], 1.0)
    every = np.concatenate(found.levels, axis=1)[0]
    assert every.shape == (15, 3)
    assert np.mean(every**2) == pytest.approx(9.0, rel=4 * np.sqrt(2 / every.size))


def test_a_trend_of_one_per_second_has_its_reach() -> None:
    time = (np.arange(SAMPLES) + 0.5) * SECONDS / SAMPLES
    found = cut([np.repeat(time[:, None], 3, axis=1)])
    assert found.slope[0] == pytest.approx(found.slope_per_trend[0], rel=1e-9)


@pytest.mark.slow
def test_white_noise_is_rejected_as_often_as_the_level_says() -> None:
    rng = np.random.default_rng(2)
    p = np.array([[t.p_value for t in judged(white(rng)).tests] for _ in range(200)])
    assert p.shape == (200, 2)
    band = 4 * np.sqrt(0.05 * 0.95 / 200)
    assert np.mean(p < 0.05, axis=0) == pytest.approx(0.05, abs=band)
    assert np.mean(p < 0.001) < 0.015


# By chance a tenth of a section looks like a random walk within it in 2.5 % of all recordings.
@pytest.mark.slow
@pytest.mark.parametrize(("tau", "most"), [(0.05, 1), (1.0, 4)])
def test_correlated_noise_is_found_and_rejects_nothing(tau: float, most: int) -> None:
    rng = np.random.default_rng(3)
    predicted: list[float] = []
    means: list[Array] = []
    rejected = 0
    for _ in range(40):
        sections = markov(rng, tau)
        found = judged(sections)
        means += [one.mean(axis=0) for one in sections]
        pooled = np.mean([contrast**2 for one in sections for contrast in levels(one)])
        typical = np.mean(found.correlation.contrast_variance_ratio(blocks()))
        seconds = np.array([SECONDS])
        predicted.append(
            float(pooled / typical * found.correlation.mean_variance_ratio(seconds)[0] / SAMPLES)
        )
        rejected += min(test.p_value for test in found.tests) < 0.001
    # The tail of what is extrapolated is long.
    assert np.median(predicted) == pytest.approx(np.mean(np.array(means) ** 2), rel=0.25)
    assert rejected <= most


@pytest.mark.slow
@pytest.mark.parametrize("tau", [10.0, 30.0, 100.0])
def test_noise_slower_than_the_sections_rejects_the_model(tau: float) -> None:
    rng = np.random.default_rng(7)
    found = [judged(markov(rng, tau)) for _ in range(40)]
    named = [one.long_test for one in found if one.long_test is not None]
    assert len(named) >= 0.7 * len(found)
    assert all(test.p_value < 1e-6 for test in named)


def levels(section: Array) -> list[Array]:
    return [row for level in cut([section]).levels for row in level[0]]


def blocks() -> Array:
    """Return the block of each of the fifteen contrasts, s."""
    return np.concatenate([np.full(2 ** (k - 1), SECONDS / 2**k) for k in range(1, 5)])


@pytest.mark.parametrize("size", [6.0, 60.0])
def test_a_step_in_half_of_a_section_names_the_section_and_the_channel(size: float) -> None:
    rng = np.random.default_rng(4)
    for _ in range(10):
        sections = white(rng)
        k, a = rng.integers(6), rng.integers(3)
        sd = np.array([1.0, 2.0, 0.1])[a] * np.sqrt(4 / SAMPLES)  # of a difference of halves
        sections[k][SAMPLES // 2 :, a] += (size + 1.5) * sd
        change = judged(sections).tests[0]
        assert change.p_value < 1e-3
        assert change.name == f"change within {LABELS[k]} ({NAMES[a]})"


@pytest.mark.parametrize(("place", "words"), [(-1, "at the end of"), (0, "at the start of")])
def test_rows_of_another_attitude_at_an_end_of_a_section_are_placed(place: int, words: str) -> None:
    sections = white(np.random.default_rng(6))
    sections[2][place, 0] += 300.0
    within = judged(sections).within
    assert within is not None
    assert within.name == f"burst {words} {LABELS[2]} ({NAMES[0]})"


def test_a_trend_common_to_all_sections_is_named_and_measured() -> None:
    rng = np.random.default_rng(5)
    time = (np.arange(SAMPLES) / SAMPLES - 0.5) * SECONDS
    sections = [one + np.outer(time, [0.0, 0.1, 0.0]) for one in white(rng)]
    found = judged(sections)
    assert found.tests[1].p_value < 1e-4
    assert found.tests[1].name.endswith("(y)")
    assert found.trend[1] == pytest.approx(0.1, abs=4 * found.trend_sd[1])
    # The root mean square over three channels, of which one drifts, in units of noise.
    assert found.significant_trend_sd[1] == pytest.approx(0.1 / np.sqrt(3), rel=0.3)


def test_a_section_of_other_noise_has_its_own_variance_and_is_no_change() -> None:
    rng = np.random.default_rng(6)
    ratios: list[float] = []
    least = 1.0
    for _ in range(20):
        sections = white(rng)
        sections[2] = 12.0 * sections[2]
        found = judged(sections)
        ratios.append(float(found.scale[2] / np.median(found.scale)))
        least = min(least, *(test.p_value for test in found.tests))
    assert np.median(ratios) == pytest.approx(144.0, rel=0.25)
    assert least > 1e-3


def test_sections_of_one_noise_share_their_variance() -> None:
    rng = np.random.default_rng(7)
    scatter = np.mean([judged(white(rng)).scale.std() for _ in range(20)])
    assert scatter < 0.5 * np.sqrt(2 / 36)  # that of 12 contrasts in each of three channels


def test_constant_sections_and_channels_reject_nothing() -> None:
    rng = np.random.default_rng(8)
    sections = white(rng)
    sections[1][:] = 3.0
    for one in sections:
        one[:, 2] = 1.0
    found = judged(sections)
    assert all(0.001 < test.p_value <= 1.0 for test in found.tests)
    assert np.isfinite(found.scale).all()
    assert judged([np.ones((SAMPLES, 3))] * 6).tests == ()


def test_a_change_below_the_rounding_of_coarse_steps_rejects_nothing() -> None:
    rng = np.random.default_rng(9)
    q = 40.0
    sections = white(rng)
    for one in sections:
        one *= 0.05
    sections[3][SAMPLES // 2 :, 0] += 0.2 * q
    coarse = np.full(3, q**2 / 12)
    assert judged(sections).tests[0].p_value < 1e-6
    assert judged(sections, coarse).tests[0].p_value > 0.01


def test_the_scatter_of_batches_of_white_noise_is_that_of_samples() -> None:
    seconds = np.array([3.0, 10.0])
    assert WHITE.batch_variance_ratio(seconds, 20) == pytest.approx(1.0)
    # A correlation far shorter than a batch adds its whole density.
    assert NoiseCorrelation(5.0, 1e-5).batch_variance_ratio(seconds, 20) == pytest.approx(
        6.0, rel=1e-3
    )
    assert NoiseCorrelation(5.0, 1e-5).mean_variance_ratio(seconds) == pytest.approx(6.0, rel=1e-3)


FLICKER = 3.0 * np.sqrt(np.pi / np.log(4 * SAMPLES))  # B of a series of standard deviation 3


def flicker(rng: np.random.Generator) -> list[Array]:
    """Return six slices of one series whose power falls with frequency, and white noise."""
    n = 8 * SAMPLES
    spectrum = rng.standard_normal((2, n // 2, 3)) / np.sqrt(np.arange(1, n // 2 + 1))[:, None]
    slow = np.fft.irfft(
        np.concatenate([np.zeros((1, 3)), spectrum[0] + 1j * spectrum[1]]), n, axis=0
    )
    series = 3.0 * slow / slow.std() + rng.standard_normal((n, 3))
    return [series[k * SAMPLES : (k + 1) * SAMPLES] for k in range(len(LABELS))]


def walk(rng: np.random.Generator) -> list[Array]:
    """Return six slices of a random walk, K = 1 per √s, and white noise."""
    steps = rng.standard_normal((6 * SAMPLES, 3)) * np.sqrt(SECONDS / SAMPLES)
    series = np.cumsum(steps, axis=0) + rng.standard_normal((6 * SAMPLES, 3))
    return [series[k * SAMPLES : (k + 1) * SAMPLES] for k in range(len(LABELS))]


def judged_given(sections: Sequence[Array], b: float, k: float) -> SectionStatistics:
    """Return the statistics of sections whose slow noise is stated."""
    relative = cut(sections).relative_to_slow_noise(np.full(3, b), np.full(3, k))
    return analyse_sections(relative, LABELS, NAMES)


@pytest.mark.slow
@pytest.mark.parametrize(("series", "b", "k"), [(flicker, FLICKER, 0.0), (walk, 0.0, 1.0)])
def test_stated_slow_noise_is_rejected_no_more_often_than_the_level_says(
    series: Callable[[np.random.Generator], list[Array]], b: float, k: float
) -> None:
    rng = np.random.default_rng(10)
    found = [judged_given(series(rng), b, k) for _ in range(60)]
    assert sum(one.correlation is not WHITE for one in found) <= 3
    p = np.array([[t.p_value for t in one.tests[:2]] for one in found])
    assert np.mean(p < 0.05, axis=0).max() < 0.05 + 4 * np.sqrt(0.05 * 0.95 / 60)
    assert sum(one.long_test is not None for one in found) <= 3
    # The same noise, stated too small by a factor of five, does not look like stated noise.
    less = [judged_given(series(rng), b / 5, k / 5) for _ in range(10)]
    assert all(one.correlation is not WHITE for one in less)
    assert (sum(one.long_test is not None for one in less) >= 8) == (k > 0)


def test_a_change_and_a_drift_beyond_the_stated_slow_noise_are_found() -> None:
    rng = np.random.default_rng(11)
    sections = flicker(rng)
    sections[4][SAMPLES // 2 :, 1] += 40.0
    within = judged_given(sections, FLICKER, 0.0).within
    assert within is not None
    assert within.name == "change within e (y)"
    assert within.p_value < 1e-3
    time = np.arange(SAMPLES)[:, None] / SAMPLES
    drifting = [one + 6.0 * time * [0, 1, 0] for one in flicker(rng)]
    common = judged_given(drifting, FLICKER, 0.0).trend_test
    assert common is not None
    assert common.name == "drift common to all sections (y)"
    assert common.p_value < 1e-3
