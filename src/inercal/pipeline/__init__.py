"""The main path from a run file to a calibration, with drafts, plans, budgets and checks.

run file ─> recording ─> audit ─> marks ─> observations ─> method's estimator ─> calibration
"""

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from inercal.basics.process_settings import with_one_thread
from inercal.pipeline.correction import apply, load_recording
from inercal.pipeline.outcome import Outcome
from inercal.pipeline.run_arguments import drafted_run, stated_run
from inercal.pipeline.run_calibration import calibrate_run
from inercal.pipeline.run_simulation import apply_data_columns, read_out, simulate, simulate_files
from inercal.runfile import Run, read

if TYPE_CHECKING:
    from inercal.methods.ship_multi_angle.norm_equations import Generation


@with_one_thread
def calibrate(
    data: object,
    progress: "Callable[[Generation], None] | None" = None,
    *,
    method: str | Mapping[str, object] | None = None,
    sensor: Mapping[str, object] | None = None,
    bench: Mapping[str, object] | None = None,
    environment: Mapping[str, object] | None = None,
    specification: Mapping[str, object] | None = None,
    job: Mapping[str, object] | None = None,
    also: str | Sequence[str] | None = None,
    **data_keys: Any,
) -> Outcome:
    """Calibrate from a run file, or from data and sections given as arguments.

    Parameters
    ----------
    data : Run or path, or with `method`: path, Recording, DataFrame, Arrow table, mapping or array
        A run file, whose name ends in ".toml"; a recording, for which a run file is drafted as by
        `inercal init`; or, with `method`, the data, as a file or as a table with named columns. The
        columns of an array are named "1", "2", ….
    progress : callable, optional
        Function called after each generation of a search, with the number of the generation, the
        smallest sum of squares and the largest error.
    method : str or mapping
        Name of the method, or the keys of [method]. Without it, only a path is accepted, and the
        sections of a recording's run file contain the values that cannot be found from the data.
    sensor, bench, environment, specification, job : mapping
        The keys of these run-file sections. Paths of files are relative to the working folder.
    also : "auto" or sequence of str, optional
        Replaces [method] also: coefficients to estimate in addition to the method's default
        coefficients. "auto" adds the coefficients that the score tests find.
    **data_keys
        The keys of the run-file section [data], such as `rate`, `accelerometer`, `kind`. `marks`
        may be a mapping from the label of each section to its samples, (start, end).

    Raises
    ------
    InercalError
        If the run file, the recording or the marks cannot be used, if the data do not determine
        all coefficients, or if a drafted run file has open questions.
    TypeError
        If the data have an unsupported type, or if sections are given without a method.

    Examples
    --------
    >>> data = {
    ...     "position": ["x_p", "x_a", "y_p", "y_a", "z_p", "z_a"],
    ...     "acc_x": [1.002, -0.998, 0, 0, 0, 0],
    ...     "acc_y": [0, 0, 1.001, -1, 0, 0],
    ...     "acc_z": [0, 0, 0, 0, 1, -1.003],
    ... }
    >>> outcome = calibrate(
    ...     data,
    ...     method="six_position",
    ...     sensor={"accelerometer": {"unit": "g"}},
    ...     bench={"gravity": "9.81 m/s² ± 0.001 m/s²", "tilt": "0.1 °"},
    ...     kind="means",
    ...     label="position",
    ...     sd={"accelerometer": "0.2 mg"},
    ... )
    >>> outcome
    <Outcome: Calibration of sensor: six_position, ml, 12 coefficients, consistent>
    """
    sections = {
        "method": method,
        "sensor": sensor,
        "bench": bench,
        "environment": environment,
        "specification": specification,
        "job": job,
    }
    given = {name: one for name, one in sections.items() if one is not None}
    path = _path(data)
    if method is None and path is not None and path.suffix != ".toml":
        return calibrate_run(drafted_run(path, given, data_keys), progress, also)
    if method is not None and not isinstance(data, Run):
        required = {"sensor": sensor or {}, "bench": bench or {}}
        with stated_run(data, sections | required, data_keys) as run:
            return calibrate_run(run, progress, also)
    if data_keys or given:
        raise TypeError(
            "a run file already states all sections: give either only a run file, or data with "
            "method"
        )
    if path is not None:
        return calibrate_run(read(path), progress, also)
    if isinstance(data, Run):
        return calibrate_run(data, progress, also)
    raise TypeError(f"data are a {type(data).__name__}: give method, sensor and bench too")


def _path(data: object) -> Path | None:
    return Path(cast("str", data)) if isinstance(data, str | PathLike) else None


__all__ = [
    "Outcome",
    "apply",
    "apply_data_columns",
    "calibrate",
    "load_recording",
    "read_out",
    "simulate",
    "simulate_files",
]
