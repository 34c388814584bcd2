"""The same calibration in IEEE 1293's equation, in the tilted form and in other body frames."""

from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.refusals import refused

from inercal.calibration import Calibration, ConvertedCoefficients, SharedError
from inercal.physics.motion import Motion
from inercal.physics.sensors import G0, Readout, Sensor, imu, pair, triad

Array = NDArray[np.float64]
LSB = Readout(2000 / G0, 12.0, "LSB")
DRAWS = 40_000
AFFINE = ("bias", "scale", "misalignment", "g")
FRAMES: list[Literal["triangular", "symmetric"]] = ["triangular", "symmetric"]


def random_covariance(rng: np.random.Generator, sd: Array) -> Array:
    root = rng.standard_normal((sd.size, 2 * sd.size))
    full = root @ root.T
    size = np.sqrt(np.diag(full))
    return full / np.outer(size, size) * np.outer(sd, sd)


def calibration(sensor: Sensor, *groups: str, seed: int = 5) -> Calibration:
    """Return one with errors of per cents, known to parts in ten thousand, all correlated."""
    rng = np.random.default_rng(seed)
    modelled = sensor.with_coefficients(*groups)
    p = len(modelled.coefficients)
    values = 0.03 * modelled.unit_scale * rng.uniform(-1, 1, p)
    return Calibration(modelled, values, random_covariance(rng, 2e-4 * modelled.unit_scale))


def assert_covariance(found: Array, draws: Array) -> None:
    """Assert that a covariance is that of the draws, (n, q), within five of its deviations."""
    sampled = np.cov(draws, rowvar=False)
    sd = np.sqrt(np.diag(sampled))
    certain = sd < 1e-12 * sd.max()
    assert np.abs(found[certain]).max(initial=0) < 1e-20
    sd = sd[~certain]
    part = np.ix_(~certain, ~certain)
    difference = (found[part] - sampled[part]) / np.outer(sd, sd)
    assert np.abs(difference).max() < 5 * np.sqrt(2 / len(draws))


def motions(n: int = 40) -> Motion:
    rng = np.random.default_rng(8)
    return Motion(rng.uniform(-20, 20, (n, 3)), rng.uniform(-5, 5, (n, 3)))


def readings(known: Calibration, motion: Motion) -> Array:
    return known.sensor.forward(motion, known.values)


def matrices(sensor: Sensor, c: Array) -> tuple[Array, Array, Array]:
    """Return d(acc)/df, d(gyro)/dω and d(gyro)/df, (..., 3, 3), term by term from the names."""
    by_name = {name: c[..., k] for k, name in enumerate(sensor.coefficients)}
    zero = np.zeros(c.shape[:-1])
    own, force = [], []
    for axis in sensor.axes:
        scale = "k1" if axis.measures == "f" else "scale"
        row = [1 + by_name[f"{axis.name}.{scale}"], by_name[f"{axis.name}.delta_o"]]
        row.append(-by_name[f"{axis.name}.delta_p"])
        own.append(np.stack(row, -1) @ axis.frame)
        felt = [by_name.get(f"{axis.name}.g_{s}", zero) for s in "ipo"]
        force.append(np.stack(felt, -1) @ axis.frame)
    stacked = np.stack(own, -2), np.stack(force, -2)
    return stacked[0][..., :3, :], stacked[0][..., 3:, :], stacked[1][..., 3:, :]


# IEEE Std 1293's equation


def test_ieee_1293_of_one_axis_is_that_computed_by_hand():
    sensor = triad("t", "f", "", LSB).with_coefficients("x.bias", "x.scale", "x.misalignment", "k2")
    by_name = {
        "x.k0": 0.02 * G0,
        "x.k1": 0.01,
        "x.delta_o": 1e-3,
        "x.delta_p": -2e-3,
        "x.k2": 50e-6 / G0,
    }
    values = np.array([by_name.get(name, 0.0) for name in sensor.coefficients])
    found = Calibration(sensor, values, np.zeros((values.size,) * 2)).ieee1293()
    stated = dict(
        zip(found.names, zip(found.values.tolist(), found.units, strict=True), strict=True)
    )
    assert stated["x.K1"] == (pytest.approx(2020.0), "LSB/g")
    assert stated["x.k0"] == (pytest.approx(0.02 / 1.01), "g")
    assert stated["x.delta_o"] == (pytest.approx(1e-3 / 1.01), "rad")
    assert stated["x.delta_p"] == (pytest.approx(-2e-3 / 1.01), "rad")
    assert stated["x.k2"] == (pytest.approx(50e-6 / 1.01), "g/g²")
    assert stated["y.K1"] == (pytest.approx(2000.0), "LSB/g")


def test_the_equation_of_ieee_1293_gives_the_sensors_output():
    known = calibration(
        triad("t", "f", "", LSB), "bias", "scale", "misalignment", "k2", "k3", "kip"
    )
    found = known.ieee1293()
    c = dict(zip(found.names, found.values.tolist(), strict=True))
    motion = Motion(motions().f)
    output = known.sensor.to_output(readings(known, motion))
    for k, axis in enumerate(known.sensor.axes):
        i, p, o = np.moveaxis(motion.f @ axis.frame.T / G0, -1, 0)
        n = axis.name
        inside = c[f"{n}.k0"] + i + c[f"{n}.k2"] * i**2 + c[f"{n}.k3"] * i**3
        inside += c[f"{n}.delta_o"] * p - c[f"{n}.delta_p"] * o + c[f"{n}.kip"] * i * p
        assert output[:, k] - 12.0 == pytest.approx(c[f"{n}.K1"] * inside, rel=1e-12, abs=1e-9)


def test_the_form_of_the_model_does_not_change_ieee_1293():
    known = calibration(triad("t", "f", "", LSB), "bias", "scale", "misalignment")
    reference, tilted = known.ieee1293(), known.in_form("tilted").ieee1293()
    assert tilted.names == reference.names
    assert tilted.values == pytest.approx(reference.values, rel=1e-12)


def test_the_covariance_of_ieee_1293_is_that_of_monte_carlo():
    known = calibration(triad("t", "f", "", LSB), "bias", "scale", "misalignment", "k2")
    found = known.ieee1293()
    rng = np.random.default_rng(9)
    c = rng.multivariate_normal(known.values, known.covariance, DRAWS)
    by_name = {name: c[:, k] for k, name in enumerate(known.sensor.coefficients)}
    sizes = {"k0": G0, "delta_o": 1.0, "delta_p": 1.0, "k2": 1 / G0}
    columns: list[Array] = []
    for name in found.names:
        axis, _, short = name.partition(".")
        gain = 1 + by_name[f"{axis}.k1"]
        columns.append(2000 * gain if short == "K1" else by_name[name] / gain / sizes[short])
    assert_covariance(found.covariance, np.stack(columns, -1))
    assert found.std == pytest.approx(np.sqrt(np.diag(found.covariance)))


def test_gyros_alone_have_no_form_of_ieee_1293():
    with refused(names=["x", "y", "z"]):
        calibration(triad("t", "w"), "bias").ieee1293()


# Reference and tilted form


def test_both_forms_read_the_same_and_lead_back_to_each_other():
    known = calibration(imu(), *AFFINE)
    tilted = known.in_form("tilted")
    assert tilted.sensor.form == "tilted"
    assert np.abs(tilted.values - known.values).max() > 1e-5
    motion = motions()
    assert readings(tilted, motion) == pytest.approx(readings(known, motion), abs=1e-12)
    back = tilted.in_form("reference")
    assert back.values == pytest.approx(known.values, abs=1e-14)
    scale = np.outer(known.std, known.std)
    assert back.covariance / scale == pytest.approx(known.covariance / scale, abs=1e-6)


def test_the_covariance_in_the_tilted_form_is_that_of_monte_carlo():
    known = calibration(triad(), "bias", "scale", "misalignment")
    c = np.random.default_rng(9).multivariate_normal(known.values, known.covariance, DRAWS)
    converted = c.copy()
    for axis in "xyz":
        k1, o, p = (
            known.sensor.coefficients.index(f"{axis}.{n}") for n in ("k1", "delta_o", "delta_p")
        )
        row = np.stack([1 + c[:, k1], c[:, o], c[:, p]], -1)
        converted[:, k1] = np.linalg.norm(row, axis=-1) - 1
        converted[:, o] = np.arctan(c[:, o] / (1 + c[:, k1]))
        converted[:, p] = np.arctan(c[:, p] / (1 + c[:, k1]))
    assert_covariance(known.in_form("tilted").covariance, converted)


def test_nonlinear_terms_cannot_change_form():
    with refused(names=["x.k2", "y.k2", "z.k2"]):
        calibration(triad(), "bias", "k2").in_form("tilted")


# Body frames


@pytest.mark.parametrize("frame", FRAMES)
def test_another_frame_turns_the_motion_and_leaves_the_readings(
    frame: Literal["triangular", "symmetric"],
):
    known = calibration(imu(), *AFFINE)
    turned = known.in_frame(frame)
    assert turned.frame == frame
    q = turned.mount
    assert q @ q.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(q) == pytest.approx(1)
    motion = motions()
    seen = Motion(motion.f @ q.T, motion.w @ q.T)
    assert readings(turned, seen) == pytest.approx(readings(known, motion), abs=1e-12)
    data = readings(known, motion)
    assert turned.correct(data).f == pytest.approx(seen.f, abs=1e-11)
    assert turned.correct(data).w == pytest.approx(seen.w, abs=1e-12)


def test_the_triangular_frame_leaves_nothing_above_the_diagonal():
    turned = calibration(imu(), *AFFINE).in_frame("triangular")
    own, _, _ = matrices(turned.sensor, turned.values)
    assert own[np.triu_indices(3, 1)] == pytest.approx(0, abs=1e-16)
    assert (np.diag(own) > 0).all()
    # x sees no y and no z, y no z: their coefficients are zero, and known to be.
    for name in ("ax.delta_o", "ax.delta_p", "ay.delta_o"):
        assert turned.value(name) == pytest.approx(0, abs=1e-16)
        assert turned.uncertainty(name) < 1e-12


def test_the_symmetric_frame_leaves_a_symmetric_matrix():
    turned = calibration(imu(), *AFFINE).in_frame("symmetric")
    own, _, _ = matrices(turned.sensor, turned.values)
    assert own == pytest.approx(own.T, abs=1e-15)
    assert (np.linalg.eigvalsh(own) > 0).all()
    assert np.abs(own - np.diag(np.diag(own))).max() > 1e-3


@pytest.mark.parametrize("frame", FRAMES)
def test_gyros_turn_along_with_the_accelerometers(frame: Literal["triangular", "symmetric"]):
    known = calibration(imu(), *AFFINE)
    turned = known.in_frame(frame)
    _, rate, force = matrices(known.sensor, known.values)
    _, new_rate, new_force = matrices(turned.sensor, turned.values)
    assert new_rate == pytest.approx(rate @ turned.mount.T, abs=1e-15)
    assert new_force == pytest.approx(force @ turned.mount.T, abs=1e-17)


@pytest.mark.parametrize("frame", FRAMES)
def test_the_covariance_in_another_frame_is_that_of_monte_carlo(
    frame: Literal["triangular", "symmetric"],
):
    known = calibration(imu(), *AFFINE)
    sensor = known.sensor
    c = np.random.default_rng(9).multivariate_normal(known.values, known.covariance, DRAWS)
    own, rate, force = matrices(sensor, c)
    # Both M Qᵀ are roots of M Mᵀ: the triangular and the symmetric one.
    square = own @ np.swapaxes(own, -1, -2)
    if frame == "triangular":
        root = np.linalg.cholesky(square)
    else:
        size, vectors = np.linalg.eigh(square)
        root = (vectors * np.sqrt(size)[:, None]) @ np.swapaxes(vectors, -1, -2)
    back = np.swapaxes(np.linalg.solve(root, own), -1, -2)
    turned = np.concatenate([root, rate @ back], axis=-2)
    felt = np.concatenate([np.zeros_like(root), force @ back], axis=-2)
    columns: list[Array] = []
    for name in sensor.coefficients:
        axis, _, short = name.partition(".")
        k = sensor.channels.index(axis)
        frame_of = sensor.axes[k].frame
        along, of_force = turned[:, k] @ frame_of.T, felt[:, k] @ frame_of.T
        columns.append(
            {
                "k0": c[:, sensor.coefficients.index(name)],
                "bias": c[:, sensor.coefficients.index(name)],
                "k1": along[:, 0] - 1,
                "scale": along[:, 0] - 1,
                "delta_o": along[:, 1],
                "delta_p": -along[:, 2],
                "g_i": of_force[:, 0],
                "g_p": of_force[:, 1],
                "g_o": of_force[:, 2],
            }[short]
        )
    # In natural sizes, so that a coefficient is told to be certain from its own deviation.
    unit_scale = sensor.unit_scale
    found = known.in_frame(frame)
    assert found.sensor.coefficients == sensor.coefficients
    assert_covariance(
        found.covariance / np.outer(unit_scale, unit_scale), np.stack(columns, -1) / unit_scale
    )


def test_coefficients_that_were_not_calibrated_appear_where_the_turn_makes_them():
    known = calibration(triad(), "bias", "nonorthogonality")
    turned = known.in_frame("symmetric")
    assert len(turned.sensor.coefficients) == 12
    motion = Motion(motions().f)
    seen = Motion(motion.f @ turned.mount.T)
    assert readings(turned, seen) == pytest.approx(readings(known, motion), abs=1e-12)


def test_one_frame_after_the_other_is_the_last_one():
    known = calibration(imu(), *AFFINE)
    direct, around = known.in_frame("symmetric"), known.in_frame("triangular").in_frame("symmetric")
    assert around.values == pytest.approx(direct.values, abs=1e-14)
    assert around.mount == pytest.approx(direct.mount, abs=1e-14)
    assert direct.in_frame("symmetric") is direct


def test_the_mounting_frame_cannot_be_recovered():
    turned = calibration(imu(), *AFFINE).in_frame("triangular")
    with refused(key="frame"):
        turned.in_frame("mount")


def test_nonlinear_terms_do_not_turn_with_the_frame():
    with refused(names=["ax.k2"]):
        calibration(imu(), *AFFINE, "ax.k2").in_frame("triangular")


def test_only_triads_change_frame():
    for sensor in (pair(), triad("t", "w")):
        with refused(names=sensor.channels):
            calibration(sensor, "bias", "scale").in_frame("triangular")


@pytest.mark.parametrize("frame", FRAMES)
def test_the_tilted_form_changes_frame_as_the_reference_form_does(
    frame: Literal["triangular", "symmetric"],
):
    known = calibration(imu(), *AFFINE)
    turned = known.in_form("tilted").in_frame(frame)
    motion = motions()
    seen = Motion(motion.f @ turned.mount.T, motion.w @ turned.mount.T)
    assert readings(turned, seen) == pytest.approx(readings(known, motion), abs=1e-11)
    assert turned.mount == pytest.approx(known.in_frame(frame).mount, abs=1e-12)


# What is shared


def sharing(known: Calibration) -> Calibration:
    """Return it with an error of the bench that moves all coefficients."""
    rng = np.random.default_rng(3)
    column = 1e-4 * known.sensor.unit_scale * rng.uniform(-1, 1, known.values.size)
    return replace(known, shared=(SharedError("g", "m/s²", 1e-4, column * 1e-4, "a"),))


@pytest.mark.parametrize("to", ["tilted", "triangular", "symmetric", "ieee1293"])
def test_what_is_shared_moves_as_the_values_do(to: str):
    known = sharing(calibration(imu(), *AFFINE))

    def changed(one: Calibration) -> Calibration | ConvertedCoefficients:
        if to == "ieee1293":
            return one.ieee1293()
        return one.in_form("tilted") if to == "tilted" else one.in_frame(FRAMES[to == "symmetric"])

    assert known.shared is not None
    h = 1e-4  # m/s²
    step = h * known.shared[0].sensitivity
    there, here = (changed(replace(known, values=known.values + s * step)) for s in (1, -1))
    after = changed(known).shared
    assert after is not None
    (found,) = after
    expected = (there.values - here.values) / (2 * h)
    assert found.sensitivity == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.abs(expected).max())
    assert (found.name, found.std, found.determination) == ("g", 1e-4, "a")


def test_what_is_not_known_to_be_shared_stays_so():
    known = calibration(imu(), *AFFINE)
    assert known.in_frame("triangular").shared is None
    assert replace(known, shared=()).in_form("tilted").shared == ()


def test_a_shared_error_of_other_coefficients_is_refused():
    known = sharing(calibration(imu(), *AFFINE))
    assert known.shared is not None
    with refused(names=["g"]):
        replace(known, sensor=triad().with_coefficients("bias"), values=np.zeros(3),
                covariance=np.eye(3))  # fmt: skip
    with refused(names=["g"]):
        replace(known, shared=(*known.shared, *known.shared))
