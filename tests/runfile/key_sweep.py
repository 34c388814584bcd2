"""Run files in which one key after another is changed, drawn from the schema: no list of keys."""

import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np
from pydantic.fields import FieldInfo

from inercal.basics.errors import InercalError, InputError
from inercal.benches.kind_definition import KINDS
from inercal.pipeline import Outcome
from inercal.pipeline.run_calibration import calibrate_run
from inercal.runfile import read
from inercal.runfile.schema import (
    EnvironmentSection,
    FilterInitialSection,
    FilterSection,
    ReadoutSection,
    SensorSection,
)

EXAMPLES = Path(__file__).parents[2] / "examples"
Content = dict[str, Any]
NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
FACTORS = (1.3, 1.0005, 30.0, 0.5, 300.0, 0.01)  # some must stay near, others are too small


@dataclass(frozen=True)
class Key:
    """A key of a run file: its section and name, and whether it is the value or its deviation."""

    section: tuple[str, ...]
    name: str
    part: str = ""

    def __str__(self) -> str:
        """Return it as a complaint names it, "[bench] radius"."""
        return f"[{'.'.join(self.section)}] {self.name}{self.part}"


def example(path: str, *changes: tuple[str, str, object]) -> Content:
    """Return an example's content with keys changed: section, name, value (None takes it out)."""
    content = tomllib.loads((EXAMPLES / path).read_text(encoding="utf-8"))
    for section, name, value in changes:
        place = content
        for part in section.split("."):
            place = place.setdefault(part, {})
        if value is None:
            place.pop(name, None)
        else:
            place[name] = value
    return content


def toml(content: Content) -> str:
    """Return a run file's text."""
    lines: list[str] = []

    def section(name: str, values: Mapping[str, Any]) -> None:
        lines.append(f"[{name}]")
        later: dict[str, Mapping[str, Any]] = {}
        for key, value in values.items():
            if isinstance(value, dict):
                later[key] = value
            else:
                lines.append(f"{json.dumps(key, ensure_ascii=False)} = {_literal(value)}")
        for key, value in later.items():
            section(f"{name}.{json.dumps(key, ensure_ascii=False)}", value)

    for name, values in content.items():
        section(name, values)
    return "\n".join(lines) + "\n"


def _literal(value: object) -> str:
    return json.dumps(value, ensure_ascii=False)


def counts(field: FieldInfo) -> bool:
    """Return whether a key is neither a description nor for planning alone, by the schema."""
    return _role(field) is None


def planning(field: FieldInfo) -> bool:
    """Return whether a key shapes plans and simulations alone, by the schema."""
    return _role(field) == "plan"


def _role(field: FieldInfo) -> object:
    extra = field.json_schema_extra
    return extra.get("role") if isinstance(extra, dict) else None


def keys(
    content: Content, kept: Callable[[FieldInfo], bool] = counts
) -> Iterator[tuple[Key, FieldInfo, Any]]:
    """Yield every key of [sensor], [bench], [environment], [method.filter], its field and value.

    Where nothing is stated it is None. Of a quantity with "±" the value and the deviation come one
    after the other.
    """
    bench = content["bench"]
    model = KINDS[bench.get("kind", "hand")].section
    sections: list[tuple[tuple[str, ...], Any, Content]] = [
        (("sensor",), SensorSection, content["sensor"]),
        (("bench",), model, bench),
    ]
    sections += [
        (("sensor", kind), ReadoutSection, content["sensor"][kind])
        for kind in ("accelerometer", "gyro", "magnetometer")
        if kind in content["sensor"]
    ]
    stated_filter = content["method"].get("filter", {})
    sections += [
        (("method", "filter"), FilterSection, stated_filter),
        (
            ("method", "filter", "initial"),
            FilterInitialSection,
            stated_filter.get("initial", {}),
        ),
    ]
    if "environment" in content:
        sections.append((("environment",), EnvironmentSection, content["environment"]))
    for section, schema, values in sections:
        for name, field in schema.model_fields.items():
            if name in ("accelerometer", "gyro", "magnetometer", "kind", "initial") or not kept(
                field
            ):
                continue
            stated = values.get(name, None if field.is_required() else field.default)
            for part in (" value", " ±") if _with_deviation(stated) else ("",):
                yield Key(section, name, part), field, stated


def _with_deviation(stated: Any) -> bool:
    first = stated[0] if isinstance(stated, (list, tuple)) and stated else stated
    return isinstance(first, str) and "±" in first


def alternatives(key: Key, field: FieldInfo, stated: Any) -> Iterator[Any]:
    """Yield other values of a key, by its type."""
    options = _words(field)
    yield from (option for option in options if option != stated)
    if options:
        return
    shown = [*(field.examples or ())]
    if stated is None or stated in ((), [], ""):
        yield from shown
        for one in shown:
            yield from (_changed(one, factor, key.part) for factor in FACTORS)
        return
    if isinstance(stated, float | int):
        yield stated + 0.01
        return
    whole = list(stated) if isinstance(stated, (list, tuple)) else stated
    for factor in FACTORS:
        if (changed := _changed(whole, factor, key.part)) != whole:
            yield changed
    if not field.is_required() and field.default is None:
        yield None  # left out
    if isinstance(stated, str) and len(stated) > 1 and stated.isalpha():
        yield stated[::-1]
    yield from (one for one in shown if one != stated)


def _words(field: FieldInfo) -> list[Any]:
    """Return the words that a key takes, yes and no included, where it takes no other."""
    if field.annotation is bool or bool in get_args(field.annotation):
        return [False, True]
    return [
        option
        for part in (field.annotation, *get_args(field.annotation))
        if get_origin(part) is Literal
        for option in get_args(part)
    ]


def _changed(stated: Any, factor: float, part: str) -> Any:
    """Return a quantity, or several, by a factor; directions stay as they are."""
    if isinstance(stated, list):
        return [_changed(one, factor, part) for one in stated]
    return _scaled(stated, factor, part) if isinstance(stated, str) else stated


def _scaled(text: str, factor: float, part: str) -> str:
    """Return a quantity whose value, or deviation, is another one."""
    value, sign, deviation = text.partition("±")

    def other(found: re.Match[str]) -> str:
        return f"{(float(found[0]) or 1.0) * factor:.9g}"

    if part == " ±":
        return f"{value}{sign}{NUMBER.sub(other, deviation, count=1)}"
    return NUMBER.sub(other, value, count=1) + sign + deviation


def with_key(content: Content, key: Key, value: Any) -> Content:
    """Return the content with one key changed."""
    made = deepcopy(content)
    place = made
    for part in key.section:
        place = place.setdefault(part, {})
    place[key.name] = value
    if value is None:
        del place[key.name]
    return made


@dataclass(frozen=True, eq=False)
class Result:
    """What a calibration says, as far as a key may change it."""

    values: np.ndarray
    covariance: np.ndarray
    frame: str
    findings: frozenset[str]

    def __eq__(self, other: object) -> bool:
        """Return whether both say the same, but for rounding."""
        if not isinstance(other, Result):
            return False
        if (self.frame, self.findings) != (other.frame, other.findings):
            return False
        sd = np.sqrt(np.diag(self.covariance))
        moved = np.abs(self.values - other.values) > 1e-6 * sd
        wider = np.abs(np.diag(self.covariance) / np.diag(other.covariance) - 1) > 1e-6
        return not (moved.any() or wider.any())


def result(outcome: Outcome) -> Result:
    """Return what a calibration says."""
    calibration = outcome.calibration
    return Result(
        calibration.values,
        calibration.covariance,
        f"{calibration.frame} {calibration.sensor.form}",
        frozenset(outcome.calibration.notes) | {finding.message for finding in outcome.findings},
    )


def calibrated(folder: Path, content: Content) -> Result | str:
    """Write a run file and return what it is calibrated to, or why its data do not go with it.

    Raises
    ------
    InputError
        The run file is refused by itself.
    """
    path = folder / "run.toml"
    path.write_text(toml(content), encoding="utf-8")
    run = read(path)
    try:
        return result(calibrate_run(run, advise=False))
    except InercalError as error:
        return str(error)


def silent_keys(folder: Path, content: Content) -> dict[str, str]:
    """Return the keys that change nothing and are not refused by name, and what was tried."""
    base = calibrated(folder, content)
    assert isinstance(base, Result), base
    silent: dict[str, str] = {}
    for key, field, stated in keys(content):
        tried: list[str] = []
        for value in alternatives(key, field, stated):
            try:
                found = calibrated(folder, with_key(content, key, value))
            except InputError as error:
                # A section may be refused as a whole, or the one that it is part of.
                sections = {key.section, key.section[:2]}
                named = (key.name, str(value), *(f"[{'.'.join(one)}]" for one in sections))
                tried.append("refused" if any(one in str(error) for one in named) else str(error))
                continue
            if found != base:
                break
            tried.append(f"{value!r}: the same")
        else:
            # One of few words may be the default; of numbers a refusal may be of the size alone.
            refused = {"refused"} & set(tried) if _words(field) else set(tried) == {"refused"}
            if not refused:
                silent[str(key)] = "; ".join(tried)
    return silent
