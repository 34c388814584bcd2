"""What a result shares with others of the same bench: the columns of `calibration.shared_errors`.

Only what a run file states is shared. What a run finds of its bench by its own data, as the clock
of a readback in a file of its own, is its own; what a prior from another calibration shares is not
carried on.
"""

from collections.abc import Mapping
from hashlib import sha256
from json import dumps

from inercal.benches import Bench
from inercal.calibration import SharedError
from inercal.estimate import Estimate
from inercal.parameters import Parameter
from inercal.runfile import Run

_GRAVITY = "g"  # the parameter of each bench


def shared_errors(
    run: Run, estimate: Estimate, expected: Mapping[str, Parameter], count: int
) -> tuple[SharedError, ...]:
    """Return the errors of the bench that last beyond a run and that an estimate counts.

    Parameters
    ----------
    run : Run
    estimate : Estimate
        Its first `count` parameters are the sensor's coefficients.
    expected : mapping of str to Parameter
        The bench's parameters that act, by full name.
    count : int
    """
    declared = {q.name: q for q in run.bench.parameters}
    found: list[SharedError] = []
    for name, q in expected.items():
        if q.scope != "run" or q.sd <= 0 or declared[q.name] != q:
            continue
        by = estimate.sensitivity(name, q.sd)
        std = _stated_deviation(run.bench, q)
        if by is not None and std > 0:
            column = by[:count] * std**2
            found.append(SharedError(name, q.unit, std, column, shared_error_digest(run, q)))
    return tuple(found)


def shared_error_digest(run: Run, q: Parameter) -> str:
    """Return what is alike where the same is stated of the same: SHA-256, in hexadecimal.

    Local gravity is of the place, and alike on all benches there; all else is of one bench, by its
    kind and its name.
    """
    bench = [] if q.name == _GRAVITY else [run.kind.name, run.bench_name]
    stated = [*bench, q.name, q.unit, q.value, _stated_deviation(run.bench, q)]
    return sha256(dumps(stated, ensure_ascii=False).encode()).hexdigest()


def _stated_deviation(bench: Bench, q: Parameter) -> float:
    """Return the deviation that is stated: a bench may count more beside gravity's own."""
    return bench.gravity.sd if q.name == _GRAVITY else q.sd
