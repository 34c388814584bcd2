"""The run file: a TOML text that names the sensor, the bench, the data and the method.

`read` checks it whole, units included, and gives plain objects in SI. A mistake is one line that
names the file, the key and what is possible there.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from hashlib import sha256
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from inercal.benches import Bench
from inercal.benches.kind_definition import Kind
from inercal.benches.kinds import KINDS, kind_name_for_class
from inercal.errors import InputError
from inercal.estimate import Gaussian
from inercal.keys import CoefficientName
from inercal.methods import Method, method
from inercal.methods._base import Estimator
from inercal.methods.ship_multi_angle import global_
from inercal.methods.ship_multi_angle.global_search import Generation, SearchOptions
from inercal.plan import Step, TableStep, Turn, table_steps
from inercal.recording import Finding
from inercal.runfile.filter_keys import with_filter_keys
from inercal.runfile.format_options import reader_options
from inercal.runfile.gravity import check_stated_gravity
from inercal.runfile.priors import prior_from, static_prior
from inercal.runfile.schema import MethodSection, RunSchema, schema_for_kind
from inercal.runfile.search import search_options
from inercal.runfile.section_checks import (
    require_distinct_priors,
    require_frame,
    require_used_keys,
)
from inercal.runfile.sensor_builder import build_sensor, coefficient_value
from inercal.runfile.validation_errors import describe_error, describe_unknown_kind
from inercal.section_settings import si_value
from inercal.sensors import Sensor
from inercal.small_files import parse_toml, read_small_file

if TYPE_CHECKING:
    from inercal.methods.turntable_kalman.filter_config import FilterConfig  # loads kernels

# [method] keys of the plan: key, unit like, argument of the method's plan
_PLAN = (
    ("seconds", "s", "seconds"),
    ("turn", "°", "angle"),
    ("turn_seconds", "s", "turn_seconds"),
    ("positions", "", "positions"),
    ("reverse", "", "reverse"),
    ("attitudes", "", "attitudes"),
    ("rates", "rpm", "rates"),
    ("turns", "", "turns"),
    ("path", "", "path"),
)
_DEFAULT_KIND = "hand"  # [bench] kind
_SENSE = ", or negative for a turn clockwise seen from above"


@dataclass(frozen=True, eq=False)
class Run:
    """A run file, read and checked.

    Parameters
    ----------
    path : Path
        The run file; other files are named relative to its folder.
    sha256 : str
        Of its text.
    sensor : Sensor
        With readouts, noise and the coefficients wanted; all axes, also those not calibrated.
    truth : mapping of str to float
        Coefficients for a simulation, SI.
    bench : Bench
    kind : Kind
        Of the bench.
    data : DataSection
        Of the kind of bench.
    method : Method
    estimator : str
    plan : callable
        Gives the nominal plan.
    priors : tuple of Gaussian
    rate_hz : float or None
    time_offset : bool
        Whether the gyros' delay is asked for.
    has_plan_keys : bool
        Whether [method] says something of the plan.
    search : SearchOptions or None
        What the search is told, of an estimator that searches.
    filter : FilterConfig or None
        The filters' configuration where [method.filter] states one; `method` estimates by it.
    bench_name : str
        What the laboratory calls its bench; empty where it says nothing.
    findings : tuple of Finding
        What the statements of the run file say of one another.
    reader_options : mapping of str to object
        Keys of [data] that belong to the reader of a format (`inercal.io.readers`).
    """

    path: Path
    sha256: str
    sensor: Sensor
    truth: Mapping[str, float]
    bench: Bench
    kind: Kind[Any, Any]
    data: Any
    method: Method[Any, Any]
    estimator: str
    plan: Callable[[], tuple[Step, ...]]
    priors: tuple[Gaussian, ...]
    rate_hz: float | None
    time_offset: bool = False
    has_plan_keys: bool = False
    search: SearchOptions | None = None
    filter: "FilterConfig | None" = None
    bench_name: str = ""
    findings: tuple[Finding, ...] = ()
    reader_options: Mapping[str, object] = field(default_factory=dict[str, object])

    @property
    def steps(self) -> tuple[Step, ...]:
        """The nominal plan. One by hand is only designed where it is asked for.

        Raises
        ------
        InputError
            No plan with what the run file says of it.
        """
        return self._steps

    @cached_property
    def _steps(self) -> tuple[Step, ...]:
        try:
            return self.plan()
        except InputError as error:
            raise InputError(f"{self.path}: [method] {error}") from None

    @property
    def table_steps(self) -> list[TableStep]:
        """The positions and rotations of the nominal plan: on a turntable all of its steps."""
        return table_steps(self.steps)

    def solver(self, progress: Callable[[Generation], None] | None = None) -> Estimator[Any, Any]:
        """Return the estimator, with what the run file says of its search if it is one.

        Parameters
        ----------
        progress : callable, optional
            Called after each generation of a search.
        """
        if self.search is None:
            return self.method.estimator(self.estimator)
        return partial(global_, options=self.search, progress=progress)

    def file(self, name: str) -> Path:
        """Return the path of a file named in the run file."""
        return self.path.parent / name


def read(path: str | Path, method_keys: Mapping[str, object] | None = None) -> Run:
    """Read and check a run file.

    Parameters
    ----------
    path : path
    method_keys : mapping, optional
        Keys that take the place of those in [method].

    Raises
    ------
    InputError
        No such file, not TOML, an unknown key or name, a value out of place, a wrong unit.
    """
    path = Path(path)
    raw = read_small_file(path, "run file")
    try:
        content = parse_toml(raw, "run file")
    except InputError as error:
        raise error.located(path) from None
    if method_keys and isinstance(content.get("method", {}), dict):
        content["method"] = content.get("method", {}) | dict(method_keys)
    whole, chosen = dict(content), _DEFAULT_KIND
    if isinstance(content.get("bench"), dict):
        whole["bench"] = {"kind": chosen} | content["bench"]
        chosen = whole["bench"]["kind"]
    if not isinstance(chosen, str) or chosen not in KINDS:
        raise InputError(f"{path}: {describe_unknown_kind(chosen)}")
    model = schema_for_kind(chosen)
    options: dict[str, Any] = {}
    try:
        if isinstance(content.get("data"), dict):
            whole["data"], options = reader_options(content["data"], KINDS[chosen].data)
        schema = model.model_validate(whole)
    except ValidationError as error:
        raise InputError(f"{path}: {describe_error(error, content, model)}") from None
    except InputError as error:
        raise error.located(path) from None
    try:
        run = _build_run(path, sha256(raw).hexdigest(), schema, KINDS[chosen])
        return replace(run, reader_options=options) if options else run
    except InputError as error:
        raise error.located(path) from None


def _build_run(path: Path, digest: str, schema: RunSchema, kind: Kind[Any, Any]) -> Run:
    chosen = method(schema.method.name)
    bench = kind.build(schema.bench, path.parent)
    whole = build_sensor(schema.sensor, schema.data.accelerometer, kind.sensor)
    part = chosen.prepare(whole, schema.method.coefficients, schema.method.also)
    if not isinstance(bench, chosen.bench):
        raise InputError(
            f"[bench] kind: method {chosen.name} takes {kind_name_for_class(chosen.bench)!r}, not "
            f"{kind.name!r}"
        )
    schema.data.readback(bench)  # its units are looked at before anything is read
    stated = {
        key: given for key, _, _ in _PLAN if (given := getattr(schema.method, key)) is not None
    }
    plan = kind.plan(stated, bench, path.parent, _build_plan(chosen, schema.method))
    turns = () if chosen.unknown_attitudes or Turn not in kind.steps else chosen.plan()
    require_used_keys(schema, chosen, turns)
    chosen.estimator(schema.method.estimator)
    estimator = schema.method.estimator or next(iter(chosen.estimators))
    require_frame(schema.sensor.frame, chosen, estimator)
    priors: list[Gaussian] = []
    for name, text in schema.method.prior.items():
        value = coefficient_value(part, name, text, "[method.prior]")
        if value.sd == 0:
            raise InputError(f"[method.prior] {name}: {text!r} has no uncertainty; write ± and one")
        priors.append(Gaussian((name,), np.array([value.value]), np.array([[value.sd**2]])))
    if schema.method.prior_file is not None:
        priors.append(static_prior(path.parent / schema.method.prior_file, part))
    for file, names in schema.method.prior_from.items():
        priors.append(prior_from(path.parent / file, names, part))
    require_distinct_priors(priors)
    truth = {
        name: coefficient_value(whole.with_coefficients(name), name, text, "[sensor.truth]").value
        for name, text in schema.sensor.truth.items()
    }
    # An IMU's truth may serve a method that leaves its gyros out.
    truth = {name: c for name, c in truth.items() if CoefficientName(name).axis in part.channels}
    if schema.data.time_unit != "sample":
        si_value(f"1 {schema.data.time_unit}", "s", "[data] time_unit")
    if schema.data.temperature is not None:
        si_value(f"1 {schema.data.temperature_unit}", "K", "[data] temperature_unit")
    if schema.method.time_offset and not (chosen.unknown_attitudes and part.select_axes("w").axes):
        raise InputError("[method] time_offset: it takes multi_position and a sensor with gyros")
    rate = None if schema.data.rate is None else si_value(schema.data.rate, "Hz", "[data] rate")
    if rate is not None and rate <= 0:
        raise InputError(f"[data] rate: {schema.data.rate!r} must be positive")
    chosen, config = with_filter_keys(schema, chosen, estimator, part, rate)
    return Run(
        path=path,
        sha256=digest,
        sensor=part,
        truth=truth,
        bench=bench,
        kind=kind,
        data=schema.data,
        method=chosen,
        estimator=estimator,
        plan=plan,
        priors=tuple(priors),
        rate_hz=rate,
        time_offset=schema.method.time_offset,
        has_plan_keys=bool(stated),
        search=search_options(schema.method, chosen, estimator),
        filter=config,
        bench_name=schema.bench.name,
        findings=check_stated_gravity(schema.bench),
    )


def _build_plan(chosen: Method[Any, Any], section: MethodSection) -> Callable[[], tuple[Step, ...]]:
    """Return the method's plan with what the section says of it."""
    possible = signature(chosen.plan).parameters
    options: dict[str, Any] = {}
    for key, like, option in _PLAN:
        given: str | bool | int | tuple[str, ...] | None = getattr(section, key)
        if given is None:
            continue
        if option not in possible:
            keys = ", ".join(key for key, _, option in _PLAN if option in possible)
            raise InputError(f"[method] {key}: the plan of {chosen.name} has none; it has {keys}")
        options[option] = _plan_option(given, like, f"[method] {key}")
    return partial(chosen.plan, **options)


def _plan_option(given: str | bool | int | tuple[str, ...], like: str, key: str) -> Any:
    """Return what the plan takes: a word, yes or no, a number, or quantities in SI."""
    if isinstance(given, tuple):
        return tuple(_plan_option(each, like, key) for each in given)
    if isinstance(given, bool) or (isinstance(given, str) and not like):
        return given
    value = given if isinstance(given, int) else si_value(given, like, key)
    if value == 0 or (like not in ("°", "rpm") and value < 0):
        raise InputError(f"{key}: {given!r} must be positive" + _SENSE * (like == "°"))
    return value


__all__ = ["Run", "read"]
