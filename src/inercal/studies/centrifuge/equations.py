"""The printed equations beside their mended forms, each tried on exact data.

Each finding takes one number that an equation should give: what it gives as printed, what is true,
and, as the uncertainty, what the mended form leaves.
"""

from dataclasses import dataclass, replace

import numpy as np

from inercal.arrays import Array
from inercal.methods.centrifuge_norm import closed
from inercal.methods.centrifuge_norm.plans import RATES
from inercal.studies.centrifuge.experiment import (
    TRUTH,
    G,
    Triad,
    force,
    outputs,
    regression,
    steps,
)
from inercal.studies.centrifuge.taylor import root
from inercal.studies.centrifuge.trials import Trials
from inercal.studies.claim import Claim, Finding, judge, shown
from inercal.studies.section import Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.centrifuge", "equations")

# γ_xy, γ_xz, γ_yx, γ_yz, γ_zx, γ_zy, rad: all six different.
GAMMA = dict(zip(("xy", "xz", "yx", "yz", "zx", "zy"),
                 (1e-3, -8e-4, 6e-4, 9e-4, -7e-4, 5e-4), strict=True))  # fmt: skip


@dataclass(frozen=True)
class Tried:
    """One equation: what is asked of it, as printed, mended, and the truth."""

    equation: str
    what: str
    unit: str
    printed: float
    mended: float
    true: float
    because: str

    @property
    def finding(self) -> Finding:
        """The finding: as printed against the truth."""
        left = max(abs(self.mended - self.true), abs(self.true) * 2.0**-52)
        claim = Claim(self.what, self.equation, self.printed, self.unit, basis="derived")
        return judge(claim, self.true, left, self.because)


def norm_of_sum() -> Tried:
    """(4): the norm of a sum at right angles is no sum of norms."""
    a = RATES[0] ** 2 / G
    true = float(np.linalg.norm(force(steps())[0]))
    return Tried("(4)", "|g + A| = g + A, at ω₁", "g", 1 + a, float(np.hypot(a, 1)), true,
                 "√(g² + A²), g and A being at right angles")  # fmt: skip


def misaligned() -> Tried:
    """(9): the signs of the misalignments, and two angles of Δ₃ exchanged."""
    f = force(steps())
    g = GAMMA
    phi = np.array([[1, -g["xz"], g["xy"]], [g["yz"], 1, -g["yx"]], [-g["zy"], g["zx"], 1]])
    # (7): N = S Φ (f + D f²) + b
    u = (f + TRUTH.bend * f**2) @ phi.T
    x, y, z = u.T
    mended = np.stack([
        -x - g["xz"] * y + g["xy"] * z,
        -y + g["yz"] * x - g["yx"] * z,
        -z - g["zy"] * x + g["zx"] * y,
    ], axis=-1)  # fmt: skip
    printed = np.stack([
        -x + g["xz"] * y - g["xy"] * z,
        -y + g["yz"] * x - g["yx"] * z,
        -z + g["zx"] * x - g["zy"] * y,
    ], axis=-1)  # fmt: skip
    one, other = (root(-delta, TRUTH.bend, None) for delta in (printed, mended))
    at = np.unravel_index(np.abs(one - f).argmax(), f.shape)
    axes = " and ".join("xyz"[k] for k in range(3) if np.abs((one - other)[:, k]).max() > 1e-9)
    return Tried(
        "(9)", f"the force along {'xyz'[at[1]]}, misaligned by up to 10⁻³ rad", "g",
        float(one[at]), float(other[at]), float(f[at]),
        f"Δ of {axes} is wrong in print, by up to {shown(np.abs(one - f).max())} g; the mended "
        f"form errs by {shown(np.abs(other - f).max())} g, of the second order in γ",
    )  # fmt: skip


def fourth_power() -> Tried:
    """(14): C₄ with N⁴ in it, so that (13) has N to the eighth."""
    output = outputs(TRUTH, steps())
    norm2 = (force(steps()) ** 2).sum(axis=1)
    k = TRUTH.bend * TRUTH.bias / TRUTH.scale
    s, b, d = TRUTH.values
    c1, c2, c3 = (
        -2 * b / s**2 * (1 + k) * (1 + 2 * k), (1 + 6 * k + 6 * k**2) / s**2,
        -2 * d / s**3 * (1 + 2 * k),
    )  # fmt: skip
    c4 = 5 * d**2 / s**4
    c0 = (b**2 / s**2 * (1 + k) ** 2).sum()
    below = c0 + (c1 * output + c2 * output**2 + c3 * output**3).sum(axis=1)
    mended, printed = (below + (c4 * output**n).sum(axis=1) for n in (4, 8))
    at = int(np.abs(printed - norm2).argmax())
    return Tried(
        "(14)", f"|f|² of (13) in row {at + 1}", "g²",
        float(printed[at]), float(mended[at]), float(norm2[at]),
        "C₄ = 5D²S⁻⁴, without N⁴, which is the regressor",
    )  # fmt: skip


def _inverted(device: Triad) -> tuple[Array, Array, Array, Array]:
    """Return C₁ to C₄ of the regression on exact data."""
    output = outputs(device, steps())
    c = regression(output, (force(steps()) ** 2).sum(axis=1))
    return c[1:4], c[4:7], c[7:10], c[10:13]


def branch() -> Tried:
    """(19): the root with plus is −1 − K."""
    c1, c2, c3, c4 = _inverted(TRUTH)
    m = c4 / c3 * c1 / c2
    six = 6 * m - 5
    k = (-six + np.sqrt(12 * m**2 - 40 * m + 25)) / (2 * six)
    bias = -c1 * (1 + 6 * k + 6 * k**2) / (2 * c2 * (1 + k) * (1 + 2 * k))
    mended = closed.paper(c1, c2, c3, c4)[1]
    return Tried(
        "(19)", "b_ax by the root with +", "g", float(bias[0]), float(mended[0]),
        float(TRUTH.bias[0]),
        f"K = {shown(k[0], 7)} in place of "
        f"{shown(TRUTH.bend[0] * TRUTH.bias[0] / TRUTH.scale[0])}; "
        f"biases of {', '.join(shown(x) for x in bias)} g; the root with minus holds",
    )  # fmt: skip


def sign(trials: Trials) -> Tried:
    """(21): a root has no sign, and there is none of a negative number."""
    bent = replace(TRUTH, bend=-TRUTH.bend)
    c = _inverted(bent)
    scale, _, mended = closed.paper(*c)
    printed = np.sqrt(c[3] * scale**4 / 5)
    return Tried(
        "(21)", "D_ax of a triad that bends the other way", "1/g", float(printed[0]),
        float(mended[0]), float(bent.bend[0]),
        f"sign D = −sign C₃; and C₄ is negative, or (18) without root, in "
        f"{trials.rootless:.1%} of trials with 10⁻⁵ V of noise",
    )  # fmt: skip


def upside_down() -> Tried:
    """(22): numerator and denominator exchanged."""
    c1, c2, c3, c4 = _inverted(TRUTH)
    _, mended, _ = closed.paper(c1, c2, c3, c4)
    k = TRUTH.bend * TRUTH.bias / TRUTH.scale
    printed = c2 * (1 + 6 * k + 6 * k**2) / (-2 * c1 * (1 + k) * (1 + 2 * k))
    return Tried(
        "(22)", "b_ax", "g", float(printed[0]), float(mended[0]), float(TRUTH.bias[0]),
        f"biases of {', '.join(shown(x, 3) for x in printed)} g; mended, "
        "b = −C₁ (1 + 6K + 6K²) / [2 C₂ (1 + K)(1 + 2K)]",
    )  # fmt: skip


def section(trials: Trials) -> Section:
    """Return the section of the equations."""
    tried = (norm_of_sum(), misaligned(), fourth_power(), branch(), sign(trials), upside_down())
    rows = [
        (
            f"{one.equation}: {one.what}, {one.unit}",
            [shown(one.printed, 7), shown(one.mended, 7), shown(one.true, 7),
             shown(one.mended - one.true)],
        )
        for one in tried
    ]  # fmt: skip
    return WORDS.section(
        [one.finding for one in tried],
        (Table("What the equations give", "equation",
               ("as printed", "mended", "true", "mended −\ntrue"), rows),),
    )  # fmt: skip
