"""Reader for run files: TOML files that state the sensor, the bench, the data and the method.

`read` checks the whole file, including the units, and returns plain objects in SI units. Every
error message is one line that names the file, the key and the possible values.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any, cast

from pydantic import ValidationError

from inercal.basics.errors import InputError, error_location
from inercal.basics.keys import CoefficientName
from inercal.basics.small_files import parse_toml, read_small_file
from inercal.benches.kind_definition import KINDS, Kind, kind_name_for_class
from inercal.benches.qualification import UsedQualifications
from inercal.methods import METHODS, method
from inercal.physics.plan import Turn
from inercal.physics.section_settings import key_error
from inercal.physics.sensors import Sensor
from inercal.runfile import method_section, section_checks
from inercal.runfile.environment_section import (
    require_free_order,
    stated_environment,
    terms_of_order,
)
from inercal.runfile.filter_keys import with_filter_keys
from inercal.runfile.job import job_texts
from inercal.runfile.run import Run, check_validity, qualified_bench, with_qualifications
from inercal.runfile.schema import RunSchema, reader_options, schema_for_kind
from inercal.runfile.sensor_builder import build_sensor, coefficient_value
from inercal.runfile.specification_section import stated_specification
from inercal.runfile.validation_errors import (
    require_possible_numbers,
    schema_error,
    unknown_kind_error,
)

_QUESTION = re.compile(r'\s*(?P<key>[\w.]+)\s*=\s*"\?"\s*(#\s*(please \w+: )?(?P<comment>.*?)\s*)?')
_DEFAULT_KIND = "hand"  # [bench] kind


def read(path: str | Path, method_keys: Mapping[str, object] | None = None) -> Run:
    """Read and check a run file.

    Parameters
    ----------
    path : path
    method_keys : mapping, optional
        Keys that override keys in [method].

    Raises
    ------
    InputError
        The file does not exist or is not TOML, a key or a name is unknown, a value is not possible,
        or a unit is wrong.
    """
    path = Path(path)
    raw = read_small_file(path, "run file")
    with error_location(path):
        content = parse_toml(raw, "run file")
    _refuse_open_questions(path, raw)
    if method_keys and isinstance(content.get("method", {}), dict):
        content["method"] = content.get("method", {}) | dict(method_keys)
    with error_location(path):
        return from_sections(path, content, sha256(raw).hexdigest())


def _refuse_open_questions(path: Path, raw: bytes) -> None:
    """Raise an error if a draft from `inercal init` still has unanswered questions."""
    lines = enumerate(raw.decode("utf-8", "replace").splitlines(), 1)
    found = [(k, match) for k, line in lines if (match := _QUESTION.fullmatch(line))]
    if not found:
        return
    where = f"line{'s' * (len(found) > 1)} {' and '.join(str(k) for k, _ in found)}"
    asked = "; ".join(f'{one["key"]} = "?": {one["comment"] or "its value"}' for _, one in found)
    raise InputError(
        f"{path} line {found[0][0]}: the draft has open questions: answer {where} ({asked})",
        file=path,
        line=found[0][0],
        key=found[0][1]["key"],
        names=tuple(one["key"] for _, one in found),
    )


def from_sections(path: Path, content: Mapping[str, Any], digest: str) -> Run:
    """Build a `Run` from the sections of a run file.

    Parameters
    ----------
    path : Path
        Path of the run file. Files named in the sections are relative to its folder.
    content : mapping
        The sections, as the TOML parser returns them.
    digest : str
        SHA-256 hash of the run file.

    Raises
    ------
    InputError
        See `read`.
    """
    require_possible_numbers(content)
    completed, kind = dict(content), _DEFAULT_KIND
    if isinstance(content.get("bench"), dict):
        completed["bench"] = {"kind": kind} | content["bench"]
        kind = completed["bench"]["kind"]
    elif "bench" not in content and _follows_rest(content):
        completed["bench"] = {"kind": kind}  # a single rest depends on no key of [bench]
    if not isinstance(kind, str) or kind not in KINDS:
        raise unknown_kind_error(kind)
    options: dict[str, Any] = {}
    if isinstance(content.get("data"), dict):
        completed["data"], options = reader_options(content["data"], KINDS[kind].data)
    completed, used = with_qualifications(completed, KINDS[kind], path.parent)
    model = schema_for_kind(kind)
    try:
        schema = model.model_validate(completed)
    except ValidationError as error:
        raise schema_error(error, content, model) from None
    run = _build_run(path, digest, schema, KINDS[kind], used)
    return replace(run, reader_options=options, sections=content)


def _follows_rest(content: Mapping[str, Any]) -> bool:
    """Return whether the method of a run file follows a single rest."""
    section = content.get("method")
    name = cast("dict[str, Any]", section).get("name") if isinstance(section, dict) else None
    return isinstance(name, str) and name in METHODS and METHODS.find(name).follows_rest


def _build_run(
    path: Path, digest: str, schema: RunSchema, kind: Kind[Any, Any], used: UsedQualifications
) -> Run:
    # Imported here because it loads the estimators.
    from inercal.runfile.priors import method_priors

    chosen = method(schema.method.name)
    bench = qualified_bench(kind.build(schema.bench, path.parent), used)
    section_checks.require_magnetometer_method(schema.sensor, chosen)
    full_sensor = build_sensor(schema.sensor, schema.data, kind.sensor)
    possible = chosen.possible(full_sensor)
    ordered = terms_of_order(schema.method.temperature_order, full_sensor, possible)
    stated_terms = method_section.stated_also(schema.method, chosen)
    require_free_order(schema.method.temperature_order, stated_terms, ordered)
    also = (*stated_terms, *ordered)
    whole = chosen.prepare(full_sensor, schema.method.coefficients, also)
    sensor, magnetometer = section_checks.split_magnetometer(whole)
    section_checks.require_no_field_priors(schema.method, magnetometer)
    if not isinstance(bench, chosen.bench):
        needed = kind_name_for_class(chosen.bench)
        raise key_error(
            "[bench] kind",
            f"method {chosen.name} needs {needed!r}, not {kind.name!r}; change [bench] kind or "
            "[method] name",
            names=(needed, kind.name),
        )
    schema.data.readback(bench)  # checks the units before any file is read
    stated = method_section.stated_plan_keys(schema.method)
    plan = kind.plan(stated, bench, path.parent, method_section.nominal_plan(chosen, schema.method))
    turns = () if chosen.unknown_attitudes or Turn not in kind.steps else chosen.plan()
    section_checks.require_used_keys(schema, chosen, turns, used.keys, path.parent)
    chosen.estimator(schema.method.estimator)
    estimator = schema.method.estimator or next(iter(chosen.estimators))
    method_section.require_frame(schema.sensor.frame, chosen, estimator)
    priors = method_priors(schema.method, path.parent, sensor)
    truth = {
        name: _true_value(full_sensor, name, text) for name, text in schema.sensor.truth.items()
    }
    # A run file may state true values for gyros even if its method does not calibrate them.
    truth = {name: c for name, c in truth.items() if CoefficientName(name).axis in whole.channels}
    section_checks.require_time_offset(schema.method, chosen, sensor)
    rate = section_checks.sampling_rate(schema.data)
    job, overdue = job_texts(schema.job, path.parent)
    check, doubts = section_checks.stated_check_standard(schema.bench, schema.job, path.parent)
    chosen, config = with_filter_keys(schema, chosen, estimator, sensor, rate)
    frame = "symmetric" if sensor.frame == "symmetric" else chosen.frame(bench)
    return Run(
        path=path,
        sha256=digest,
        sensor=sensor,
        truth=truth,
        bench=bench,
        kind=kind,
        data=schema.data,
        method=chosen,
        estimator=estimator,
        plan=plan,
        priors=priors,
        rate_hz=rate,
        time_offset=schema.method.time_offset,
        has_plan_keys=bool(stated),
        search=method_section.search_options(schema.method, chosen, estimator),
        filter=config,
        bench_name=schema.bench.name,
        findings=section_checks.assumed_units(schema.sensor)
        + section_checks.check_stated_gravity(schema.bench)
        + overdue
        + check_validity(used, schema.job)
        + doubts,
        job=job,
        specification=stated_specification(schema.specification, whole, frame, path.parent),
        environment=stated_environment(schema, sensor, chosen),
        temperature_order=schema.method.temperature_order,
        qualified=used,
        check_standard=check,
        magnetometer=magnetometer,
    )


def _true_value(sensor: Sensor, name: str, text: str | float) -> float:
    """Return the value of a coefficient in [sensor.truth], in SI units."""
    key = f"[sensor.truth] {name}"
    with error_location(key, key=key):
        extended = sensor.with_coefficients(name)
    return coefficient_value(extended, name, text, "[sensor.truth]").value


__all__ = ["Run", "from_sections", "read"]
