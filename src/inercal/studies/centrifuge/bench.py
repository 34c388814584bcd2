"""Table 3 and what else the bench does: lever arms, earth's rate, errors of the acceleration."""

from dataclasses import dataclass, replace

import numpy as np

from inercal.arrays import Array
from inercal.benches.forces import directions
from inercal.methods.centrifuge_norm import closed, ml
from inercal.studies.centrifuge import experiment
from inercal.studies.centrifuge.experiment import (
    AXES,
    BENCH,
    LATITUDE,
    QUANTITIES,
    TRUTH,
    UNITS,
    G,
    as_printed,
    by_formulas,
    by_ml,
    force,
    outputs,
    steps,
)
from inercal.studies.claim import Claim, judge, shown
from inercal.studies.section import Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.centrifuge", "bench")

ARM = 0.02  # m
RELATIVE = 1e-5  # error of the centripetal acceleration
PRINTED = np.array([  # |ΔS|, |Δb|, |ΔD| of x, y, z
    [2.073e-10, 3.795e-11, 3.191e-10],
    [5.012e-8, 7.918e-10, 4.682e-10],
    [8.117e-11, 2.289e-13, 1.863e-13],
])  # fmt: skip
# Of the nine components of three lever arms these act on the readings of the printed positions.
ACTING = ("x.arm_i", "x.arm_o", "y.arm_i", "z.arm_i", "z.arm_p")


@dataclass(frozen=True, eq=False)
class Arms:
    """Errors of S, b, D, (3, 3), with lever arms ignored, and what is found of them.

    Parameters
    ----------
    paper, ml : (3, 3) arrays
        Axes B and C 2 cm out along their own directions, A at the centre.
    least : (3, 3) array
        The smallest |error| of `paper` over arrangements, by coefficient; `arrangements` many.
    std : (5,) array
        Deviations of the components in `ACTING` where they are estimated, m.
    left : float
        Largest |error| of S, b and D then.
    """

    paper: Array
    ml: Array
    least: Array
    arrangements: int
    std: Array
    left: float


def arms() -> Arms:
    """Return what lever arms of 2 cm do."""
    spins = steps()
    own = np.diag([0.0, ARM, ARM])
    output = outputs(replace(TRUTH, arms=own), spins)
    found: list[Array] = []
    for i in range(3):  # which axis is out
        for k in range(3):  # and along what
            for sign in (1, -1):
                place = np.zeros((3, 3))
                place[i, k] = sign * ARM
                other = outputs(replace(TRUTH, arms=place), spins)
                if np.abs(other - outputs(TRUTH, spins)).max() > 1e-9:
                    found.append(np.abs(by_formulas(closed.paper, other, spins) - TRUTH.values))
    made = experiment.sensor(*ACTING)
    estimate = ml(experiment.observations(output, made), made, BENCH, spins)
    index = [estimate.names.index(name) for name in ACTING]
    nine = [estimate.names.index(name) for name in experiment.sensor().coefficients]
    return Arms(
        by_formulas(closed.paper, output, spins) - TRUTH.values,
        as_printed(by_ml(output, spins).value) - TRUTH.values,
        np.nanmin(np.stack(found), axis=0),
        len(found),
        estimate.std[index],
        float(np.abs(as_printed(estimate.value[nine]) - TRUTH.values).max()),
    )


def earth() -> Array:
    """Return the errors of S, b, D by `ml`, (3, 3), with the earth's rate at 39° ignored."""
    output = outputs(TRUTH, steps(), force(steps(), LATITUDE))
    return as_printed(by_ml(output, steps()).value) - TRUTH.values


def _with_errors(relative: Array) -> Array:
    """Return outputs, (..., r, 3), with relative errors, (..., r), of the acceleration."""
    spins = steps()
    out, _ = directions(spins)
    a = np.array([step.rate for step in spins]) ** 2 / G
    return outputs(TRUTH, spins, force(spins) - (a * relative)[..., None] * out)


def common() -> Array:
    """Return the errors by `ml`, (3, 3), of an acceleration 10⁻⁵ larger than taken, in all rows."""
    output = _with_errors(np.full(len(steps()), RELATIVE))
    return as_printed(by_ml(output, steps()).value) - TRUTH.values


def each(trials: int, seed: int) -> Array:
    """Return the scatter by `ml`, (3, 3), of an error of 1e-5 of its own in each row."""
    rng = np.random.default_rng([seed, 836])
    output = _with_errors(RELATIVE * rng.standard_normal((trials, len(steps()))))
    return as_printed(by_ml(output, steps()).value).std(axis=0)


def section(clean: Array, bound: Array, trials: int, seed: int) -> Section:
    """Return the section of Table 3 and of the bench.

    Parameters
    ----------
    clean, bound : (3, 3) arrays
        Errors of `paper` without a lever arm, and the Cramér–Rao bound.
    trials, seed : int
        Of the random errors.
    """
    lever, turning, shared, own = arms(), earth(), common(), each(trials, seed)
    findings = [
        judge(
            Claim(f"error of {q}_a{axis} by a lever arm of 2 cm", "Table 3", PRINTED[i, k],
                  UNITS[q], kind="result", last_digit=_last_digit(PRINTED[i, k])),
            abs(lever.paper[i, k]), abs(clean[i, k]),
            "u is what the formulas leave without any arm; ml with nine parameters errs by "
            f"{shown(lever.ml[i, k])}, and of {lever.arrangements} arrangements of a single arm "
            f"the least error is {shown(lever.least[i, k])}",
        )
        for i, q in reversed(list(enumerate(QUANTITIES)))
        for k, axis in enumerate(AXES)
    ]  # fmt: skip
    for i, q in enumerate(QUANTITIES):
        worst = np.abs(lever.paper[i]).max()
        findings.append(
            WORDS.judge(f"small_{q}", worst, np.abs(clean[i]).max(),
                f"the largest error of three axes by (16) to (22); by ml "
                f"{shown(np.abs(lever.ml[i]).max())}")
        )  # fmt: skip
    rows = {
        "lever arms of B and C ignored: paper": lever.paper,
        "lever arms of B and C ignored: ml": lever.ml,
        f"earth's rate at 39° ignored: ml ({shown(experiment.earth_share())} of ω₁)": turning,
        "acceleration 10⁻⁵ larger than taken: ml": shared,
        "10⁻⁵ S and 10⁻⁵ D for comparison": RELATIVE
        * TRUTH.values
        * np.array([[1.0], [0.0], [1.0]]),
        "acceleration off by 10⁻⁵ at random in each row: ml, scatter": own,
        "the same over the bound by noise alone": own / bound,
    }
    return WORDS.section(
        findings,
        (
            Table("Errors of S (V/g), b (g) and D (1/g)", "",
                  [f"{q}_a{axis}" for q in QUANTITIES for axis in AXES],
                  [(name, [shown(x) for x in value.ravel()]) for name, value in rows.items()]),
        ),
        arrangements=lever.arrangements,
        finest=shown(lever.std.min() * 1e6),
        coarsest=shown(lever.std.max() * 1e6),
        left=shown(lever.left),
        least=shown((own / bound).min()),
        most=shown((own / bound).max()),
    )  # fmt: skip


def _last_digit(value: float) -> float:
    """Return one unit in the last of four printed digits."""
    return 10.0 ** (np.floor(np.log10(value)) - 3)
