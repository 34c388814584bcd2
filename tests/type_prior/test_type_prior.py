"""The prior of a type from calibrations: what it uses, what it refuses and what it says."""

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.refusals import refused
from tests.type_prior.cases import MEASURED, MICRO, SCATTER, TERMS, calibrations, new_sensors
from tests.type_prior.populations import draw

import inercal
from inercal.calibration import Calibration
from inercal.calibration.type_prior import TypePrior, load_type_prior
from inercal.laboratory.type_prior import FALSE_ALARMS, type_prior
from inercal.physics.sensors import Sensor, axes_along, triad

P = 0.9545  # coverage of U


def made(seed: int = 1, n: int = 5, *, shared: float = 0.0) -> dict[str, Calibration]:
    return calibrations(draw(np.random.default_rng(seed), n, SCATTER, MEASURED, shared=shared))


def coefficient(found: TypePrior, name: str):
    return found.coefficient[found.names.index(name)]


def with_name(one: Calibration, name: str) -> Calibration:
    return replace(one, sensor=replace(one.sensor, name=name))


def test_the_public_function_reads_files(tmp_path: Path):
    files = [inercal.save(one, tmp_path / name) for name, one in made().items()]
    found = inercal.type_prior(files)
    assert found.coefficient == type_prior(made()).coefficient
    assert [Path(one.source) for one in found.sensor] == files


def test_a_file_is_read_back_exactly(tmp_path: Path):
    found = type_prior(made(), type_name='a "type" of\\ours')
    path = found.save(tmp_path / "t.prior.toml")
    assert load_type_prior(path) == found
    content = tomllib.loads(path.read_text(encoding="utf-8"))
    assert content["count"] == 5
    assert [one["unit"] for one in content["coefficient"]] == [
        "(m/s²)⁻¹", "(m/s²)⁻²", "(m/s²)⁻¹",
    ]  # fmt: skip


def test_by_default_all_nonlinear_and_cross_terms_that_all_have_are_used():
    assert set(type_prior(made()).names) == set(TERMS)
    some = {**made()}
    name = next(iter(some))
    drawn = draw(np.random.default_rng(9), 1, SCATTER[:2], MEASURED[:2])
    some[name] = with_name(next(iter(calibrations(drawn).values())), "S1")
    assert set(type_prior(some).names) == {"k2", "kip"}
    with refused(names=("k3",), key="--coefficients"):
        type_prior(some, ["k3"])
    assert type_prior(made(), ["cross"]).names == ("kip",)


def test_bench_errors_that_files_share_do_not_average_out():
    """A bench error of 20 µg in all files: no scatter, but each new sensor may be off by it."""
    rng = np.random.default_rng(3)
    drawn = draw(rng, 20, np.array([10.0]), np.array([2.0]), shared=10.0)
    found = coefficient(type_prior(calibrations(drawn)), "k2")
    assert found.between_sensors / MICRO["k2"] < 20
    assert found.sd / MICRO["k2"] > 20
    # A file that does not state its shared errors counts as if all of them were shared.
    silent = type_prior(calibrations(drawn, unstated=True))
    assert coefficient(silent, "k2").sd >= found.sd
    assert len(silent.notes) == 20
    # Without the shared error, the mean of 20 sensors is known far better.
    alone = replace_shared(calibrations(drawn))
    assert coefficient(type_prior(alone), "k2").sd < 0.7 * found.sd


def replace_shared(given: dict[str, Calibration]) -> dict[str, Calibration]:
    return {name: replace(one, shared=()) for name, one in given.items()}


def test_an_outlying_sensor_is_named_but_used():
    given = made(n=10)
    name = "S4.calibration.json"
    values = given[name].values.copy()
    place = given[name].sensor.coefficients.index("a.kip")
    values[place] += 300 * MICRO["kip"]
    given[name] = replace(given[name], values=values)
    found = type_prior(given)
    assert [(one.sensor, one.coefficient) for one in found.outlying] == [("S4", "kip")]
    assert found.count == 10
    rest = type_prior(given, without=["S4"])
    assert not rest.outlying
    assert rest.count == 9
    assert "S4" not in [one.name for one in rest.sensor]
    assert coefficient(rest, "kip").sd < 0.5 * coefficient(found, "kip").sd


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_stated():
    rng = np.random.default_rng(11)
    draws = 60
    alarms = sum(
        bool(type_prior(calibrations(draw(rng, 5, SCATTER[:1], MEASURED[:1]))).outlying)
        for _ in range(draws)
    )
    # The 99.9 % point of a binomial distribution with 60 draws and 1 % is 4.
    assert FALSE_ALARMS == 0.01
    assert alarms <= 4


def test_the_covariance_of_two_axes_has_the_mean_in_common():
    found = type_prior(made(), ["kip"])
    (one,) = found.coefficient
    both = found.covariance([(0, "a"), (0, "b")])
    assert both == pytest.approx(one.sd**2 * np.array([[1, one.mean_share], [one.mean_share, 1]]))


@pytest.mark.slow
def test_every_covariance_is_positive_definite():
    rng = np.random.default_rng(8)
    for n in (3, 4, 8):
        for scatter in (0.0, 1.0, 30.0):
            drawn = draw(rng, n, scatter * SCATTER, MEASURED, correlation=0.95, shared=1.0)
            found = type_prior(calibrations(drawn))
            places = [(k, axis) for axis in "ab" for k in range(3)]
            covariance = found.covariance(places)
            sd = np.sqrt(np.diag(covariance))
            assert np.linalg.eigvalsh(covariance / np.outer(sd, sd)).min() > 1e-4


def test_axes_of_triads_have_priors_of_their_own_or_are_sensors_of_their_own():
    rng = np.random.default_rng(5)
    given: dict[str, Calibration] = {}
    for k in range(4):
        sensor = triad(f"T{k}").with_coefficients("k0", "k2")
        values = rng.standard_normal(6)
        covariance = 0.01 * np.eye(6)
        given[f"{k}"] = Calibration(sensor, values, covariance, shared=())
    apart = type_prior(given)
    axes = given["0"].sensor.channels
    assert apart.names == tuple(f"{axis}.k2" for axis in axes)
    assert apart.count == 4
    alike = type_prior(given, each_axis=True)
    assert alike.names == ("k2",)
    assert alike.count == 12
    assert alike.coefficient[0].dof > apart.coefficient[0].dof
    assert set(type_prior(given, ["k2", "bias"]).names) == {
        f"{axis}.{term}" for axis in axes for term in ("k0", "k2")
    }


def test_what_cannot_be_one_type_is_refused():
    given = made()
    with refused(key="FILE"):
        type_prior(dict(list(given.items())[:2]))
    with refused(names=("S1",)):
        type_prior({"again": given["S1.calibration.json"], **given})
    with refused(names=("S9",), key="--without"):
        type_prior(given, without=["S9"])
    with refused(key="FILE"):
        type_prior(given, without=["S1", "S2", "S3"])
    sensor = given["S3.calibration.json"].sensor
    axes = tuple(replace(a, readout=replace(a.readout, scale=2.0)) for a in sensor.axes)
    other = replace(given["S3.calibration.json"], sensor=replace(sensor, axes=axes))
    with refused(names=("S3",)):
        type_prior({**given, "S3.calibration.json": other})


def test_mounting_angles_and_the_scale_of_another_form_are_refused():
    given: dict[str, Calibration] = {}
    for k in range(3):
        sensor = triad(f"T{k}").with_coefficients("k1", "misalignment")
        p = len(sensor.coefficients)
        given[f"{k}"] = Calibration(sensor, 0.1 * k * np.ones(p), 0.01 * np.eye(p), shared=())
    name = given["0"].sensor.channels[0]
    with refused(names=(f"{name}.delta_o",)):
        type_prior(given, [f"{name}.delta_o"])
    assert type_prior(given, ["k1"]).count == 3
    sensor = replace(given["2"].sensor, form="tilted")
    with refused(names=("T2",)):
        type_prior({**given, "2": replace(given["2"], sensor=sensor)}, ["k1"])


@pytest.mark.slow
@pytest.mark.parametrize("n", [3, evidence(5)])
def test_a_new_sensor_lies_within_u_as_often_as_stated_in_a_small_sample(n: int):
    draws = 40
    inside, _ = new_sensors(np.random.default_rng([12, n]), n, draws, 2)
    assert np.mean(inside) > P - 3.3 * np.sqrt(P * (1 - P) / draws)


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('schema = "inercal/type-prior/1"', 'schema = "inercal/type-prior/9"'),
        ("sd = ", "sd = -"),
        ('name = "k2"', 'name = "k9"'),
        ("correlation = [1.0, ", "correlation = ["),
        ("[[coefficient]]", "[[others]]"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, old: str, new: str):
    path = type_prior(made()).save(tmp_path / "t.prior.toml")
    text = path.read_text(encoding="utf-8")
    assert old in text
    write(path, text.replace(old, new))
    with refused(file="t.prior.toml"):
        load_type_prior(path)


def test_accelerometers_and_gyros_are_refused_for_the_reason_that_applies(tmp_path: Path):
    gyros = {
        f"G{k}": Calibration(
            Sensor(f"G{k}", axes_along(["z"], "w", "g")).with_coefficients("scale2"),
            np.zeros(1), np.eye(1), shared=(),
        )
        for k in range(3)
    }  # fmt: skip
    with refused(key="FILE"):
        type_prior({**made(), **gyros})
    with refused(key="--each-axis"):
        type_prior({**made(), **gyros}, each_axis=True)
    other = {name: replace(one, sensor=one.sensor) for name, one in made().items()}
    biases = Sensor("S9", axes_along(["x"], "f", "a")).with_coefficients("bias")
    other["S9"] = Calibration(biases, np.zeros(1), np.eye(1), shared=())
    with refused(key="--coefficients"):
        type_prior(other)


def test_correlations_are_only_mentioned_between_coefficients():
    assert type_prior(made(), ["kip"]).correlations == ""
    assert "50 %" in type_prior(made()).correlations
