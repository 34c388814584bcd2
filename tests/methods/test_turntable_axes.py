"""Any number of axes on a turntable, in any direction: errors as stated, and those of a triad.

Devices are of a generator that imports nothing of inercal, `axes_on_table`.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.accuracy import turntable
from tests.base_seeds import evidence
from tests.methods import turntable_cases
from tests.methods.axes_on_table import Directions, draw_motions, mount
from tests.methods.axis_accuracy import errors, require_stated_accuracy
from tests.methods.axis_devices import DIRECTIONS
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.basics.units import Measured
from inercal.benches import Turntable
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.methods.turntable_discrete import least_squares
from inercal.physics.sensors import Noise, Sensor, axes_along

Kinds = Mapping[str, Directions]
SEEDS = (1, 2, 3)
TOGETHER = 10  # devices in memory
GRADE, HZ = turntable.T, 10.0
# Between samples at 10 Hz, a longer delay shifts the ends of a turn more than at 100 Hz.
TABLE = turntable.Table(latency=1e-3)
BENCH = turntable_cases.bench(TABLE, lean=TABLE.lean, latency=Measured(0.0, TABLE.latency))
PATH = turntable_cases.discrete(30.0)
WHICH = ("one", "one, inclined", "two, not at right angles", "three", "four")
CASES: dict[str, tuple[Kinds, ...]] = {
    "accelerometers": tuple({"f": DIRECTIONS[one]} for one in WHICH),
    "gyros": tuple({"w": DIRECTIONS[one]} for one in WHICH),
    "both": (
        {"f": DIRECTIONS["one"], "w": DIRECTIONS["one, inclined"]},
        {"f": DIRECTIONS["two, not at right angles"], "w": DIRECTIONS["one"]},
    ),
}


def sensor(directions: Kinds, *coefficients: str, grade: turntable.Grade = GRADE) -> Sensor:
    grades = {"f": (grade.vrw, grade.acc_drift), "w": (grade.arw, grade.gyro_drift)}
    axes = tuple(
        axis
        for kind, prefix in (("f", "a"), ("w", "g"))
        for axis in axes_along(
            directions.get(kind, ()),
            "f" if kind == "f" else "w",
            prefix,
            noise=Noise(
                white=grades[kind][0],
                bias_instability=grades[kind][1],
                correlation=grade.correlation,
            ),
        )
    )
    wanted = coefficients or ("bias", "scale", "misalignment")
    return Sensor("s", axes).with_coefficients(*wanted)


def estimated(
    made: turntable.Draw,
    of: Sensor,
    bench: Turntable = BENCH,
    path: list[turntable.Stand | turntable.Turn] = PATH,
) -> Estimate:
    seen = turntable_cases.observations(made, of)
    return least_squares(seen, of, bench, turntable_cases.steps(path, seen.labels))


def pooled(cases: Sequence[Kinds], n: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return errors (3 n, p) and covariances (3 n, p, p) for each of some sensors."""
    found: list[list[tuple[np.ndarray, np.ndarray]]] = [[] for _ in cases]
    for seed in SEEDS:
        for k in range(0, n, TOGETHER):
            motions = draw_motions(1000 * seed + k, TOGETHER, PATH, TABLE, HZ)
            for directions, results in zip(cases, found, strict=True):
                made, truth = mount(motions, directions, GRADE, 1000 * seed + k)
                estimate = estimated(made, sensor(directions))
                assert estimate.converged.all()
                results.append(errors(truth, estimate))
    return [
        (np.concatenate([one for one, _ in of]), np.concatenate([one for _, one in of]))
        for of in found
    ]


@pytest.mark.slow
@pytest.mark.parametrize("cases", CASES.values(), ids=CASES)
@pytest.mark.parametrize("devices", [20, evidence(200)])  # for each seed
def test_errors_are_as_stated(cases: tuple[Kinds, ...], devices: int):
    for off, covariance in pooled(cases, devices):
        require_stated_accuracy(off, covariance)


# At a bench that is known exactly, nothing couples the axes.
_EXACTLY = Measured(0.0, 0.0)
EXACT = replace(BENCH, lean=0.0, square=0.0, harmonics=(), azimuth=_EXACTLY, latency=_EXACTLY)


@pytest.fixture(scope="module")
def motions() -> turntable.Draw:
    return draw_motions(5, 3, PATH, TABLE, HZ)


def only(made: turntable.Draw, forces: Sequence[int], rates: Sequence[int]) -> turntable.Draw:
    return replace(made, forces=made.forces[..., forces], rates=made.rates[..., rates])


def modelled(estimate: Estimate) -> np.ndarray:
    """Return the standard uncertainties without a factor for the scatter of the residuals."""
    return np.sqrt(np.diagonal(estimate.covariance, axis1=-2, axis2=-1))


@pytest.mark.parametrize("kind", ["f", "w"])
def test_an_uncoupled_axis_gets_the_result_of_the_triad(motions: turntable.Draw, kind: str):
    triad = DIRECTIONS["three"]
    made, _ = mount(motions, {kind: triad}, GRADE, 5)
    whole = estimated(made, sensor({kind: triad}), EXACT)
    for k in range(3):
        of = sensor({kind: [triad[k]]})
        one = estimated(only(made, *([[k], []] if kind == "f" else [[], [k]])), of, EXACT)
        assert one.names == of.coefficients
        at = [whole.names.index(name) for name in one.names]
        assert np.abs((one.value - whole.value[:, at]) / modelled(one)).max() < 1e-9
        np.testing.assert_allclose(modelled(one), modelled(whole)[..., at], rtol=1e-9)


@pytest.mark.parametrize(
    ("kind", "key"),
    [("f", "square"), ("f", "lean"), ("f", "harmonics"), ("w", "square"), ("w", "harmonics")],
)
def test_errors_of_the_table_enter_u_of_one_axis(motions: turntable.Draw, kind: str, key: str):
    triad, size = DIRECTIONS["three"], 60 * turntable.ARCSEC
    bench = replace(EXACT, **{key: (size,) if key == "harmonics" else size})
    made, _ = mount(motions, {kind: triad}, GRADE, 5)
    whole = estimated(made, sensor({kind: triad}), bench)
    larger: list[float] = []
    for k in range(3):
        of = sensor({kind: [triad[k]]})
        alone = only(made, *([[k], []] if kind == "f" else [[], [k]]))
        exact, one = (modelled(estimated(alone, of, b))[..., :4] for b in (EXACT, bench))
        of_triad = modelled(whole)[..., [whole.names.index(name) for name in of.coefficients]]
        # The other axes of a triad also show the error; the slopes change by squares of 60″.
        assert (one > (1 - 1e-3) * of_triad).all()
        larger.append(float((one / exact).max()))
    assert max(larger) > 10


def test_one_axis_that_turned_about_one_axis_does_not_show_its_misalignment():
    path: list[turntable.Stand | turntable.Turn] = [
        ("north", (0, 0, 0), 60.0), ("z+", 0, 1080.0, 30.0), ("z-", 0, -1080.0, 30.0),
        ("east", (90, 0, 0), 60.0), ("south", (180, 0, 0), 60.0), ("west", (270, 0, 0), 60.0),
    ]  # fmt: skip
    grade, axes = turntable.GRADES["C"], {"w": DIRECTIONS["one"]}
    made, truth = mount(draw_motions(5, 3, path, TABLE, HZ), axes, grade, 5)
    with refused(NotObserved, names=("gz.delta_o", "gz.delta_p")):
        estimated(made, sensor(axes, grade=grade), path=path)
    found = estimated(made, sensor(axes, "bias", "scale", grade=grade), path=path)
    assert (np.abs(errors(truth, found)[0][:, 1]) < 4 * modelled(found)[..., 1]).all()


def test_axes_without_coefficients_do_not_enter_chi_squared(motions: turntable.Draw):
    both = {"f": DIRECTIONS["one"], "w": DIRECTIONS["one"]}
    made, _ = mount(motions, both, GRADE, 5)
    wrong = replace(made, forces=made.forces + 1.0)
    beside = sensor(both)
    gyro = tuple(name for name in beside.coefficients if name.startswith("g"))
    found = estimated(wrong, sensor(both, *gyro))
    alone = estimated(only(made, [], [0]), sensor({"w": DIRECTIONS["one"]}))
    assert found.names == alone.names
    # In u, because some values are nearly zero.
    assert np.max(np.abs(found.value - alone.value) / alone.std) < 1e-9
    np.testing.assert_allclose(found.chi2, alone.chi2, rtol=1e-9)
    assert found.dof == alone.dof


@pytest.mark.parametrize("method", ["turntable_kalman", "turntable_trajectory", "systematic"])
@pytest.mark.parametrize("beside", [{}, {"f": DIRECTIONS["three"]}])
def test_methods_that_carry_vectors_refuse_one_gyro(method: str, beside: Kinds):
    with refused(key="[sensor.gyro]", names=("gz",)) as error:
        METHODS[method].prepare(sensor({"w": DIRECTIONS["one"], **beside}))
    assert "turntable_discrete" in str(error.value)
