"""A run file as it was read and checked: objects in SI."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from inercal.basics.errors import InputError
from inercal.basics.small_files import is_file, read_toml, texts_of
from inercal.benches import Bench
from inercal.benches.kind_definition import Kind
from inercal.benches.qualification import NO_QUALIFICATIONS, UsedQualifications
from inercal.methods import Estimator, Method
from inercal.physics.plan import Step, TableStep, table_steps
from inercal.physics.sensors import Sensor
from inercal.recordings import Finding
from inercal.recordings.environment import Environment
from inercal.recordings.io.file_patterns import is_pattern, matching_files
from inercal.runfile.environment_section import TemperatureOrder

if TYPE_CHECKING:
    from inercal.calibration.specification import Specification
    from inercal.estimation import Gaussian
    from inercal.methods.ship_multi_angle.norm_equations import Generation, SearchOptions
    from inercal.methods.turntable_kalman.filter_config import FilterConfig  # loads kernels


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
        With readouts, noise and the coefficients to be estimated; all axes, also those that are
        not calibrated.
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
        Returns the nominal plan.
    priors : tuple of Gaussian
    rate_hz : float or None
    time_offset : bool
        Whether the gyros' delay is estimated.
    has_plan_keys : bool
        Whether [method] states a key of the plan.
    search : SearchOptions or None
        Options of the search; None for an estimator that does not search.
    filter : FilterConfig or None
        The filters' configuration where [method.filter] states one; `method` estimates by it.
    bench_name : str
        The laboratory's name of its bench; empty where none is stated.
    findings : tuple of Finding
        Results of the comparison of stated values with one another.
    reader_options : mapping of str to object
        Keys of [data] that belong to the reader of a format (`inercal.recordings.io.readers`).
    job : mapping of str to str
        Texts of [job] and of the laboratory's file, by name.
    specification : Specification or None
        Limits of coefficients.
    environment : Environment or None
        The temperatures around the bench.
    temperature_order : "auto", tuple of 3 int, or None
        Orders of bias, scale factor and misalignment in temperature.
    qualified : UsedQualifications
        The qualifications of the bench.
    check_standard : str
        State of the bench's check standard, in words; empty where none is stated.
    held_files : mapping of str to Path
        Files that hold what a call gave in memory, by the names that [data] has for them.
    sections : mapping of str to object
        The sections as the run file states them.
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
    priors: "tuple[Gaussian, ...]"
    rate_hz: float | None
    time_offset: bool = False
    has_plan_keys: bool = False
    search: "SearchOptions | None" = None
    filter: "FilterConfig | None" = None
    bench_name: str = ""
    findings: tuple[Finding, ...] = ()
    reader_options: Mapping[str, object] = field(default_factory=dict[str, object])
    job: Mapping[str, str] = field(default_factory=dict[str, str])
    specification: "Specification | None" = None
    environment: Environment | None = None
    temperature_order: TemperatureOrder = None
    qualified: UsedQualifications = NO_QUALIFICATIONS
    check_standard: str = ""
    held_files: Mapping[str, Path] = field(default_factory=dict[str, Path])
    sections: Mapping[str, Any] = field(default_factory=dict[str, Any])

    @property
    def adds_coefficients(self) -> bool:
        """Whether [method] also = "auto" adds the coefficients that the score tests ask for."""
        return self.sections.get("method", {}).get("also") == "auto"

    @property
    def steps(self) -> tuple[Step, ...]:
        """The nominal plan, designed when it is first read: a plan by hand takes seconds.

        Raises
        ------
        InputError
            The options of [method] allow no plan.
        """
        return self._steps

    @cached_property
    def _steps(self) -> tuple[Step, ...]:
        try:
            return self.plan()
        except InputError as error:
            raise error.located(f"{self.path}: [method]", file=self.path, key="[method]") from None

    @property
    def table_steps(self) -> list[TableStep]:
        """The positions and rotations of the nominal plan; on a turntable these are all steps."""
        return table_steps(self.steps)

    def solver(self, progress: "Callable[[Generation], None] | None" = None) -> Estimator[Any, Any]:
        """Return the estimator; one that searches has the options of the run file.

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

    def file(self, name: str) -> Path:
        """Return the path of a file named in the run file.

        Raises
        ------
        InputError
            The text can be no name.
        """
        if "\0" in name:
            raise InputError(
                f"{self.path}: {name!r} holds a zero character, which no name of a file can; "
                "correct the name",
                file=self.path,
            )
        return self.held_files.get(name, self.path.parent / name)

    def input_files(self) -> list[Path]:
        """Return the run file and the existing files that its keys and values name."""
        named = [self.file(text) for text in texts_of(read_toml(self.path, "run file"))]
        sections = self.file(self.data.file)
        if is_pattern(sections):
            named += matching_files(sections).values()
        return [self.path, *(path for path in named if is_file(path))]
