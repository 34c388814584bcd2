"""Drawn types as calibrations of inercal, and the patent's case."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tests.accuracy.dividing_head import Bench
from tests.accuracy.dividing_head import draw as draw_readings
from tests.methods.dual_orthogonal_cases import case, declared, observed
from tests.type_prior.populations import Drawn, draw

from inercal.benches.dividing_head.bench import mounted_sensor, position_plan
from inercal.calibration import Calibration
from inercal.calibration.shared_errors import SharedError
from inercal.calibration.type_prior import TypePrior
from inercal.estimation import Estimate, Gaussian
from inercal.laboratory.type_prior import type_prior
from inercal.methods.dual_orthogonal import joint, patent, single
from inercal.physics.sensors import G0
from inercal.recordings import Observations
from inercal.runfile.priors import type_prior_of

Array = NDArray[np.float64]
TERMS = ("k2", "kip", "k3")
MICRO = {"k2": 1e-6 / G0, "kip": 1e-6 / G0, "k3": 1e-6 / G0**2}
ESTIMATORS = {"patent": patent, "joint": joint}
# µg: measurements are 0.2, 0.25 and 1 times as uncertain as the sensors scatter.
SCATTER, MEASURED = np.array([10.0, 20.0, 5.0]), np.array([2.0, 5.0, 5.0])


def units(p: int) -> Array:
    """Return the SI sizes of a micro-g of the first p terms."""
    return np.array([MICRO[term] for term in TERMS[:p]])


def calibrations(drawn: Drawn, *, unstated: bool = False) -> dict[str, Calibration]:
    """Return the calibrations of a type of single accelerometers; its values are in µg."""
    n, p = drawn.values.shape
    unit = units(p)
    made: dict[str, Calibration] = {}
    for k in range(n):
        sensor = mounted_sensor(f"S{k + 1}", ("a",)).with_coefficients(*TERMS[:p])
        order = [TERMS.index(name.partition(".")[2]) for name in sensor.coefficients]
        scale = unit[order]
        column = (drawn.shared * unit)[order]
        own = drawn.own[k][np.ix_(order, order)] * np.outer(scale, scale)
        error = SharedError("sin1", "rad", 1.0, column, "the head")
        made[f"S{k + 1}.calibration.json"] = Calibration(
            sensor,
            drawn.values[k][order] * scale,
            own + np.outer(column, column),
            "tumble",
            "least_squares",
            shared=None if unstated else (error,) if column.any() else (),
        )
    return made


def standard_errors(found: TypePrior, new: Array) -> Array:
    """Return the error of the prediction of new values (..., p), µg, in standard deviations."""
    order = [found.names.index(term) for term in TERMS[: new.shape[-1]]]
    unit = units(new.shape[-1])
    mean = np.array([found.coefficient[k].mean for k in order]) / unit
    sd = np.array([found.coefficient[k].sd for k in order]) / unit
    return (new - mean) / sd


def new_sensors(rng: np.random.Generator, n: int, draws: int, p: int) -> tuple[Array, Array]:
    """Return whether U of p coefficients contains a new sensor, and whether any is named.

    The shapes are (draws, p) and (draws,). The sensors of each draw are another population, whose
    calibrations share an error of the bench.
    """
    inside, alarms = np.empty((draws, p)), np.empty(draws)
    for k in range(draws):
        drawn = draw(rng, n, SCATTER[:p], MEASURED[:p], correlation=0.5, shared=0.5)
        found = type_prior(calibrations(drawn))
        inside[k] = np.abs(standard_errors(found, drawn.new[0])) < 2
        alarms[k] = bool(found.outlying)
    return inside, alarms


def one_channel(seen: Observations, y: Array) -> Observations:
    covariance = np.asarray(seen.covariance)[:, :1, :1]
    return replace(seen, mean=y[..., :1] * G0, covariance=covariance, channels=("a",))


def tumble_priors(
    seed: int, populations: int, n: int, folder: Path, words: Sequence[str] = ("kip",)
) -> Iterator[Gaussian]:
    """Yield the prior of a pair from n tumble tests of other accelerometers, per population."""
    bench = Bench(collimated="none")
    _, _, y = draw_readings(seed, populations * n, bench)
    steps = position_plan(12)
    sensor = mounted_sensor("S", ("a",)).with_coefficients("k0", "k1", "k2", "k3", "kip", "delta_o")
    tests = one_channel(observed(y, steps, bench.noise), y)
    found = single(tests, sensor, declared(bench), steps)
    pair = mounted_sensor().with_coefficients("k0", "k1", "k2", "k3", "kip", "delta_o")
    path = folder / "type.prior.toml"
    for k in range(populations):
        made: dict[str, Calibration] = {}
        for m in range(n):
            value, covariance = found.value[k * n + m], found.covariance[k * n + m]
            one = mounted_sensor(f"S{m + 1}", ("a",)).with_coefficients(*sensor.coefficients)
            made[f"S{m + 1}"] = Calibration(one, value, covariance, "dual_orthogonal", "single",
                                            shared=())  # fmt: skip
        type_prior(made, words).save(path)
        yield type_prior_of(path, pair)


def nine(estimate: Estimate, truth: dict[str, Array], k: int) -> tuple[Array, Array]:
    """Return error and covariance of K0, k1 + K3, δ, K2, Kip of trial k, in g and rad."""
    names = list(estimate.names)
    terms = [[(f"{axis}.k0", 1 / G0)] for axis in "ab"]
    terms += [[(f"{axis}.k1", 1.0), (f"{axis}.k3", G0**2)] for axis in "ab"]
    terms += [[("b.delta_o", 1.0), ("a.delta_o", -1.0)]]
    terms += [[(f"{axis}.{term}", G0)] for term in ("k2", "kip") for axis in "ab"]
    rows = np.zeros((9, len(names)))
    for row, parts in zip(rows, terms, strict=True):
        for name, weight in parts:
            row[names.index(name)] = weight
    true = np.concatenate([
        truth["k0"][k], truth["k1"][k] + truth["k3"][k], np.diff(truth["delta"][k]),
        truth["k2"][k], truth["kip"][k],
    ])  # fmt: skip
    value, covariance = estimate.value.reshape(-1, len(names))[0], estimate.covariance
    return rows @ value - true, rows @ covariance.reshape(-1, *covariance.shape[-2:])[0] @ rows.T


def patent_nees(
    estimator: str, seed: int, populations: int, n: int, folder: Path
) -> tuple[Array, Array]:
    """Return the NEES of the nine parameters of new pairs, and of both Kip alone, (populations,).

    K3 is known from a centrifuge to 0.5 µg, and Kip from tumble tests of n accelerometers.
    """
    drawn = case(seed + 1000, populations, Bench())
    rng = np.random.default_rng(seed)
    k3 = drawn.truth["k3"] + 0.5e-6 * rng.standard_normal((populations, 2))
    found = np.empty((2, populations))
    for k, prior in enumerate(tumble_priors(seed, populations, n, folder)):
        known = Gaussian.independent(("a.k3", "b.k3"), k3[k] / G0**2, 0.5e-6 / G0**2)
        seen = replace(drawn.seen, mean=drawn.seen.mean[k])
        pair = mounted_sensor().with_coefficients("k0", "k1", "k2", "k3", "kip", "delta_o")
        estimate = ESTIMATORS[estimator](seen, pair, drawn.bench, drawn.steps, (prior, known))
        off, covariance = nine(estimate, drawn.truth, k)
        found[0, k] = off @ np.linalg.solve(covariance, off) / 9
        kip = prior.mean * G0 - drawn.truth["kip"][k]
        found[1, k] = kip @ np.linalg.solve(prior.covariance * G0**2, kip) / 2
    return found[0], found[1]
