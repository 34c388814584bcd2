"""The correction of the ROS 2 package, and its node, run against a stand-in for ROS."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.export.calibrations import (
    COUNTS,
    LINEAR,
    NONLINEAR,
    RANGES,
    SI,
    TEMPERATURE,
    magnetometer_readings,
    make_calibration,
    make_magnetometer,
    random_readings,
)
from tests.export.ros_exports import DENSITIES, Loaded, export, linear, nine_axes
from tests.export.ros_stand_in import (
    SENSOR_DATA,
    DiagnosticStatus,
    Header,
    Imu,
    MagneticField,
    Temperature,
    Vector3,
)
from tests.refusals import refused

import inercal
from inercal.basics.arrays import Array
from inercal.export import Export
from inercal.export.cost import propagation
from inercal.export.model import export_model
from inercal.physics.motion import Motion
from inercal.physics.sensors import triad

FULL = (*LINEAR, *TEMPERATURE, *NONLINEAR)


def imu_message(reading: Array) -> Imu:
    f, w = reading[:3].tolist(), reading[3:].tolist()
    return Imu(
        Header(12, "imu_link"), angular_velocity=Vector3(*w), linear_acceleration=Vector3(*f)
    )


def vector(one: Vector3) -> list[float]:
    return [one.x, one.y, one.z]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("terms", "readouts"), [(LINEAR, SI), (FULL, COUNTS)], ids=["linear", "full, counts"]
)
def test_ten_thousand_readings_are_corrected_as_by_the_calibration(
    load: Loaded, terms: tuple[str, ...], readouts: Any
):
    calibration = make_calibration(*terms, readouts=readouts)
    seen = random_readings(calibration)
    settings, _ = load(export(calibration), "settings")
    at = [seen.celsius.tolist()] * settings.TAKES_TEMPERATURE
    rows = calibration.sensor.to_si(seen.output).tolist()
    found = np.array([settings.CORRECT_IMU(*one) for one in zip(rows, *at, strict=True)])
    assert settings.TAKES_TEMPERATURE is (terms is FULL)
    assert len(found) == 10_000
    np.testing.assert_allclose(found, seen.corrected, rtol=0, atol=1e-8)
    assert settings.CORRECT_FIELD is None


@pytest.mark.slow
def test_magnetometers_and_the_imu_are_corrected_in_their_own_messages(load: Loaded):
    calibration = make_magnetometer("bias_dT", "scale_dT", inertial=True)
    seen = magnetometer_readings(calibration, 500)
    node, world = load(nine_axes())
    node.CorrectionNode()
    kinds = [axis.measures for axis in calibration.sensor.axes]
    assert kinds == [*"fffwwwmmm"]
    readings = calibration.sensor.to_si(seen.output)
    for reading, celsius in zip(readings, seen.celsius.tolist(), strict=True):
        world.send("imu/temperature", Temperature(celsius))
        world.send("imu/data_raw", imu_message(reading[:6]))
        field = Vector3(*reading[6:].tolist())
        world.send("imu/mag", MagneticField(Header(12, "mag"), field))
    imu, field = world.published["imu/data_corrected"], world.published["imu/mag_corrected"]
    found = [[*vector(x.linear_acceleration), *vector(x.angular_velocity)] for x in imu]
    np.testing.assert_allclose(found, seen.corrected[:, :6], rtol=0, atol=1e-9)
    found = [vector(x.magnetic_field) for x in field]
    np.testing.assert_allclose(found, seen.corrected[:, 6:], rtol=0, atol=1e-14)
    assert (field[0].header.frame_id, field[0].header.stamp) == ("mag", 12)


def test_what_the_calibration_does_not_have_and_the_orientation_are_copied(load: Loaded):
    sensor = triad("t", "f", "a").with_coefficients("bias")
    calibration = inercal.Calibration(
        sensor, np.array([0.1, 0.2, 0.3]), np.zeros((3, 3)), validity=RANGES
    )
    node, world = load(export(calibration), frame_id="")
    node.CorrectionNode()
    message = imu_message(np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]))
    message.orientation_covariance = [-1.0] + [0.0] * 8
    message.angular_velocity_covariance = [-1.0] + [0.0] * 8
    world.send("imu/data_raw", message)
    (sent,) = world.published["imu/data_corrected"]
    assert vector(sent.linear_acceleration) == pytest.approx([0.9, 1.8, 2.7])
    assert vector(sent.angular_velocity) == [4.0, 5.0, 6.0]
    assert sent.orientation == (0.0, 0.0, 0.0, 1.0)
    assert sent.orientation_covariance[0] == sent.angular_velocity_covariance[0] == -1.0
    assert sent.header == Header(12, "imu_link")
    assert set(world.subscriptions) == {"imu/data_raw"}


def matrix_of(message: Imu, name: str) -> Array:
    return np.array(getattr(message, f"{name}_covariance")).reshape(3, 3)


def one_message(load: Loaded, made: Export, stated: float = 0.0, **parameters: Any) -> Imu:
    node, world = load(made, **parameters)
    node.CorrectionNode()
    message = imu_message(np.array([0.0, 0.0, 9.8, 0.0, 0.0, 0.1]))
    message.linear_acceleration_covariance = np.diag([stated] * 3).ravel().tolist()
    world.send("imu/data_raw", message)
    return world.published["imu/data_corrected"][0]


@pytest.mark.slow
def test_the_covariance_is_that_of_corrected_samples_and_of_the_coefficients(load: Loaded):
    """Corrected noisy samples of drawn calibrations scatter as the covariance states."""
    calibration = make_calibration(*LINEAR, u=5e-4, size=2e-2)
    sent = one_message(load, export(calibration, update_rate=100, **DENSITIES))
    rng, n = np.random.default_rng(5), 20_000
    sensor, sd = calibration.sensor, np.repeat([1e-3, 2e-4], 3) * 10.0
    low, high = np.array([*[RANGES.force] * 3, *[RANGES.rate] * 3]).T
    true = rng.uniform(low, high, (n, 6))
    motion = Motion(true[:, :3], true[:, 3:])
    noise = rng.normal(size=(n, 6)) * sd
    drawn = rng.normal(size=(n, len(sensor.coefficients))) * calibration.std
    # To first order in the coefficients: the error of a result is −x_c · (change of c).
    change = np.einsum(
        "nkp,np->nk", propagation(export_model(calibration), motion_at(motion)), drawn
    )
    seen = calibration.correct(sensor.to_output(sensor.forward(motion, calibration.values) + noise))
    error = np.hstack([seen.f, seen.w]) - true + change
    for name, part in (("linear_acceleration", slice(0, 3)), ("angular_velocity", slice(3, 6))):
        found, wanted = matrix_of(sent, name), np.cov(error[:, part].T)
        scale = np.sqrt(np.outer(np.diag(found), np.diag(found)))
        # Four standard deviations of a variance from this many draws; sizes mix over the range.
        np.testing.assert_allclose(found / scale, wanted / scale, rtol=0, atol=8 / n**0.5)


def motion_at(motion: Motion) -> Motion:
    return replace(motion, dT=np.zeros(len(motion.f)))


def test_without_the_calibration_the_covariance_is_that_of_the_noise(load: Loaded):
    sent = one_message(load, linear(), covariance_of_calibration=False)
    for name, density in (("linear_acceleration", 1e-3), ("angular_velocity", 2e-4)):
        expected = density**2 * 400 * np.eye(3)
        np.testing.assert_allclose(matrix_of(sent, name), expected, atol=0.03 * expected[0, 0])


def test_a_stated_deviation_replaces_the_covariance_and_the_rate_is_a_parameter(load: Loaded):
    sent = one_message(load, linear(), linear_acceleration_stddev=0.5, update_rate=0.0)
    np.testing.assert_array_equal(matrix_of(sent, "linear_acceleration"), 0.25 * np.eye(3))
    np.testing.assert_array_equal(matrix_of(sent, "angular_velocity"), np.zeros((3, 3)))


@pytest.mark.parametrize("stated", [0.0, 0.04])
def test_without_noise_the_covariance_of_the_message_stays_and_unknown_stays_unknown(
    load: Loaded, stated: float
):
    sent = one_message(load, linear(), stated, update_rate=0.0)
    found = matrix_of(sent, "linear_acceleration")
    assert bool(found.any()) is (stated > 0)
    if stated:
        assert (np.diag(found) > stated).all()
    assert not matrix_of(sent, "angular_velocity").any()


@pytest.mark.slow
def test_the_noise_is_read_from_the_file_of_a_noise_analysis(load: Loaded, tmp_path: Path):
    path = tmp_path / "imu.yaml"
    path.write_text("accelerometer_noise_density: 2.0e-03\nupdate_rate: 50\n", encoding="utf-8")
    made = export(make_calibration(*LINEAR), noise=str(path))
    sent = one_message(load, made, covariance_of_calibration=False)
    variance = np.diag(matrix_of(sent, "linear_acceleration"))
    np.testing.assert_allclose(variance, 2e-3**2 * 50, rtol=0.03)
    assert not matrix_of(sent, "angular_velocity").any()


@pytest.mark.parametrize("wrong", [{"accelerometer_noise_density": 1e-3}, {"update_rate": -1.0}])
def test_a_density_without_a_rate_and_a_negative_rate_are_refused(wrong: dict[str, float]):
    with refused(key="--set", names=("update_rate",)):
        export(make_calibration(), **wrong)


@pytest.mark.slow
def test_messages_that_lack_a_quantity_are_not_published_and_counted(load: Loaded):
    node, world = load(linear())
    one = node.CorrectionNode()
    wrong = [imu_message(np.ones(6)) for _ in range(4)]
    wrong[0].angular_velocity_covariance = [-1.0] + [0.0] * 8
    wrong[1].linear_acceleration_covariance = [float("nan")] + [0.0] * 8
    wrong[2].linear_acceleration.y = float("nan")
    wrong[3].angular_velocity.z = float("inf")
    for message in wrong:
        world.send("imu/data_raw", message)
    assert not world.published["imu/data_corrected"]
    assert one.counts == {"corrected": 0, "saturated": 0, "not_corrected": 4}
    ((level, text),) = one.get_logger().lines  # throttled
    assert level == "error"
    assert "angular_velocity" in text
    world.seconds += 11.0
    world.send("imu/data_raw", wrong[2])
    assert len(one.get_logger().lines) == 2


@pytest.mark.parametrize("drop", [False, True])
def test_saturated_messages_are_counted_and_dropped_on_request(load: Loaded, drop: bool):
    limited = [
        replace(one, full_scale=one.scale * limit)
        for one, limit in zip(COUNTS, (19, 2), strict=True)
    ]
    calibration = make_calibration(*LINEAR, readouts=(limited[0], limited[1]))
    node, world = load(export(calibration), drop_saturated=drop)
    one = node.CorrectionNode()
    for reading in ([18.9] + [0] * 5, [0, -19.0] + [0] * 4, [0] * 5 + [2.1]):
        world.send("imu/data_raw", imu_message(np.array(reading, dtype=float)))
    assert one.counts["saturated"] == 2
    assert len(world.published["imu/data_corrected"]) == (1 if drop else 3)
    assert [level for level, _ in one.get_logger().lines] == ["warning"]
    ((period, publish),) = world.timers
    assert period == 1.0
    publish()
    publish()
    first, second = (x.status[0] for x in world.published["/diagnostics"])
    assert (first.level, second.level) == (DiagnosticStatus.WARN, DiagnosticStatus.OK)
    assert {x.key: x.value for x in second.values}["saturated"] == "2"
    assert first.hardware_id == "IMU-7"


@pytest.mark.slow
def test_the_reference_temperature_is_used_and_said_once_until_one_arrives(load: Loaded):
    calibration = make_calibration(*LINEAR, *TEMPERATURE, u=0.0)
    node, world = load(export(calibration), temperature_timeout=5.0)
    one, reading = node.CorrectionNode(), np.array([1.0, 2.0, 3.0, 0.1, 0.2, 0.3])
    log = one.get_logger().lines

    def corrected() -> list[float]:
        world.send("imu/data_raw", imu_message(reading))
        return vector(world.published["imu/data_corrected"][-1].linear_acceleration)

    def expected(dT: float) -> Array:
        return calibration.correct(reading[None], dT=np.array([dT])).f[0]

    for _ in range(3):
        np.testing.assert_allclose(corrected(), expected(0.0), atol=1e-9)
    assert len(log) == 1
    assert "20.0 degC" in log[0][1]
    world.timers[0][1]()
    assert world.published["/diagnostics"][0].status[0].level == DiagnosticStatus.WARN
    world.send("imu/temperature", Temperature(35.0))
    world.send("imu/temperature", Temperature(float("nan")))
    np.testing.assert_allclose(corrected(), expected(15.0), atol=1e-9)
    assert len(log) == 2
    world.seconds += 6.0
    np.testing.assert_allclose(corrected(), expected(15.0), atol=1e-9)
    assert "older than 5 s" in log[2][1]
    world.send("imu/temperature", Temperature(90.0))
    np.testing.assert_allclose(corrected(), expected(40.0), atol=1e-9)  # the range ends at 60 °C
    assert "outside the calibrated range" in log[3][1]


def test_subscriptions_match_every_driver_and_publishers_every_subscriber(load: Loaded):
    node, world = load(nine_axes(), frame_id="imu_calibrated")
    node.CorrectionNode()
    assert set(world.subscriptions) == {"imu/data_raw", "imu/mag", "imu/temperature"}
    assert all(quality is SENSOR_DATA for _, _, quality in world.subscriptions.values())
    for topic in ("imu/data_corrected", "imu/mag_corrected"):
        assert world.qualities[topic].reliability == "reliable"
    assert all(read_only for _, read_only in world.descriptors.values())
    world.send("imu/mag", MagneticField(Header(1, "mag")))
    assert world.published["imu/mag_corrected"][0].header.frame_id == "imu_calibrated"


def test_an_interrupt_ends_the_node_cleanly(load: Loaded):
    node, world = load(linear())
    node.main()
    assert world.calls == ["init", "spin", "destroy_node", "try_shutdown"]
