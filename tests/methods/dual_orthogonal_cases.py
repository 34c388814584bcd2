"""Calibrations of two accelerometers on a dividing head, and how far they are off."""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tests.accuracy import dividing_head as made
from tests.accuracy.dividing_head import ARCSEC, TERMS, Bench, draw

from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import (
    DividingHead,
    mounted_sensor,
    position_plan,
    sensed_motion,
)
from inercal.estimation import Estimate, Gaussian
from inercal.methods.dual_orthogonal import dual, joint, patent, single
from inercal.physics.plan import Index
from inercal.physics.sensors import G0
from inercal.recordings import Observations

Array = NDArray[np.float64]
SENSOR = mounted_sensor().with_coefficients("k0", "k1", "k2", "k3", "kip", "delta_o")
SI = {"k0": G0, "k1": 1.0, "delta": 1.0, "k2": 1 / G0, "k3": 1 / G0**2, "kip": 1 / G0}
NAMES = {"delta": "delta_o"}
WHOLE = Bench(
    collimator=0.4,
    third=5.0,
    polygon=(0.0, 3.0, -2.0, 5.0, 1.0, -4.0, 2.0, 0.5, -1.5, 4.0, -3.0, 2.5),
    certificate=0.3,
    pier=0.3,
    creep=1.5,
    drifting=1e-6,
    gravity=1e-6,
)


class Case(NamedTuple):
    """Calibrations of one bench: their data, and the truth by term, (trials, 2)."""

    seen: Observations
    bench: DividingHead
    steps: tuple[Index, ...]
    truth: dict[str, Array]


def nominal(n: int = 12) -> tuple[Array, tuple[Index, ...]]:
    """Return what the nominal pair reads at n positions, (n, 2) m/s², and the steps."""
    steps = position_plan(n)
    return sensed_motion(DividingHead(Measured(G0, 0.0)), steps, {}).f[..., :2], steps


def observed(
    y: Array,
    steps: tuple[Index, ...],
    noise: float = 0.2e-6,
    channels: tuple[str, ...] = SENSOR.channels,
) -> Observations:
    r, m = len(steps), y.shape[-1]
    return Observations(
        tuple(step.label for step in steps),
        y * G0,
        np.broadcast_to((noise * G0) ** 2 * np.eye(m), (r, m, m)),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        channels,
    )


def declared(bench: Bench) -> DividingHead:
    """Return the bench as stated; a `drift` common to all passes is not stated."""
    first, second, rest = ARCSEC * bench.head * np.sqrt(bench.shares)
    assert bench.collimated in ("pairs", "every", "none")
    return DividingHead(
        Measured(G0, G0 * bench.gravity),
        (first, second, ARCSEC * bench.third),
        rest,
        ARCSEC * bench.collimator,
        bench.collimated,
        tuple(ARCSEC * deviation for deviation in bench.polygon),
        ARCSEC * bench.certificate,
        base=ARCSEC * bench.base,
        pier=ARCSEC * bench.pier,
        creep=ARCSEC * bench.creep,
        lean=ARCSEC * bench.cross,
        drift=G0 * bench.drifting,
    )


def case(seed: int, trials: int, bench: Bench, n: int = 12, *, reverse: bool = False) -> Case:
    _, truth, y = draw(seed, trials, bench, n, reverse=reverse)
    steps = position_plan(n, reverse=reverse)
    return Case(observed(y, steps, bench.noise), declared(bench), steps, truth)


def known(given: Case, term: str, sd: float, seed: int | None = None) -> Gaussian:
    """Return a prior of `sd` in µg; with a seed from a measurement, else that of the production."""
    truth, size = given.truth[term], sd * 1e-6
    mean = np.zeros_like(truth)
    if seed is not None:
        mean = truth + size * np.random.default_rng([seed, len(term)]).standard_normal(truth.shape)
    return Gaussian.independent((f"a.{term}", f"b.{term}"), mean * SI[term], size * SI[term])


def errors(found: Estimate, given: Case) -> dict[str, Array]:
    """Return the errors in µg (µrad, ppm) by column of the note's table."""
    off: dict[str, Array] = {}
    for term in TERMS:
        names = [f"{axis}.{NAMES.get(term, term)}" for axis in "ab"]
        value = found.select(names).value / SI[term]
        off[term] = 1e6 * (value - given.truth[term])
    off["delta"] = off["delta"][..., 1] - off["delta"][..., 0]
    off["k1+k3"] = off["k1"] + off["k3"]
    return off


def rms(found: Estimate, given: Case) -> dict[str, float]:
    assert np.all(found.converged)
    return {name: float(np.sqrt(np.mean(e**2))) for name, e in errors(found, given).items()}


def nees(found: Estimate, given: Case) -> float:
    """Return the mean normalised squared error of all coefficients, over their number."""
    return float(squared(found, given).mean())


def squared(found: Estimate, given: Case) -> Array:
    """Return the normalised squared error of each calibration over that number, (trials,)."""
    p = len(SENSOR.coefficients)
    short = {v: k for k, v in NAMES.items()}
    true = np.empty((len(found.value), p))
    for k, name in enumerate(SENSOR.coefficients):
        axis, _, coefficient = name.partition(".")
        term = short.get(coefficient, coefficient)
        true[:, k] = SI[term] * given.truth[term][:, "ab".index(axis)]
    off = found.value[:, :p] - true
    weighted = np.linalg.solve(found.covariance[:, :p, :p], off[..., None])[..., 0]
    return np.asarray(np.sum(off * weighted, axis=-1) / p)


def bound(found: Estimate) -> dict[str, float]:
    """Return the stated deviations in the table's units, k0 … kip but δ."""
    return {
        term: float(np.sqrt(np.mean(found.select([f"a.{term}", f"b.{term}"]).std ** 2)))
        * 1e6
        / SI[term]
        for term in TERMS
        if term != "delta"
    }


def calibrate(
    method: str, seed: int, trials: int, head: float = 3.0, **sizes: float
) -> tuple[Case, Estimate]:
    """Return the case and the estimate of one line of the note's table."""
    collimated = {"single": "none", "dual": "none", "every face": "every"}.get(method, "pairs")
    truth = made.SIZES | sizes
    given = case(seed, trials, Bench(head=head, collimated=collimated, sizes=truth))
    centrifuge, wide = known(given, "k3", 0.5, seed), known(given, "k3", 5)
    kip = known(given, "kip", 20)
    estimator, priors = {
        "single": (single, ()),
        # The note does not say how well single tests know Kip: with 4.69 µg, its K0 is 4.70 µg.
        "dual": (dual, (known(given, "kip", 4.69, seed), centrifuge)),
        "patent": (patent, (kip, centrifuge)),
        "joint": (joint, (kip, wide)),
        "joint, K3 known": (joint, (kip, centrifuge)),
        "every face": (joint, (kip, wide)),
    }[method]
    return given, estimator(given.seen, SENSOR, given.bench, given.steps, priors)


@cache
def scatter_of(method: str, head: float = 3.0, **sizes: float) -> dict[str, float]:
    given, found = calibrate(method, 1, 500, head, **sizes)
    return rms(found, given)
