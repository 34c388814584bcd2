"""Read and write calibration files: versioned JSON, `*.calibration.json`.

Schema "inercal/calibration/2": `sensor` (axes with input and pendulous axes, readout),
`coefficients` (a list of name, value, std, unit; SI), `covariance` in that order, `conditions`,
`provenance`, `notes`, `frame`, `mount`, `verdict` (grade, reasons, tests, suspect), `shared` (a
list of errors of the bench that other calibrations may have too), `validity` (ranges by name),
`job` (texts by name), `conformity` (rule, result and limits from [specification]),
`bench_estimates` (a list of bench parameters as estimated from the run), and `sha256`, the hash of
the other keys. Unknown fields are omitted.
"""

import hashlib
import json
from contextlib import suppress
from dataclasses import asdict, replace
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Any, cast

import numpy as np
from pydantic_core import from_json, to_json

from inercal.basics.atomic_files import atomic_write
from inercal.basics.documents import document_text, record_object
from inercal.basics.errors import InercalError, InputError
from inercal.basics.small_files import read_small_file
from inercal.calibration import Calibration, SharedError, Validity
from inercal.calibration.file_schema import CalibrationRecord, ConformityRecord, checked_record
from inercal.calibration.shared_errors import BenchEstimate
from inercal.calibration.specification import Conformity, LimitResult, conformity_object
from inercal.calibration.verdict_object import recorded_verdict, verdict_object
from inercal.estimation.uncertainty.conformity import DecisionRule
from inercal.physics.sensors import SI_UNITS, Axis, Readout, Sensor

SCHEMA = "inercal/calibration/2"
_HASH = "sha256"  # the key of the content's hash
_NOT_JSON = "it is not JSON text; give a *.calibration.json file"
_LARGEST = 16 << 20  # bytes; 24 coefficients need about 20 kilobytes


def calibration_object(calibration: Calibration) -> dict[str, Any]:
    """Return the JSON object that the file of a calibration contains."""
    content = _content(calibration)
    return content | {_HASH: _hash(content)}


def calibration_text(calibration: Calibration) -> str:
    """Return the canonical text of `calibration_object`, in half the time."""
    content = _content(calibration)
    before, after = (
        {name: content[name] for name in content if (name < _HASH) is first}
        for first in (True, False)
    )
    head, tail = canonical_text(before)[:-1], ("," if after else "") + canonical_text(after)[1:]
    digest = hashlib.sha256(f"{head}{tail}".encode()).hexdigest()
    return f'{head},"{_HASH}":"{digest}"{tail}'


def _content(calibration: Calibration) -> dict[str, Any]:
    """Return the content of a calibration's file without its hash."""
    sensor = calibration.sensor
    units = [SI_UNITS[sensor.coefficient(name).unit] for name in sensor.coefficients]
    rows = zip(sensor.coefficients, calibration.values, calibration.std, units, strict=True)
    content: dict[str, Any] = {
        "schema": SCHEMA,
        "sensor": {
            "name": sensor.name,
            "form": sensor.form,
            "reference_temperature_K": sensor.reference_temperature,
            "axes": [
                {
                    "name": axis.name,
                    "measures": axis.measures,
                    "i": list(axis.i),
                    "p": list(axis.p),
                    "readout": asdict(axis.readout),
                }
                for axis in sensor.axes
            ],
        },
        "method": calibration.method,
        "estimator": calibration.estimator,
        "coefficients": [
            {"name": name, "value": float(value), "std": float(std), "unit": unit}
            for name, value, std, unit in rows
        ],
        "covariance": calibration.covariance.tolist(),
        "frame": calibration.frame,
        "mount": calibration.mount.tolist(),
        "conditions": dict(calibration.conditions),
        "provenance": dict(calibration.provenance),
        "notes": list(calibration.notes),
    }
    if calibration.verdict is not None:
        content["verdict"] = verdict_object(calibration.verdict)
    if calibration.shared is not None:
        content["shared"] = record_object(calibration.shared)
    if calibration.validity is not None:
        known = calibration.validity.ranges
        content["validity"] = {name: list(found) for name, found in known.items()}
    if calibration.job:
        content["job"] = dict(calibration.job)
    if calibration.bench_estimates is not None:
        content["bench_estimates"] = record_object(calibration.bench_estimates)
    if calibration.conformity is not None:
        content["conformity"] = conformity_object(calibration.conformity)
    return content


def canonical_text(content: dict[str, Any]) -> str:
    """Return the JSON text, with sorted keys and without spaces, whose hash is `sha256`."""
    return json.dumps(content, sort_keys=True, ensure_ascii=False, separators=(",", ":"))


def _hash(content: dict[str, Any]) -> str:
    return hashlib.sha256(canonical_text(content).encode()).hexdigest()


def _is_proven(text: str, stated: object) -> bool:
    """Return whether a text is canonical, apart from the hash in it, and matches the stated hash.

    A register stores canonical texts. For these, the check makes it unnecessary to format 600
    numbers again, which would take longer than the rest of the reading.
    """
    rest = text.replace(f'"sha256":"{stated}",', "", 1)
    return len(rest) < len(text) and hashlib.sha256(rest.encode()).hexdigest() == stated


def save(calibration: Calibration, path: str | Path) -> Path:
    """Write the calibration file atomically and return its path."""
    with atomic_write(Path(path)) as temporary:
        temporary.write_text(document_text(calibration_object(calibration)), encoding="utf-8")
    return Path(path)


def load(path: str | Path) -> Calibration:
    """Read a calibration file.

    Raises
    ------
    InputError
        If the file is missing, is not JSON, or has another schema, a wrong hash or invalid fields.
    """
    return parse(read_text(path), str(path))


def read_text(path: str | Path) -> str:
    """Return the text of a calibration file.

    Raises
    ------
    InputError
        If the file is missing or cannot be read.
    """
    raw = read_small_file(Path(path), "calibration file", _LARGEST)
    try:
        return raw.decode("utf-8-sig")  # editors on Windows write a byte order mark first
    except ValueError:
        raise InputError(f"{path}: not a calibration file: {_NOT_JSON}", file=path) from None


def parse(text: str, source: str) -> Calibration:
    """Parse the text of a calibration file; `source` is its path, used in messages.

    Raises
    ------
    InputError
        If the text is not JSON, or has another schema, a wrong hash or invalid fields.
    """
    content: Any
    try:
        content, proven = _parse_json(text)
    except InputError as error:
        raise InputError(f"{source}: not a calibration file: {error}", file=source) from None
    except (ValueError, RecursionError) as error:
        raise InputError(
            f"{source}: not a calibration file: {_json_problem(text, source, error)}", file=source
        ) from None
    fields = cast(dict[str, Any], content) if isinstance(content, dict) else {}
    if fields.get("schema") != SCHEMA:
        found = f"schema {fields['schema']!r}" if "schema" in fields else "it states no schema"
        raise InputError(
            f"{source}: not a calibration file that this version reads: {found}; it reads "
            f"{SCHEMA!r}",
            file=source,
            key="schema",
        )
    stated = fields.pop("sha256", None)
    try:
        proven = proven or _hash(fields) == stated
    except ValueError:  # the text contains half of a surrogate pair
        raise InputError(
            f"{source}: broken calibration file: a text is not valid Unicode; restore the file",
            file=source,
        ) from None
    if not proven:
        raise InputError(
            f"{source}: the file was changed since it was written (its SHA-256 differs); calibrate "
            "again or restore the file",
            file=source,
            key="sha256",
        )
    try:
        return _recorded(checked_record(fields), fields)
    except InercalError as error:
        raise InputError(
            f"{source}: broken calibration file: {error}; calibrate again or restore it",
            file=source,
            key=error.key,
            names=error.names,
        ) from None


def _json_problem(text: str, source: str, error: Exception) -> str:
    """Say why a text is not JSON, and what to do."""
    if not text.strip():
        return "it is empty; restore it, or calibrate again"
    if source.lower().endswith(".toml"):
        return (
            f"it is a TOML file; if it is a run file, calibrate it first (inercal calibrate "
            f"{source}), and give the *.calibration.json file that this writes"
        )
    if isinstance(error, json.JSONDecodeError) and text.lstrip().startswith("{"):
        return f"line {error.lineno}: {error.msg}; the file is cut off or damaged: restore it"
    return _NOT_JSON


def _parse_json(text: str) -> tuple[Any, bool]:
    """Parse a JSON text; return its content, and whether the hash in it proves the whole text.

    The parser of pydantic takes a quarter of the time of Python's parser, but it drops repeated
    keys. A text that is proven has none, and any other text is parsed again.

    Raises
    ------
    InputError
        If a key occurs twice, or a number is not finite.
    """
    with suppress(ValueError):  # Python's parser states the reason
        content: Any = from_json(text, allow_inf_nan=False)
        if isinstance(content, dict):
            fields = cast(dict[str, Any], content)
            if _is_proven(text, fields.get("sha256")):
                return fields, True
    return json.loads(text, object_pairs_hook=_object, parse_constant=_refuse_constant), False


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object; raise an error if a key occurs twice."""
    content = dict(pairs)
    if len(content) < len(pairs):
        names = [name for name, _ in pairs]
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"the key {twice!r} is stated more than once", key=twice)
    return content


def _refuse_constant(word: str) -> float:
    raise InputError(f"{word} is not a JSON number")


def _recorded(record: CalibrationRecord, content: dict[str, Any]) -> Calibration:
    """Return the calibration from the checked record and the content of a file."""
    coefficients, notes, shared = record.coefficients, tuple(record.notes), record.shared
    sensor = _sensor(
        to_json(content["sensor"]), tuple((one.name, one.unit) for one in coefficients)
    )
    conformity, bench_estimates = record.conformity, record.bench_estimates
    return Calibration(
        sensor,
        np.array([one.value for one in coefficients], dtype=float),
        np.array(record.covariance, dtype=float),
        record.method,
        record.estimator,
        record.conditions,
        record.provenance,
        notes,
        record.frame,
        np.array(record.mount, dtype=float),
        None if record.verdict is None else recorded_verdict(record.verdict, notes),
        None
        if shared is None
        else tuple(
            SharedError(
                covariance=np.array(one.covariance, dtype=float),
                **one.model_dump(exclude={"covariance"}),
            )
            for one in shared
        ),
        None
        if record.validity is None
        else Validity(**{name: (ends[0], ends[1]) for name, ends in record.validity.items()}),
        record.job,
        None if conformity is None else _recorded_conformity(conformity),
        None
        if bench_estimates is None
        else tuple(BenchEstimate(**vars(one)) for one in bench_estimates),
    )


def _recorded_conformity(record: ConformityRecord) -> Conformity:
    limits = tuple(
        LimitResult(
            lower=-inf if one.lower is None else one.lower,
            upper=inf if one.upper is None else one.upper,
            **one.model_dump(exclude={"lower", "upper"}),
        )
        for one in record.limits
    )
    rule = DecisionRule(record.rule, record.factor)
    return Conformity(rule, limits, record.probability, record.uncertainty)


@lru_cache(maxsize=16)  # a register may contain thousands of calibrations of one sensor
def _sensor(described: bytes, coefficients: tuple[tuple[str, str], ...]) -> Sensor:
    """Return the sensor from a file, after checking the units of its coefficients."""
    content: dict[str, Any] = json.loads(described, parse_int=float)
    axes = tuple(
        Axis(a["name"], a["measures"], tuple(a["i"]), tuple(a["p"]), Readout(**a["readout"]))
        for a in content["axes"]
    )
    names = tuple(name for name, _ in coefficients)
    sensor = Sensor(
        content["name"], axes, names, content["form"], content["reference_temperature_K"]
    )
    for name, stated in coefficients:
        unit = SI_UNITS[sensor.coefficient(name).unit]
        if stated != unit:
            raise InputError(
                f"coefficients: {name} is in {stated!r}; it must be in {unit!r}",
                key="coefficients",
                names=(name,),
            )
    return sensor


OUTDATED = "outdated"
"""Key in `Calibration.provenance`; its text states the reason."""


def marked_as_outdated(calibration: Calibration, reason: str) -> Calibration:
    """Return the calibration with a note in its provenance that says why a new one may be needed.

    Parameters
    ----------
    calibration : Calibration
    reason : str
        Reason in words. If it is empty, the calibration is returned unchanged.
    """
    if not reason:
        return calibration
    return replace(calibration, provenance={**calibration.provenance, OUTDATED: reason})
