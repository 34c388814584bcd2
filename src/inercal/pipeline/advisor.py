"""Try each piece of advice before giving it: calibrate the run again with the changed keys.

A change is not advised if it causes an error in the run file, the plan or the data, or if χ²
decreases by far less than the cause should explain. Undetectable coefficients are advised as a set
that can be estimated together; it is tried without reading the data again. If the method follows
the samples of a recording, a trial would take as long as the calibration itself. Then only the
first coefficient is advised, because the score tests show that it alone can be estimated.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from math import ceil, floor, log10, radians

import numpy as np

from inercal.basics.errors import InercalError, InputError
from inercal.basics.keys import PRIOR_OF, CoefficientName, ErrorName
from inercal.basics.parameters import Parameter
from inercal.basics.run_file_advice import Advice, Change, with_changes
from inercal.basics.units import Measured, format_value_and_uncertainty, si_factor
from inercal.benches.key_declarations import declarations
from inercal.calibration.best_cause import (
    SuspectedCause,
    action_on,
    also,
    changes_text,
    is_estimable,
)
from inercal.estimation import Estimate
from inercal.methods import METHODS
from inercal.methods.observability import OBSERVABILITY_LIMIT
from inercal.physics.sensors import G0
from inercal.physics.sensors.coefficient_selection import select_coefficients
from inercal.pipeline.outcome import FittedRun
from inercal.pipeline.temperature_fit import fit_over_temperatures
from inercal.runfile import Run, from_sections

_ENOUGH = 0.9  # least fraction of the expected decrease of χ²
_SAME = 1.0  # values of χ² with a smaller difference count as equal
_CONFUSED = 5.0  # times the standard deviation with no other coefficient added
_SMALL = 1e-6  # an uncertainty that every key accepts, SI
_WRONG_LATITUDE = radians(30)
_HARMONIC = re.compile(r"(?:sin|cos)(\d+)")
# Keys of parameters that the bench does not declare.
_KEYS = {"g": "gravity", "earth_up": "latitude", "index": "indexing", "rate": "rate_error"}
# SI units of parameters, as units of a run file.
_UNITS = {
    "rad": "rad",
    "1": "ppm",
    "m": "m",
    "s": "s",
    "m/s²": "m/s²",
    "rad/s": "rad/s",
    "(m/s²)⁻¹": "1/(m/s²)",
}
_STATED_UNIT = re.compile(r"[\d.]\)?\s*([^\deE\s.)±][^±]*?)\s*(?:\(k.*)?$")  # of the last number


class RunAdvisor:
    """An advisor for one run, which tries its advice.

    Parameters
    ----------
    fitted : FittedRun
    row_word : str
        Word for a row of the data, used in sentences.
    fit : callable
        Function that returns the fit of a run.
    """

    def __init__(self, fitted: FittedRun, row_word: str, fit: Callable[[Run], FittedRun]) -> None:
        self._fitted = fitted
        self._run, self._estimate, self._expected = fitted.stated, fitted.estimate, fitted.expected
        self._possible = fitted.run.method.possible(fitted.run.sensor)
        self.row_word, self._fit = row_word, fit
        self._tried: dict[str, FittedRun | None] = {}
        self._refused: dict[str, str] = {}  # key that an error names, by change

    def on_cause(self, cause: SuspectedCause) -> Advice:
        """Return keys that make the model include a cause, or else an action at the bench."""
        before, best = self._estimate.score_tests.chi2, None
        least = _ENOUGH * cause.chi2 - cause.dof
        for changes in self._alternatives(cause):
            completed = self._completed(changes)
            after = self._chi2_after(completed)
            if after is None or self.explained(cause, before - after, completed) < least:
                continue
            # Fewer keys are preferred, unless more keys explain more.
            if best is None or best.chi2 is None or after < best.chi2 - _SAME:
                best = Advice(cause.name, completed, chi2=after)
            if after < cause.remaining_chi2 + _SAME:
                break
        return best or Advice(cause.name, action=self._action(cause))

    def _action(self, cause: SuspectedCause) -> str:
        """Return what to do about a cause that no change of existing keys can include."""
        for changes in self._alternatives(cause) if cause.kind == "coefficient" else ():
            key = self._refused.get(repr(completed := self._completed(changes)), "")
            section, _, name = key.removeprefix("[").partition("] ")
            if name and name not in self._run.sections.get(section, {}):
                return f"state {key}, and set in the run file: {changes_text(completed)}"
        if cause.kind == "coefficient":
            own = (one for one in METHODS.values() if one.bench is self._run.method.bench)
            able = (set(cause.components) <= set(one.possible(self._run.sensor)) for one in own)
            if not any(able):
                text = "no method for this bench estimates this coefficient"
                return f"{text}; U does not include its effect"
        return action_on(cause, self.row_word)

    def explained(self, cause: SuspectedCause, drop: float, changes: tuple[Change, ...]) -> float:
        """Return the χ² that a cause explains in the changed run, whose χ² is smaller by `drop`.

        If the noise comes from the data, it also decreases in a better fit, and the χ² of both fits
        do not have the same unit: that of the better fit may even be larger. The coefficients are
        then compared with their covariance.
        """
        estimate = self._estimate_after(changes)
        measured = np.isfinite(self._estimate.noise_dof) and cause.kind == "coefficient"
        if estimate is None or not measured:
            return drop
        return max(drop, wald_statistic(estimate, cause.components))

    def on_coefficients(self, names: Sequence[str]) -> Advice | None:
        """Return the key that makes the method estimate undetectable coefficients, if it can."""
        shown = {
            name
            for score in self._estimate.score_tests.scores
            if score.dof == len(score.components)
            for name in (score.name, *score.components)
        }
        chosen = tuple(name for name in names if name in shown)
        while chosen and (free := self._undetermined(chosen)) is not None:
            own = [set(select_coefficients(self._run.sensor.axes, (one,))) for one in chosen]
            last = max((k for k, some in enumerate(own) if some & set(free)), default=-1)
            chosen = tuple(one for one in chosen if one != chosen[last])
        if self._fitted.inputs.observations.track is not None:
            chosen = chosen[:1]
        if not chosen:
            return None
        return Advice(", ".join(chosen), self._completed((also(chosen),)))

    def on_changes(self, advice: Advice) -> Advice | None:
        """Complete the keys in the advice of a method; None if the advice cannot be followed."""
        completed = self._completed(advice.changes)
        after = self._chi2_after(completed)
        if after is None or after > self._estimate.score_tests.chi2:
            return None
        return replace(advice, changes=completed, chi2=after)

    def accepts_uncertainty(self, name: str) -> bool | None:
        """Return whether the run file can state an uncertainty of a bench parameter."""
        scores = self._estimate.score_tests.scores
        full = {ErrorName(s.name).name: s.components[0] for s in scores if s.kind == "bench"}[name]
        key, stated = bench_key(self._run.bench, name), self._run.sections.get("bench", {})
        if key not in self._run.kind.section.model_fields:
            return None
        text = self._text(key, stated.get(key), full, _SMALL, 0.0)
        return self._is_readable((Change("bench", key, text),))

    def followed(self, advice: Advice) -> FittedRun:
        """Return the fit with the changed keys in `advice`, which this advisor gave."""
        fitted = self._tried[repr(advice.changes)]
        assert fitted is not None
        return fitted

    def _is_readable(self, changes: tuple[Change, ...]) -> bool:
        with suppress(InercalError):
            changed_run(self._run, changes)
            return True
        return False

    def _undetermined(self, names: tuple[str, ...]) -> tuple[str, ...] | None:
        """Return what a run with more coefficients does not determine, if known; else None.

        Samples of a recording are not solved again.
        """
        if self._run.search is not None:
            return ()
        try:
            changed = changed_run(self._run, self._completed((also(names),)))
            run, inputs, _ = fit_over_temperatures(changed, self._fitted.inputs)
            sensor, observations = inputs.sensor_of_samples(run.sensor), inputs.observations
            run.method.require_determined(sensor, observations, run.priors)
            if observations.track is not None:
                return None
            bench = self._fitted.bench
            estimate = run.solver()(observations, sensor, bench, inputs.plan, run.priors)
        except InercalError as error:
            return error.names
        if not np.all(estimate.converged):
            return ()
        return self._confused(estimate, names) or None

    def _confused(self, estimate: Estimate, words: Sequence[str]) -> tuple[str, ...]:
        """Return the added coefficients that the data hardly tell from the other added ones."""
        added = set(select_coefficients(self._run.sensor.axes, words))
        alone = {
            name: sd
            for score in self._estimate.score_tests.scores
            for name, sd in zip(score.components, score.sd.tolist(), strict=False)
            if score.kind == "coefficient" and name in added
        }
        std = dict(zip(estimate.names, estimate.std.tolist(), strict=False))
        return tuple(name for name, sd in alone.items() if std.get(name, 0.0) > _CONFUSED * sd)

    def _chi2_after(self, changes: tuple[Change, ...]) -> float | None:
        """Return χ² of the changed run; None if the run is refused."""
        estimate = self._estimate_after(changes)
        return None if estimate is None else estimate.score_tests.chi2

    def _estimate_after(self, changes: tuple[Change, ...]) -> Estimate | None:
        """Return the estimate of the changed run; None if the run is refused.

        A global search takes minutes and is not repeated.
        """
        if self._run.search is not None:
            return None
        key = repr(changes)
        if key not in self._tried:
            try:
                self._tried[key] = self._fit(changed_run(self._run, changes))
            except InercalError as error:
                self._tried[key] = None
                self._refused[key] = getattr(error, "key", None) or ""
        fitted = self._tried[key]
        return None if fitted is None else fitted.estimate

    def _completed(self, changes: tuple[Change, ...]) -> tuple[Change, ...]:
        """Return the changes that are not in the run file yet, with the coefficients that are."""
        stated = self._run.sections.get("method", {}).get("also", ())
        stated = () if self._run.adds_coefficients else stated
        return tuple(
            replace(one, value=list(dict.fromkeys((*stated, *one.value))))
            if (one.section, one.key) == ("method", "also")
            else one
            for one in changes
            if self._run.sections.get(one.section, {}).get(one.key) != one.value
        )

    def _alternatives(self, cause: SuspectedCause) -> list[tuple[Change, ...]]:
        """Return the changes that may include a cause in the model, the shortest first."""
        if cause.changes:
            return [cause.changes]
        if is_estimable(cause, self._possible):
            words = list(dict.fromkeys(((cause.name,), cause.components)))
            plain = [(also(one),) for one in words]
            angles = {CoefficientName(name).term for name in cause.components}
            if self._run.sensor.form == "tilted" or not angles & {"delta_o", "delta_p"}:
                return plain
            tilted = Change("sensor", "form", "tilted")
            return [*plain, *((*one, tilted) for one in plain)]
        return [changes] if cause.kind == "bench" and (changes := self._of_bench(cause)) else []

    def _of_bench(self, cause: SuspectedCause) -> tuple[Change, ...]:
        """Return [bench] keys with deviations that are as large as the observed departures."""
        sizes: dict[str, tuple[str, float]] = {}
        stated = self._run.sections.get("bench", {})
        harmonics = list(stated.get("harmonics", ("1 ″", "1 ″")))
        if cause.components[0].startswith(PRIOR_OF):
            return self._of_priors(cause)
        # The data may not determine all components, but only, for example, a sum over sections. The
        # smallest sizes of k components with equal deviation then have only d directions.
        departures = np.array(cause.least_sizes or cause.sizes)
        open_ = cause.dof < len(cause.components)
        typical = float(np.sqrt(np.nansum(departures**2) / max(cause.dof, 1)))
        for full, size, unit in zip(
            cause.components, departures.tolist(), cause.units, strict=True
        ):
            if not np.isfinite(size) or unit not in _UNITS:
                return ()
            if size == 0:
                continue
            name = ErrorName(full).name
            if harmonic := _HARMONIC.fullmatch(name):
                order = int(harmonic[1])
                harmonics += ["0 ″"] * (order - len(harmonics))
                sizes["harmonics"] = (full, max(abs(size), sizes.get("harmonics", ("", 0.0))[1]))
                harmonics[order - 1] = f"{_rounded_up(sizes['harmonics'][1] / si_factor('″'))} ″"
                continue
            key = bench_key(self._run.bench, name)
            size = max(abs(size), typical) if open_ else abs(size)
            if key not in sizes or size > sizes[key][1]:
                sizes[key] = (full, size)
        if sizes.get("latitude", ("", 0.0))[1] > _WRONG_LATITUDE:
            return ()  # so wrong a value must be corrected: no deviation makes it right
        signed = dict(zip(cause.components, departures.tolist(), strict=True))
        return tuple(
            Change("bench", key, harmonics)
            if key == "harmonics"
            else Change("bench", key, self._text(key, stated.get(key), full, size, signed[full]))
            for key, (full, size) in sizes.items()
        )

    def _of_priors(self, cause: SuspectedCause) -> tuple[Change, ...]:
        """Return priors with deviations that are as large as the departures in the data."""
        sensor, means = self._run.sensor, dict[str, float]()
        for prior in self._run.priors:
            means |= dict(zip(prior.names, prior.mean.tolist(), strict=True))
        changes: list[Change] = []
        for name, size in zip(cause.components, cause.sizes, strict=True):
            full = name.removeprefix(PRIOR_OF)
            line = sensor.coefficient(full)
            text = f"{means[full] / line.si:.9g} ± {_rounded_up(abs(size) / line.si)} {line.unit}"
            changes.append(Change("method.prior", full, text))
        return tuple(changes)

    def _text(self, key: str, stated: str | None, full: str, size: float, departure: float) -> str:
        """Return a deviation, or a measured constant with ±, as text for a run file.

        If the bench treats the constant as exact, return the value that the data suggest.
        """
        parameter = self._expected.get(full)
        name = ErrorName(full).name
        like = _UNITS["rad/s" if name == "earth_up" else self._unit(full)]
        like = "°" if name == "latitude" else like
        unit_of_value, unit = self._stated_units(key, stated, like)
        deviation = f"{_rounded_up(size / si_factor(unit))} {unit}"
        value = getattr(self._run.bench, {"g": "gravity"}.get(name, name), None)
        declared = parameter is not None or name in declarations(type(self._run.bench))
        if isinstance(value, float) and not declared:
            moved = (value + departure) / si_factor(unit)
            return f"{moved:.{4 if unit == '°' else 6}g} {unit}"
        if not isinstance(value, Measured):
            return deviation
        before = stated.partition("±")[0].strip() if stated else ""
        known = value.value if parameter is None else parameter.value
        if not before or before.startswith("("):
            known, size = (x / si_factor(unit_of_value) for x in (known, size))
            digits = format_value_and_uncertainty(known, size / 100)[0]
            before = f"{float(digits):.12g} {unit_of_value}"
        return f"{before} ± {deviation}"

    def _stated_units(self, key: str, stated: object, like: str) -> tuple[str, str]:
        """Return the units of a value and its deviation, as a key, its default or example states.

        If there is no value, the units are the same.
        """
        info = self._run.kind.section.model_fields.get(key)
        for text in (stated, info.default, *(info.examples or ())) if info else (stated,):
            if isinstance(text, str) and (found := _STATED_UNIT.search(text)):
                first = _STATED_UNIT.search(text.partition("±")[0].strip()) or found
                with suppress(InputError):
                    si_factor(first[1], like)
                    si_factor(found[1], like)
                    return first[1], found[1]
        return like, like

    def _unit(self, full: str) -> str:
        scores = self._estimate.score_tests.scores
        pairs = (pair for s in scores for pair in zip(s.components, s.units, strict=True))
        return next(unit for name, unit in pairs if name == full)


def wald_statistic(estimate: Estimate, names: Sequence[str]) -> float:
    """Return xᵀC⁻¹x of coefficients x with covariance C, which is χ² if they are zero."""
    at = [estimate.names.index(name) for name in names]
    x, covariance = estimate.value[at], estimate.stated_covariance[np.ix_(at, at)]
    return float(x @ np.linalg.solve(covariance, x))


def bench_key(bench: object, name: str) -> str:
    """Return the [bench] key that states a parameter."""
    for field, one in declarations(type(bench)).items():
        names = [field] if isinstance(one.parameters, str) else one.parameters
        if name in names:
            return one.key or field
    stem = re.sub(r"(_[a-z12]|\d)$", "", name)
    return _KEYS.get(name, _KEYS.get(stem, stem))


def large_uncertainties(run: Run, expected: Mapping[str, Parameter]) -> str:
    """Name the [bench] keys with an uncertainty so large that it can hide a coefficient."""
    keys = dict.fromkeys(
        bench_key(run.bench, ErrorName(name).name)
        for name, one in expected.items()
        if one.sd > OBSERVABILITY_LIMIT * {"m/s²": G0}.get(one.unit, 1.0)
    )
    stated = [f"[bench] {key}" for key in keys if key in run.sections.get("bench", {})]
    return f"; check {', '.join(stated)}, whose stated uncertainty is very large" if stated else ""


def changed_run(run: Run, changes: tuple[Change, ...]) -> Run:
    """Return the run with changed keys; its data are only read again if a key of [data] changes.

    Raises
    ------
    InputError
        See `from_sections`.
    """
    changed = from_sections(run.path, with_changes(run.sections, changes), run.sha256)
    same = not any(one.section.startswith("data") for one in changes)
    data = run.data if same else changed.data
    return replace(changed, held_files=run.held_files, data=data)


def _rounded_up(size: float) -> str:
    """Return a positive number as text, rounded up to two digits."""
    step = 10.0 ** (floor(log10(size)) - 1)
    return f"{ceil(size / step) * step:.6g}"
