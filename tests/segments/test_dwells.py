"""Dwells on a centrifuge's arm: found, cut to whole turns, averaged with the noise of the turns."""

from dataclasses import replace
from math import pi

import numpy as np
import pytest
from tests.accuracy.arm_runs import Run, record
from tests.accuracy.centrifuge import EARTH, PAPER_G, RATES, Triad, full_circle
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.physics.sensors import Readout, Sensor, triad
from inercal.recordings import Finding, Recording
from inercal.recordings.segments import average_dwells, find_dwells

DEVICE = Triad()


def sensor() -> Sensor:
    return triad("triad", "f", "", Readout(1.25 / PAPER_G, 0.0, "V")).with_coefficients("k0")


def recording(run: Run, **changes: object) -> Recording:
    made = Recording(
        run.time,
        run.output,
        ("x", "y", "z"),
        ("V",) * 3,
        run.position,
        None,
        {"arm_rate": run.rate},
    )
    return replace(made, **changes)  # pyright: ignore[reportArgumentType]


def a_run(seed: int = 1, **options: object) -> Run:
    options = {"attitudes": full_circle()[:3]} | options
    return record(DEVICE, rng=np.random.default_rng(seed), **options)  # pyright: ignore


def test_each_attitude_has_a_dwell_at_each_rate_in_whole_turns():
    made = recording(a_run())
    dwells, left_out = find_dwells(made)
    assert not left_out
    names = [f"p0{k} at {rpm} rpm" for k in (1, 2, 3) for rpm in (60, 120, 180)]
    assert [dwell.mark.label for dwell in dwells] == names
    for dwell, rate in zip(dwells, RATES * 3, strict=True):
        assert dwell.rate == pytest.approx(rate)
        assert dwell.turns >= 8
        length = made.span(dwell.mark.start, dwell.mark.stop)
        assert length * rate / (2 * pi) == pytest.approx(dwell.turns, abs=rate / 50 / pi)


def test_a_dwell_holds_no_sample_on_the_way():
    run = a_run()
    for dwell in find_dwells(recording(run))[0]:
        assert np.ptp(run.rate[dwell.mark.start : dwell.mark.stop]) == 0


def test_a_lean_averages_out_over_whole_turns():
    """A lean of 1° swings each reading by 17 mg; cut to a sample, a turn keeps a hundredth."""
    upright, leaning = (
        average_dwells(recording(run), sensor(), find_dwells(recording(run))[0])[0].mean
        for run in (a_run(noise=0.0), a_run(noise=0.0, lean=(0.017, 0.0)))
    )
    assert np.abs(upright - leaning).max() < 2e-3 * PAPER_G / 8


@pytest.mark.slow
def test_noise_of_the_means_is_that_of_independent_samples():
    ratios: list[float] = []
    for seed in range(12):
        run = a_run(seed, noise=1e-4, attitudes=full_circle())
        made = recording(run)
        dwells, _ = find_dwells(made)
        seen, _ = average_dwells(made, sensor(), dwells)
        sd = 1e-4 * PAPER_G / 1.25 / np.sqrt(seen.samples)
        own = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
        ratios += (own / sd[:, None]).ravel().tolist()
    assert np.mean(ratios) == pytest.approx(1, abs=0.02)


def test_a_platform_that_turns_back_gives_the_curve_at_five_azimuths():
    # At a pole: elsewhere the earth's level rate swings the norm by some µg.
    run = a_run(noise=0.0, locked=False, latitude=pi / 2)
    made = recording(run)
    dwells, _ = find_dwells(made)
    seen, steps = average_dwells(made, sensor(), dwells, harmonics=2)
    assert len(steps) == 5 * len(dwells)
    assert steps[1].label == "p01 at 60 rpm, 72°"
    assert steps[1].azimuth == pytest.approx(2 * pi / 5)
    # What the curve reads is what a sensor reads there: the norm holds at each azimuth.
    output = sensor().to_output(seen.mean)
    u = (output - DEVICE.bias) / DEVICE.scale
    f = 2 * u / (1 + np.sqrt(1 + 4 * DEVICE.bend * u))
    a = (np.repeat([dwell.rate for dwell in dwells], 5) + EARTH) ** 2 / PAPER_G
    assert np.linalg.norm(f, axis=1) == pytest.approx(np.hypot(a, 1), rel=1e-7)


@pytest.mark.slow
def test_rows_at_azimuths_scatter_as_stated():
    whitened: list[np.ndarray] = []
    exact = a_run(noise=0.0, locked=False)
    mean = average_dwells(recording(exact), sensor(), find_dwells(recording(exact))[0], 2)[0].mean
    for seed in range(20):
        made = recording(a_run(seed, locked=False))
        seen, _ = average_dwells(made, sensor(), find_dwells(made)[0], harmonics=2)
        sd = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
        whitened.append((seen.mean - mean) / sd)
    assert np.mean(np.square(whitened)) == pytest.approx(1, abs=0.06)


def test_a_dwell_with_a_changing_rate_is_left_out_with_a_warning():
    """Over a long dwell 0.15 % a second stays below what a window shows, and adds up."""
    run = a_run(turns=40)
    made = recording(run)
    first = find_dwells(made)[0][0].mark
    creeping = run.rate.copy()
    inside = slice(first.start, first.stop)
    creeping[inside] *= 1 + 1.5e-3 * (made.time[inside] - made.time[first.start])
    dwells, left_out = find_dwells(recording(run, readback={"arm_rate": creeping}))
    assert first.start not in [dwell.mark.start for dwell in dwells]
    assert (left_out[0].severity, left_out[0].what) == ("warning", "dwell")
    assert left_out[0].start == first.start


def test_attitudes_read_back_are_those_of_positions():
    run = a_run()
    noise = 1e-5 * np.random.default_rng(2).standard_normal((2, run.time.size))
    own = np.unique(run.position, return_inverse=True)[1]
    psi, theta = (np.array([angles[k] for angles in full_circle()[:3]])[own] for k in (0, 1))
    said = {"arm_rate": run.rate, "psi": psi + noise[0], "theta": theta + noise[1]}
    dwells, _ = find_dwells(recording(run, readback=said))
    assert len({dwell.attitude for dwell in dwells}) == 3


def test_noise_of_all_rates_is_shared_by_its_density():
    """A few turns at each rate: a turn at 180 rpm is a third as long as one at 60 rpm."""
    ratios: list[list[float]] = []
    for seed in range(40):
        made = recording(a_run(seed, turns=4))
        dwells, _ = find_dwells(made)
        seen, _ = average_dwells(made, sensor(), dwells)
        sd = 1e-4 * PAPER_G / 1.25 / np.sqrt(seen.samples)
        variance = np.diagonal(seen.covariance, axis1=1, axis2=2).mean(axis=1)
        ratios.append((variance / sd**2).tolist())
    by_rate = np.mean(ratios, axis=0).reshape(3, 3).mean(axis=0)
    assert by_rate == pytest.approx([1, 1, 1], abs=0.08)


def test_gaps_cut_and_flaws_leave_out():
    run = a_run()
    made = recording(run)
    first = find_dwells(made)[0][0].mark
    middle = (first.start + first.stop) // 2
    late = np.where(np.arange(run.time.size) >= middle, run.time + 0.5, run.time)
    dwells, _ = find_dwells(replace(made, time=late))
    assert not any(d.mark.start < middle < d.mark.stop for d in dwells)
    flaw = Finding("warning", "saturation", "x is at its limit", "x", middle, middle + 3)
    dwells, left_out = find_dwells(replace(made, findings=(flaw,)))
    assert first.label not in [d.mark.label for d in dwells]
    assert (left_out[0].start, left_out[0].stop) == (first.start, first.stop)


def test_a_rate_that_is_nowhere_steady_is_refused():
    run = a_run()
    swinging = run.rate * (1 + 0.05 * np.sin(np.arange(run.rate.size) / 7))
    with refused(names=["arm_rate"]):
        find_dwells(recording(run, readback={"arm_rate": swinging}))
    with refused(names=["arm_rate"]):
        find_dwells(recording(run, readback={"arm_rate": 0 * run.rate}))


def test_too_few_turns_for_the_noise_are_refused():
    made = recording(a_run())
    dwells, _ = find_dwells(made)
    with refused(names=()):
        average_dwells(made, sensor(), dwells[:1])


def test_a_dwell_that_returns_is_named_apart():
    made = recording(a_run(rates=[RATES[0], RATES[1], RATES[0]]))
    labels = [dwell.mark.label for dwell in find_dwells(made)[0]]
    assert labels[:3] == ["p01 at 60 rpm", "p01 at 120 rpm", "p01 at 60 rpm (2)"]


@pytest.mark.parametrize(("size", "named"), [(1e-3, True), (1.0, False)])
def test_times_too_short_for_any_dwell_name_their_unit(size: float, named: bool):
    made = recording(a_run())
    creeping = made.readback["arm_rate"] * np.linspace(1, 9, made.time.size)
    made = replace(made, time=size * made.time, readback={"arm_rate": creeping})
    with pytest.raises(InputError) as caught:
        find_dwells(made)
    assert ("time_unit" in str(caught.value)) == named
