"""The classical least-squares line of rate tests, its hysteresis, and the range of a calibration.

Devices are of a generator that imports nothing of inercal, `platform_devices`.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.methods.platform_devices import (
    EXACT,
    FULL,
    MID,
    READ,
    Devices,
    Row,
    Table,
    devices,
    plan,
)
from tests.refusals import refused

from inercal.basics.units import Measured
from inercal.benches.characteristics import Characteristic
from inercal.benches.rate_platform import RatePlatform
from inercal.benches.rate_platform.linearity import gyro_characteristics, speed_scales
from inercal.benches.rate_platform.sections import RateDwell
from inercal.estimation import Estimate, Gaussian
from inercal.methods import METHODS
from inercal.methods.rates_and_poses import least_squares_line
from inercal.physics.sensors import Sensor, triad
from inercal.pipeline import apply, apply_data_columns, calibrate, simulate
from inercal.recordings import Observations
from inercal.recordings.io.write import write_recording
from inercal.runfile import read

LINEAR = ("bias", "scale", "delta_o", "delta_p")
LATITUDE = float(np.radians(50.0))


def bench(table: Table, latitude: float = LATITUDE) -> RatePlatform:
    return RatePlatform(Measured(9.81, 1e-4), Measured(latitude, 0.0), **table.stated())


def steps_of(rows: list[Row]) -> list[RateDwell]:
    return [
        RateDwell(f"{k} {row.name}", row.name, row.rate, row.seconds, row.setting)
        for k, row in enumerate(rows)
    ]


def seen(made: Devices, device: int) -> Observations:
    r = len(made.rows)
    return Observations(
        labels=tuple(step.label for step in steps_of(made.rows)),
        mean=made.reading[device],
        covariance=made.sd[:, None, None] ** 2 * np.eye(3),
        duration=np.array([row.seconds for row in made.rows]),
        samples=np.ones(r, dtype=np.int64),
        time=np.arange(r, dtype=float),
        channels=("gx", "gy", "gz"),
        timed=False,
    )


def lined(
    made: Devices, device: int = 0, terms: tuple[str, ...] = LINEAR, **changes: object
) -> tuple[Estimate, Sensor]:
    sensor = replace(triad("t", "w", "g").with_coefficients(*terms), **changes)
    solve = METHODS["rates_and_poses"].estimator("ieee")
    return solve(seen(made, device), sensor, bench(READ), steps_of(made.rows)), sensor


def test_the_line_is_that_of_numpy_and_its_uncertainty_that_of_noise():
    """Of a table without errors."""
    rng, n = np.random.default_rng(1), 30
    made = devices(MID, "T", EXACT, LINEAR, n, rng)
    sensor, steps = triad("t", "w", "g").with_coefficients(*LINEAR), steps_of(MID)
    used = np.arange(3 * len(MID))
    found = [least_squares_line(seen(made, k), sensor, bench(READ), steps, used) for k in range(n)]
    for i, axis in enumerate("xyz"):
        for term in LINEAR[1:]:
            at = found[0].names.index(f"g{axis}.{term}")
            off = np.array([one.value[at] for one in found]) - made.truth[term][:, i]
            sd = found[0].std[at]
            assert 0.7 < np.sqrt(np.mean(off**2)) / sd < 1.3
    # All rows of one axis up, rates symmetric: the slope does not depend on the intercept.
    own = [k for k, row in enumerate(MID) if row.axis == 0]
    rate = np.array([MID[k].rate for k in own])
    slope = np.polyfit(rate, made.reading[0][own, 0], 1)[0]
    scale = found[0].value[found[0].names.index("gx.scale")]
    assert 1 + scale == pytest.approx(slope, abs=1e-9)


def test_the_line_says_that_the_bench_is_taken_as_exact_and_tests_the_readings():
    made = devices(MID, "T", READ, LINEAR, 1, np.random.default_rng(2))
    found, sensor = lined(made)
    assert any("bench as exact" in note for note in found.notes)
    ml = METHODS["rates_and_poses"].estimator("ml")
    whole = ml(seen(made, 0), sensor, bench(READ), steps_of(made.rows))
    at = [found.names.index(f"g{a}.scale") for a in "xyz"]
    assert np.all(found.std[at] < whole.std[at])
    assert found.tests[0].statistic == pytest.approx(float(whole.chi2))


def test_what_the_line_cannot_use_is_refused():
    made = devices(MID, "T", READ, LINEAR, 1, np.random.default_rng(2))
    with refused(key="[sensor] form"):
        lined(made, form="tilted")
    sensor = triad("t", "w", "g").with_coefficients(*LINEAR)
    solve = METHODS["rates_and_poses"].estimator("ieee")
    prior = Gaussian.independent(("gx.scale",), [0.0], [1e-3])
    with refused(key="priors"):
        solve(seen(made, 0), sensor, bench(READ), steps_of(made.rows), [prior])


def found(made: Devices, device: int, rows: list[Row]) -> dict[tuple[str, str], Characteristic]:
    sensor = triad("t", "w", "g").with_coefficients(*LINEAR)
    own = gyro_characteristics(seen(made, device), sensor, bench(READ), steps_of(rows))
    return {(one.axis, one.name): one for one in own}


@pytest.mark.slow
def test_a_hysteresis_is_found_with_its_uncertainty():
    rng, n, h = np.random.default_rng(3), 30, np.radians(100 / 3600)
    made = devices(FULL, "T", READ, LINEAR, n, rng)
    before = 0.0
    largest = max(abs(row.rate) for row in FULL)
    for k, row in enumerate(made.rows):
        if row.axis == 0:
            sense = np.sign(row.rate - before) if k else 0.0
            made.reading[:, k, 0] -= 0.5 * h * sense * (1 - (row.rate / largest) ** 2)
            before = row.rate
    of_x = [found(made, k, FULL)["gx", "hysteresis"].figure for k in range(n)]
    assert all(one.detected for one in of_x)
    off = np.array([(one.value - h) / one.u for one in of_x])
    assert 0.7 < np.sqrt(np.mean(off**2)) < 1.4
    assert not found(made, 0, FULL)["gy", "hysteresis"].figure.detected


def test_rates_that_are_reached_from_one_side_show_no_hysteresis():
    made = devices(MID, "T", READ, LINEAR, 1, np.random.default_rng(4))
    assert ("gx", "hysteresis") not in found(made, 0, MID)


SLOW = plan([0, 0.01, -0.01, 0.03, -0.03, 0.06, -0.06, 0.1, -0.1], seconds=3600)


@pytest.mark.slow
@pytest.mark.parametrize("width", [0.0, 0.02])
def test_a_dead_band_is_found_with_its_interval(width: float):
    made = devices(SLOW, "T", EXACT, ("bias",), 10, np.random.default_rng(6))
    band = np.radians(width)
    own = np.array([row.axis for row in SLOW]) == 0
    sensed = made.reading[:, own, 0] - made.truth["bias"][:, :1]
    bias = made.truth["bias"][:, :1]
    made.reading[:, own, 0] = bias + np.sign(sensed) * np.maximum(np.abs(sensed) - band, 0)
    all_found = [found(made, k, SLOW) for k in range(10)]
    assert not any(one["gy", "dead band"].figure.detected for one in all_found)
    bands = [one["gx", "dead band"].figure for one in all_found]
    assert [one.detected for one in bands] == [width > 0] * 10
    if width:
        assert sum(one.low <= band <= one.high for one in bands) >= 8
        assert all(abs(one.value - band) < 0.05 * band for one in bands)
        assert all(abs(one["gx", "threshold"].figure.value / band - 2) < 0.1 for one in all_found)


def test_a_kink_shows_in_the_scale_factors_of_single_speeds():
    made = devices(FULL, "T", READ, LINEAR, 1, np.random.default_rng(5))
    rate = np.array([row.rate for row in FULL])
    beyond = np.abs(rate) > np.radians(50)
    own = np.array([row.axis for row in FULL]) == 1
    made.reading[0, :, 1] += 1e-3 * (rate - np.sign(rate) * np.radians(50)) * (beyond & own)
    sensor = triad("t", "w", "g").with_coefficients(*LINEAR)
    rows = speed_scales(seen(made, 0), sensor, bench(READ), steps_of(made.rows))
    assert len(rows) == 3 * 6
    for row in rows:
        k = "xyz".index(row.gyro[1])
        kink = 1e-3 * max(0.0, 1 - np.radians(50) / row.speed) if k == 1 else 0.0
        expected = 1 + made.truth["scale"][0, k] + kink
        # Clock and angle reading are common to the speeds, or in the deviation.
        assert abs(row.scale - expected) < 4 * np.hypot(row.scale_sd, READ.rate_scale)
        assert abs(row.even - made.truth["bias"][0, k]) < 4 * row.even_sd


RUN = """[sensor.gyro]
unit = "°/s"
white = "0.1 °/√h"
[bench]
kind = "rate_platform"
latitude = "50 °"
rate_scale = "5 ppm"
rate_asymmetry = "0 ppm"
rate_stability = "0 ppm"
setting = "0.02 °"
[data]
file = "log.npz"
rate = "10 Hz"
gyro = ["gx", "gy", "gz"]
label = "label"
marks = "labels"
[method]
name = "rates_and_poses"
positions = 3
seconds = "8 s"
rates = ["RATE °/s"]
"""


def test_apply_says_where_a_recording_is_beyond_the_calibrated_rates(tmp_path: Path):
    paths = {}
    for rate in (50, 80):
        folder = tmp_path / str(rate)
        folder.mkdir()
        paths[rate] = folder / "run.toml"
        paths[rate].write_text(RUN.replace("RATE", str(rate)), encoding="utf-8")
        run = read(paths[rate])
        write_recording(apply_data_columns(run, simulate(run, 1)), run.file(run.data.file))
    found = calibrate(paths[50]).calibration
    said = {
        rate: [one for one in apply(found, path).findings if one.what == "range"]
        for rate, path in paths.items()
    }
    assert not said[50]
    (warning,) = said[80]
    assert warning.severity == "warning"
    assert "−50" in warning.message
