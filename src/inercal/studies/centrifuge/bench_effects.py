"""Recompute Table 3 and other effects of the bench: lever arms, earth's rate, acceleration."""

from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.benches.arm import outward_and_up_directions
from inercal.methods.centrifuge_norm import closed_formulas, ml
from inercal.studies.centrifuge import simulated_centrifuge
from inercal.studies.centrifuge.simulated_centrifuge import (
    AXES,
    BENCH,
    LATITUDE,
    QUANTITIES,
    TRUTH,
    UNITS,
    G,
    closed_form_errors,
    coefficients_as_printed,
    dwell_force,
    ml_errors,
    ml_estimate,
    outputs,
    steps,
)
from inercal.studies.claim import Claim, format_all, judge_claim, shown
from inercal.studies.study import StudySection, StudyTable, read_section_text

TEXT = read_section_text("inercal.studies.centrifuge", "bench")

ARM_LENGTH = 0.02  # m
ACCELERATION_ERROR = 1e-5  # relative error of the centripetal acceleration
PRINTED_ERRORS = np.array([  # |ΔS|, |Δb|, |ΔD| for x, y, z
    [2.073e-10, 3.795e-11, 3.191e-10],
    [5.012e-8, 7.918e-10, 4.682e-10],
    [8.117e-11, 2.289e-13, 1.863e-13],
])  # fmt: skip
# The components of the three lever arms that affect the readings in the printed positions.
OBSERVED_ARMS = ("x.arm_i", "x.arm_o", "y.arm_i", "z.arm_i", "z.arm_p")


@dataclass(frozen=True, eq=False)
class LeverArmErrors:
    """Errors of S, b and D, (3, 3), if lever arms are ignored, and if they are estimated.

    Parameters
    ----------
    paper, ml : (3, 3) arrays
        Errors with axes B and C 2 cm off the centre along their own directions, and A at the
        centre.
    least : (3, 3) array
        Smallest |error| of `paper` for each coefficient over all `arrangements`.
    std : (5,) array
        Standard deviations of the components in `OBSERVED_ARMS` when they are estimated, m.
    left : float
        Largest |error| of S, b and D when the lever arms are estimated.
    """

    paper: Array
    ml: Array
    least: Array
    arrangements: int
    std: Array
    left: float


def lever_arm_errors() -> LeverArmErrors:
    """Return the effects of lever arms of 2 cm."""
    spins = steps()
    own = np.diag([0.0, ARM_LENGTH, ARM_LENGTH])
    output = outputs(replace(TRUTH, arms=own), spins)
    found: list[Array] = []
    for i in range(3):  # the axis that is off the centre
        for k in range(3):  # and the direction
            for sign in (1, -1):
                place = np.zeros((3, 3))
                place[i, k] = sign * ARM_LENGTH
                other = outputs(replace(TRUTH, arms=place), spins)
                if np.abs(other - outputs(TRUTH, spins)).max() > 1e-9:
                    found.append(np.abs(closed_form_errors(closed_formulas.paper, other)))
    result = simulated_centrifuge.sensor(*OBSERVED_ARMS)
    estimate = ml(simulated_centrifuge.observations(output, result), result, BENCH, spins)
    index = [estimate.names.index(name) for name in OBSERVED_ARMS]
    nine = [estimate.names.index(name) for name in simulated_centrifuge.sensor().coefficients]
    return LeverArmErrors(
        closed_form_errors(closed_formulas.paper, output),
        ml_errors(output),
        np.nanmin(np.stack(found), axis=0),
        len(found),
        estimate.std[index],
        float(np.abs(coefficients_as_printed(estimate.value[nine]) - TRUTH.values).max()),
    )


def earth_rate_errors() -> Array:
    """Return the errors of `ml`, (3, 3), when the earth's rate at 39° is ignored."""
    return ml_errors(outputs(TRUTH, steps(), dwell_force(steps(), LATITUDE)))


def _outputs_with_errors(relative: Array) -> Array:
    """Return outputs, (..., r, 3), with relative acceleration errors, (..., r)."""
    spins = steps()
    out, _ = outward_and_up_directions(spins)
    a = np.array([step.rate for step in spins]) ** 2 / G
    return outputs(TRUTH, spins, dwell_force(spins) - (a * relative)[..., None] * out)


def common_acceleration_error() -> Array:
    """Return the errors of S, b and D from `ml`, (3, 3), if all accelerations are wrong.

    The true acceleration is larger than the stated one by the same factor, 1 + 10⁻⁵, in all rows.
    """
    return ml_errors(_outputs_with_errors(np.full(len(steps()), ACCELERATION_ERROR)))


def random_acceleration_scatter(trials: int, seed: int) -> Array:
    """Return the scatter of S, b and D from `ml`, (3, 3), due to errors of the acceleration.

    The relative errors of the rows are independent, with a standard deviation of 10⁻⁵.
    """
    rng = np.random.default_rng([seed, 836])
    output = _outputs_with_errors(ACCELERATION_ERROR * rng.standard_normal((trials, len(steps()))))
    return coefficients_as_printed(ml_estimate(output, steps()).value).std(axis=0)


def section(clean: Array, bound: Array, trials: int, seed: int) -> StudySection:
    """Build the section about Table 3 and the other effects of the bench.

    Parameters
    ----------
    clean, bound : (3, 3) arrays
        Errors of `paper` without a lever arm, and the Cramér–Rao bound.
    trials, seed : int
        Number of trials and seed for the random errors.
    """
    lever, turning, shared = lever_arm_errors(), earth_rate_errors(), common_acceleration_error()
    own = random_acceleration_scatter(trials, seed)
    findings = [
        judge_claim(
            Claim(f"error of {q}_a{axis} by a lever arm of 2 cm", "Table 3", PRINTED_ERRORS[i, k],
                  UNITS[q], kind="result", last_digit=_last_digit(PRINTED_ERRORS[i, k])),
            abs(lever.paper[i, k]), abs(clean[i, k]),
            "u is the error of the formulas without any arm; ml with nine parameters has an error "
            f"of {shown(lever.ml[i, k])}, and of {lever.arrangements} arrangements of "
            f"a single arm the smallest error is {shown(lever.least[i, k])}",
        )
        for i, q in reversed(list(enumerate(QUANTITIES)))
        for k, axis in enumerate(AXES)
    ]  # fmt: skip
    for i, q in enumerate(QUANTITIES):
        worst = np.abs(lever.paper[i]).max()
        findings.append(
            TEXT.judge(f"small_{q}", worst, np.abs(clean[i]).max(),
                f"the largest error of the three axes from (16) to (22); from ml "
                f"{shown(np.abs(lever.ml[i]).max())}")
        )  # fmt: skip
    rows = {
        "lever arms of B and C ignored: paper": lever.paper,
        "lever arms of B and C ignored: ml": lever.ml,
        "earth's rate at 39° ignored: ml "
        f"({shown(simulated_centrifuge.earth_rate_ratio())} of ω₁)": turning,
        "acceleration 10⁻⁵ larger than assumed: ml": shared,
        "10⁻⁵ S and 10⁻⁵ D for comparison": ACCELERATION_ERROR
        * TRUTH.values
        * np.array([[1.0], [0.0], [1.0]]),
        "random acceleration error of 10⁻⁵ in each row: ml, scatter": own,
        "the same, divided by the bound from noise only": own / bound,
    }
    return TEXT.section(
        *findings,
        StudyTable("Errors of S (V/g), b (g) and D (1/g)", "",
              [f"{q}_a{axis}" for q in QUANTITIES for axis in AXES],
              [(name, format_all(value.ravel())) for name, value in rows.items()]),
        arrangements=lever.arrangements,
        finest=shown(lever.std.min() * 1e6),
        coarsest=shown(lever.std.max() * 1e6),
        left=shown(lever.left),
        least=shown((own / bound).min()),
        most=shown((own / bound).max()),
    )  # fmt: skip


def _last_digit(value: float) -> float:
    """Return the value of one unit in the last of four printed digits."""
    return 10.0 ** (np.floor(np.log10(value)) - 3)
