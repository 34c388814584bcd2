"""The printed equations and their corrected forms, each evaluated on exact data.

Each finding takes one number that an equation should give: what it gives as printed, what is true,
and, as the uncertainty, what the mended form leaves.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.methods.centrifuge_norm import RATES, closed_formulas
from inercal.studies.centrifuge.centrifuge_trials import CentrifugeTrials
from inercal.studies.centrifuge.simulated_centrifuge import (
    TRUTH,
    G,
    SimulatedTriad,
    dwell_force,
    outputs,
    regress_squared_norms,
    steps,
)
from inercal.studies.centrifuge.taylor_orders import truncated_root
from inercal.studies.claim import Claim, ClaimResult, format_significant, judge_claim
from inercal.studies.section_texts import read_section_text
from inercal.studies.study_content import StudySection, StudyTable

TEXT = read_section_text("inercal.studies.centrifuge", "equations")

# γ_xy, γ_xz, γ_yx, γ_yz, γ_zx, γ_zy, rad: all six different.
MISALIGNMENT_ANGLES = dict(zip(("xy", "xz", "yx", "yz", "zx", "zy"),
                 (1e-3, -8e-4, 6e-4, 9e-4, -7e-4, 5e-4), strict=True))  # fmt: skip


@dataclass(frozen=True)
class EquationCheck:
    """One equation: its quantity, as printed, as corrected, and the truth."""

    equation: str
    quantity: str
    unit: str
    printed: float
    corrected: float
    true: float
    reason: str

    @property
    def finding(self) -> ClaimResult:
        """The finding: as printed against the truth."""
        left = max(abs(self.corrected - self.true), abs(self.true) * 2.0**-52)
        claim = Claim(self.quantity, self.equation, self.printed, self.unit, basis="derived")
        return judge_claim(claim, self.true, left, self.reason)


def norm_of_sum() -> EquationCheck:
    """(4): the norm of a sum at right angles is not a sum of norms."""
    a = RATES[0] ** 2 / G
    true = float(np.linalg.norm(dwell_force(steps())[0]))
    return EquationCheck("(4)", "|g + A| = g + A, at ω₁", "g", 1 + a, float(np.hypot(a, 1)), true,
                 "√(g² + A²), g and A being at right angles")  # fmt: skip


def misalignment_signs() -> EquationCheck:
    """(9): the signs of the misalignments, and two angles of Δ₃ exchanged."""
    f = dwell_force(steps())
    g = MISALIGNMENT_ANGLES
    phi = np.array([[1, -g["xz"], g["xy"]], [g["yz"], 1, -g["yx"]], [-g["zy"], g["zx"], 1]])
    # (7): N = S Φ (f + D f²) + b
    u = (f + TRUTH.bend * f**2) @ phi.T
    x, y, z = u.T
    corrected = np.stack([
        -x - g["xz"] * y + g["xy"] * z,
        -y + g["yz"] * x - g["yx"] * z,
        -z - g["zy"] * x + g["zx"] * y,
    ], axis=-1)  # fmt: skip
    printed = np.stack([
        -x + g["xz"] * y - g["xy"] * z,
        -y + g["yz"] * x - g["yx"] * z,
        -z + g["zx"] * x - g["zy"] * y,
    ], axis=-1)  # fmt: skip
    one, other = (truncated_root(-delta, TRUTH.bend, None) for delta in (printed, corrected))
    at = np.unravel_index(np.abs(one - f).argmax(), f.shape)
    axes = " and ".join("xyz"[k] for k in range(3) if np.abs((one - other)[:, k]).max() > 1e-9)
    return EquationCheck(
        "(9)", f"the force along {'xyz'[at[1]]}, misaligned by up to 10⁻³ rad", "g",
        float(one[at]), float(other[at]), float(f[at]),
        f"Δ of {axes} is wrong in print, by up to {format_significant(np.abs(one - f).max())} g; "
        f"the mended form errs by {format_significant(np.abs(other - f).max())} g, of the second "
        "order in γ",
    )  # fmt: skip


def fourth_power() -> EquationCheck:
    """(14): C₄ with N⁴ in it, so that (13) has N to the eighth."""
    output = outputs(TRUTH, steps())
    norm2 = (dwell_force(steps()) ** 2).sum(axis=1)
    k = TRUTH.bend * TRUTH.bias / TRUTH.scale
    s, b, d = TRUTH.values
    c1, c2, c3 = (
        -2 * b / s**2 * (1 + k) * (1 + 2 * k), (1 + 6 * k + 6 * k**2) / s**2,
        -2 * d / s**3 * (1 + 2 * k),
    )  # fmt: skip
    c4 = 5 * d**2 / s**4
    c0 = (b**2 / s**2 * (1 + k) ** 2).sum()
    below = c0 + (c1 * output + c2 * output**2 + c3 * output**3).sum(axis=1)
    corrected, printed = (below + (c4 * output**n).sum(axis=1) for n in (4, 8))
    at = int(np.abs(printed - norm2).argmax())
    return EquationCheck(
        "(14)", f"|f|² of (13) in row {at + 1}", "g²",
        float(printed[at]), float(corrected[at]), float(norm2[at]),
        "C₄ = 5D²S⁻⁴, without N⁴, which is the regressor",
    )  # fmt: skip


def _regression_coefficients(device: SimulatedTriad) -> tuple[Array, Array, Array, Array]:
    """Return C₁ to C₄ of the regression on exact data."""
    output = outputs(device, steps())
    c = regress_squared_norms(output, (dwell_force(steps()) ** 2).sum(axis=1))
    return c[1:4], c[4:7], c[7:10], c[10:13]


def root_branch() -> EquationCheck:
    """(19): the root with plus is −1 − K."""
    c1, c2, c3, c4 = _regression_coefficients(TRUTH)
    m = c4 / c3 * c1 / c2
    six = 6 * m - 5
    k = (-six + np.sqrt(12 * m**2 - 40 * m + 25)) / (2 * six)
    bias = -c1 * (1 + 6 * k + 6 * k**2) / (2 * c2 * (1 + k) * (1 + 2 * k))
    corrected = closed_formulas.paper(c1, c2, c3, c4)[1]
    return EquationCheck(
        "(19)", "b_ax by the root with +", "g", float(bias[0]), float(corrected[0]),
        float(TRUTH.bias[0]),
        f"K = {format_significant(k[0], 7)} in place of "
        f"{format_significant(TRUTH.bend[0] * TRUTH.bias[0] / TRUTH.scale[0])}; "
        f"biases of {', '.join(format_significant(x) for x in bias)} g; the root with minus holds",
    )  # fmt: skip


def bend_sign(trials: CentrifugeTrials) -> EquationCheck:
    """(21): a root has no sign, and there is none of a negative number."""
    bent = replace(TRUTH, bend=-TRUTH.bend)
    c = _regression_coefficients(bent)
    scale, _, corrected = closed_formulas.paper(*c)
    printed = np.sqrt(c[3] * scale**4 / 5)
    return EquationCheck(
        "(21)", "D_ax of a triad that bends the other way", "1/g", float(printed[0]),
        float(corrected[0]), float(bent.bend[0]),
        f"sign D = −sign C₃; and C₄ is negative, or (18) without root, in "
        f"{trials.rootless:.1%} of trials with 10⁻⁵ V of noise",
    )  # fmt: skip


def inverted_fraction() -> EquationCheck:
    """(22): numerator and denominator exchanged."""
    c1, c2, c3, c4 = _regression_coefficients(TRUTH)
    _, corrected, _ = closed_formulas.paper(c1, c2, c3, c4)
    k = TRUTH.bend * TRUTH.bias / TRUTH.scale
    printed = c2 * (1 + 6 * k + 6 * k**2) / (-2 * c1 * (1 + k) * (1 + 2 * k))
    return EquationCheck(
        "(22)", "b_ax", "g", float(printed[0]), float(corrected[0]), float(TRUTH.bias[0]),
        f"biases of {', '.join(format_significant(x, 3) for x in printed)} g; mended, "
        "b = −C₁ (1 + 6K + 6K²) / [2 C₂ (1 + K)(1 + 2K)]",
    )  # fmt: skip


def section(trials: CentrifugeTrials) -> StudySection:
    """Return the section of the equations."""
    tried = (
        norm_of_sum(),
        misalignment_signs(),
        fourth_power(),
        root_branch(),
        bend_sign(trials),
        inverted_fraction(),
    )
    rows = [
        (
            f"{one.equation}: {one.quantity}, {one.unit}",
            [format_significant(one.printed, 7), format_significant(one.corrected, 7),
             format_significant(one.true, 7), format_significant(one.corrected - one.true)],
        )
        for one in tried
    ]  # fmt: skip
    return TEXT.section(
        [one.finding for one in tried],
        (StudyTable("What the equations give", "equation",
               ("as printed", "mended", "true", "mended −\ntrue"), rows),),
    )  # fmt: skip
