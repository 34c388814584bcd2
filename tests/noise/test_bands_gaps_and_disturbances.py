"""What is left out of a fit, the Allan deviation across gaps, and K with and without a step."""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.base_seeds import SEEDS, evidence
from tests.noise.generator import DEG_H, MEMS, draw
from tests.refusals import refused

import inercal
from inercal.basics.errors import InputError
from inercal.noise.pieces import Part, gap_oadev
from inercal.noise.sensor_noise import require_stated
from inercal.noise.texts import channel_remarks
from inercal.recordings import Recording
from inercal.recordings.io.audit import audit

STEP = 40.0  # °/h


def recording(y: np.ndarray, dt: float) -> Recording:
    return Recording(dt * np.arange(float(y.size)), y[:, None], ("gx",), ("rad/s",))


def vibrating(low: float, high: float) -> Recording:
    """Return white noise with nine times its power from `low` to `high`, Hz."""
    n, dt = 32768, 0.02
    spectrum = np.fft.rfft(np.random.default_rng(3).standard_normal(n))
    f = np.fft.rfftfreq(n, dt)
    y = np.fft.irfft(spectrum * np.where((f > low) & (f < high), 3.0, 1.0), n)
    return recording(y * DEG_H, dt)


def test_a_band_that_is_skipped_leaves_n_as_it_is_without_the_vibration():
    readings, true = vibrating(4, 5), DEG_H * np.sqrt(0.02)
    (whole,) = inercal.analyse_noise(readings, terms="N", kinds=()).channels
    (found,) = inercal.analyse_noise(
        readings, terms="N", kinds=(), skipped_bands=[(3.9, 5.1)]
    ).channels
    assert not whole.goodness.fits
    assert whole.goodness.worst_band == pytest.approx((4, 5), abs=0.2)
    assert any("--skip-band" in one for one in channel_remarks(whole))
    below = replace(whole, band=2.0)  # the fit already stops below the vibration
    assert not any("--skip-band" in one for one in channel_remarks(below))
    assert whole.value("N") > 1.1 * true
    assert found.value("N") == pytest.approx(true, rel=0.01)
    assert found.goodness.worst_band is None
    assert not ((found.bins.frequency > 4.2) & (found.bins.frequency < 4.8)).any()


def test_bands_that_leave_nothing_are_refused():
    with pytest.raises(InputError, match="excludes all"):
        inercal.analyse_noise(vibrating(4, 5), skipped_bands=[(0, 30)])


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_k_is_stated_with_a_step_and_without_it(seed: int):
    y = draw(MEMS, 700 + seed)[0]
    y[round(4040 / MEMS.dt) :] += STEP * DEG_H
    kept, skipped = (
        inercal.analyse_noise(recording(y, MEMS.dt), kinds=(), keep_disturbed=one, terms="NBK")
        for one in (True, False)
    )
    (text,) = [one for one in kept.channels[0].remarks if one.startswith("K is")]
    (other,) = [one for one in skipped.channels[0].remarks if one.startswith("K is")]
    with_step, without = (float(x) for x in re.findall(r"(\d+\.?\d*) °/h/√s", text))
    assert other.startswith(text.split(";")[0])
    # The note: a step of 40 °/h that is not noticed makes K 1.8 times as large.
    assert 1.3 < with_step / MEMS.walk < 3.0
    assert without < 0.8 * with_step
    unit = kept.channels[0].coefficients[2].size
    assert kept.channels[0].value("K") / unit == pytest.approx(with_step, rel=0.01)
    assert skipped.channels[0].value("K") / unit == pytest.approx(without, rel=0.01)


def parted(y: np.ndarray, dt: float, count: int, lost: int) -> list[Part]:
    """Return `count` + 1 pieces with `lost` samples missing between them."""
    each = (y.size - count * lost) // (count + 1)
    starts = [k * (each + lost) for k in range(count + 1)]
    return [Part(y[a : a + each], a * dt) for a in starts]


@pytest.mark.slow
@pytest.mark.parametrize(("count", "lost"), [(20, 240), evidence(4, 3600)])
def test_the_allan_deviation_across_gaps_is_that_of_the_terms_within_2_percent(
    count: int, lost: int
):
    recordings = (draw(MEMS, 5000 + seed)[0] for seed in range(40))
    tables = [gap_oadev(parted(y, MEMS.dt, count, lost), MEMS.dt, "octave") for y in recordings]
    found = [one.value**2 / DEG_H**2 for one in tables]
    long, tau = tables[-1].edf > 100, tables[-1].tau
    true = MEMS.white**2 / tau + 0.4413 * MEMS.flicker**2 + MEMS.walk**2 * tau / 3
    ratio = np.sqrt(np.mean(found, axis=0) / true)
    assert np.abs(ratio[long] - 1).max() < 0.02
    # Averaging times go on past the longest piece.
    assert tau[-1] > 2 * (MEMS.n // (count + 1)) * MEMS.dt / 2


def test_without_gaps_the_allan_deviation_of_pieces_is_that_of_the_whole():
    y = draw(replace(MEMS, n=8192), 1)[0]
    whole = inercal.noise.deviations(y, MEMS.dt)
    found = gap_oadev([Part(y[:3000], 0.0), Part(y[3000:], 3000 * MEMS.dt)], MEMS.dt, "octave")
    assert np.allclose(found.value, whole.value, rtol=1e-9)
    assert np.allclose(found.edf, whole.edf, rtol=1e-9)


def test_a_band_above_half_the_rate_is_refused():
    with refused(InputError, key="--skip-band"):
        inercal.analyse_noise(vibrating(4, 5), terms="N", kinds=(), skipped_bands=[(30, 60)])


def shaken(seconds: float) -> Recording:
    """Return white noise with a burst of 30 times its size after 200 s."""
    dt = 0.02
    rng = np.random.default_rng(8)
    y = rng.standard_normal(32768)
    start, stop = round(200 / dt), round((200 + seconds) / dt)
    y[start:stop] += 30 * rng.standard_normal(stop - start)
    return recording(y * DEG_H, dt)


@pytest.mark.slow
def test_noise_that_the_disturbed_times_change_by_more_than_u_is_not_to_be_relied_on():
    analysis = inercal.analyse_noise(shaken(1.0), terms="N", kinds=())
    assert analysis.channels[0].disturbed
    with refused(InputError, names=("gx",)):
        require_stated(analysis)
    quiet = inercal.analyse_noise(shaken(1.0), terms="N", kinds=(), keep_disturbed=False)
    assert quiet.channels[0].value("N") == pytest.approx(DEG_H * np.sqrt(0.02), rel=0.02)
    for calm in (quiet, inercal.analyse_noise(shaken(0.0), terms="N", kinds=())):
        assert not calm.channels[0].disturbed
        require_stated(calm)


def warm_ups_suspected(size: float, seeds: range) -> int:
    """Return in how many recordings with a warm-up, °/h, K is doubted, beside a ramp as well."""
    truth, found = replace(MEMS, n=16384, dt=1.0), 0
    warm = size * DEG_H * np.exp(-4.5 * np.linspace(0.0, 1.0, truth.n))
    for seed in seeds:
        y = draw(truth, seed)[0] + warm
        (channel,) = inercal.analyse_noise(recording(y, truth.dt), kinds=(), terms="NBK").channels
        found += any("warm up" in one for one in channel.remarks)
    return found


@pytest.mark.slow
def test_a_warm_up_is_suspected_and_a_random_walk_is_not():
    assert warm_ups_suspected(200.0, range(3)) == 3
    assert warm_ups_suspected(0.0, range(6)) == 0


@pytest.mark.evidence
def test_random_walks_rarely_look_like_a_warm_up():
    # 99.9 % of a binomial of 200 with 1 %.
    assert warm_ups_suspected(0.0, range(9000, 9200)) <= 8


@pytest.mark.parametrize("what", ["stuck", "saturation"])
def test_the_noise_of_a_stuck_or_clipped_channel_is_not_to_be_relied_on(what: str):
    x = np.round(np.random.default_rng(5).normal(scale=2.1, size=(20_000, 2)))
    if what == "stuck":
        x[9000:11_000, 1] = x[9000, 1]
    else:
        x[:, 1] = np.minimum(x[:, 1], 2.0)
    time = np.arange(20_000) / 50
    audited = audit(Recording(time, 1e-3 * x, ("gx", "gy"), ("rad/s",) * 2))
    found = inercal.analyse_noise(audited, terms="N", kinds=())
    assert [bool(one.disturbed) for one in found.channels] == [False, True]
    with pytest.raises(InputError, match="gy"):
        require_stated(found)
