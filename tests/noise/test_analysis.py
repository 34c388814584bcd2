"""From simulated recordings to coefficients, refusals and remarks."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.noise.generator import DEG_H, MEMS, Truth, draw

import inercal
from inercal.basics.errors import InputError
from inercal.noise import NoiseAnalysis
from inercal.noise.channel_noise import ChannelNoise, NoiseCoefficient
from inercal.noise.coefficients import length_for
from inercal.recordings import Recording


def recording(y: np.ndarray, dt: float, unit: str = "rad/s") -> Recording:
    y = np.atleast_2d(y)
    names = tuple("g" + axis for axis in "xyzuvw"[: len(y)])
    return Recording(dt * np.arange(y.shape[1]), y.T, names, (unit,) * len(y))


def coefficient(analysis: NoiseAnalysis, symbol: str, channel: int = 0) -> NoiseCoefficient:
    return coefficient_of(analysis.channels[channel], symbol)


def coefficient_of(channel: ChannelNoise, symbol: str) -> NoiseCoefficient:
    found = channel.coefficient(symbol)
    assert found is not None
    return found


@pytest.mark.slow
def test_a_mems_gyro_is_found_within_three_uncertainties():
    analysis = inercal.analyse_noise(recording(draw(MEMS, 4)[0], MEMS.dt))
    assert analysis.channels[0].fit.symbols == ("N", "B", "K")
    for symbol, true in (("N", MEMS.white), ("B", MEMS.flicker), ("K", MEMS.walk)):
        found = coefficient(analysis, symbol)
        assert abs(found.value - true * DEG_H) < 3 * found.u
        assert found.low < true * DEG_H < found.high
    assert analysis.channels[0].goodness.fits


def test_values_do_not_depend_on_the_unit_of_the_readings():
    y = draw(replace(MEMS, n=8192), 4)[0]
    one = inercal.analyse_noise(recording(y, 0.25), terms="NBK", kinds=())
    other = inercal.analyse_noise(recording(np.degrees(y), 0.25, "°/s"), terms="NBK", kinds=())
    assert coefficient(one, "N").value == pytest.approx(coefficient(other, "N").value, rel=1e-6)


def test_an_accelerometer_is_stated_in_micro_g():
    truth = Truth(16384, 0.01, 100.0, unit=9.80665e-6)
    analysis = inercal.analyse_noise(recording(draw(truth, 1)[0], 0.01, "m/s²"))
    white = coefficient(analysis, "N")
    assert white.unit == "µg/√Hz"
    assert white.value / white.size == pytest.approx(100, rel=0.03)


def test_readings_rounded_to_coarse_steps_are_refused_below_0_4_and_named_below_1_5():
    rng = np.random.default_rng(3)
    y = rng.standard_normal(20_000)
    with pytest.raises(InputError, match="rounding hides the noise"):
        inercal.analyse_noise(recording(np.round(y * 0.3), 0.01))
    fine = inercal.analyse_noise(recording(np.round(y * 0.45), 0.01), terms="N", kinds=())
    assert any("rounding steps" in text for text in fine.channels[0].remarks)
    middle = inercal.analyse_noise(recording(np.round(y * 0.6), 0.01), terms="N", kinds=())
    # The rounding adds a variance of 1/12: N is √(1 + 1/(12 · 0.36)) times too large.
    assert any("1.11 times too large" in text for text in middle.channels[0].remarks)
    # At 2 steps it adds 1 %, and u(N) of 20 000 samples is 0.5 %.
    finer = inercal.analyse_noise(recording(np.round(y * 2), 0.01), terms="N", kinds=())
    assert any("adds 1 % to N" in text for text in finer.channels[0].remarks)
    finest = inercal.analyse_noise(recording(np.round(y * 5), 0.01), terms="N", kinds=())
    assert not any("rounding" in text for text in finest.channels[0].remarks)


def test_fewer_than_64_samples_are_refused():
    with pytest.raises(InputError, match="64"):
        inercal.analyse_noise(recording(np.random.default_rng(1).standard_normal(63), 1.0))


def test_a_unit_that_is_no_rate_and_no_acceleration_is_refused():
    with pytest.raises(InputError, match="'V'"):
        inercal.analyse_noise(recording(np.random.default_rng(1).standard_normal(99), 1.0, "V"))


def test_terms_that_do_not_exist_are_refused():
    y = np.random.default_rng(1).standard_normal(256)
    with pytest.raises(InputError, match="'NX'"):
        inercal.analyse_noise(recording(y, 1.0), terms="NX")


def test_bias_instability_that_white_noise_covers_at_all_averaging_times_has_only_a_limit():
    truth = replace(MEMS, n=512, dt=0.01, flicker=1.0, walk=0.0)
    analysis = inercal.analyse_noise(recording(draw(truth, 3)[0], truth.dt), terms="NB")
    found = coefficient(analysis, "B")
    assert found.is_limit
    assert found.high > 0


@pytest.mark.slow
def test_a_term_that_comes_out_zero_has_an_upper_limit_above_the_truth():
    truth = replace(MEMS, n=2048)
    limits: list[float] = []
    for seed in range(16):
        analysis = inercal.analyse_noise(
            recording(draw(truth, seed)[0], truth.dt), terms="NBK", kinds=()
        )
        found = coefficient(analysis, "K")
        if found.is_limit:
            assert (found.low, found.u) == (0, np.inf)
            limits.append(found.high / (truth.walk * DEG_H))
    assert len(limits) >= 3
    # A limit of 95 % may lie below the truth in one of so few.
    assert sum(limit < 1 for limit in limits) <= 1
    assert max(limits) < 20


@pytest.mark.parametrize(
    ("white", "flicker", "walk", "dt", "hours"),
    [
        (36, 20, 1.5, 0.01, (0.19, 2.5, 0.44)),
        (9, 5, 0.2, 0.25, (0.18, 7.8, 1.4)),
        (3, 0.5, 0.01, 1, (2.0, 34, 6.0)),
        (3, 0.3, 0.006, 1, (6.2, 38, 6.9)),
        (0.18, 0.02, 0.0003, 1, (4.6, 61, 11)),
    ],
)
def test_lengths_of_recordings_are_those_of_the_note(
    white: float, flicker: float, walk: float, dt: float, hours: tuple[float, float, float]
):
    variances = {"N": white**2, "B": flicker**2, "K": walk**2}
    wanted = (("B", 0.1), ("K", 0.2), ("K", 0.5))
    for (symbol, relative), expected in zip(wanted, hours, strict=True):
        found = length_for(variances, dt, symbol, relative) / 3600
        assert found == pytest.approx(expected, rel=0.15)


@pytest.mark.slow
def test_lost_single_samples_are_closed_up_and_long_gaps_part_the_recording():
    y = draw(replace(MEMS, n=8192), 1)[0]
    whole = recording(y, 0.25)
    rng = np.random.default_rng(2)
    single = np.ones(y.size, dtype=bool)
    single[rng.choice(y.size - 2, 60, replace=False) + 1] = False
    found = inercal.analyse_noise(whole.take(single), terms="N", kinds=())
    assert found.remarks[0].startswith("60 lost samples")
    long = np.ones(y.size, dtype=bool)
    long[3000:3240] = False
    parted = inercal.analyse_noise(whole.take(long), terms="N", kinds=())
    assert "2 pieces" in parted.remarks[0]
    assert len(parted.channels[0].bins.spectra) == 2
    both = inercal.analyse_noise(whole.take(single & long), terms="N", kinds=())
    assert both.remarks[0].startswith("58 lost samples")
    assert len(both.channels[0].bins.spectra) == 2


def test_the_band_of_a_vibration_is_named_with_its_power():
    rng = np.random.default_rng(3)
    n, dt = 32768, 0.02
    spectrum = np.fft.rfft(rng.standard_normal(n))
    f = np.fft.rfftfreq(n, dt)
    y = np.fft.irfft(spectrum * np.where((f > 4) & (f < 5), 3.0, 1.0), n)
    (found,) = inercal.analyse_noise(recording(y * DEG_H, dt), terms="N", kinds=()).channels
    assert not found.goodness.fits
    worst = max(found.goodness.decades, key=lambda one: one.mean_square)
    assert (worst.worst_low, worst.worst_high) == pytest.approx((4, 5), abs=0.2)
    white = found.value("N") ** 2 / DEG_H**2 / dt
    # The bins at both ends hold half of the band each.
    assert worst.level == pytest.approx(9 / white, rel=0.2)


@pytest.mark.slow
def test_gmwm_is_reported_only_where_it_is_possible():
    y = draw(replace(MEMS, n=4096), 1)[0]
    whole = recording(y, 0.25)
    (one,) = inercal.analyse_noise(whole, terms="NB", method="gmwm").channels
    assert one.method == "gmwm"
    assert coefficient_of(one, "N").value == one.comparison["gmwm"]["N"][0]
    kept = np.ones(y.size, dtype=bool)
    kept[1000:1240] = False
    (parted,) = inercal.analyse_noise(whole.take(kept), terms="NB", method="gmwm").channels
    assert parted.method == "likelihood"
    assert any("gmwm" in text for text in parted.remarks)


@pytest.mark.slow
def test_estimates_do_not_depend_on_the_averaging_times_that_are_reported():
    y = recording(draw(replace(MEMS, n=2048), 1)[0], 0.25)
    octave, every = (
        inercal.analyse_noise(y, spacing=one, kinds=(), terms="NB").channels[0]
        for one in ("octave", "all")
    )
    assert octave.comparison == every.comparison
    assert (octave.oadev.tau.size, every.oadev.tau.size) == (11, 1024)


def test_a_disturbance_at_the_start_is_left_out_with_its_temperature():
    y = draw(replace(MEMS, n=8192), 1)[0]
    y[8:48] += 3e-4 * np.random.default_rng(1).standard_normal(40)
    temperature = 290 + np.sin(np.arange(y.size) / 900)
    readings = replace(recording(y, 0.25), temperature=temperature)
    (found,) = inercal.analyse_noise(readings, terms="NB", keep_disturbed=False).channels
    assert [one.kind for one in found.disturbances] == ["burst"]
    assert y.size - 120 < found.n < y.size - 40


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size"), [evidence("ramp", 0.2), ("temperature", 50.0)])
def test_drift_is_found_within_three_uncertainties_and_no_walk_takes_its_place(
    name: str, size: float
):
    y = draw(replace(MEMS, n=8192, walk=0.0), 3)[0]
    time = MEMS.dt * np.arange(y.size)
    temperature = 300 + np.sin(time / 300)
    follows = {"ramp": time, "temperature": temperature - 300}[name]
    plain, drifted = (
        inercal.analyse_noise(replace(recording(one, MEMS.dt), temperature=temperature), kinds=())
        for one in (y, y + size * DEG_H * follows)
    )
    assert not plain.channels[0].drift
    (found,) = drifted.channels[0].drift
    assert found.name == name
    assert abs(found.value - size * DEG_H) < 3 * found.u < 0.5 * size * DEG_H
    assert drifted.channels[0].fit.symbols == plain.channels[0].fit.symbols == ("N", "B")


@pytest.mark.slow
def test_the_example_in_python_runs(capsys: pytest.CaptureFixture[str]):
    example = Path(__file__).parents[2] / "examples" / "noise_in_python.py"
    runpy.run_path(str(example))
    assert capsys.readouterr().out.count("white noise") == 3
