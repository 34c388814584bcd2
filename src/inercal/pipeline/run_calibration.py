"""Calibrate a run that was read and checked; the architecture page shows the same stations."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple, cast

import numpy as np

from inercal.basics.errors import InercalError, InputError, NotObserved, error_location
from inercal.basics.units import ZERO_CELSIUS, Measured, format_duration
from inercal.benches import Bench
from inercal.benches.contradicting_rows import (
    contradicting_rows,
    require_possible_rows,
    require_right_columns,
)
from inercal.calibration import Calibration
from inercal.calibration.best_cause import also as also_change
from inercal.calibration.best_cause import changes_text
from inercal.calibration.check_standard import CHECK_STANDARD
from inercal.calibration.delays import delay_words
from inercal.calibration.detectability import wrong_latitude_sign
from inercal.calibration.explanation import additions_text, doubtful_additions
from inercal.calibration.verdict import verdict
from inercal.estimation import Estimate
from inercal.methods import Fit
from inercal.methods.solving import prepared
from inercal.methods.temperature import temperature_coefficients
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_selection import select_coefficients
from inercal.pipeline import calibration_record, stated_values, temperature_fit
from inercal.pipeline.added_coefficients import with_added_coefficients
from inercal.pipeline.advisor import RunAdvisor, changed_run, large_uncertainties
from inercal.pipeline.outcome import FittedRun, Outcome
from inercal.pipeline.stated_noise import stated_noise_findings
from inercal.recordings import Finding, merge_findings
from inercal.recordings.data import EstimatorInput
from inercal.recordings.io.mean_tables import check_repeated_rows, clipped_means
from inercal.recordings.io.rest_norm import check_zero_rates
from inercal.recordings.io.row_checks import copied_sections
from inercal.runfile import Run

_PART = 0.05  # of a section; a smaller part that is not used is not remarked
_CONTRADICTED = 100.0  # times the noise: with such residuals, a linear step names wrong rows
_MOST_WRONG = 2  # rows that are named as the cause

if TYPE_CHECKING:
    from inercal.methods.ship_multi_angle.norm_equations import Generation, SearchHistory


class ObservedRun(NamedTuple):
    """A run after its temperature orders were chosen, with its data."""

    stated: Run
    run: Run
    inputs: EstimatorInput
    thermal: temperature_fit.TemperatureFit | None
    of_type: Mapping[str, str]


def observed(run: Run) -> ObservedRun:
    """Read and average the data of a run that was read and checked.

    Raises
    ------
    InputError, NotObserved
        The data cannot be used.
    """
    stated = run
    try:
        inputs = run.kind.observe(run)
        of_type = calibration_record.prior_of_type(run, inputs)
        inputs = replace(inputs, conditions={**inputs.conditions, **of_type})
        return ObservedRun(stated, *temperature_fit.fit_over_temperatures(run, inputs), of_type)
    except (InputError, NotObserved) as error:
        named = error.file is not None or str(run.path) in str(error)
        raise (error if named else error.located(run.path)) from None


def _fitted(
    run: Run,
    progress: "Callable[[Generation], None] | None" = None,
    seen: ObservedRun | None = None,
    solution: Estimate | None = None,
) -> FittedRun:
    """Run the estimator for a run that was read and checked, unless its solution is given."""
    stated, run, inputs, thermal, of_type = seen or observed(run)
    sensor, bench = run.sensor, inputs.bench or run.bench
    expected = bench.nuisances(inputs.steps, sensor)
    observations, findings = inputs.observations, (*run.findings, *inputs.findings)
    findings += calibration_record.temperature_findings(run, inputs)
    zero_rates = check_zero_rates(observations, sensor, inputs.steps, run.priors, run.data.gyro)
    findings += zero_rates
    reported = any(one.what == "repeated" for one in inputs.findings)
    if inputs.recording is None and observations.track is None and not reported:
        findings += check_repeated_rows(observations, sensor)
    if inputs.recording is not None:
        findings += copied_sections(inputs.recording, inputs.marks)
    require_right_columns(run.path, observations, sensor, bench, inputs.steps)
    solver_sensor = inputs.sensor_of_samples(sensor)
    if thermal is not None:
        findings += thermal.findings
    generations: list[Generation] = []

    def after(generation: "Generation") -> None:
        generations.append(generation)
        if progress is not None:
            progress(generation)

    try:
        # A fit to wrong rows may overflow before it is refused.
        with prepared(solution), np.errstate(all="ignore"):
            estimate = run.solver(after)(
                observations, solver_sensor, bench, inputs.plan, run.priors
            )
    except (InputError, NotObserved) as error:
        require_possible_rows(run.path, observations, sensor, bench, inputs.steps)
        flaws = _flaws_in_words(inputs.findings)
        located = error.located(f"{run.path}{flaws}", file=run.path)
        causes = _possible_causes(inputs, sensor, zero_rates, error)
        if isinstance(error, NotObserved):
            causes = f"{large_uncertainties(run, expected)}{causes}"
        located.args = (f"{located}{_usable_also(run, error)}{causes}",)
        raise located from None
    estimate = temperature_fit.with_common_errors(run, inputs, estimate)
    fit = Fit(
        run.estimator,
        sensor,
        bench,
        observations,
        inputs.steps,
        run.priors,
        estimate,
        run.time_offset,
        run.environment,
    )
    if not np.all(estimate.converged):
        require_possible_rows(run.path, observations, sensor, bench, inputs.steps)
    elif estimate.largest_birge_ratio > _CONTRADICTED:
        text, labels = contradicting_rows(observations, sensor, bench, inputs.steps)
        if labels and len(labels) <= _MOST_WRONG:
            cause = f"wrong readings in {' and '.join(labels)}"
            findings += (Finding("warning", "rows", text, cause=cause),)
    remarks = run.method.remarks(fit)
    findings += remarks.findings
    if inputs.recording is None and observations.track is None and not np.all(estimate.consistent):
        findings += clipped_means(observations, sensor)
    findings += stated_noise_findings(
        estimate,
        observations,
        sensor,
        inputs.steps,
        recorded=inputs.recording is not None,
        by_hand=run.method.unknown_attitudes,
        own_tilts=any(n.startswith("tilt") and n.endswith(" (2)]") for n in estimate.names),
    )
    findings += tuple(wrong_latitude_sign(estimate, sensor, getattr(bench, "latitude", None)))
    findings = merge_findings(findings)
    if not np.all(estimate.converged):
        largest = 0.1 * sensor.unit_scale
        large = (np.abs(estimate.value) + estimate.std)[: len(largest)] > largest
        free = tuple(np.array(sensor.coefficients)[large].tolist())
        text = "".join(f"; {finding.message}" for finding in findings if finding.what == "norm")
        sections = "rows" if inputs.recording is None else "marks"
        if free:
            text = f"; perhaps the plan does not determine {', '.join(free)}{text}"
        text = f"{large_uncertainties(run, expected)}{text}"
        raise InputError(
            f"the fit did not converge; check the {sections} and the plan{text}", names=free
        ).located(run.path)
    if not np.isfinite(estimate.covariance).all():
        raise InputError(
            f"estimator {run.estimator} states no uncertainty for this noise, because its "
            "equation may have no root; use another estimator",
            key="[method] estimator",
        ).located(run.path)
    p = len(sensor.coefficients)
    assumed = stated_values.find_assumed_constants(expected)

    def solve(other: Bench) -> Estimate:
        return run.solver()(observations, solver_sensor, other, inputs.plan, run.priors)

    with error_location(run.path):
        stated_values.require_small_assumed_share(assumed, estimate, p, bench, solve)
    weighs_gravity = bool(sensor.select_axes("f").coefficients)
    estimate = replace(
        estimate,
        notes=(
            *remarks.notes,
            *(f"The {what} is {text}." for what, text in of_type.items()),
            *inputs.notes,
            *section_notes(inputs),
            *observations.notes,
            *(
                f"[data] takes {c}, judged by their names."
                for c in [calibration_record.crossed_columns(run)]
                if c
            ),
            *estimate.notes,
            *(() if thermal is None else thermal.notes),
            *stated_values.gravity_notes(bench, sensor, estimate),
            *stated_values.constant_notes(bench, assumed),
            *stated_values.uncounted_notes(run, estimate, expected),
            *(one.message for one in run.findings if one.what == "height" and weighs_gravity),
        ),
        tests=tuple(dict.fromkeys((*observations.tests, *estimate.tests))),
        # Estimators that follow a track weight samples by the stated noise, or set these fields
        # themselves.
        noise_dof=estimate.noise_dof if observations.track is not None else observations.dof,
        noise_channels=len(sensor.axes),
    )
    try:
        run, estimate, of_field, thermal = temperature_fit.with_magnetometers(
            run, replace(fit, estimate=estimate), thermal
        )
    except (InputError, NotObserved) as error:
        raise error.located(run.path) from None
    findings += of_field.findings
    remarks = remarks._replace(conditions={**remarks.conditions, **of_field.conditions})
    return FittedRun(
        stated,
        run,
        inputs,
        thermal,
        bench,
        expected,
        estimate,
        findings,
        remarks,
        tuple(generations),
    )


def section_notes(inputs: EstimatorInput) -> Iterator[str]:
    """Yield a note for each section that lost samples, or of which a part was not used."""
    if (recording := inputs.recording) is None:
        return
    before, after = recording.gaps.T
    lost = recording.time[after] - recording.time[before]
    lost[list(inputs.pauses)] = 0.0
    for mark in inputs.marks:
        missing = float(lost[(before >= mark.start) & (after < mark.stop)].sum())
        span = recording.span(mark.start, mark.stop)
        if missing > _PART * span:
            yield (
                f"Samples were lost for {format_duration(missing)} of the "
                f"{format_duration(span)} of section {mark.label}."
            )
    if (rests := inputs.rests) is None:
        return
    for k, (start, stop) in rests.other_parts:
        mark = rests.marks[k]
        if stop - start > _PART * (mark.stop - mark.start):
            yield (
                f"Only {mark.stop - mark.start} samples of rest {mark.label} are used, because the "
                f"readings change within it; {stop - start} samples are left out."
            )


def _advisor(fitted: FittedRun) -> RunAdvisor:
    run = fitted.run
    row = run.kind.words.row
    if run.method.unknown_attitudes:
        row = "rest or turn" if run.sensor.rank("w") else "rest"
    return RunAdvisor(fitted, "part of the recording" if run.method.follows_rest else row, _fitted)


def calibrate_run(
    stated: Run,
    progress: "Callable[[Generation], None] | None" = None,
    also: str | Sequence[str] | None = None,
    seen: ObservedRun | None = None,
    solution: Estimate | None = None,
    *,
    advise: bool = True,
) -> Outcome:
    """Calibrate a run that was read and checked; advice is tried before it is given.

    The other arguments and the errors are those of `inercal.calibrate`.

    Parameters
    ----------
    seen : ObservedRun, optional
        The result of `observed`, if it is known.
    solution : Estimate, optional
        The result of `inercal.methods.solving.solve` for these observations, if it is known.
    advise : bool
        Whether the advice of the verdict is tried; the grade does not depend on it.
    """
    if also is not None:
        with error_location(stated.path):
            stated = changed_run(stated, (also_change(also),))
    fitted = _fitted(stated, progress, seen, solution)
    if stated.adds_coefficients:
        fitted, advisor, additions = with_added_coefficients(fitted, _advisor)
    else:
        advisor, additions = _advisor(fitted), ()
    _, run, inputs, thermal, bench, expected, estimate, findings, remarks, generations = fitted
    sensor, observations = run.whole_sensor, inputs.observations
    p = len(sensor.coefficients)
    conditions = {**calibration_record.run_conditions(run, inputs), **remarks.conditions}
    if run.bench_name:
        conditions["bench"] = run.bench_name
    conditions |= stated_values.qualification_conditions(run)
    if run.check_standard:
        conditions[CHECK_STANDARD] = run.check_standard
    possible, findings = run.method.possible(sensor), findings + doubtful_additions(additions)
    judged = verdict(
        estimate, sensor, findings, expected, possible, advisor.row_word,
        advisor if advise else None, additions_text(additions, sensor),
    )  # fmt: skip
    judged = replace(judged, additions=additions)
    if observations.rounding is not None:
        judged = replace(judged, rounding=observations.rounding.channels)
    value, covariance = estimate.value[:p], estimate.stated_covariance[:p, :p]
    calibration = Calibration(
        sensor,
        value,
        covariance,
        run.method.name,
        run.estimator,
        conditions,
        calibration_record.provenance(run, inputs),
        judged.statements,
        "symmetric" if sensor.frame == "symmetric" else run.method.frame(run.bench),
        verdict=judged,
        shared=calibration_record.shared_errors(run, estimate, expected, p),
        validity=calibration_record.validity(run, inputs),
        job=run.job,
        conformity=None
        if run.specification is None
        else run.specification.judge(sensor.coefficients, value, covariance),
        bench_estimates=calibration_record.bench_estimates(estimate, expected, p),
    )
    return Outcome(
        calibration=calibration,
        estimate=estimate,
        observations=observations,
        steps=inputs.steps,
        bench=bench,
        kind=run.kind,
        expected=expected,
        recording=inputs.recording,
        marks=inputs.marks,
        findings=findings,
        verdict=judged,
        rests=inputs.rests,
        search=_search_history(run, generations),
        temperature_fit=thermal,
        plots=remarks.plots,
        characteristics=inputs.characteristics,
    )


def _search_history(run: Run, generations: "Sequence[Generation]") -> "SearchHistory | None":
    if run.search is None:
        return None
    from inercal.methods.ship_multi_angle.norm_equations import SearchHistory

    return SearchHistory(run.search.goal, tuple(generations))


def _usable_also(run: Run, error: InercalError) -> str:
    """Return the key `also` without the undetermined coefficients, if only it added them."""
    stated = run.sections.get("method", {}).get("also")
    if not isinstance(error, NotObserved) or not error.names or isinstance(stated, str | None):
        return ""
    free, kept = set(error.names), list[str]()
    for word in cast(Sequence[str], stated):
        added = select_coefficients(run.sensor.axes, (word,))
        left = [name for name in added if name not in free]
        kept += [word] if len(left) == len(added) else left
        free -= set(added)
    if free:
        return ""
    return f"; or {f'use {changes_text((also_change(kept),))}' if kept else 'remove [method] also'}"


# Kinds of findings about single readings, rows, rests and windows.
_FLAWS = ("saturation", "stuck", "axes", "moving", "rests", "dwell", "outlier", "nonfinite")


def _flaws_in_words(findings: Sequence[Finding]) -> str:
    """Return the readings that cannot be used, as the start of a refusal; "" if there are none."""
    found = {
        (one.what, one.channel): one.message
        for one in reversed(findings)
        if one.what in _FLAWS and (one.what, one.severity) != ("rests", "note")
    }
    return f": {'; '.join(found.values())}; check these readings first" if found else ""


def _possible_causes(
    inputs: EstimatorInput,
    sensor: Sensor,
    zero_rates: Sequence[Finding],
    error: InercalError,
) -> str:
    """Suggest why the estimator refused the data: wrong units, temperatures or rests."""
    causes = [one.message for one in inputs.findings if one.what == "missing"]
    if inputs.rests is not None:
        causes.append(inputs.rests.finding.message)
        from inercal.recordings.segments.attitudes import clock_difference  # loads the kernels

        assert inputs.recording is not None
        if late := clock_difference(inputs.recording, sensor):
            words = delay_words("w", Measured(late, 0.0))
            causes.insert(0, f"{words}: correct one of the time columns by this difference")
    causes = [*(finding.message for finding in zero_rates), *causes]
    t = inputs.observations.temperature
    if t is not None and isinstance(error, NotObserved):
        free = " ".join(error.directions).split()
        if set(temperature_coefficients(sensor)) & set(free):
            low, high = float(t.min()) - ZERO_CELSIUS, float(t.max()) - ZERO_CELSIUS
            rows = f"the rows are at {low:.2f} to {high:.2f} °C, but temperature coefficients need"
            causes.insert(0, f"{rows} rows over a wider range of temperatures")
    return "".join(f"; {cause}" for cause in causes)
