"""The Taylor orders of (10): what each leaves out of the force, and does to the coefficients.

With u = (N − b)/S the root of f + D f² = u is f = Σ c_n D^(n−1) u^n, c = 1, −1, 2, −5, 14 …, the
Catalan numbers with alternating signs. A calibration that stops at some order is the least-squares
fit of Σ f² = A² + 1 with f so shortened, weighted as `ml` is.
"""

from math import comb

import numpy as np

from inercal.basics.arrays import Array
from inercal.studies.centrifuge.simulated_centrifuge import TRUTH, G, dwell_force, outputs, steps
from inercal.studies.claim import format_significant
from inercal.studies.section_texts import read_section_text
from inercal.studies.study_content import Chart, Curve, StudyPanel, StudySection, StudyTable

TEXT = read_section_text("inercal.studies.centrifuge", "taylor")

ORDERS = (2, 3, 4, 5)
_ITERATIONS = 8


def truncated_root(u: Array, bend: Array, order: int | None) -> Array:
    """Return f of f + D f² = u, to an order of u or exactly; g.

    >>> float(truncated_root(np.array(1.0), np.array(0.0), None))
    1.0
    """
    if order is None:
        return 2 * u / (1 + np.sqrt(1 + 4 * bend * u))
    # f = u Σ Catalan(n) (−D u)^n
    return u * sum(comb(2 * n, n) // (n + 1) * (-bend * u) ** n for n in range(order))


def truncation_error(order: int, f: Array, bend: Array) -> Array:
    """Return the error of force f by an order, g."""
    return truncated_root(f + bend * f**2, bend, order) - f


def fit_to_order(output: Array, norm: Array, order: int | None) -> Array:
    """Return S, b, D by least squares with f to an order, (3, 3).

    Parameters
    ----------
    output : (r, 3) array
        V.
    norm : (r,) array
        g.
    order : int or None
        None is exact.
    """
    x: Array = TRUTH.values.copy()
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
    """Return |f| − norm and how noise of one unit shows in it, (r,) each."""
    scale, bias, bend = x
    f = truncated_root((output - bias) / scale, bend, order)
    size = np.linalg.norm(f, axis=-1)
    return size - norm, np.linalg.norm(f / (scale * (1 + 2 * bend * f)), axis=-1) / size


def order_errors() -> dict[int | None, Array]:
    """Return the errors of S, b, D, (3, 3), by each order on noise-free data."""
    spins = steps()
    output = outputs(TRUTH, spins)
    norm = np.sqrt((np.array([s.rate for s in spins]) ** 2 / G) ** 2 + 1)
    return {n: fit_to_order(output, norm, n) - TRUTH.values for n in (*ORDERS, None)}


def section() -> StudySection:
    """Return the section of the Taylor orders."""
    f = dwell_force(steps())
    worst = {n: float(np.abs(truncation_error(n, f, TRUTH.bend)).max()) for n in ORDERS}
    u = (outputs(TRUTH, steps())) / TRUTH.scale
    fourth = float((TRUTH.bend**2 * u**4).max())
    shift = order_errors()
    reach = np.linspace(-36.3, 36.3, 241)
    bend = float(TRUTH.bend.max())
    findings = (
        TEXT.judge("error", worst[2], 0.0,
            f"the largest of the design is 2D²f³ = {format_significant(worst[2])} g; the third "
            f"order leaves {format_significant(worst[3])} g"),
        # Judged in powers of ten: "of the order of" is right within half of one.
        TEXT.judge("size", np.log10(fourth), 0.0,
            f"the largest of the design is {format_significant(fourth)} g²"),
    )  # fmt: skip
    rows = [
        (
            "exact" if n is None else f"order {n}",
            [
                "0" if n is None else format_significant(worst[n]),
                *(format_significant(x) if abs(x) > 1e-14 else "0" for x in shift[n].ravel()),
            ],
        )
        for n in (*ORDERS, None)
    ]
    heads = [f"Δ{q}_a{axis}" for q in "SbD" for axis in "xyz"]
    return TEXT.section(
        findings,
        (StudyTable("Errors by order: of the force, g, and of S (V/g), b (g), D (1/g)", "",
               ("f", *heads), rows),),
        (
            Chart(
                "taylor",
                "Error of the force by order at D = 5.7·10⁻⁵ 1/g (left), and the largest error of "
                "S, b and D that it makes (right). The source claims less than 10⁻⁴ g for order 2.",
                (
                    StudyPanel(
                        "force", "f, g", "error, g",
                        [Curve(f"order {n}", reach,
                              np.maximum(np.abs(truncation_error(n, reach, np.array(bend))), 1e-12))
                         for n in ORDERS],
                    ),
                    StudyPanel(
                        "coefficients", "", "error",
                        [Curve(q, np.arange(4.0),
                              np.array([np.abs(shift[n][k]).max() for n in ORDERS]))
                         for k, q in enumerate("SbD")],
                        names=[f"order {n}" for n in ORDERS],
                    ),
                ),
            ),
        ),
    )  # fmt: skip
