"""The errors of qualified parameters of a bench, which calibrations share.

Calibrations by the same qualification share J Σ Jᵀ with J = ∂c/∂b₀. It is stored by
the columns of J L, Σ = L Lᵀ: column j is the part of parameter j that those before it do not
explain, so that the columns of different parameters are independent.
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
    """Return the shared errors of the qualified parameters.

    Parameters
    ----------
    run : Run
    estimate : Estimate
        Its first `count` parameters are the sensor's coefficients.
    expected : mapping of str to Parameter
        The bench's parameters that act, by full name.
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
    # Of all of them: one that does not act itself may act through one that builds on it.
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
    """Return which qualifications do not enter the uncertainty, and why.

    An estimator that takes the bench as exact has neither a sensitivity to a parameter of the bench
    nor the parameter among its unknowns. Other parameters do not act in these steps.
    """
    lines: list[str] = []
    for file, one in zip(run.qualified.files, run.qualified.each, strict=True):
        left_out = [name for name in one.names if not _is_counted(name, estimate, expected)]
        if not left_out:
            continue
        acting = any(q.name in left_out for q in expected.values())
        reason = (
            f"estimator {run.estimator} does not count it"
            if acting
            else "it does not act in this run"
        )
        lines.append(
            f"Qualification {file}: the uncertainty of {', '.join(left_out)} is not in U, because "
            f"{reason}. Its values do correct the bench."
        )
    return tuple(lines)


def _is_counted(name: str, estimate: Estimate, expected: Mapping[str, Parameter]) -> bool:
    found = [full for full, q in expected.items() if q.name == name and q.sd > 0]
    if any(estimate.sensitivity(full, expected[full].sd) is not None for full in found):
        return True
    # Those of each position or dwell may be eliminated with the noise of its row.
    lasting = [full for full, q in expected.items() if q.scope == "run" and q.sd > 0]
    return any(expected[full].scope != "run" for full in found) and any(
        estimate.sensitivity(full, expected[full].sd) is not None for full in lasting
    )


def qualification_conditions(run: Run) -> dict[str, str]:
    """Return the qualifications of a run, for people."""
    return {
        f"qualification {file}": (
            f"{one.kind} of {one.date}"
            + (f", valid until {one.valid_until}" if one.valid_until else "")
            + (f", certificate {one.certificate}" if one.certificate else "")
        )
        for file, one in zip(run.qualified.files, run.qualified.each, strict=True)
    }


def _acting(known: QualifiedParameters, expected: Mapping[str, Parameter]) -> list[int]:
    """Return the places of the qualified parameters of the run that act and are not exact."""
    return [
        k
        for k, name in enumerate(known.names)
        if name in expected and expected[name].scope == "run" and expected[name].sd > 0
    ]
