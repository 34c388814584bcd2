"""The path of a turntable that a run file names: one of those there are, or a file of steps."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from inercal.benches import Turntable
from inercal.benches.turntable.path_file import read_path
from inercal.benches.turntable.paths import PATHS
from inercal.errors import InputError
from inercal.plan import Step
from inercal.runfile.schema import MethodSection


def on_path(
    section: MethodSection, bench: Turntable, folder: Path, plan: Callable[[], tuple[Step, ...]]
) -> Callable[[], tuple[Step, ...]]:
    """Return the plan; of a file it is read when it is asked for.

    Parameters
    ----------
    section : MethodSection
    bench : Turntable
        Its axes name the columns of a file.
    folder : Path
        Where a file is looked for.
    plan : callable
        The plan of a path by name.

    Raises
    ------
    InputError
        A path that is neither known nor a file, or a file and `seconds`.
    """
    name = section.path
    if name is None or name in PATHS:
        if len(bench.axes) != _AXES:
            return _refused(
                f"path: {name or next(iter(PATHS))} is of three axes, this table has "
                f"{len(bench.axes)}: name a file of its steps"
            )
        return plan
    file = folder / name
    if not file.is_file():
        raise InputError(f"[method] path {name!r}: no such file; or {', '.join(PATHS)}")
    if section.seconds is not None:
        raise InputError(f"[method] seconds: {name} says how long positions last; leave it out")
    return partial(read_path, file, bench.names)


_AXES = 3  # of the paths that have a name


def _refused(words: str) -> Callable[[], tuple[Step, ...]]:
    """Return a plan that is refused where it is asked for: a calibration can do without."""

    def plan() -> tuple[Step, ...]:
        raise InputError(words)

    return plan
