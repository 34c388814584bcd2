"""Every method that lists coefficients of temperature finds them, and refuses what it cannot."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.methods.test_every_estimator import bench_of
from tests.refusals import refused

from inercal.basics.errors import InputError, NotObserved
from inercal.benches import DividingHead, Turntable
from inercal.benches.dividing_head.bench import mounted_sensor
from inercal.estimation import Gaussian
from inercal.methods import METHODS
from inercal.methods.temperature import row_offsets, temperature_coefficients
from inercal.physics.motion import Motion
from inercal.physics.sensors import Sensor, imu
from inercal.recordings import Observations, Track, join_observations
from inercal.recordings.temperature import TEMPERATURE_VARIATION

Array = NDArray[np.float64]
TEMPERATURES = (263.15, 323.15)
FIRST = ("k0_dT", "k1_dT", "bias_dT", "scale_dT")
MEANS = [
    (name, estimator)
    for name, one in METHODS.items()
    for estimator in one.estimators
    if one.also and one.bench is not Turntable and "temperature" in one.also.get("f", ())
]
# Closed formulas, and the sources' own parametrisations.
REFUSED = {
    ("six_position", "classical"), ("ferraris", "classical"), ("tumble", "fourier"),
    ("rates_and_poses", "ieee"),
    ("dual_orthogonal", "patent"), ("dual_orthogonal", "dual"),
    *(("centrifuge_norm", name) for name in ("series", "series_weighted", "paper")),
    *(("ship_multi_angle", name) for name in ("planar", "planar_norm", "damped", "global")),
}  # fmt: skip


def steps_of(method: str) -> list[Any]:
    """Return the method's plan once at each temperature."""
    return [
        replace(step, label=f"{step.label} ({k})")
        for k in range(len(TEMPERATURES))
        for step in METHODS[method].plan()
    ]


def motion_of(method: str, steps: Sequence[Any]) -> Motion:
    bench: Any = bench_of(method)
    return bench.mean_motion(steps, {}).motion


def made(method: str, estimator: str) -> tuple[Sensor, Array, Observations, list[Any]]:
    """Return sensor, truth, readings without noise at both temperatures, and their steps."""
    chosen = METHODS[method]
    whole = imu().select_axes("f") if chosen.unknown_attitudes else imu()
    if chosen.bench is DividingHead:
        whole = mounted_sensor(axes="a" if method == "tumble" else "ab")
        whole = replace(whole, form="reference" if estimator == "fourier" else "tilted")
    kinds = {axis.measures for axis in whole.axes if axis.measures in chosen.default_coefficients}
    also = FIRST if kinds == {"f", "w"} else FIRST[:2]
    if "scale" not in chosen.default_coefficients.get("w", ("scale",)):
        also = FIRST[:3]  # a method without rates
    sensor = chosen.prepare(whole, also=also)
    p = len(sensor.coefficients)
    c = 2e-3 * np.random.default_rng(5).normal(size=p) * sensor.unit_scale
    if method == "centrifuge_norm":
        c[[name.endswith(".k2") for name in sensor.coefficients]] *= 1e-2
    steps = steps_of(method)
    each = len(steps) // len(TEMPERATURES)
    temperature = np.repeat(np.array(TEMPERATURES, dtype=np.float64), each)
    motion = replace(motion_of(method, steps), dT=temperature - sensor.reference_temperature)
    m, r = len(sensor.axes), len(steps)
    seen = Observations(
        tuple(step.label for step in steps),
        sensor.forward(motion, c),
        np.broadcast_to(1e-10 * np.eye(m), (r, m, m)),
        np.array([step.seconds for step in steps]),
        np.full(r, 1000),
        np.arange(r, dtype=float),
        sensor.channels,
        temperature=temperature,
    )
    return sensor, c, seen, steps


def priors(method: str, sensor: Sensor, c: Array) -> list[Gaussian]:
    if method != "dual_orthogonal":
        return []
    known = [k for k, name in enumerate(sensor.coefficients) if name[2:] in ("kip", "k3")]
    names = tuple(sensor.coefficients[k] for k in known)
    return [Gaussian.independent(names, c[known], 1e-3 * sensor.unit_scale[known])]


@pytest.mark.parametrize(("method", "estimator"), MEANS)
def test_each_estimator_finds_coefficients_of_temperature_or_refuses_them_by_name(
    method: str, estimator: str
):
    sensor, c, seen, steps = made(method, estimator)
    solve = METHODS[method].estimator(estimator)
    told = priors(method, sensor, c)
    if (method, estimator) in REFUSED:
        with refused(key="[method]", names=temperature_coefficients(sensor)):
            solve(seen, sensor, bench_of(method), steps, told)
        return
    found = solve(seen, sensor, bench_of(method), steps, told)
    error = (found.value[: c.size] - c) / sensor.unit_scale
    np.testing.assert_allclose(error, 0, atol=1e-6)


@pytest.mark.parametrize(("method", "estimator"), [one for one in MEANS if one not in REFUSED])
def test_one_temperature_and_none_are_refused_by_name(method: str, estimator: str):
    sensor, c, seen, steps = made(method, estimator)
    solve = METHODS[method].estimator(estimator)
    told = priors(method, sensor, c)
    rng = np.random.default_rng(3)
    scatter = (
        0.2 * TEMPERATURE_VARIATION * rng.uniform(-1, 1, len(steps))
    )  # of a sensor of temperature
    alike = replace(seen, temperature=300.0 + scatter)
    with pytest.raises(NotObserved) as raised:
        solve(alike, sensor, bench_of(method), steps, told)
    words = " ".join(raised.value.directions)
    warm = temperature_coefficients(sensor)
    assert all(name in words for name in warm)
    with refused(key="[data] temperature", names=warm):
        solve(replace(seen, temperature=None), sensor, bench_of(method), steps, told)


@pytest.mark.parametrize("method", ["ship_planar"])
def test_methods_without_a_place_for_them_refuse_coefficients_of_temperature(method: str):
    with refused(key="[method]", names=[f"{axis}.k0_dT" for axis in ("ax", "ay", "az")]):
        METHODS[method].prepare(imu(), also=("k0_dT",))


@pytest.mark.slow
def test_a_bias_that_follows_the_temperature_is_a_suspect_where_it_was_recorded():
    _, _, seen, steps = made("six_position", "ml")
    plain = METHODS["six_position"].prepare(imu())
    solve = METHODS["six_position"].estimator("ml")
    bench = bench_of("six_position")
    seen = replace(seen, covariance=seen.covariance * 100)
    score_tests = solve(seen, plain, bench, steps).score_tests
    worst = max(score_tests.scores, key=lambda one: one.chi2)
    assert worst.name in ("k0_dT", "k1_dT")
    for silent in (None, np.full(len(steps), 300.0)):
        of_others = solve(replace(seen, temperature=silent), plain, bench, steps).score_tests
        assert not [one for one in of_others.scores if "_dT" in one.name]


def observations(r: int, temperature: Array | None, **changes: Any) -> Observations:
    return Observations(
        tuple(f"r{k}" for k in range(r)),
        np.zeros((r, 1)),
        np.ones((r, 1, 1)),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        ("i",),
        temperature=temperature,
        **changes,
    )


def test_rows_that_are_joined_or_taken_keep_their_temperatures():
    one, other = observations(2, np.array([280.0, 281.0])), observations(1, np.array([290.0]))
    assert join_observations(one, other).temperature == pytest.approx([280, 281, 290])
    assert join_observations(one, observations(1, None)).temperature is None
    assert join_observations(one, other).rows([2, 0]).temperature == pytest.approx([290, 280])
    assert one.temperature_offset(280.5) == pytest.approx([-0.5, 0.5])
    assert observations(2, None).temperature_offset(280.5).shape == ()
    assert [seen.temperature_varies for seen in (one, other, observations(2, None))] == [
        True,
        False,
        False,
    ]


def test_temperatures_of_another_number_or_not_finite_are_refused():
    with pytest.raises(InputError):
        observations(2, np.zeros(3))
    with pytest.raises(InputError):
        observations(2, np.array([280.0, np.nan]))


def test_a_track_cuts_its_temperature_with_its_samples():
    n = 5
    track = Track(
        np.arange(n, dtype=float),
        np.zeros((2, n, 1)),
        np.zeros((2, n, 1)),
        np.zeros(n, dtype=np.int64),
        np.linspace(280.0, 284.0, n),
    )
    assert track.slice(1, 3).temperature == pytest.approx([281, 282])
    assert track.trial(1).temperature == pytest.approx(280.0 + np.arange(n))
    each = replace(track, temperature=np.stack([np.full(n, 280.0), np.full(n, 290.0)]))
    assert each.trial(1).temperature == pytest.approx(np.full(n, 290.0))
    with pytest.raises(InputError):
        replace(track, temperature=np.zeros(4))
    with pytest.raises(InputError):
        replace(track, temperature=np.array([1.0, 1.0, np.nan, 1.0, 1.0]))


def test_rows_of_nearly_one_temperature_keep_their_own_if_priors_state_all_coefficients():
    sensor, _, seen, steps = made("tumble", "least_squares")
    kelvin = 300.0 + np.linspace(0.0, 0.7 * TEMPERATURE_VARIATION, len(steps))
    names = tuple(temperature_coefficients(sensor))
    told = Gaussian.independent(names, np.zeros(len(names)), np.ones(len(names)))
    seen = replace(seen, temperature=kelvin)
    own = row_offsets(seen, sensor, [told])
    np.testing.assert_allclose(own, kelvin - sensor.reference_temperature)
    assert np.ptp(row_offsets(seen, sensor)) == 0
    one = Gaussian.independent(names[:1], np.zeros(1), np.ones(1))
    assert np.ptp(row_offsets(seen, sensor, [one])) == 0
