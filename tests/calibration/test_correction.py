"""A calibration undoes what its sensor does."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.refusals import refused

from inercal.basics.errors import NotInvertible
from inercal.calibration import Calibration
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, Readout, Sensor, cluster, imu, triad
from inercal.recordings import Recording

Array = NDArray[np.float64]
LSB = Readout(2048 / G0, 12.0, "LSB", 32768.0)
DEG = Readout(180 / np.pi, -0.5, "°/s")
IMU = imu("imu", accelerometer=(LSB, imu().axes[0].noise), gyro=(DEG, imu().axes[3].noise))
AFFINE = ("bias", "scale", "misalignment", "g")
ERRORS = {  # SI; scale errors and misalignments of per cents, as of cheap sensors
    "bias": 0.3,
    "scale": 0.02,
    "misalignment": 0.03,
    "g": 1e-4,
    "nonlinearity": 1e-4,
    "cross": 1e-4,
    "temperature": 1e-3,
    "arm": 0.05,
}


def calibration(sensor: Sensor, *groups: str, seed: int = 1) -> Calibration:
    modelled = sensor.with_coefficients(*groups)
    sizes = [ERRORS[modelled.coefficient(name).group] for name in modelled.coefficients]
    values = np.array(sizes) * np.random.default_rng(seed).uniform(-1, 1, len(sizes))
    return Calibration(modelled, values, np.diag(np.array(sizes) ** 2))


def motion(*shape: int, seed: int = 2) -> Motion:
    rng = np.random.default_rng(seed)
    return Motion(rng.uniform(-30, 30, (*shape, 3)), rng.uniform(-5, 5, (*shape, 3)))


def output(known: Calibration, true: Motion) -> Array:
    return known.sensor.to_output(known.sensor.forward(true, known.values))


def recording(known: Calibration, data: Array) -> Recording:
    units = tuple(axis.readout.unit for axis in known.sensor.axes)
    n = data.shape[-2]
    return Recording(np.arange(n) / 100, data, known.sensor.channels, units, source="log.csv")


@pytest.mark.parametrize("groups", [AFFINE, (*AFFINE, "nonlinearity", "cross")])
@pytest.mark.parametrize("form", ["reference", "tilted"])
@pytest.mark.parametrize("shape", [(50,), (4, 50)])
def test_correcting_undoes_the_sensor(groups: tuple[str, ...], form: str, shape: tuple[int, ...]):
    known = calibration(replace(IMU, form=form), *groups)  # type: ignore[arg-type]
    true = motion(*shape)
    found = known.correct(output(known, true))
    assert found.f == pytest.approx(true.f, abs=1e-10)
    assert found.w == pytest.approx(true.w, abs=1e-11)


def test_a_triad_gives_no_rates():
    known = calibration(triad("t", "f", "a", LSB), "bias", "scale", "misalignment", "k2")
    true = Motion(motion(50).f)
    found = known.correct(output(known, true))
    assert found.f == pytest.approx(true.f, abs=1e-10)
    assert not found.w.any()


def test_columns_of_a_recording_are_taken_by_name():
    known = calibration(IMU, *AFFINE)
    true = motion(50)
    made = recording(known, output(known, true))
    order = [5, 1, 0, 2, 4, 3]
    shuffled = replace(
        made,
        data=made.data[:, order],
        channels=tuple(made.channels[k] for k in order),
        units=tuple(made.units[k] for k in order),
    )
    assert known.correct(shuffled).f == pytest.approx(true.f, abs=1e-10)


def test_temperature_is_taken_from_the_recording():
    known = calibration(IMU, *AFFINE, "k0_dT", "k1_dT", "bias_dT", "scale_dT")
    warm = np.linspace(-20.0, 30.0, 50)
    true = replace(motion(50), dT=warm)
    made = replace(recording(known, output(known, true)), temperature=293.15 + warm)
    for found in (known.correct(made), known.correct(made.data, dT=warm)):
        assert found.f == pytest.approx(true.f, abs=1e-9)
        assert found.w == pytest.approx(true.w, abs=1e-9)
    assert np.abs(known.correct(made.data, dT=0.0).f - true.f).max() > 1e-3
    with refused(key="dT"):
        known.correct(made.data)


def test_what_a_lever_arm_adds_is_taken_out_with_the_recorded_rates():
    known = calibration(IMU, *AFFINE, "arm")
    time = np.arange(200) / 100
    # ω grows linearly, so that differences give its derivative exactly.
    rise = np.array([0.5, -2.0, 3.0])
    n = time.size
    true = Motion(motion(n).f, time[:, None] * rise, np.broadcast_to(rise, (n, 3)))
    made = recording(known, output(known, true))
    for found in (known.correct(made), known.correct(made.data, dw=true.dw)):
        assert found.f == pytest.approx(true.f, abs=1e-9)
    with refused(key="dw"):
        known.correct(made.data)


@pytest.mark.parametrize("sensor", [IMU, triad("t", "f", "a", LSB), triad("t", "w", "g", DEG)])
def test_one_matrix_and_one_offset_correct_as_the_model_does(sensor: Sensor):
    groups = AFFINE if len(sensor.axes) == 6 else ("bias", "scale", "misalignment")
    known = calibration(sensor, *groups)
    data = output(known, motion(4, 50))
    matrix, offset = known.affine_correction()
    motion_by_matrix = (data - offset) @ matrix.T
    found = known.correct(data)
    kinds = {axis.measures for axis in sensor.axes}
    expected = [v for kind, v in (("f", found.f), ("w", found.w)) if kind in kinds]
    assert motion_by_matrix == pytest.approx(np.concatenate(expected, axis=-1), abs=1e-10)


def test_one_matrix_corrects_a_redundant_cluster_in_the_sense_of_least_squares():
    directions = [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]
    known = calibration(cluster("four", directions), "bias", "scale", "misalignment")
    data = output(known, Motion(motion(50).f)) + 0.1 * np.random.default_rng(3).normal(size=(50, 4))
    matrix, offset = known.affine_correction()
    assert matrix.shape == (3, 4)
    assert (data - offset) @ matrix.T == pytest.approx(known.correct(data).f, abs=1e-10)


@pytest.mark.parametrize("group", ["k2", "kpo", "k0_dT", "koq"])
def test_no_single_matrix_is_given_where_more_than_f_and_w_acts(group: str):
    known = Calibration(IMU.with_coefficients(group), np.zeros(3), np.eye(3))
    with refused(names=known.sensor.coefficients):
        known.affine_correction()


def test_a_recording_in_other_units_is_refused():
    known = calibration(IMU, *AFFINE)
    made = recording(known, output(known, motion(5)))
    other = replace(made, units=("LSB", "g", "LSB", *made.units[3:]))
    with refused(names=["ay"]):
        known.correct(other)


def test_a_recording_without_one_of_the_axes_is_refused():
    known = calibration(IMU, *AFFINE)
    made = recording(known, output(known, motion(5)))
    part = replace(made, data=made.data[:, :5], channels=made.channels[:5], units=made.units[:5])
    with refused(names=["gz"]):
        known.correct(part)


def test_an_array_with_another_number_of_columns_is_refused():
    with refused(names=IMU.channels):
        calibration(IMU, *AFFINE).correct(np.zeros((4, 5)))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_readings_that_are_not_finite_are_refused(bad: float):
    data = np.zeros((4, 6))
    data[2, 3] = bad
    with refused(names=[IMU.channels[3]]):
        calibration(IMU, *AFFINE).correct(data)


def test_a_reading_beyond_the_fold_of_the_model_is_refused():
    # y = f + 0.01 f² is never below −25 m/s².
    sensor = triad().with_coefficients("k2")
    known = Calibration(sensor, np.full(3, 0.01), np.eye(3))
    assert known.correct(np.array([[-24.9, 0.0, 0.0]])).f[0, 0] == pytest.approx(-50 + 10**0.5)
    with refused(NotInvertible):
        known.correct(np.array([[-25.1, 0.0, 0.0]]))


def test_values_and_uncertainties_are_had_by_name():
    known = calibration(IMU, *AFFINE)
    k = known.sensor.coefficients.index("gz.g_o")
    assert known.value("gz.g_o") == known.values[k]
    assert known.uncertainty("gz.g_o") == pytest.approx(1e-4)
    with refused(names=["gz.k0"]):
        known.value("gz.k0")


def test_values_that_do_not_fit_the_sensor_are_refused():
    with refused():
        Calibration(triad().with_coefficients("bias"), np.zeros(4), np.eye(3))
