"""Check the printed equations, their corrected forms and the Taylor orders of (10) on exact data.

Each finding on an equation compares one number: the result of the printed equation, the true value,
and, as the uncertainty, the remaining error of the corrected form.

With u = (N − b)/S, the root of f + D f² = u is f = Σ c_n D^(n−1) u^n, c = 1, −1, 2, −5, 14 …, the
Catalan numbers with alternating signs. A calibration up to some order is the least-squares fit of Σ
f² = A² + 1 with f truncated at this order, with the same weights as `ml`.
"""

from dataclasses import dataclass, replace
from math import comb

import numpy as np

from inercal.basics.arrays import Array
from inercal.methods.centrifuge_norm import RATES, closed_formulas
from inercal.studies import study
from inercal.studies.centrifuge import simulated_centrifuge as simulated
from inercal.studies.claim import Claim, ClaimResult, judge_claim, shown

TAYLOR_TEXT = study.read_section_text("inercal.studies.centrifuge", "taylor")

ORDERS = (2, 3, 4, 5)
_ITERATIONS = 8


def truncated_root(u: Array, bend: Array, order: int | None) -> Array:
    """Return the root f of f + D f² = u, exactly or up to an order of u, g.

    >>> float(truncated_root(np.array(1.0), np.array(0.0), None))
    1.0
    """
    if order is None:
        return 2 * u / (1 + np.sqrt(1 + 4 * bend * u))
    # f = u Σ Catalan(n) (−D u)^n
    return u * sum(comb(2 * n, n) // (n + 1) * (-bend * u) ** n for n in range(order))


def truncation_error(order: int, f: Array, bend: Array) -> Array:
    """Return the error of a force f from truncating at an order, g."""
    return truncated_root(f + bend * f**2, bend, order) - f


def fit_to_order(output: Array, norm: Array, order: int | None) -> Array:
    """Fit S, b and D by least squares with f truncated at an order, (3, 3).

    Parameters
    ----------
    output : (r, 3) array
        Outputs, V.
    norm : (r,) array
        Norms of the specific force, g.
    order : int or None
        Order of truncation; None for the exact root.
    """
    x: Array = simulated.TRUTH.values.copy()
    for _ in range(_ITERATIONS):
        residual, scale = _residual(x, output, norm, order)
        columns: list[Array] = []
        for k, step in enumerate(np.repeat([1e-6, 1e-6, 1e-8], 3)):
            up, down = (x.ravel() + sign * step * np.eye(9)[k] for sign in (1, -1))
            difference = (
                _residual(up.reshape(3, 3), output, norm, order)[0]
                - _residual(down.reshape(3, 3), output, norm, order)[0]
            )
            columns.append(difference / (2 * step) / scale)
        slope = np.stack(columns, axis=-1)
        size = np.linalg.norm(slope, axis=0)
        q, r = np.linalg.qr(slope / size)
        move = np.linalg.solve(r, q.T @ (-residual / scale)) / size
        x = x + move.reshape(3, 3)
    return x


def _residual(x: Array, output: Array, norm: Array, order: int | None) -> tuple[Array, Array]:
    """Return |f| − norm and its standard deviation for unit noise, (r,) each."""
    scale, bias, bend = x
    f = truncated_root((output - bias) / scale, bend, order)
    size = np.linalg.norm(f, axis=-1)
    return size - norm, np.linalg.norm(f / (scale * (1 + 2 * bend * f)), axis=-1) / size


def order_errors() -> dict[int | None, Array]:
    """Return the errors of S, b and D, (3, 3), for each order, on noise-free data."""
    spins = simulated.steps()
    output = simulated.outputs(simulated.TRUTH, spins)
    norm = np.sqrt((np.array([s.rate for s in spins]) ** 2 / simulated.G) ** 2 + 1)
    return {n: fit_to_order(output, norm, n) - simulated.TRUTH.values for n in (*ORDERS, None)}


def taylor_section() -> study.StudySection:
    """Build the section about the Taylor orders."""
    f = simulated.dwell_force(simulated.steps())
    worst = {n: float(np.abs(truncation_error(n, f, simulated.TRUTH.bend)).max()) for n in ORDERS}
    u = (simulated.outputs(simulated.TRUTH, simulated.steps())) / simulated.TRUTH.scale
    fourth = float((simulated.TRUTH.bend**2 * u**4).max())
    shift = order_errors()
    reach = np.linspace(-36.3, 36.3, 241)
    bend = float(simulated.TRUTH.bend.max())
    findings = (
        TAYLOR_TEXT.judge("error", worst[2], 0.0,
            f"the largest error in the design is 2D²f³ = {shown(worst[2])} g; the "
            f"third order leaves {shown(worst[3])} g"),
        # Judged in powers of ten: "of the order of" is true within half a power.
        TAYLOR_TEXT.judge("size", np.log10(fourth), 0.0,
            f"the largest value in the design is {shown(fourth)} g²"),
    )  # fmt: skip
    rows = [
        (
            "exact" if n is None else f"order {n}",
            [
                "0" if n is None else shown(worst[n]),
                *(shown(x) if abs(x) > 1e-14 else "0" for x in shift[n].ravel()),
            ],
        )
        for n in (*ORDERS, None)
    ]
    heads = [f"Δ{q}_a{axis}" for q in "SbD" for axis in "xyz"]
    return TAYLOR_TEXT.section(
        *findings,
        study.StudyTable("Errors by order: force (g), S (V/g), b (g) and D (1/g)", "",
               ("f", *heads), rows),
        study.Chart(
            "taylor",
            "Error of the force by order at D = 5.7·10⁻⁵ 1/g (left), and the largest resulting "
            "error of S, b and D (right). The source claims less than 10⁻⁴ g for order 2.",
            (
                study.StudyPanel(
                    "force", "f, g", "error, g",
                    [study.Curve(f"order {n}", reach,
                          np.maximum(np.abs(truncation_error(n, reach, np.array(bend))), 1e-12))
                     for n in ORDERS],
                ),
                study.StudyPanel(
                    "coefficients", "", "error",
                    [study.Curve(q, np.arange(4.0),
                          np.array([np.abs(shift[n][k]).max() for n in ORDERS]))
                     for k, q in enumerate("SbD")],
                    names=[f"order {n}" for n in ORDERS],
                ),
            ),
        ),
    )  # fmt: skip


EQUATIONS_TEXT = study.read_section_text("inercal.studies.centrifuge", "equations")

# γ_xy, γ_xz, γ_yx, γ_yz, γ_zx, γ_zy, rad, all different.
MISALIGNMENT_ANGLES = dict(zip(("xy", "xz", "yx", "yz", "zx", "zy"),
                 (1e-3, -8e-4, 6e-4, 9e-4, -7e-4, 5e-4), strict=True))  # fmt: skip


@dataclass(frozen=True)
class EquationCheck:
    """Check of one equation: its result as printed and as corrected, and the true value."""

    equation: str
    quantity: str
    unit: str
    printed: float
    corrected: float
    true: float
    reason: str

    @property
    def finding(self) -> ClaimResult:
        """Return the finding, which compares the printed form with the truth."""
        left = max(abs(self.corrected - self.true), abs(self.true) * 2.0**-52)
        claim = Claim(self.quantity, self.equation, self.printed, self.unit, basis="derived")
        return judge_claim(claim, self.true, left, self.reason)


def norm_of_sum() -> EquationCheck:
    """Check (4), which takes the norm of a sum of perpendicular vectors as the sum of norms."""
    a = RATES[0] ** 2 / simulated.G
    true = float(np.linalg.norm(simulated.dwell_force(simulated.steps())[0]))
    return EquationCheck("(4)", "|g + A| = g + A, at ω₁", "g", 1 + a, float(np.hypot(a, 1)), true,
                 "√(g² + A²), because g and A are perpendicular")  # fmt: skip


def misalignment_signs() -> EquationCheck:
    """Check (9), which has wrong signs of misalignments and two exchanged angles in Δ₃."""
    f = simulated.dwell_force(simulated.steps())
    g = MISALIGNMENT_ANGLES
    phi = np.array([[1, -g["xz"], g["xy"]], [g["yz"], 1, -g["yx"]], [-g["zy"], g["zx"], 1]])
    # (7): N = S Φ (f + D f²) + b
    u = (f + simulated.TRUTH.bend * f**2) @ phi.T
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
    one, other = (
        truncated_root(-delta, simulated.TRUTH.bend, None) for delta in (printed, corrected)
    )
    at = np.unravel_index(np.abs(one - f).argmax(), f.shape)
    axes = " and ".join("xyz"[k] for k in range(3) if np.abs((one - other)[:, k]).max() > 1e-9)
    return EquationCheck(
        "(9)", f"the force along {'xyz'[at[1]]}, misaligned by up to 10⁻³ rad", "g",
        float(one[at]), float(other[at]), float(f[at]),
        f"Δ of {axes} is wrong in print, by up to {shown(np.abs(one - f).max())} g; the corrected "
        f"form has an error of {shown(np.abs(other - f).max())} g, of second order in γ",
    )  # fmt: skip


def fourth_power() -> EquationCheck:
    """Check (14), whose C₄ contains N⁴, so that (13) has N to the eighth power."""
    output = simulated.outputs(simulated.TRUTH, simulated.steps())
    norm2 = (simulated.dwell_force(simulated.steps()) ** 2).sum(axis=1)
    k = simulated.TRUTH.bend * simulated.TRUTH.bias / simulated.TRUTH.scale
    s, b, d = simulated.TRUTH.values
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
        "C₄ = 5D²S⁻⁴ without N⁴, which is the regressor",
    )  # fmt: skip


def _regression_coefficients(device: simulated.SimulatedTriad) -> tuple[Array, Array, Array, Array]:
    """Return the regression coefficients C₁ to C₄ on exact data."""
    output = simulated.outputs(device, simulated.steps())
    c = simulated.regress_squared_norms(
        output, (simulated.dwell_force(simulated.steps()) ** 2).sum(axis=1)
    )
    return c[1:4], c[4:7], c[7:10], c[10:13]


def root_branch() -> EquationCheck:
    """Check (19), whose root with the plus sign is −1 − K."""
    c1, c2, c3, c4 = _regression_coefficients(simulated.TRUTH)
    m = c4 / c3 * c1 / c2
    six = 6 * m - 5
    k = (-six + np.sqrt(12 * m**2 - 40 * m + 25)) / (2 * six)
    true = simulated.TRUTH
    bias = -c1 * (1 + 6 * k + 6 * k**2) / (2 * c2 * (1 + k) * (1 + 2 * k))
    corrected = closed_formulas.paper(c1, c2, c3, c4)[1]
    return EquationCheck(
        "(19)", "b_ax from the root with +", "g", float(bias[0]), float(corrected[0]),
        float(true.bias[0]),
        f"K would be {shown(k[0], 7)} instead of "
        f"{shown(true.bend[0] * true.bias[0] / true.scale[0])}, and the biases would "
        f"be {', '.join(shown(x) for x in bias)} g; the root with the minus sign "
        "gives the correct values",
    )  # fmt: skip


def bend_sign(trials: simulated.CentrifugeTrials) -> EquationCheck:
    """Check (21), whose root cannot give the sign of D and does not exist for negative numbers."""
    bent = replace(simulated.TRUTH, bend=-simulated.TRUTH.bend)
    c = _regression_coefficients(bent)
    scale, _, corrected = closed_formulas.paper(*c)
    printed = np.sqrt(c[3] * scale**4 / 5)
    return EquationCheck(
        "(21)", "D_ax of a triad with the opposite sign of D", "1/g", float(printed[0]),
        float(corrected[0]), float(bent.bend[0]),
        f"sign D = −sign C₃; C₄ is negative, or (18) has no root, in "
        f"{trials.rootless:.1%} of trials with 10⁻⁵ V of noise",
    )  # fmt: skip


def inverted_fraction() -> EquationCheck:
    """Check (22), in which numerator and denominator are exchanged."""
    c1, c2, c3, c4 = _regression_coefficients(simulated.TRUTH)
    _, corrected, _ = closed_formulas.paper(c1, c2, c3, c4)
    k = simulated.TRUTH.bend * simulated.TRUTH.bias / simulated.TRUTH.scale
    printed = c2 * (1 + 6 * k + 6 * k**2) / (-2 * c1 * (1 + k) * (1 + 2 * k))
    return EquationCheck(
        "(22)", "b_ax", "g", float(printed[0]), float(corrected[0]), float(simulated.TRUTH.bias[0]),
        f"biases of {', '.join(shown(x, 3) for x in printed)} g; corrected, "
        "b = −C₁ (1 + 6K + 6K²) / [2 C₂ (1 + K)(1 + 2K)]",
    )  # fmt: skip


def equations_section(trials: simulated.CentrifugeTrials) -> study.StudySection:
    """Build the section about the equations."""
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
            [shown(one.printed, 7), shown(one.corrected, 7),
             shown(one.true, 7), shown(one.corrected - one.true)],
        )
        for one in tried
    ]  # fmt: skip
    return EQUATIONS_TEXT.section(
        *(one.finding for one in tried),
        study.StudyTable("Results of the equations", "equation",
               ("as printed", "mended", "true", "corrected −\ntrue"), rows),
    )  # fmt: skip
