"""Store the contents of a checked run file as objects in SI units.

This module also replaces keys of [bench] with values from the qualification files that it names.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, date, datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from inercal.basics.small_files import is_file, read_toml, texts_of
from inercal.benches import Bench
from inercal.benches.kind_definition import KINDS, Kind
from inercal.benches.qualification import KEY, NO_QUALIFICATIONS, UsedQualifications, bench_keys
from inercal.methods import Estimator, Method
from inercal.physics.plan import TableStep, table_steps
from inercal.physics.section_settings import key_error
from inercal.recordings import Finding
from inercal.recordings.data import RunBase
from inercal.recordings.io.file_patterns import is_pattern, matching_files
from inercal.runfile.environment_section import TemperatureOrder
from inercal.runfile.job import JobSection

if TYPE_CHECKING:
    from inercal.benches.motion_control import MotionControl
    from inercal.calibration.specification import Specification
    from inercal.estimation import Gaussian
    from inercal.methods.ship_multi_angle.norm_equations import Generation, SearchOptions
    from inercal.methods.turntable_kalman.filter_config import FilterConfig


def with_qualifications(
    content: Mapping[str, Any], kind: Kind[Any, Any], folder: Path
) -> tuple[dict[str, Any], UsedQualifications]:
    """Return the sections with [bench] keys filled in from the qualifications.

    Parameters
    ----------
    content : mapping
        The sections of a run file.
    kind : Kind
        Kind of bench.
    folder : Path
        Folder of the run file.

    Raises
    ------
    InputError
        A file cannot be used for this bench, or a key is also typed in the run file.
    """
    section = content.get("bench")
    if not isinstance(section, dict) or "qualification" not in section:
        return dict(content), NO_QUALIFICATIONS
    stated = cast(dict[str, Any], section)
    used = bench_keys.read_qualifications(stated["qualification"], folder)
    completed, keys = bench_keys.with_qualified_keys(stated, kind, used)
    return {**content, "bench": completed}, replace(used, keys=keys)


def qualified_bench(bench: Bench, used: UsedQualifications) -> Bench:
    """Return the bench with the results of its qualifications.

    Raises
    ------
    InputError
        The bench has no such parameter, or its kind cannot use a qualification.
    """
    if not used.each:
        return bench
    if "qualified" not in {one.name for one in fields(bench)}:
        raise key_error(KEY, "this kind of bench cannot use a qualification; remove the key")
    result: Any = replace(cast(Any, bench), qualified=used.parameters)
    bench_keys.require_parameters(result, used)
    return result


def check_validity(used: UsedQualifications, job: JobSection | None) -> tuple[Finding, ...]:
    """Return a warning for each qualification that had expired before the measurement.

    If [job] states no date of measurement, today's date is used. An inconsistent qualification also
    causes a warning.

    Parameters
    ----------
    used : UsedQualifications
    job : JobSection or None
    """
    stated = None if job is None else job.last_day
    day = stated or datetime.now(UTC).date()
    found: list[Finding] = []
    for file, one in zip(used.files, used.each, strict=True):
        days = {p.valid_until for p in one.expired_parameters(day)}
        ends = [end for end in days if end is not None]
        if ends:
            found.append(
                Finding("warning", "qualification", _expired(file, min(ends), day, stated))
            )
        if not one.consistent:
            text = f"the qualification {file} is inconsistent with its model: {one.suspects[0]}"
            found.append(Finding("warning", "qualification", text))
    return tuple(found)


def _expired(file: str, end: date, day: date, stated: date | None) -> str:
    when = f"the measurement on {day}" if stated else f"today, {day}"
    return (
        f"the qualification {file} expired on {end}, before {when}: qualify the bench again, or "
        "state a valid qualification"
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Run(RunBase[Any]):
    """Contents of a run file after reading and checking.

    Parameters
    ----------
    sha256 : str
        SHA-256 hash of the run file.
    truth : mapping of str to float
        True values of the coefficients for a simulation, in SI units.
    kind : Kind
        Kind of bench.
    estimator : str
    priors : tuple of Gaussian
    time_offset : bool
        Whether the time delay of the gyros is estimated.
    search : SearchOptions or None
        Search options; None if the estimator does not search.
    filter : FilterConfig or None
        Filter configuration from [method.filter]; None if the section is missing. `method` already
        uses it.
    bench_name : str
        The laboratory's name for its bench; empty if none is stated.
    findings : tuple of Finding
        Findings from the comparison of stated values with one another.
    job : mapping of str to str
        Texts from [job] and from the laboratory file, by name.
    specification : Specification or None
        Limits for the coefficients.
    temperature_order : "auto", tuple of 3 int, or None
        Polynomial orders of bias, scale factor and misalignment in temperature.
    qualified : UsedQualifications
        Qualifications of the bench.
    check_standard : str
        State of the bench's check standard, in words; empty if none is stated.
    sections : mapping of str to object
        Sections of the run file as written.
    """

    bench: Bench
    method: Method[Any, Any]
    sha256: str
    truth: Mapping[str, float]
    kind: Kind[Any, Any]
    estimator: str
    priors: "tuple[Gaussian, ...]"
    time_offset: bool = False
    search: "SearchOptions | None" = None
    filter: "FilterConfig | None" = None
    bench_name: str = ""
    findings: tuple[Finding, ...] = ()
    job: Mapping[str, str] = field(default_factory=dict[str, str])
    specification: "Specification | None" = None
    temperature_order: TemperatureOrder = None
    qualified: UsedQualifications = NO_QUALIFICATIONS
    check_standard: str = ""
    sections: Mapping[str, Any] = field(default_factory=dict[str, Any])

    def for_sensor(self, sections: Mapping[str, Any], sha256: str) -> "Run":
        """Return the run of another sensor; only its name and its recording differ."""
        name, magnetic = sections["sensor"]["name"], self.magnetometer
        return replace(
            self,
            sections=sections,
            sha256=sha256,
            sensor=replace(self.sensor, name=name),
            magnetometer=None if magnetic is None else replace(magnetic, name=name),
            data=self.data.model_copy(update={"file": sections["data"]["file"]}),
        )

    @property
    def adds_coefficients(self) -> bool:
        """Return whether coefficients are added by score tests ([method] also = "auto")."""
        return self.sections.get("method", {}).get("also") == "auto"

    @property
    def table_steps(self) -> list[TableStep]:
        """Return the steps of a turntable's nominal plan, which are positions and rotations."""
        return table_steps(self.steps)

    @property
    def motion_control(self) -> "MotionControl":
        """Return the functions with which a host controls the bench.

        Raises
        ------
        InputError
            The bench cannot be controlled by a host.
        """
        if self.kind.motion_control is None:
            able = " or ".join(
                f'"{name}"' for name, kind in KINDS.items() if kind.motion_control is not None
            )
            raise key_error("[bench] kind", f"must be {able} here", self.path)
        return self.kind.motion_control

    def solver(self, progress: "Callable[[Generation], None] | None" = None) -> Estimator[Any, Any]:
        """Return the estimator, with the search options of the run file if it searches.

        Parameters
        ----------
        progress : callable, optional
            Called after each generation of a search.
        """
        if self.method.follows_rest and self.environment is not None:
            follow: Any = self.method.estimator(self.estimator)
            return cast(Any, partial(follow, environment=self.environment))
        solve: Any = self.method.estimator(self.estimator)
        if self.search is not None:
            from inercal.methods.ship_multi_angle import global_

            solve = partial(global_, options=self.search, progress=progress)
        if not self.qualified.each:
            return solve
        from inercal.benches.qualification.joint_prior import JointPriorEstimator

        return JointPriorEstimator(solve)

    def input_files(self) -> list[Path]:
        """Return the run file and all existing files that it names."""
        named = [self.file(text) for text in texts_of(read_toml(self.path, "run file"))]
        sections = self.file(self.data.file)
        if is_pattern(sections):
            named += matching_files(sections).values()
        return [self.path, *(path for path in named if is_file(path))]
