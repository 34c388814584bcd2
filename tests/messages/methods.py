"""Families of messages of methods, their plans and estimators, and of studies."""

from collections.abc import Callable
from math import pi
from pathlib import Path

import numpy as np

from inercal.basics.units import Measured
from inercal.benches import RateTable
from inercal.benches.rate_table.fixture import planar_plan
from inercal.estimation import Gaussian
from inercal.methods import METHODS, centrifuge_norm
from inercal.methods.centrifuge_norm.rotation_gauge import require_gauge
from inercal.methods.dual_orthogonal.g_squared import require_fixture_sensor
from inercal.methods.dual_orthogonal.patent_estimator import averaging_matrix
from inercal.methods.observability import require_bias_scale_separation
from inercal.methods.ship_planar import require_excitation
from inercal.methods.solving import (
    refuse_priors,
    refuse_temperature_terms,
    require_matching_rows,
)
from inercal.methods.temperature import refuse_temperature_terms_in_plan
from inercal.methods.tumble_harmonics import not_observed_error, require_even_spacing
from inercal.physics.plan import Index, six_positions
from inercal.physics.sensors import Sensor, imu, pair, single, triad
from inercal.recordings import Observations
from inercal.studies import reproduce

STEPS = [Index(f"p{k}", k * pi / 6) for k in range(12)]


def warm() -> Sensor:
    return single().with_coefficients("k0", "k0_dT")


def rows_of(labels: list[str], steps: list[Index]) -> None:
    r = len(labels)
    seen = Observations(
        tuple(labels),
        np.zeros((r, 1)),
        np.ones((r, 1, 1)),
        np.ones(r),
        np.ones(r, dtype=np.int64),
        np.arange(r, dtype=float),
        single().channels,
    )
    require_matching_rows(seen, single(), steps)


def folding() -> None:
    sensor = single().with_coefficients("k1", "k3")
    angle = np.arange(4) * pi / 2
    raise not_observed_error(sensor, ["i.k1 − i.k3"], angle, "give a prior")


def without_face_down() -> None:
    *up, missing = six_positions()
    sensor = triad().with_coefficients("k0", "k1")
    require_bias_scale_separation(sensor, up, [missing], ())


def one_mounting() -> None:
    steps = [step for step in planar_plan() if step.label.startswith("XY")]
    require_excitation(RateTable(Measured(9.81, 0.0), Measured(0.25, 0.0)), steps)


CASES: dict[str, Callable[[Path], object]] = {
    "sensor lacks axes": lambda _: METHODS["ferraris"].prepare(triad()),
    "coefficient of other methods": lambda _: METHODS["six_position"].prepare(
        imu(), also=("ax.k2",)
    ),
    "unknown estimator": lambda _: METHODS["tumble"].estimator("robust"),
    "unknown attitudes": lambda _: centrifuge_norm.plan("sphere"),
    "rate of zero": lambda _: centrifuge_norm.plan(rates=(0.0,)),
    "too few positions": lambda _: METHODS["tumble"].plan(positions=3),
    "priors": lambda _: refuse_priors(
        [Gaussian.independent(("i.k3",), [0.0], 1e-9)], "fourier", "least_squares"
    ),
    "temperature of a closed formula": lambda _: refuse_temperature_terms(
        warm(), "classical", "ml"
    ),
    "temperature of a plan": lambda _: refuse_temperature_terms_in_plan(warm()),
    "row of another step": lambda _: rows_of(["p0", "p1"], [STEPS[1], STEPS[0]]),
    "label of two steps": lambda _: rows_of(["p0", "p0"], [STEPS[0], STEPS[0]]),
    "sensor of another fixture": lambda _: require_fixture_sensor(pair()),
    "cardinal positions": lambda _: averaging_matrix(STEPS[:4]),
    "uneven positions": lambda _: require_even_spacing(
        np.array([step.angle for step in STEPS if step.label != "p3"])
    ),
    "harmonics fold": lambda _: folding(),
    "bias and scale": lambda _: without_face_down(),
    "rotation of a triad": lambda _: require_gauge(triad().with_coefficients("misalignment"), ()),
    "axes without excitation": lambda _: one_mounting(),
    "unknown study": lambda _: reproduce("ferris wheel"),
    "too few trials": lambda _: reproduce("centrifuge", 19, 0),
}
