"""The forward model against hand calculations, vector formulas and finite differences."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.refusals import refused

from inercal.basics.errors import InputError, NotInvertible
from inercal.methods.residuals import norm_residuals
from inercal.physics.motion import Motion
from inercal.physics.sensors import (
    ACCELEROMETER,
    G0,
    GYRO,
    Form,
    Sensor,
    cluster,
    imu,
    inverse,
    pair,
    single,
    triad,
)
from inercal.physics.sensors.coefficient_selection import select_coefficients
from inercal.physics.sensors.coefficient_tables import COMPONENTS

UG, PPM = 1e-6 * G0, 1e-6
rng = np.random.default_rng(1293)
MOTION = Motion(
    rng.normal(size=(40, 3)) * 2 * G0,
    rng.normal(size=(40, 3)) * 10,
    rng.normal(size=(40, 3)) * 50,
    100 * rng.normal(size=40),
    0.1 * rng.normal(size=40),
)
EVERYTHING = [f"{a}.{c.name}" for a in ("ax", "ay", "az") for c in ACCELEROMETER] + [
    f"{a}.{c.name}" for a in ("gx", "gy", "gz") for c in GYRO
]
# Natural sizes give effects of 1 g at 1 g; ω and dω/dt above are tens, so their terms get less.
LARGE = {"nonlinearity": 1e-3, "rotation": 1e-5, "arm": 1e-4, "temperature": 1e-3, "cross": 1e-3}
LARGE["temperature_order"] = 1e-4  # ΔT above is several times 100 K
LARGE_ALONE = {"scale3": 1e-5}  # of ω³


def coefficients(sensor: Sensor, seed: int = 7) -> np.ndarray:
    lines = [sensor.coefficient(n) for n in sensor.coefficients]
    sizes = [LARGE_ALONE.get(line.name, LARGE.get(line.group, 5e-3)) for line in lines]
    draw = np.random.default_rng(seed).normal(size=len(sensor.coefficients))
    return draw * sizes * sensor.unit_scale


def test_k2_of_ten_micro_g_adds_ten_micro_g_at_one_g():
    y = (
        triad()
        .with_coefficients("k2")
        .forward(Motion(np.array([[G0, 0, 0]])), np.array([10 * UG / G0**2, 0, 0]))
    )
    assert_allclose(y[0], [G0 + 10 * UG, 0, 0], rtol=1e-15)


@pytest.mark.parametrize("name", [c.name for c in (*ACCELEROMETER, *GYRO)])
def test_one_natural_unit_reads_its_unit_at_one_g_one_rad_per_s_and_100_k(name: str):
    table = ACCELEROMETER if name in {c.name for c in ACCELEROMETER} else GYRO
    c = next(c for c in table if c.name == name)
    one = {name: np.array(G0 if name.startswith("f") else 1.0) for name in COMPONENTS}
    one["dT"], one["dTdt"] = np.array(100.0), np.array(10 / 60)
    unit = G0 if table is ACCELEROMETER else 1.0
    factor = sum(p.factor for p in c.basis.products)
    assert_allclose(c.unit_scale * c.basis.value(one), unit * factor, rtol=1e-12, atol=1e-12)


def test_misalignments_have_the_signs_of_ieee_1293():
    # E/K1 = … + δo a_p − δp a_o
    sensor = single().with_coefficients("misalignment")
    y = sensor.forward(Motion(np.array([[1.0, 2.0, 3.0]])), np.array([1e-3, 1e-4]))
    assert_allclose(y[0, 0], 1.0 + 1e-3 * 2.0 - 1e-4 * 3.0, rtol=1e-15)


def test_lever_arms_agree_with_the_vector_formula():
    r = np.array([3e-3, -2e-3, 5e-3])
    expected = MOTION.f + np.cross(MOTION.dw, r) + np.cross(MOTION.w, np.cross(MOTION.w, r))
    c = np.concatenate([np.roll(r, -axis) for axis in range(3)])
    for form in ("reference", "tilted"):
        sensor = Sensor("t", triad().axes, form=form).with_coefficients("arm")
        assert_allclose(sensor.forward(MOTION, c), expected, rtol=1e-12)


def test_tilted_form_turns_a_unit_axis_and_the_nonlinearity_with_it():
    sensor = Sensor("t", single().axes, form="tilted").with_coefficients("k1", "misalignment", "k2")
    k1, delta_o, delta_p, k2 = c = np.array([0.29, 0.02, -0.03, 1e-3 / G0])
    h = np.array([1.0, np.tan(delta_o), -np.tan(delta_p)])
    a = MOTION.f @ (h / np.linalg.norm(h))
    assert_allclose(sensor.forward(MOTION, c)[:, 0], (1 + k1) * a + k2 * a**2, rtol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["reference", "tilted"])
def test_design_and_slope_are_the_derivatives_of_forward(form: Form):
    # every coefficient of both tables at once, against central differences
    sensor = Sensor("s", imu().axes, tuple(EVERYTHING), form)
    c = coefficients(sensor)
    numeric = np.empty((40, 6, len(c)))
    for j, h in enumerate(1e-6 * sensor.unit_scale):
        step = np.eye(len(c))[j] * h
        numeric[..., j] = (sensor.forward(MOTION, c + step) - sensor.forward(MOTION, c - step)) / (
            2 * h
        )
    size = np.abs(numeric).max(axis=(0, 1))
    assert (np.abs(sensor.design(MOTION, c) - numeric).max(axis=(0, 1)) < 3e-7 * size).all()
    slope = sensor.slope(MOTION, c)
    for k in range(6):
        step = 1e-5 * np.eye(6)[k]
        ahead, behind = (
            Motion(MOTION.f + s * step[:3], MOTION.w + s * step[3:], MOTION.dw, MOTION.dT)
            for s in (1, -1)
        )
        numeric_slope = (sensor.forward(ahead, c) - sensor.forward(behind, c)) / 2e-5
        assert_allclose(slope[..., k], numeric_slope, atol=2e-8)


@pytest.mark.parametrize("form", ["reference", "tilted"])
def test_trials_on_a_leading_axis_agree_with_one_at_a_time(form: Form):
    sensor = Sensor("s", imu().axes, tuple(EVERYTHING), form)
    c = np.stack([coefficients(sensor, seed) for seed in range(3)])
    together = sensor.forward(MOTION, c), sensor.design(MOTION, c), sensor.slope(MOTION, c)
    for k in range(3):
        alone = (
            sensor.forward(MOTION, c[k]),
            sensor.design(MOTION, c[k]),
            sensor.slope(MOTION, c[k]),
        )
        for a, b in zip(together, alone, strict=True):
            assert_allclose(a[k], b, rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("form", ["reference", "tilted"])
def test_inverse_undoes_forward_with_every_smooth_coefficient_at_once(form: Form):
    smooth = tuple(n for n in EVERYTHING if not n.endswith("k0_prime"))
    sensor = Sensor("s", imu().axes, smooth, form)
    c = coefficients(sensor)
    y = sensor.forward(MOTION, c)
    assert np.abs(y[:, :3] - MOTION.f).max() > 0.01 * G0  # the coefficients do something
    back = inverse(sensor, y, c, dw=MOTION.dw, dT=MOTION.dT, dTdt=MOTION.dTdt)
    assert_allclose(back.f, MOTION.f, atol=1e-11)
    assert_allclose(back.w, MOTION.w, atol=1e-11)


@pytest.mark.parametrize("form", ["reference", "tilted"])
@pytest.mark.parametrize("k2_per_g", [1e-3, -1e-3])
def test_inverse_is_exact_at_40_g_with_a_scale_of_129_percent(form: Form, k2_per_g: float):
    sensor = Sensor("t", triad().axes, form=form).with_coefficients("bias", "scale", "k2")
    c = np.array([0.2 * G0, 0.29, k2_per_g / G0] * 3)
    f = np.random.default_rng(40).uniform(-40 * G0, 40 * G0, (500, 3))
    back = inverse(sensor, sensor.forward(Motion(f), c), c).f
    assert np.abs(back / f - 1).max() < 1e-12


@pytest.mark.slow
def test_inverse_of_many_trials_and_many_chunks():
    sensor = imu().with_coefficients("bias", "scale", "misalignment", "g", "k2")
    c = np.stack([coefficients(sensor, seed) for seed in range(2)])
    f, w = rng.normal(size=(2, 70_000, 3)) * G0, rng.normal(size=(2, 70_000, 3))
    back = inverse(sensor, sensor.forward(Motion(f, w), c), c)
    assert_allclose(back.f, f, atol=1e-11)
    assert_allclose(back.w, w, atol=1e-11)


def test_inverse_refuses_where_the_model_folds_back():
    sensor = triad().with_coefficients("k2")
    with refused(NotInvertible):
        inverse(sensor, np.full((1, 3), 50 * G0), np.full(3, -0.1 / G0))


def test_readings_beyond_the_fold_are_nan_for_an_optimiser():
    sensor, c = triad().with_coefficients("k2"), np.full(3, -0.1 / G0)
    readings = np.array([[1.0, 1.0, 1.0], [50.0, 1.0, 1.0]]) * G0
    force = inverse(sensor, readings, c, refuse=False).f
    assert np.isfinite(force).all(axis=1).tolist() == [True, False]
    seen = norm_residuals(sensor, readings, c, np.full(2, 3**0.5 * G0))
    assert np.isfinite(seen.residual).tolist() == [True, False]
    assert np.isfinite(seen.jacobian).all()


def test_a_redundant_cluster_inverts_in_the_sense_of_least_squares():
    axes = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [-1, 1, 1]]
    sensor = cluster("five", axes).with_coefficients("bias", "scale", "misalignment", "k2")
    c = coefficients(sensor)
    noise = 1e-3 * rng.normal(size=(40, 5))
    assert_allclose(inverse(sensor, sensor.forward(MOTION, c), c).f, MOTION.f, atol=1e-10)
    y = sensor.forward(MOTION, c) + noise
    f = inverse(sensor, y, c).f
    left = y - sensor.forward(Motion(f), c)
    slope = sensor.slope(Motion(f), c)[..., :3]
    assert np.abs(np.einsum("nmk,nm->nk", slope, left)).max() < 1e-10  # normal equations


def test_a_pair_needs_the_cross_component_or_refuses():
    sensor = pair().with_coefficients("bias", "misalignment", "k2", "kip")
    c = coefficients(sensor)
    y = sensor.forward(MOTION, c)
    with refused(key="f"):
        inverse(sensor, y, c)
    assert_allclose(inverse(sensor, y, c, f=MOTION.f).f, MOTION.f, atol=1e-11)


def test_choosing_by_group_name_and_axis():
    sensor = triad()
    assert sensor.with_coefficients("x.k2", "bias").coefficients == ("x.k0", "x.k2", "y.k0", "z.k0")
    assert imu().with_coefficients("bias").coefficients[3:] == ("gx.bias", "gy.bias", "gz.bias")


def test_nonorthogonality_makes_the_matrix_lower_triangular():
    sensor = triad().with_coefficients("scale", "nonorthogonality")
    assert sensor.coefficients == (
        "x.k1", "y.k1", "y.delta_p", "z.k1", "z.delta_o", "z.delta_p",
    )  # fmt: skip
    slope = sensor.slope(Motion(np.zeros((1, 3))), np.full(6, 1e-3))[0, :, :3]
    assert np.array_equal(slope == 0, np.triu(np.ones((3, 3)), 1) == 1)


def test_unknown_coefficient_says_what_there_is():
    with refused(names=["k9"]):
        triad().with_coefficients("bias", "k9")
    with refused(names=["missalignment"]) as refusal:
        triad().with_coefficients("missalignment")
    assert "did you mean misalignment?" in str(refusal.value)
    with refused(names=["k1_sens"]) as refusal:
        triad().with_coefficients("k1_sens")
    assert "did you mean k1?" in str(refusal.value)
    for typed, meant in (("ax.ko", "k0"), ("kl", "k1")):
        with refused(names=[typed]) as refusal:
            imu().with_coefficients(typed)
        assert f"did you mean {meant}?" in str(refusal.value)


def test_readout_converts_both_ways():
    from inercal.physics.sensors import Noise, Readout

    sensor = triad(readout=Readout(scale=208.0, offset=-3.0, unit="LSB"), noise=Noise())
    raw = rng.integers(-2000, 2000, (5, 3)).astype(float)
    assert_allclose(sensor.to_output(sensor.to_si(raw)), raw, rtol=1e-14, atol=1e-10)


def test_inverse_across_the_gap_of_a_bias_asymmetry():
    sensor = triad().with_coefficients("k0_prime", "k1", "koq")
    c = np.abs(coefficients(sensor))  # a negative one folds back: two motions give one reading
    f = rng.normal(size=(200, 3)) * G0
    assert_allclose(inverse(sensor, sensor.forward(Motion(f), c), c).f, f, atol=1e-10)
    # A reading of 0 lies in the gap between −k0′/2 and +k0′/2: the nearest motion is none.
    positive = np.array([0.01 * G0, 0, 0] * 3)
    readings = np.array([[0.0, 0.004 * G0, 1.0]])
    assert_allclose(
        inverse(triad().with_coefficients("k0_prime"), readings, positive[::3]).f,
        [[0.0, 0.0, 1.0 - 0.005 * G0]],
        atol=1e-12,
    )


@pytest.mark.parametrize("name", ["arm_i", "arm_p", "arm_o"])
def test_one_component_of_a_lever_arm_alone_acts_alike_in_both_forms(name: str):
    axes, c = triad().axes, np.array([2e-3, -1e-3, 3e-3])
    both = [
        Sensor("t", axes, form=form).with_coefficients(name) for form in ("reference", "tilted")
    ]
    plain, turned = (sensor.forward(MOTION, c) for sensor in both)
    assert_allclose(turned, plain, rtol=1e-13)
    assert_allclose(both[1].design(MOTION, c), both[0].design(MOTION, c), atol=1e-11)


def test_the_sample_that_does_not_invert_is_named_by_its_own_number():
    y = np.zeros((70_000, 3))
    y[69_000] = 50 * G0
    with refused(NotInvertible) as refusal:
        inverse(triad().with_coefficients("k2"), y, np.full(3, -0.1 / G0))
    assert "69000" in str(refusal.value)


def test_one_recording_inverts_under_many_trials_of_coefficients():
    sensor = triad().with_coefficients("bias", "k2")
    c = np.stack([coefficients(sensor, seed) for seed in range(4)])
    y = rng.normal(size=(7, 3)) * G0
    together = inverse(sensor, y, c).f
    for k in range(4):
        assert_allclose(together[k], inverse(sensor, y, c[k]).f, rtol=1e-12, atol=1e-12)


def test_auto_among_other_words_is_told_to_stand_alone():
    with pytest.raises(InputError) as refusal:
        select_coefficients(imu().axes, ["auto", "g"])
    assert refusal.value.names == ("auto",)
    assert 'also = "auto"' in str(refusal.value)
    assert "k1_prime" not in str(refusal.value)
