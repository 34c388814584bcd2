"""Known attitudes: lever arms and symmetric misalignments by norms; vectors and their errors."""

from dataclasses import replace
from math import cos, sin

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.centrifuge import (
    PAPER_G,
    RATES,
    Triad,
    full_circle,
    printed_attitudes,
    sensed_motion,
    ups,
)
from tests.methods.test_centrifuge_norm import (
    BENCH,
    NOISE,
    NOMINAL,
    TRUTH,
    off,
    printed_design,
    stated,
    table,
)

from inercal.basics.errors import InputError, NotObserved
from inercal.basics.units import Measured
from inercal.benches import Centrifuge
from inercal.estimation import Estimate
from inercal.methods.centrifuge_norm import ml
from inercal.physics.plan import Attitude, Spin, arm_attitude
from inercal.physics.sensors import Sensor

Array = NDArray[np.float64]
# In the printed attitudes `up` has no y: of the nine components these five act on the readings.
ARMS = ("x.arm_i", "x.arm_o", "y.arm_i", "z.arm_i", "z.arm_p")


def attitudes(angles: list[tuple[float, float]]) -> list[Attitude]:
    return [arm_attitude(psi, theta) for psi, theta in angles]


def in_attitudes(spins: list[Spin], known: list[Attitude]) -> list[Spin]:
    return [replace(spin, attitude=known[k % len(known)]) for k, spin in enumerate(spins)]


def symmetric_with_arms(rng: np.random.Generator) -> Triad:
    """Return the paper's triad with symmetric misalignments of 1e-3 rad and arms of 2 cm."""
    above = np.triu(1e-3 * rng.choice([-1.0, 1.0], (3, 3)), 1)
    axes = np.eye(3) + above + above.T
    arms = np.zeros((3, 3))
    for i, k in ((0, 0), (0, 2), (1, 1), (2, 2), (2, 0)):
        arms[i, k] = 0.02 * rng.choice([-1.0, 1.0])
    return replace(TRUTH, axes=axes / np.linalg.norm(axes, axis=1, keepdims=True), arms=arms)


def exact(device: Triad, sensor: Sensor) -> Array:
    """Return the coefficients that describe the device, SI."""
    h = device.axes / np.diagonal(device.axes)[:, None]  # components along the nominal axis are one
    value: dict[str, float] = {}
    for i, a in enumerate("xyz"):
        p, o = (i + 1) % 3, (i + 2) % 3
        value[f"{a}.k0"] = device.bias[i] * PAPER_G / NOMINAL
        value[f"{a}.k1"] = device.scale[i] / NOMINAL - 1
        value[f"{a}.k2"] = device.bend[i] * device.scale[i] / NOMINAL / PAPER_G
        value[f"{a}.delta_o"], value[f"{a}.delta_p"] = np.arctan(h[i, p]), -np.arctan(h[i, o])
        value |= {f"{a}.arm_{n}": device.arms[i, k] for n, k in zip("ipo", (i, p, o), strict=True)}
    return np.array([value[name] for name in sensor.coefficients])


def reading(device: Triad, angles: list[tuple[float, float]]) -> tuple[Array, Array]:
    f, rates = sensed_motion(angles, RATES)
    return device.output(f, ups(angles, RATES), rates), rates


def test_arms_and_symmetric_misalignments_are_recovered_together():
    device = symmetric_with_arms(np.random.default_rng(1))
    output, rates = reading(device, printed_attitudes())
    seen, made, spins = table(output, rates, "misalignment", *ARMS)
    made = replace(made, frame="symmetric")
    found = ml(seen, made, BENCH, in_attitudes(spins, attitudes(printed_attitudes())))
    error = found.value - exact(device, made)
    arms = [name in ARMS for name in made.coefficients]
    assert np.abs(error[arms]).max() < 1e-9  # m
    assert np.abs(error / found.std)[~np.array(arms)].max() < 1e-2


def test_arms_are_known_to_a_few_micrometres():
    """By the note 0.25 to 3 µm, with scale, bias and bending alone."""
    output, rates = reading(TRUTH, printed_attitudes())
    seen, made, spins = table(output, rates, *ARMS)
    found = ml(seen, made, BENCH, in_attitudes(spins, attitudes(printed_attitudes())))
    sd = found.std[[name in ARMS for name in made.coefficients]]
    print("arms known to", sd)
    assert (sd.min(), sd.max()) == pytest.approx((0.25e-6, 3e-6), rel=0.2)


def assert_consistent(seed: int, trials: int) -> None:
    rng = np.random.default_rng([seed, 15])
    devices, outputs = list[Triad](), list[Array]()
    rates = np.repeat(RATES, len(printed_attitudes()))
    for _ in range(trials):
        devices.append(symmetric_with_arms(rng))
        output, _ = reading(devices[-1], printed_attitudes())
        outputs.append(output + NOISE * rng.standard_normal(output.shape))
    seen, made, spins = table(np.array(outputs), rates, "misalignment", *ARMS)
    made = replace(made, frame="symmetric")
    found = ml(seen, made, BENCH, in_attitudes(spins, attitudes(printed_attitudes())))
    # The gauge leaves fewer free directions than coefficients: the pseudo-inverse counts those.
    error = (found.value - [exact(device, made) for device in devices]) / made.unit_scale
    spread = found.covariance / np.outer(made.unit_scale, made.unit_scale)
    inverse = np.linalg.pinv(spread, rcond=1e-13, hermitian=True)
    nees = np.einsum("ti,tij,tj->t", error, inverse, error) / 17
    print(f"NEES {np.mean(nees):.3f}")
    assert np.mean(nees) == pytest.approx(1, abs=4 * np.sqrt(2 / 17 / len(nees)))


def test_what_is_stated_of_arms_and_misalignments_is_what_they_scatter_by(seed: int):
    assert_consistent(seed, 20)


@pytest.mark.evidence
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_three_hundred_times_arms_and_misalignments_scatter_as_stated(seed: int):
    assert_consistent(seed, 300)


@pytest.mark.slow
def test_a_crooked_mounting_is_in_the_uncertainty_of_the_arms(seed: int):
    rng = np.random.default_rng([seed, 16])
    bench = replace(BENCH, mounting=1e-3)
    angles = printed_attitudes()
    f, rates = sensed_motion(angles, RATES)
    devices, outputs = list[Triad](), list[Array]()
    for _ in range(30):
        devices.append(replace(symmetric_with_arms(rng), axes=np.eye(3)))
        mount = turn(bench.mounting * rng.standard_normal(3))
        output = devices[-1].output(f @ mount.T, ups(angles, RATES) @ mount.T, rates)
        outputs.append(output + NOISE * rng.standard_normal(output.shape))
    seen, made, spins = table(np.array(outputs), rates, *ARMS)
    found = ml(seen, made, bench, in_attitudes(spins, attitudes(angles)))
    assert_nees(found, np.array([exact(device, made) for device in devices]))


def assert_nees(found: Estimate, true: Array) -> None:
    """Hold errors of estimates from the true coefficients, (..., p), to their covariance."""
    p = true.shape[-1]
    error = found.value[:, :p] - true
    weighed = np.linalg.solve(found.covariance[:, :p, :p], error[..., None])[..., 0]
    nees = (error * weighed).sum(axis=1) / p
    print(f"NEES {np.mean(nees):.3f}")
    assert np.mean(nees) == pytest.approx(1, abs=4 * np.sqrt(2 / p / len(nees)))


def test_arms_across_what_no_attitude_turns_are_named():
    output, rates = reading(TRUTH, printed_attitudes())
    seen, made, spins = table(output, rates, "arm")
    with pytest.raises(NotObserved) as refusal:
        ml(seen, made, BENCH, in_attitudes(spins, attitudes(printed_attitudes())))
    named = " ".join(refusal.value.directions)
    for name in ("x.arm_p", "y.arm_o", "y.arm_p", "z.arm_o"):
        assert name in named
    with pytest.raises(InputError):
        ml(seen, made, BENCH, spins)


def test_attitudes_known_exactly_reach_their_bound():
    f, rates = printed_design()
    seen, made, spins = table(TRUTH.output(f), rates)
    known = in_attitudes(spins, attitudes(printed_attitudes()))
    found = ml(seen, made, replace(BENCH, indexing=0.0), known)
    assert np.abs(off(found.value)).max() < 1e-11
    expected = [[9.2e-8, 3.8e-7, 1.2e-7], [1.5e-6, 1.8e-6, 1.4e-6], [2.9e-9, 9.6e-9, 3.9e-9]]
    assert stated(found) == pytest.approx(np.array(expected), rel=0.05)


def test_attitudes_known_badly_leave_what_norms_tell():
    f, rates = printed_design()
    seen, made, spins = table(TRUTH.output(f), rates)
    known = in_attitudes(spins, attitudes(printed_attitudes()))
    by_norm = ml(seen, made, BENCH, spins)
    found = ml(seen, made, replace(BENCH, indexing=0.02, mounting=0.02), known)
    ratio = found.std[:9] / by_norm.std[:9]
    assert np.all(ratio < 1 + 1e-6)
    print("vectors over norms", ratio)


def test_errors_of_attitudes_mounting_and_dwells_are_in_the_uncertainty(seed: int):
    """Each attitude, the mounting, each dwell's rate and tilt are drawn."""
    rng = np.random.default_rng([seed, 61])
    bench = Centrifuge(
        Measured(PAPER_G, 3e-4),
        Measured(1.0, 1e-5),
        Measured(0.0, 0.0),
        tilt=1e-5,
        dwell_rate=5e-7,
        dwell_tilt=2e-6,
        indexing=1e-3,
        mounting=5e-3,
    )
    angles = full_circle()[::2]
    outputs: list[Array] = []
    for _ in range(40):
        mount = turn(bench.mounting * rng.standard_normal(3))
        turned = [turn(1e-3 * rng.standard_normal(3)) for _ in angles]
        value = {q.name: rng.normal(q.value, q.sd) for q in bench.parameters}
        rows: list[Array] = []
        for rate in RATES:
            for one, (psi, theta) in zip(turned, angles, strict=True):
                w = rate * (1 + bench.dwell_rate * rng.standard_normal())
                tilt = value["tilt"] + bench.dwell_tilt * rng.standard_normal()
                out = np.array([cos(psi) * cos(theta), sin(psi), cos(psi) * sin(theta)])
                up = np.array([sin(theta), 0.0, -cos(theta)])
                g, a = value["g"], w**2 * value["radius"]
                force = -(a + g * np.sin(tilt)) * out + g * np.cos(tilt) * up
                rows.append(mount @ one @ force / PAPER_G)
        output = TRUTH.output(np.array(rows))
        outputs.append(output + NOISE * rng.standard_normal(output.shape))
    seen, made, spins = table(np.array(outputs), np.repeat(RATES, len(angles)))
    found = ml(seen, made, bench, in_attitudes(spins, attitudes(angles)))
    assert_nees(found, exact(TRUTH, made))


def turn(rotvec: Array) -> Array:
    """Return the rotation by Rodrigues' formula."""
    angle = np.linalg.norm(rotvec)
    x, y, z = rotvec / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + sin(angle) * k + (1 - cos(angle)) * k @ k
