"""Compute the errors that calibrations share because of qualified bench parameters.

Calibrations with the same qualification share the covariance J Σ Jᵀ, where Σ is the covariance of
the bench parameters b₀ and J = ∂c/∂b₀. It is stored as the columns of J L, where Σ = L Lᵀ. Column j
is the part of parameter j that the previous parameters do not explain, so the columns are
independent.
"""

from collections.abc import Mapping

import numpy as np

from inercal.basics.parameters import Parameter, QualifiedParameters
from inercal.benches.qualification.joint_prior import joint_prior
from inercal.calibration import SharedError
from inercal.estimation import Estimate
from inercal.runfile import Run


def qualified_errors(
    run: Run, estimate: Estimate, expected: Mapping[str, Parameter], count: int
) -> tuple[SharedError, ...]:
    """Return the shared errors due to the qualified parameters.

    Parameters
    ----------
    run : Run
    estimate : Estimate
        Estimate whose first `count` parameters are the sensor's coefficients.
    expected : mapping of str to Parameter
        Bench parameters that have an effect, by full name.
    count : int
    """
    known = run.qualified.parameters
    declared = {one.name: one for one in run.bench.parameters}
    slopes = np.zeros((count, len(known.names)))
    for k in _acting(known, expected):
        name = known.names[k]
        slope = estimate.sensitivity(name, expected[name].sd)
        if slope is not None:
            slopes[:, k] = slope[:count]
    if not slopes.any():
        return ()
    # All are used, because a parameter without an effect may act through another parameter that
    # depends on it.
    root = np.linalg.cholesky(joint_prior(known)[1])
    parts = slopes @ root
    return tuple(
        SharedError(
            name,
            declared[name].unit,
            float(root[k, k]),
            parts[:, k] * root[k, k],
            known.determination[k],
            known.date[k],
        )
        for k, name in enumerate(known.names)
        if parts[:, k].any()
    )


def uncounted_notes(
    run: Run, estimate: Estimate, expected: Mapping[str, Parameter]
) -> tuple[str, ...]:
    """Return notes on qualifications that the uncertainty does not include, with reasons.

    There are two reasons: an estimator that treats the bench as exact does not use bench
    parameters, and some parameters have no effect in the steps of the run.
    """
    lines: list[str] = []
    for file, one in zip(run.qualified.files, run.qualified.each, strict=True):
        left_out = [name for name in one.names if not _is_counted(name, estimate, expected)]
        if not left_out:
            continue
        acting = any(q.name in left_out for q in expected.values())
        reason = (
            f"estimator {run.estimator} does not take it into account"
            if acting
            else "it has no effect in this run"
        )
        lines.append(
            f"Qualification {file}: the uncertainty of {', '.join(left_out)} is not included in U, "
            f"because {reason}. Its values do correct the bench."
        )
    return tuple(lines)


def _is_counted(name: str, estimate: Estimate, expected: Mapping[str, Parameter]) -> bool:
    found = [full for full, q in expected.items() if q.name == name and q.sd > 0]
    if any(estimate.sensitivity(full, expected[full].sd) is not None for full in found):
        return True
    # Parameters of a position or dwell may be eliminated together with the noise of its row.
    lasting = [full for full, q in expected.items() if q.scope == "run" and q.sd > 0]
    return any(expected[full].scope != "run" for full in found) and any(
        estimate.sensitivity(full, expected[full].sd) is not None for full in lasting
    )


def qualification_conditions(run: Run) -> dict[str, str]:
    """Describe the qualifications of a run."""
    return {
        f"qualification {file}": (
            f"{one.kind} of {one.date}"
            + (f", valid until {one.valid_until}" if one.valid_until else "")
            + (f", certificate {one.certificate}" if one.certificate else "")
        )
        for file, one in zip(run.qualified.files, run.qualified.each, strict=True)
    }


def _acting(known: QualifiedParameters, expected: Mapping[str, Parameter]) -> list[int]:
    """Return indices of qualified run parameters that have an effect and are not exact."""
    return [
        k
        for k, name in enumerate(known.names)
        if name in expected and expected[name].scope == "run" and expected[name].sd > 0
    ]
