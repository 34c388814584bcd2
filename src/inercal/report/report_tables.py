"""Write the tables of the report as text, rounded according to the uncertainties."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from markupsafe import Markup

from inercal.basics.arrays import Array
from inercal.basics.keys import CoefficientName, ErrorName
from inercal.basics.parameters import Parameter, display_unit
from inercal.basics.units import format_number, format_value_and_uncertainty
from inercal.calibration.best_cause import familywise_p_value
from inercal.calibration.suspect_text import format_component, p_value_text
from inercal.estimation import Estimate, ScoreTest
from inercal.estimation.uncertainty import COVERAGE, value_and_jacobian
from inercal.physics.magnetism import axis_names, field_matrix, level_attitudes, split_matrix
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import G0
from inercal.pipeline import Outcome
from inercal.pipeline.outcome import true_coefficients

_MINUS_PATTERN = re.compile(r"(?<![^\s(\[e=,;:|])-(?=[\d.])")
_MIN_CORRELATION = 0.5  # smallest correlation that is listed
_MAX_PAIRS = 8
_MAX_LISTED = 10  # number of candidates shown
_TILT = 15.0  # °, of the attitudes whose heading is stated
_KIND_TEXTS = {
    "coefficient": "coefficient, not estimated",
    "bench": "bench error, larger than stated",
    "row": "error of one row's readings",
    "time": "change during the run",
}


@dataclass(frozen=True)
class CoefficientRow:
    """One coefficient as printed; `error`, if known, is in standard uncertainties."""

    name: str
    symbol: str
    index: str
    meaning: str
    value: str
    expanded: str
    unit: str
    significant: bool
    error: str
    error_is_large: bool


@dataclass(frozen=True)
class AxisGroup:
    """The coefficients for one kind of axis; `axes` contains the rows for each axis."""

    title: str
    axes: tuple[tuple[CoefficientRow, ...], ...]


@dataclass(frozen=True)
class Grid:
    """A table with a heading above each column and a name before each row."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]


def typeset_minus(text: str) -> str:
    """Replace hyphens before numbers by minus signs, but keep hyphens within words."""
    return _MINUS_PATTERN.sub("−", text)


def sentence(line: str) -> str:
    """Format a line as a sentence with proper minus signs."""
    return typeset_minus(f"{line[0].upper()}{line[1:]}.")


def sentence_with_index(line: str) -> Markup:
    """Format a line as an HTML sentence in which E_n has a subscript."""
    return Markup.escape(sentence(line)).replace("E_n", Markup("E<sub>n</sub>"))


def coefficients(outcome: Outcome, truth: Mapping[str, float] | None) -> list[AxisGroup]:
    """Return the coefficients by kind and axis, with U = k u in customary units."""
    calibration = outcome.calibration
    true = None if truth is None else true_coefficients(calibration, truth)
    groups: list[AxisGroup] = []
    for kind, quantity in QUANTITIES.items():
        rows = [
            tuple(
                _coefficient_row(outcome, name, true)
                for name in calibration.sensor.coefficients
                if CoefficientName(name).axis == axis.name
            )
            for axis in calibration.sensor.axes
            if axis.measures == kind
        ]
        if any(rows):
            title = quantity.sensors.capitalize()
            groups.append(AxisGroup(title, tuple(row for row in rows if row)))
    return groups + _field_groups(outcome)


def _coefficient_row(
    outcome: Outcome, name: str, true: Mapping[str, float] | None
) -> CoefficientRow:
    calibration = outcome.calibration
    line = calibration.sensor.coefficient(name)
    value, sd = calibration.value(name), calibration.uncertainty(name)
    error = float("nan")
    if true is not None and sd > 0:
        error = (value - true[name]) / sd
    return _row(name, line.symbol, line.meaning, value / line.si, sd / line.si, line.unit, error)


def _row(
    name: str, symbol: str, meaning: str, value: float, sd: float, unit: str, error: float = np.nan
) -> CoefficientRow:
    """Return a row with a value and U = 2 sd, both in `unit`."""
    shown, expanded = format_value_and_uncertainty(value, COVERAGE * sd)
    symbol, _, index = symbol.partition("_")
    return CoefficientRow(
        name,
        symbol,
        index,
        meaning,
        typeset_minus(shown),
        expanded,
        unit,
        abs(value) >= COVERAGE * sd,
        "" if np.isnan(error) else typeset_minus(f"{error:+.2f}"),
        abs(error) > 3,
    )


def _field_groups(outcome: Outcome) -> list[AxisGroup]:
    """Return D, its parts P and Q, and the heading of three magnetometers that are calibrated."""
    calibration = outcome.calibration
    sensor = calibration.sensor
    own = [k for k, axis in enumerate(sensor.axes) if axis.measures == "m"]
    if len(own) != 3 or sensor.rank("m") < 3 or not sensor.select_axes("m").coefficients:
        return []

    def parts(c: Array) -> Array:
        found = split_matrix(field_matrix(sensor, c))
        shape = found.shape[np.tril_indices(3)]
        return np.concatenate([found.matrix.ravel(), shape, np.degrees(found.rotation)])

    values, by = value_and_jacobian(parts, calibration.values, calibration.covariance)
    sd = np.sqrt(np.einsum("ij,jk,ik->i", by, calibration.covariance, by))
    axes = split_matrix(field_matrix(sensor, calibration.values)).axes
    along = ", ".join(
        f"{sensor.axes[k].name} along {name.replace('-', '−')}"
        for k, name in zip(own, axis_names(axes), strict=True)
    )
    pairs = [(i, j) for i in range(3) for j in range(i + 1)]
    names = [("D", sensor.axes[k].name, "xyz"[j], "reading per field", "1")
             for k in own for j in range(3)]  # fmt: skip
    names += [("P", sensor.axes[own[i]].name, sensor.axes[own[j]].name,
               "scale factors and soft iron", "1") for i, j in pairs]  # fmt: skip
    names += [("R", "rotation", one, f"rotation before the axes {along}", "°") for one in "xyz"]
    rows = [
        _row(f"{first}, {second}", f"{symbol}_{second}", meaning, value, u, unit)
        for (symbol, first, second, meaning, unit), value, u in zip(
            names, values.tolist(), sd.tolist(), strict=True
        )
    ]
    parts_of_d = (tuple(rows[:9]), tuple(rows[9:15]), tuple(rows[15:]), _heading_rows(outcome))
    return [AxisGroup("Magnetometers: D = P Q and heading", tuple(filter(None, parts_of_d)))]


def _heading_rows(outcome: Outcome) -> tuple[CoefficientRow, ...]:
    """Return U of the heading with z vertical and with z tilted, in the field of the data."""
    estimate, rows = outcome.estimate, list[CoefficientRow]()
    if not {"dip", "strength"} <= {*estimate.names}:
        return ()
    dip, strength = (float(estimate.value[estimate.names.index(n)]) for n in ("dip", "strength"))
    for tilt in (0.0, _TILT):
        f, m = level_attitudes(np.radians(tilt), dip, strength, G0)
        std = outcome.calibration.predict(f, m=m, extrapolate=True).heading_std
        if std is not None:
            at = f"{tilt:g}° tilt"
            u = float(np.degrees(np.sqrt(np.mean(std**2))))
            row = _row(f"heading, {at}", "ψ", "magnetic heading at rest, z up", 0.0, u, "°")
            rows.append(replace(row, value="", significant=True))
    return tuple(rows)


def bench_tables(outcome: Outcome) -> tuple[list[Grid], dict[str, list[tuple[str, float]]]]:
    """Return tables of the estimated bench errors, and their deviations from the stated values.

    Returns
    -------
    list of Grid
        Tables for the run, the positions and the turns.
    dict of str to list of (str, float)
        For each position, each turn and "run": the parameters, and their estimated minus stated
        values in stated standard deviations.
    """
    estimate, expected = outcome.estimate, outcome.expected
    found = [name for name in estimate.names if name not in estimate.wanted]
    known = {name: expected[name] for name in found if name in expected}
    free = [name for name in found if name not in expected and "[" in name]
    grids: list[Grid] = []
    pulls: dict[str, list[tuple[str, float]]] = {}
    for name, parameter in known.items():
        if parameter.sd > 0:
            short, label = ErrorName(name).parts
            value = estimate.value[estimate.names.index(name)]
            pull = float((value - parameter.value) / parameter.sd)
            pulls.setdefault(label or "run", []).append((short, pull))
    run = [name for name, parameter in known.items() if parameter.scope == "run"]
    if run:
        rows = tuple((known[name].meaning, _run_row(estimate, name, known[name])) for name in run)
        grids.append(Grid("The whole run", ("stated", "estimated", "unit"), rows))
    for scope, title in (
        ("position", "By position"),
        ("turn", "By turn"),
        ("pass", "By pass"),
        ("mounting", "By mounting"),
        ("speed", "By speed"),
    ):
        names = [name for name, parameter in known.items() if parameter.scope == scope]
        if scope == "turn":
            names += free
        if names:
            names = sorted(names, key=lambda name: _row_index(name, outcome))
            grids.append(_label_grid(estimate, title, names, known))
    order = ["run", *outcome.observations.labels]
    rank = {label: k for k, label in enumerate(order)}
    return grids, dict(sorted(pulls.items(), key=lambda item: rank.get(item[0], len(rank))))


def _row_index(name: str, outcome: Outcome) -> int:
    """Return the observation row to which a parameter belongs, or the first row."""
    label, labels = ErrorName(name).place, outcome.observations.labels
    return labels.index(label) if label in labels else 0


def _run_row(estimate: Estimate, name: str, parameter: Parameter) -> tuple[str, ...]:
    unit, si = display_unit(parameter)
    k = estimate.names.index(name)
    before = format_value_and_uncertainty(parameter.value / si, parameter.sd / si)
    after = format_value_and_uncertainty(estimate.value[k] / si, estimate.std[k] / si)
    return (typeset_minus(" ± ".join(before)), typeset_minus(" ± ".join(after)), unit)


def _label_grid(
    estimate: Estimate, title: str, names: list[str], known: Mapping[str, Parameter]
) -> Grid:
    shorts = list(dict.fromkeys(ErrorName(name).name for name in names))
    labels = list(dict.fromkeys(ErrorName(name).place for name in names))
    heads: list[str] = []
    cells: dict[str, list[str]] = {label: [] for label in labels}
    for short in shorts:
        parameter = known.get(next(name for name in names if name.startswith(f"{short}[")))
        unit, si = display_unit(parameter)
        stated = (
            "free" if parameter is None else f"stated {typeset_minus(_stated_text(parameter, si))}"
        )
        heads.append(f"{short}, {unit}\n{stated}")
        for label in labels:
            full = f"{short}[{label}]"
            if full not in estimate.names:
                cells[label].append("")
                continue
            k = estimate.names.index(full)
            shown = format_value_and_uncertainty(estimate.value[k] / si, estimate.std[k] / si)
            cells[label].append(typeset_minus(" ± ".join(shown)))
    return Grid(title, tuple(heads), tuple((label, tuple(row)) for label, row in cells.items()))


def _stated_text(parameter: Parameter, si: float) -> str:
    return " ± ".join(format_number(x / si, 3) for x in (parameter.value, parameter.sd))


def strongest_correlations(estimate: Estimate) -> list[str]:
    """Describe the strongest correlations, at most eight; empty if none reaches 0.5."""
    names = estimate.wanted
    matrix = estimate.select(names).correlation
    rows, columns = np.tril_indices(len(names), -1)
    r = matrix[rows, columns]
    order = [k for k in np.argsort(-np.abs(r)).tolist() if abs(r[k]) >= _MIN_CORRELATION][
        :_MAX_PAIRS
    ]
    return [
        f"{names[columns[k]]} and {names[rows[k]]}: {typeset_minus(f'{float(r[k]):+.2f}')}"
        for k in order
    ]


def correction_matrix(outcome: Outcome) -> Grid | None:
    """Return C and o in motion = C (output − o), or None if the model is not affine."""
    calibration = outcome.calibration
    sensor = calibration.sensor
    if not sensor.affine:
        return None
    slope, offset = calibration.affine_correction()
    rounding = 1e-14 * float(np.abs(slope).max())
    # Minus signs are plain hyphens here, because users copy these numbers.
    rows = [
        (f"{name[0]}_{name[1:]}", tuple(f"{x:.7g}" if abs(x) > rounding else "0" for x in row))
        for name, row in zip(sensor.sensed.names, slope, strict=True)
    ]
    rows.append(("o", tuple(f"{x:.7g}" for x in offset)))
    return Grid("", sensor.channels, tuple(rows))


def candidate_rows(outcome: Outcome) -> list[dict[str, Any]]:
    """Return the table rows of the candidates with the smallest p-values, in ascending order."""
    score_tests, suspect = outcome.estimate.score_tests, outcome.verdict.suspect
    seen = [one for one in score_tests.scores if one.dof]
    first = sorted(seen, key=lambda one: (one.p_value, -one.chi2))[:_MAX_LISTED]
    return [
        {
            "name": one.name,
            "kind": _KIND_TEXTS[one.kind],
            "size": _size_text(outcome, one),
            "chi2_decrease": f"{one.chi2:.1f}",
            "dof": one.dof,
            "familywise_p": short_p_value(familywise_p_value(score_tests, one)),
            "shift": _shift_text(outcome, one),
            "suspect": suspect is not None and one.name == suspect.name,
        }
        for one in first
    ]


def candidate_count(outcome: Outcome) -> int:
    """Return the number of candidates that were tested."""
    return sum(one.dof > 0 for one in outcome.estimate.score_tests.scores)


def short_p_value(p: float) -> str:
    """Format a p-value for a table cell."""
    return f"{p:.2f}" if p >= 0.01 else p_value_text(p).removeprefix("= ")


def _size_text(outcome: Outcome, one: ScoreTest) -> str:
    if one.kind == "row":
        return ""
    parts: Sequence[str] = [
        format_component(outcome.calibration.sensor, one.kind, name, float(size), float(sd), unit)
        for name, size, sd, unit in zip(one.components, one.size, one.sd, one.units, strict=True)
        if np.isfinite(size)
    ]
    return "; ".join(parts)


def _shift_text(outcome: Outcome, one: ScoreTest) -> str:
    """Describe the largest shift (in units of U) and the coefficient that is shifted."""
    names = outcome.calibration.sensor.coefficients
    expanded = COVERAGE * outcome.estimate.std[: len(names)]
    shift = np.abs(one.shift[: len(names)]) / np.where(expanded > 0, expanded, np.inf)
    most = int(np.argmax(shift))
    return f"{shift[most]:.2g} ({names[most]})" if shift[most] > 0 else "0"
