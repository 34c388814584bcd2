"""What a run on a dividing head leaves out or states too well is seen and named.

Devices and heads by `tests.accuracy.dividing_head` and `tests.accuracy.tumble`, which share nothing
with the product.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.dividing_head import ARCSEC, Bench
from tests.accuracy.tumble import Scale
from tests.base_seeds import evidence, most_alarms
from tests.methods import tumble_cases as tumble
from tests.methods.dual_orthogonal_cases import SENSOR, WHOLE, Case, case, known

from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import DividingHead
from inercal.calibration.grade import assess
from inercal.estimation import Estimate
from inercal.methods.dual_orthogonal import dual, joint, patent, single
from inercal.methods.tumble import fourier, least_squares
from inercal.physics.sensors import G0

Array = NDArray[np.float64]
LEVEL = 0.005  # of χ² with the other tests, and of the score tests
# Devices as modelled, and how many may be suspected: of 300, two per cent.
ALARMS = [(40, most_alarms(40, 2 * LEVEL)), evidence(300, 6)]
BOTH = Bench(drifting=3e-6)


def suspect(estimate: Estimate) -> str:
    """Return the candidate that explains most where a test rejects the model, else nothing."""
    seen = [score for score in estimate.score_tests.scores if score.dof]
    best = min(seen, key=lambda score: (score.p_value, -score.chi2))
    tests = [*(test.p_value for test in estimate.tests), float(estimate.p_value)]
    rejected = min(tests) < LEVEL / max(len(tests) - (estimate.dof == 0), 1)
    return best.name if rejected or estimate.score_tests.adjusted(best) < LEVEL else ""


def said(
    given: Case, estimator: Callable[..., Estimate] = joint, change: Array | None = None
) -> Counter[str]:
    """Return how often each candidate is named; one device at a time, as a user has them."""
    found: Counter[str] = Counter()
    priors = [known(given, "kip", 20), known(given, "k3", 5)]
    for k, mean in enumerate(given.seen.mean):
        seen = replace(given.seen, mean=mean if change is None else mean + change)
        own = [replace(prior, mean=prior.mean[k]) for prior in priors]
        found[suspect(estimator(seen, SENSOR, given.bench, given.steps, own))] += 1
    return found


def made(bench: Bench, trials: int, seed: int = 21, **stated: object) -> Case:
    """Return devices on a bench of which something else is stated."""
    given = case(seed, trials, bench, reverse=True)
    return given._replace(bench=replace(given.bench, **stated))


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [joint, patent, single])
def test_a_third_harmonic_that_is_not_declared_is_named(estimator: Callable[..., Estimate]):
    first, second, _ = made(Bench(), 1).bench.harmonics
    given = made(Bench(third=20.0), 8, harmonics=(first, second))
    assert said(given, estimator)["harmonic 3"] >= 7


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [joint, dual, patent])
def test_a_drift_that_is_not_declared_is_named(estimator: Callable[..., Estimate]):
    found = said(made(BOTH, 8, drift=0.0), estimator)
    print(found)
    assert found["drift"] + found["drift of a"] + found["drift of b"] >= 7


@pytest.mark.parametrize("factor", [1.0, -1.0, 1 / 206.3])
def test_a_wrong_sign_or_unit_of_the_autocollimator_is_named(factor: float):
    """The faces deviate, and the autocollimator shows by how much."""
    faces = tuple((7 * np.sin(np.arange(12) ** 2)).tolist())
    given = made(Bench(collimated="every", polygon=faces), 4, polygon=(0.0,) * 12)
    read = factor * ARCSEC * np.array(faces + faces[::-1])
    steps = [replace(s, reading=r) for s, r in zip(given.steps, read.tolist(), strict=True)]
    expected = "" if factor == 1 else "autocollimator scale"
    assert said(given._replace(steps=steps))[expected] == 4


@pytest.mark.parametrize("channels", [(0,), (0, 1)])
def test_a_step_of_a_bias_between_two_passes_is_the_suspect(channels: tuple[int, ...]):
    given = made(BOTH, 2, drift=3e-6 * G0)
    second = np.arange(len(given.steps)) >= len(given.steps) // 2
    change = 60e-6 * G0 * second[:, None] * np.isin([0, 1], channels)
    priors = [known(given, "kip", 20), known(given, "k3", 5)]
    for k, mean in enumerate(given.seen.mean):
        own = [replace(prior, mean=prior.mean[k]) for prior in priors]
        seen = replace(given.seen, mean=mean + change)
        estimate = joint(seen, SENSOR, given.bench, given.steps, own)
        found = assess(estimate, len(SENSOR.coefficients)).suspect
        assert found is not None
        assert found.name.startswith("step of the bias")
        assert given.steps[len(second) // 2].label in found.name
        assert np.array(found.sizes) == pytest.approx(60e-6 * G0, rel=0.2)


@pytest.mark.parametrize("collimated", ["none", "every"])
@pytest.mark.parametrize("factor", [1.0, -1.0, 4.85, 1 / 206.3])
def test_a_wrong_sign_or_unit_of_the_level_or_autocollimator_is_the_suspect(
    factor: float, collimated: Literal["none", "every"]
):
    """The base tilts by 3″ for the second pass, and the instrument shows it with this factor."""
    given = made(Bench(collimated=collimated), 2)
    angle = np.array([step.angle for step in given.steps])
    tilt = 3 * ARCSEC * (np.arange(len(angle)) >= len(angle) // 2)
    change = G0 * tilt[:, None] * np.stack([np.cos(angle), -np.sin(angle)], axis=-1)
    key = "level" if collimated == "none" else "reading"
    shown = (factor * tilt).tolist()
    steps = [replace(s, **{key: one}) for s, one in zip(given.steps, shown, strict=True)]
    priors = [known(given, "kip", 20), known(given, "k3", 5)]
    for k, mean in enumerate(given.seen.mean):
        own = [replace(prior, mean=prior.mean[k]) for prior in priors]
        seen = replace(given.seen, mean=mean + change)
        found = assess(joint(seen, SENSOR, given.bench, steps, own), len(SENSOR.coefficients))
        if factor == 1:
            assert found.best is None
        else:
            assert found.suspect is not None
            assert found.suspect.name == f"{'level' if key == 'level' else 'autocollimator'} scale"
            assert found.suspect.sizes[0] == pytest.approx(1 / factor - 1, rel=0.05)


@pytest.mark.parametrize(
    ("stated", "expected"),
    [
        (lambda d: d, ""),
        (lambda d: tuple(-one for one in d), "polygon certificate with the other sign"),
        (lambda d: d[1:] + d[:1], "polygon certificate shifted by one face"),
        (lambda d: d[-1:] + d[:-1], "polygon certificate shifted back by one face"),
    ],
)
def test_a_certificate_with_another_sign_or_first_face_is_named(
    stated: Callable[[tuple[float, ...]], tuple[float, ...]], expected: str
):
    faces = tuple((7 * np.sin(np.arange(12) ** 2)).tolist())
    bench = Bench(collimated="every", polygon=faces)
    given = made(bench, 4, polygon=tuple(ARCSEC * one for one in stated(faces)))
    assert said(given)[expected] == 4


def test_a_creep_that_is_not_declared_is_named():
    assert said(made(Bench(creep=3.0), 8, creep=0.0))["creep"] >= 7


@pytest.mark.slow
def test_an_outlying_row_is_named():
    change = np.zeros((24, 2))
    change[5, 0] = 1e-5 * G0
    given = made(Bench(), 8)
    assert said(given, joint, change) == {given.seen.labels[5]: 8}


@pytest.mark.parametrize("estimator", [joint, dual, patent, single])
def test_devices_as_modelled_are_suspected_of_nothing(estimator: Callable[..., Estimate]):
    assert said(made(WHOLE, 3, 31), estimator)[""] == 3


@pytest.mark.slow
@pytest.mark.parametrize(("devices", "most"), ALARMS)
def test_false_alarms_of_joint_are_few(devices: int, most: int):
    for bench, seed in ((Bench(), 11), (WHOLE, 12)):
        found = said(made(bench, devices, seed))
        print(found)
        assert found[""] >= devices - most


def tumbled(estimator: Callable[..., Estimate], devices: int, third: float = 0.0) -> Counter[str]:
    """Return the suspects of tumble tests whose head also has a third harmonic, ″."""
    plan, sensor = tumble.positions(12, back=True), tumble.sensor()
    bench = DividingHead(
        Measured(tumble.G * G0, 0.0), (2 * ARCSEC, ARCSEC), collimated="none", base=5 * ARCSEC
    )
    found: Counter[str] = Counter()
    for seed in range(devices):
        rng = np.random.default_rng([seed, 1293])
        one, two, zero = rng.standard_normal((3, 2))
        head = Scale(
            {1: 2 * ARCSEC * one[0], 2: ARCSEC * two[0], 3: third * ARCSEC},
            {1: 2 * ARCSEC * one[1], 2: ARCSEC * two[1]},
        )
        true = head.true(tumble.angles(plan)) + 5 * ARCSEC * zero[0]
        noise = tumble.NOISE * rng.standard_normal(len(plan))
        seen = tumble.seen(plan, tumble.DEVICE.reading(true, tumble.G) + noise)
        found[suspect(estimator(seen, sensor, bench, plan))] += 1
    return found


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [least_squares, fourier])
def test_a_tumble_names_the_harmonic_that_its_head_does_not_state(
    estimator: Callable[..., Estimate],
):
    assert tumbled(estimator, 8)[""] == 8
    assert tumbled(estimator, 8, 2.0)["harmonic 3"] == 8


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [least_squares, fourier])
@pytest.mark.parametrize(("devices", "most"), ALARMS)
def test_false_alarms_of_a_tumble_are_few(
    estimator: Callable[..., Estimate], devices: int, most: int
):
    assert tumbled(estimator, devices)[""] >= devices - most
