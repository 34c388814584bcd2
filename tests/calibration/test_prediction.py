"""Predictions at operating points: uncertainty, shares of its causes, and validity."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.calibration import Calibration, SharedError, Validity
from inercal.calibration.detectability import UndetectableCause
from inercal.calibration.files import load, save
from inercal.calibration.grade import Verdict
from inercal.calibration.prediction import OWN_ERRORS
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, Sensor, cluster, imu, pair, single, triad

RATE = np.radians(100)
VALIDITY = Validity((-RATE, RATE), (-1.2 * G0, 1.2 * G0), (263.15, 323.15))
SENSORS = {
    "imu": imu().with_coefficients("bias", "scale", "misalignment", "k2", "g", "k0_dT", "scale_dT"),
    "tilted triad": replace(
        triad().with_coefficients("k0", "k1", "misalignment", "k2", "k3", "kip"), form="tilted"
    ),
    "arms": imu().with_coefficients("bias", "scale", "misalignment", "arm"),
    "pair": replace(pair().with_coefficients("k0", "k1", "delta_o", "k2", "kip"), form="tilted"),
    "one gyro": single("gyro", "w").with_coefficients("bias", "scale", "g"),
    "cluster": cluster("five", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [0, 1, 1]])
    .with_coefficients("k0", "k1"),
    "oblique": cluster("two", [[1, 1, 0], [0, 1, 1]]).with_coefficients("k0", "k1", "k2"),
}  # fmt: skip


def calibrated(sensor: Sensor, seed: int = 0, size: float = 1e-3) -> Calibration:
    """Return a calibration with random coefficients and a full covariance; u is `size` of them."""
    rng = np.random.default_rng(seed)
    values = 1e-2 * sensor.unit_scale * rng.standard_normal(len(sensor.coefficients))
    mixed = np.eye(values.size) + 0.3 * rng.standard_normal((values.size, values.size))
    root = size * 1e-2 * sensor.unit_scale[:, None] * mixed
    return Calibration(sensor, values, root @ root.T, validity=VALIDITY)


def single_axis(**values: float) -> Calibration:
    """Return one accelerometer whose coefficients have these standard uncertainties, SI."""
    sensor = single().with_coefficients(*values)
    u = np.array([values[name.partition(".")[2]] for name in sensor.coefficients])
    return Calibration(sensor, np.zeros(u.size), np.diag(u**2), validity=VALIDITY)


def with_causes(calibration: Calibration, *causes: UndetectableCause) -> Calibration:
    return replace(calibration, verdict=Verdict("consistent", undetectable=causes))


@pytest.mark.parametrize("name", SENSORS)
def test_u_is_the_scatter_of_corrections_with_coefficients_drawn_from_their_covariance(name: str):
    calibration = calibrated(SENSORS[name])
    sensor, rng = calibration.sensor, np.random.default_rng(1)
    kinds = {axis.measures for axis in sensor.axes}
    f = np.array([[0.4, -0.7, 0.3], [-1.0, 0.1, 0.2]]) * G0
    w = np.array([[0.5, 0.1, -0.9], [0.0, 0.0, 1.0]]) * ("w" in kinds)
    kelvin = np.array([270.0, 310.0])
    found = calibration.predict(f, w, kelvin)
    dT = kelvin - sensor.reference_temperature
    drawn = rng.multivariate_normal(calibration.values, calibration.covariance, 4000)
    # Each device has other coefficients; the calibration with the estimated ones corrects it.
    y = sensor.to_output(sensor.forward(Motion(f, w, dT=dT), drawn))
    still = np.zeros_like(w)
    motion = calibration.correct(y, f=f, w=w, dw=still, dT=dT)
    directions = dict(zip("xyz", np.eye(3), strict=True))
    directions |= {str(k): np.array(axis.i) for k, axis in enumerate(sensor.axes, 1)}
    for k, (quantity, measures) in enumerate(zip(found.names, found.measures, strict=True)):
        seen, true = (motion.f, f) if measures == "f" else (motion.w, w)
        along = directions[quantity[1]]
        np.testing.assert_allclose(found.value[:, k], true @ along, atol=1e-12)
        error = (seen - true) @ along
        # 4000 draws scatter by 1.1 % (k = 1).
        np.testing.assert_allclose(error.std(axis=0), found.std[:, k], rtol=0.05)
        assert np.all(np.abs(error).max(axis=0) > 0)


@pytest.mark.parametrize("name", SENSORS)
def test_shares_of_groups_add_up_to_one(name: str):
    w = [0.1, 0.2, 0.3] if "w" in {axis.measures for axis in SENSORS[name].axes} else None
    found = calibrated(SENSORS[name]).predict([5.0, -3.0, 1.0], w)
    np.testing.assert_allclose(sum(found.groups.values()), np.ones_like(found.std), rtol=1e-9)
    assert not found.effects
    assert not any(found.outside)


def test_the_bias_alone_counts_at_zero_and_the_scale_factor_grows_with_the_force():
    calibration = single_axis(k0=3e-4, k1=1e-4)
    found = calibration.predict(np.array([[0.0, 0, 0], [4.0, 0, 0], [8.0, 0, 0]]))
    np.testing.assert_allclose(
        found.expanded[:, 0], 2 * np.hypot(3e-4, 1e-4 * np.array([0, 4, 8])), rtol=1e-12
    )
    np.testing.assert_allclose(
        found.groups["scale factor"][:, 0], [0, 16e-8 / 25e-8, 64e-8 / 73e-8], rtol=1e-9
    )


def test_the_raw_error_is_the_nominal_reading_minus_the_true_value():
    sensor = single().with_coefficients("k0", "k1")
    calibration = Calibration(sensor, np.array([0.02, 0.01]), np.eye(2), validity=VALIDITY)
    found = calibration.predict([5.0, 0.0, 0.0])
    assert found.names == ("fx",)
    np.testing.assert_allclose(found.raw_error, [[0.02 + 0.05]], rtol=1e-12)


def test_a_shared_error_of_the_bench_has_its_part_of_the_variance():
    calibration = single_axis(k0=3e-4, k1=1e-4)
    gravity = SharedError("g", "m/s²", 1e-3, np.array([0.0, -8e-8]), "a" * 64)  # u of k1: 0.8e-4
    found = replace(calibration, shared=(gravity,)).predict([5.0, 0.0, 0.0])
    variance = 9e-8 + (5e-4) ** 2
    assert found.bench["bench: g"].item() == pytest.approx((5 * 0.8e-4) ** 2 / variance)
    assert sum(one.item() for one in found.bench.values()) == pytest.approx(1)
    assert OWN_ERRORS in found.bench
    assert not calibration.predict([5.0, 0.0, 0.0]).bench  # the file does not state them


@pytest.mark.parametrize(
    ("part", "point", "amount"),
    [
        ("f", {"f": [3 * G0, 0, 0]}, 1.8 * G0),
        ("w", {"w": [0, 0, -2 * RATE]}, RATE),
        ("T", {"T": 333.15}, 10.0),
    ],
)
def test_a_point_outside_is_refused_and_its_part_is_named(
    part: str, point: dict[str, object], amount: float
):
    calibration = with_causes(calibrated(SENSORS["imu"], size=1e-6))
    plain = replace(calibration, values=np.zeros_like(calibration.values))
    with refused(InputError, key=part):
        plain.predict(**point)  # type: ignore[arg-type]
    found = plain.predict(**point, extrapolate=True)  # type: ignore[arg-type]
    ((one,),) = found.outside
    assert (one.part, one.amount) == (part, pytest.approx(amount))


def test_the_first_point_outside_is_counted_among_all():
    calibration = single_axis(k0=1e-4)
    with pytest.raises(InputError, match=r"^point 2 "):
        calibration.predict(np.array([[1.0, 0, 0], [20.0, 0, 0]]))


def test_points_at_the_edge_are_inside():
    calibration = single_axis(k0=1e-4)
    edge = 1.2 * G0 * np.array([[1.0, 0, 0], [-1.0, 0, 0]])
    assert calibration.predict(edge, T=np.array([263.15, 323.15])).outside == ((), ())


def test_outside_u_grows_by_effects_that_depend_on_what_is_outside():
    k2 = UndetectableCause("k2", "ax.k2", 2e-5)
    turn = UndetectableCause("scale2", "gx.scale2", 1e-3)
    calibration = with_causes(calibrated(SENSORS["arms"], size=1e-7), k2, turn)
    plain = replace(calibration, values=np.zeros_like(calibration.values))
    found = plain.predict([30.0, 0.0, 0.0], extrapolate=True)
    (name,) = found.effects
    assert "k2" in name
    assert found.std[0, 0] == pytest.approx(2e-5 * 900 / 3**0.5, rel=1e-3)
    assert found.effects[name][0] == pytest.approx([1, 0, 0, 0, 0, 0], abs=1e-3)
    inside = plain.predict([11.0, 0.0, 0.0], extrapolate=True)
    assert not inside.effects


def test_outside_u_covers_an_effect_of_the_size_that_is_not_detectable():
    size = 2e-5
    k2 = UndetectableCause("k2", "i.k2", size)
    calibration = with_causes(single_axis(k0=1e-9), k2)
    true = calibration.sensor.with_coefficients("k0", "k2")
    f = np.array([[20.0, 0, 0], [40.0, 0, 0]])
    y = true.to_output(true.forward(Motion(f), np.array([0.0, size])))
    error = calibration.correct(y, f=f).f[:, 0] - f[:, 0]
    expanded = calibration.predict(f, extrapolate=True).expanded[:, 0]
    assert np.all(np.abs(error) <= expanded)
    assert np.all(np.abs(error) > 0.8 * expanded)


def test_effects_without_size_and_a_missing_list_are_remarked():
    unsized = UndetectableCause("k2", "i.k2", float("nan"))
    calibration = single_axis(k0=1e-4)
    for one in (calibration, with_causes(calibration, unsized)):
        found = one.predict([20.0, 0, 0], extrapolate=True)
        assert len(found.remarks) == 1
        assert found.expanded.item() == pytest.approx(2e-4)
    assert "k2" in found.remarks[0]


def test_an_unknown_range_is_remarked_and_not_refused():
    calibration = replace(single_axis(k0=1e-4), validity=Validity(force=(-1.0, 1.0)))
    assert not calibration.predict([0.5, 0, 0]).remarks
    (remark,) = calibration.predict([0.5, 0, 0], T=300.0).remarks
    assert "temperature" in remark


def test_what_the_readings_do_not_depend_on_is_refused_unless_it_is_zero():
    calibration = single_axis(k0=1e-4)
    assert calibration.predict([0.5, 0, 0], [0, 0, 0]).std.item() == pytest.approx(1e-4)
    with refused(InputError, key="w"):
        calibration.predict([0.5, 0, 0], [0, 0, 0.1])
    turning = Calibration(
        single().with_coefficients("k0", "kspin"), np.zeros(2), np.diag([1e-8, 1e-6])
    )
    assert turning.predict(w=[2.0, 3.0, 0]).std.item() == pytest.approx(np.hypot(1e-4, 6e-3))
    assert turning.predict().std.item() == pytest.approx(1e-4)


@pytest.mark.parametrize(
    ("point", "key"),
    [({"f": [1.0, 2.0]}, "f"), ({"w": [np.nan, 0, 0]}, "w"), ({"T": -5.0}, "T")],
)
def test_points_of_another_shape_or_size_are_refused(point: dict[str, object], key: str):
    with refused(InputError, key=key):
        calibrated(SENSORS["imu"]).predict(**point)  # type: ignore[arg-type]


def test_a_calibration_without_uncertainties_predicts_none():
    calibration = replace(single_axis(k0=1e-4), covariance=np.zeros((1, 1)))
    with pytest.raises(InputError, match="states no uncertainties"):
        calibration.predict([0.5, 0, 0])


def test_a_point_without_temperature_has_that_of_the_calibration():
    bias = single_axis(k0=1e-4)
    assert bias.predict().temperature.item() == pytest.approx(293.15)  # the middle of its data
    warm = replace(bias, validity=replace(VALIDITY, temperature=(300.0, 320.0)))
    assert warm.predict().temperature.item() == pytest.approx(310.0)
    assert single_axis(k0=1e-4, k0_dT=1e-6).predict().temperature.item() == 293.15


def test_the_file_keeps_the_list_of_what_is_not_detectable(tmp_path: Path):
    causes = (UndetectableCause("k2", "i.k2", 2e-5), UndetectableCause("row", "", float("nan")))
    calibration = with_causes(single_axis(k0=1e-4), *causes)
    read = load(save(calibration, tmp_path / "a.calibration.json")).verdict
    assert read is not None
    assert read.undetectable is not None
    assert read.undetectable[0] == causes[0]
    assert (read.undetectable[1].name, np.isnan(read.undetectable[1].size)) == ("row", True)
    older = replace(calibration, verdict=Verdict("consistent"))
    read = load(save(older, tmp_path / "b.calibration.json")).verdict
    assert read is not None
    assert read.undetectable is None
