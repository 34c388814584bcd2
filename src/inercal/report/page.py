"""The page of a report: what each of its sections says, and the template that holds them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, isnan, nan
from pathlib import Path
from typing import TYPE_CHECKING

from markupsafe import Markup

from inercal.benches.report import Direction
from inercal.benches.turntable import is_turntable
from inercal.calibration.verdict import chance
from inercal.methods.observed import NOISE_ALONE
from inercal.pipeline import Outcome
from inercal.plan import Hold, Rotation, Spin, Step, Turn
from inercal.report import courses, tables
from inercal.report import tests as judged
from inercal.report.figures import correlations, departures, residuals
from inercal.report.history import history
from inercal.report.plots import drawn
from inercal.report.sphere import missing_faces, sphere
from inercal.report.templates import render
from inercal.report.traces import scatters, traces
from inercal.report.whole import by_step, by_steps, is_whole

if TYPE_CHECKING:
    from inercal.store import History


@dataclass(frozen=True)
class Section:
    """One position or turn of the table of attitudes."""

    label: str
    what: str
    off: str
    seconds: str
    samples: str


def page(
    outcome: Outcome, truth: Mapping[str, float] | None, register: "History | None" = None
) -> str:
    """Return the whole page, HTML.

    Parameters
    ----------
    outcome : Outcome
    truth : mapping of str to float or None
        Of a simulation, SI.
    register : History, optional
        Of the sensor's calibrations.
    """
    estimate, calibration = outcome.estimate, outcome.calibration
    kind = outcome.kind
    words, found = kind.words, kind.directions(outcome)
    grids, pulls = tables.bench(outcome)
    recording = outcome.recording
    chosen = calibration.sensor.coefficients
    return render(
        "page.html",
        minus=tables.minus,
        calibration=calibration,
        sensor=calibration.sensor,
        estimate=estimate,
        outcome=outcome,
        date=calibration.provenance.get("created", "").partition("T")[0],
        verdict=outcome.verdict,
        facts=facts(outcome),
        groups=tables.coefficients(outcome, truth),
        simulated=truth is not None,
        exact=NOISE_ALONE in estimate.notes,
        bench_counted=bool(pulls),
        matrix=tables.matrix(outcome),
        calibration_file=f"{Path(calibration.provenance.get('run file', 'run')).stem}"
        ".calibration.json",
        run_file=calibration.provenance.get("run file", "run.toml"),
        residuals=_residuals(outcome),
        tests=judged.tests(outcome),
        candidates=judged.candidates(outcome),
        counted=judged.counted(outcome),
        whole=is_whole(outcome),
        words=words,
        plots=[(one.text, drawn(one)) for one in kind.plots(outcome)],
        search=None if outcome.search is None else history(outcome.search),
        over_time=None if register is None else _over_time(register),
        course=_course(outcome, truth),
        spheres=(sphere(found, 1), sphere(found, -1)) if found else (),
        sections=sections(outcome, found),
        missing=missing_faces(found),
        faced=Hold in kind.steps and not estimate.groups,
        turned_too=any(axis.measures == "w" for axis in calibration.sensor.axes),
        turned=any(isinstance(step, Turn | Rotation) for step in outcome.steps),
        norms=by_norm(outcome),
        unjudged="" if estimate.dof else words.unjudged,
        chance=chance,
        placed=any(not isnan(attitude.off) for attitude in found),
        spun=any(isinstance(step, Spin) for step in outcome.steps),
        free=bool(estimate.groups),
        quiet=None
        if recording is None or outcome.rests is None
        else scatters(recording, outcome.calibration.sensor, outcome.rests),
        traces=None if recording is None else traces(outcome, recording),
        correlations=correlations(estimate) if len(chosen) > 1 else None,
        strongest=tables.strongest(estimate),
        bench=grids,
        departures=departures(pulls) if pulls else None,
        condition=f"{estimate.singular_values[0] / estimate.singular_values[-1]:.3g}",
    )


def _residuals(outcome: Outcome) -> Markup | None:
    """Return the figure of residuals; None where there are none."""
    if is_whole(outcome):
        return by_steps(by_step(outcome))
    estimate = outcome.estimate
    return residuals(outcome) if estimate.whitened.size or estimate.groups else None


def _over_time(register: "History") -> tuple[list[Markup], Markup]:
    """Return what a history says, and its figures with the table of verdicts."""
    # Here, for a history comes with what the register needs, which reports do without.
    from inercal.report.over_time import lines, section

    return lines(register), section(register)


@dataclass(frozen=True)
class Course:
    """The figures of sequential filters, SVG."""

    convergence: Markup
    smoothed: Markup | None
    innovations: Markup
    path: Markup | None


def _course(outcome: Outcome, truth: Mapping[str, float] | None) -> Course | None:
    """Return the figures of how filters came to the result; None of other estimators."""
    found, track, bench = outcome.estimate.courses, outcome.observations.track, outcome.bench
    if not found:
        return None
    path = None
    if track is not None and is_turntable(bench):
        path = courses.path(track, bench)
    return Course(
        courses.convergence(outcome, truth),
        courses.smoothed(found, outcome.calibration.sensor),
        courses.innovations(found),
        path,
    )


def by_norm(outcome: Outcome) -> bool:
    """Whether the residuals are of the norms of readings, one a row."""
    rows, axes = len(outcome.observations.labels), len(outcome.observations.channels)
    named = all(name.startswith("|f|") for name in outcome.estimate.observations)
    return axes > 1 and (named or outcome.estimate.whitened.size == rows)


def facts(outcome: Outcome) -> list[tuple[str, str]]:
    """Return the key facts, name and text of one or two lines."""
    provenance, recording = outcome.calibration.provenance, outcome.recording
    turns = sum(isinstance(step, Turn | Rotation) for step in outcome.steps)
    spins = [step for step in outcome.steps if isinstance(step, Spin)]
    holds = len(outcome.steps) - turns - len(spins)
    digest = provenance.get("recording sha256", "")
    source = provenance.get("recording", "") + (f"\nSHA-256 {digest[:12]}…" if digest else "")
    result = [("Recording", source)]
    if recording is None:
        result.append(("Data", "means, read in as a table"))
    else:
        rate = f"{recording.rate_hz:.4g} Hz"
        size = f"{recording.time.size} samples\n{recording.duration:.4g} s at {rate}"
        result.append(("Data", size))
    result.append(("Gravity", outcome.calibration.conditions.get("gravity", "")))
    used = f"{holds} position{'s' * (holds != 1)}"
    if spins:
        rates = len({round(abs(step.rate), 3) for step in spins})
        words = outcome.kind.words
        used = (
            f"{len(spins)} {words.rows}\nat {rates} rate{'s' * (rates != 1)} of the {words.turner}"
        )
    if turns:
        used += f"\n{turns} turn{'s' * (turns != 1)}"
    result.append(("Used", used))
    return [(name, text) for name, text in result if text]


def sections(outcome: Outcome, found: Sequence[Direction]) -> list[Section]:
    """Return the rows of the table of positions and turns.

    The axis of a turn has no angle here: the gyros' misalignments were found from it.
    """
    observed = outcome.observations
    off = {attitude.step.label: attitude.off for attitude in found}

    in_words = outcome.kind.row

    def what(step: Step, row: int) -> str:
        return tables.minus(in_words(step, outcome, row))

    def away(step: Step) -> str:
        angle = off.get(step.label, nan)
        return "" if isinstance(step, Turn | Rotation) or isnan(angle) else f"{degrees(angle):.2f}"

    return [
        Section(step.label, what(step, row), away(step), f"{seconds:.2f}", str(samples))
        for row, (step, seconds, samples) in enumerate(
            zip(outcome.steps, observed.duration.tolist(), observed.samples.tolist(), strict=True)
        )
    ]
