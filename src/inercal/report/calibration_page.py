"""HTML page of a calibration report; this module computes the contents of each section."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

from markupsafe import Markup

from inercal.basics.keys import CoefficientName
from inercal.benches.report_data import MeasuredDirection
from inercal.calibration.explanation import (
    EXPLAIN,
    customer_lines,
    customer_sections,
    without_operator_words,
)
from inercal.calibration.specification import LimitRow, limit_row
from inercal.calibration.suspect_text import p_value_text
from inercal.methods.observability import NOISE_ONLY_NOTE
from inercal.physics.plan import Hold, Rotation, Spin, Step, Turn
from inercal.pipeline import Outcome
from inercal.report.figures import correlations, departures, residuals
from inercal.report.templates import render

if TYPE_CHECKING:
    from inercal.laboratory.store import SensorHistory
# matplotlib's stubs leave **kwargs untyped.
# pyright: reportUnknownMemberType=false


import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.units import (
    ZERO_CELSIUS,
    format_count,
    format_duration,
    format_value_and_uncertainty,
)
from inercal.calibration.display import TemperatureCurve, temperature_curves
from inercal.estimation.uncertainty import COVERAGE
from inercal.pipeline.temperature_fit import SoakLeftOut
from inercal.pipeline.temperature_orders import OrderTest
from inercal.report import drawing, report_tables, traces


def calibration_page(
    outcome: Outcome,
    truth: Mapping[str, float] | None,
    register: "SensorHistory | None" = None,
    *,
    for_customer: bool = False,
) -> str:
    """Return the whole page as HTML.

    Parameters
    ----------
    outcome : Outcome
    truth : mapping of str to float or None
        True coefficients of a simulation, in SI units.
    register : SensorHistory, optional
        Calibrations of the sensor.
    for_customer : bool
        Whether to omit run-file keys and recommended next steps.
    """
    estimate, calibration = outcome.estimate, outcome.calibration
    kind = outcome.kind
    words, found = kind.words, kind.directions(outcome)
    grids, pulls = report_tables.bench_tables(outcome)
    recording = outcome.recording
    chosen = calibration.sensor.coefficients
    lines, sections = outcome.verdict.lines, outcome.verdict.explanation
    findings = [(one, one.message) for one in outcome.findings]
    if for_customer:
        lines, sections = customer_lines(lines), customer_sections(sections)
        findings = [(one, without_operator_words(text)) for one, text in findings]
    return render(
        "page.html",
        minus=report_tables.typeset_minus,
        calibration=calibration,
        sensor=calibration.sensor,
        estimate=estimate,
        outcome=outcome,
        date=calibration.provenance.get("created", "").partition("T")[0],
        verdict=outcome.verdict,
        verdict_lines=[line.removesuffix(f" {EXPLAIN}") for line in lines[1:]],
        explanation=sections,
        findings=findings,
        for_customer=for_customer,
        facts=key_facts(outcome),
        groups=report_tables.coefficients(outcome, truth),
        simulated=truth is not None,
        exact=NOISE_ONLY_NOTE in estimate.notes,
        bench_counted=bool(pulls),
        specification=specification_rows(outcome),
        characteristics=outcome.characteristics,
        matrix=report_tables.correction_matrix(outcome),
        calibration_file=f"{Path(calibration.provenance.get('run file', 'run')).stem}"
        ".calibration.json",
        run_file=calibration.provenance.get("run file", "run.toml"),
        temperature=temperature_section(outcome),
        residuals=_residual_figure(outcome),
        tests=outcome.verdict.tests,
        p_value=report_tables.short_p_value,
        candidates=report_tables.candidate_rows(outcome),
        candidate_count=report_tables.candidate_count(outcome),
        whole=traces.uses_whole_recording(outcome),
        words=words,
        plots=[
            (one.text, drawing.draw_plot(one)) for one in (*kind.plots(outcome), *outcome.plots)
        ],
        over_time=None if register is None else _history_section(register),
        **_filter_figures(outcome, truth),
        spheres=(traces.sphere(found, 1), traces.sphere(found, -1)) if found else (),
        sections=attitude_rows(outcome, found),
        missing=traces.missing_faces(found),
        has_face_positions=Hold in kind.steps and not estimate.groups,
        has_gyros=any(axis.measures == "w" for axis in calibration.sensor.axes),
        has_turns=any(isinstance(step, Turn | Rotation) for step in outcome.steps),
        norm_residuals=has_norm_residuals(outcome),
        unjudged="" if estimate.dof else words.unjudged,
        chance=p_value_text,
        has_attitude_errors=any(not isnan(attitude.deviation_angle) for attitude in found),
        has_spins=any(isinstance(step, Spin) for step in outcome.steps),
        free=bool(estimate.groups),
        rest_scatter=None
        if recording is None or outcome.rests is None
        else traces.scatter_figure(recording, outcome.calibration.sensor, outcome.rests),
        traces=None if recording is None else traces.section_figure(outcome, recording),
        correlations=correlations(estimate) if len(chosen) > 1 else None,
        strongest=report_tables.strongest_correlations(estimate),
        bench=grids,
        departures=departures(pulls) if pulls else None,
        condition=f"{estimate.singular_values[0] / estimate.singular_values[-1]:.3g}",
    )


def specification_rows(outcome: Outcome) -> tuple[list[str], list[LimitRow]] | None:
    """Return sentences about the limits and a row for each, or None if no limits are stated."""
    calibration = outcome.calibration
    if calibration.conformity is None:
        return None
    terms = calibration.sensor.coefficient
    rows = [limit_row(one, terms(one.name)) for one in calibration.conformity.limits]
    return calibration.conformity_lines[:1], rows


def _residual_figure(outcome: Outcome) -> Markup | None:
    """Return the figure of residuals, or None if there are no residuals."""
    if traces.uses_whole_recording(outcome):
        return traces.step_residual_figure(traces.residuals_by_step(outcome))
    estimate = outcome.estimate
    return residuals(outcome) if estimate.whitened.size or estimate.groups else None


def _history_section(register: "SensorHistory") -> tuple[list[Markup], Markup]:
    """Return the conclusions from a sensor's history, and its figures with the table."""
    # Imported here because most reports do not need the register.
    from inercal.report.sensor_history_page import history_section, summary_lines

    return summary_lines(register), history_section(register)


def _filter_figures(outcome: Outcome, truth: Mapping[str, float] | None) -> dict[str, Any]:
    """Return the figures of the filters over time and of a search; None for other estimators."""
    found, track, bench = outcome.estimate.courses, outcome.observations.track, outcome.bench
    if not found and outcome.search is None:
        return {"search": None, "course": None}
    from inercal.benches.turntable import is_turntable
    from inercal.report import filter_figures

    search = None if outcome.search is None else filter_figures.search_figure(outcome.search)
    if not found:
        return {"search": search, "course": None}
    path = None
    if track is not None and is_turntable(bench):
        path = filter_figures.path_figure(track, bench)
    course = {
        "convergence": filter_figures.convergence_figure(outcome, truth),
        "smoothed": filter_figures.smoothed_figure(found, outcome.calibration.sensor),
        "innovations": filter_figures.innovation_figure(found),
        "path": path,
    }
    return {"search": search, "course": course}


def has_norm_residuals(outcome: Outcome) -> bool:
    """Return whether each row has only one residual, which comes from the norm of its readings."""
    rows, axes = len(outcome.observations.labels), len(outcome.observations.channels)
    named = all(name.startswith("|f|") for name in outcome.estimate.observations)
    return axes > 1 and (named or outcome.estimate.whitened.size == rows)


def key_facts(outcome: Outcome) -> list[tuple[str, str]]:
    """Return the key facts; each fact has a name and a text of one or two lines."""
    provenance, recording = outcome.calibration.provenance, outcome.recording
    turns = sum(isinstance(step, Turn | Rotation) for step in outcome.steps)
    spins = [step for step in outcome.steps if isinstance(step, Spin)]
    holds = len(outcome.steps) - turns - len(spins)
    digest = provenance.get("recording sha256", "")
    source = provenance.get("recording", "") + (f"\nSHA-256 {digest[:12]}…" if digest else "")
    result = [("Recording", source)]
    if recording is None:
        result.append(("Data", "means, read from a table"))
    else:
        rate = f"{recording.mean_rate_hz:.4g} Hz"
        size = f"{recording.time.size} samples\n{format_duration(recording.duration)} at {rate}"
        result.append(("Data", size))
    result.append(("Gravity", outcome.calibration.conditions.get("gravity", "")))
    used = format_count(holds, "position")
    if spins:
        rates = len({round(abs(step.rate), 3) for step in spins})
        words = outcome.kind.words
        used = (
            f"{len(spins)} {words.rows}\nat {format_count(rates, 'rate')} of the "
            f"{words.turning_device}"
        )
    if turns:
        used += f"\n{format_count(turns, 'turn')}"
    result.append(("Used", used))
    return [(name, text) for name, text in result if text]


def attitude_rows(
    outcome: Outcome, found: Sequence[MeasuredDirection]
) -> list[tuple[str, str, str, str, str]]:
    """Return the table of positions and turns: label, description, angle, seconds, samples.

    The deviation angle is empty for a turn, because its axis was used to estimate the gyros'
    misalignments.
    """
    observed = outcome.observations
    off = {attitude.step.label: attitude.deviation_angle for attitude in found}
    in_words = outcome.kind.row

    def away(step: Step) -> str:
        angle = off.get(step.label, nan)
        return "" if isinstance(step, Turn | Rotation) or isnan(angle) else f"{degrees(angle):.2f}"

    lengths = zip(observed.duration.tolist(), observed.samples.tolist(), strict=True)
    return [
        (
            step.label,
            report_tables.typeset_minus(in_words(step, outcome, row)),
            away(step),
            f"{seconds:.2f}",
            str(samples),
        )
        for row, (step, (seconds, samples)) in enumerate(zip(outcome.steps, lengths, strict=True))
    ]


_POINTS = 60
_TABLE_ROWS = 7
_COLUMNS = 3
_BEST_ORDERS = 5


@dataclass(frozen=True)
class TemperatureSection:
    """Contents of the section about temperatures."""

    figure: Markup
    celsius: tuple[str, ...]
    rows: list[
        tuple[str, str, str, list[str]]
    ]  # name, meaning, unit, value ± U at each temperature
    orders: tuple[OrderTest, ...]
    left_out: tuple[SoakLeftOut, ...]
    zero: float = ZERO_CELSIUS


def temperature_section(outcome: Outcome) -> TemperatureSection | None:
    """Return the section, or None if no coefficient depends on temperature or it hardly varied."""
    calibration, found = outcome.calibration, outcome.temperature_fit
    limits = None if calibration.validity is None else calibration.validity.temperature
    if limits is None or not calibration.sensor.uses("dT") or limits[1] - limits[0] < 1.0:
        return None
    course: Array = np.linspace(limits[0], limits[1], _POINTS)
    soaks = np.zeros(0) if found is None else found.soaks
    stated = np.unique(np.round(soaks - ZERO_CELSIUS, 1)) + ZERO_CELSIUS  # as it is shown
    if not 1 < stated.size <= _TABLE_ROWS:
        stated = np.linspace(limits[0], limits[1], _TABLE_ROWS)
    kelvin: Array = np.clip(stated, *limits)
    tests = () if found is None else tuple(sorted(found.tests, key=lambda one: one.excess))
    return TemperatureSection(
        curve_figure(temperature_curves(calibration, course), course),
        tuple(report_tables.typeset_minus(f"{t - ZERO_CELSIUS:.1f} °C") for t in kelvin.tolist()),
        _temperature_rows(temperature_curves(calibration, kelvin)),
        tests[:_BEST_ORDERS],
        () if found is None else found.left_out,
    )


def _temperature_rows(curves: Sequence[TemperatureCurve]) -> list[tuple[str, str, str, list[str]]]:
    rows: list[tuple[str, str, str, list[str]]] = []
    for one in curves:
        cells: list[str] = []
        for value, std in zip(one.value.tolist(), one.std.tolist(), strict=True):
            shown, expanded = format_value_and_uncertainty(value / one.si, COVERAGE * std / one.si)
            cells.append(f"{report_tables.typeset_minus(shown)} ± {expanded}")
        change = "" if one.complete else ", change from the reference temperature"
        rows.append((one.name, one.meaning + change, one.unit, cells))
    return rows


@drawing.style
def curve_figure(curves: Sequence[TemperatureCurve], kelvin: Array) -> Markup:
    """Return a figure of curves with bands of ±2 u; a coefficient has one panel for all axes."""
    named: dict[str, list[TemperatureCurve]] = {}
    for one in curves:
        axis, term = CoefficientName(one.name).parts
        named.setdefault(f"{axis[0]} {term}", []).append(one)
    figure, places = drawing.grid(1.7, 0.45, len(named), _COLUMNS)
    celsius = kelvin - ZERO_CELSIUS
    for axes, members in zip(places, named.values(), strict=True):
        for k, one in enumerate(members):
            colour = drawing.AXES[k % len(drawing.AXES)]
            y, reach = one.value / one.si, COVERAGE * one.std / one.si
            axes.fill_between(celsius, y - reach, y + reach, color=colour, alpha=0.25, lw=0)
            axes.plot(celsius, y, color=colour, lw=1.0, label=CoefficientName(one.name).axis)
        first = members[0]
        axes.set_title(CoefficientName(first.name).term)
        axes.set_ylabel(first.unit)
        axes.set_xlabel("temperature, °C")
        drawing.add_legend(axes)
    return drawing.svg(figure, "temperature", "Coefficients against temperature, with bands")
