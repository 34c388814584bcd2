"""The errors of qualified parameters of a bench, which calibrations share.

Calibrations by the same qualification share J Σ Jᵀ with J = ∂c/∂b₀. It is stored by
the columns of J L, Σ = L Lᵀ: column j is the part of parameter j that those before it do not
explain, so that the columns of different parameters are independent.
"""

from collections.abc import Mapping

import numpy as np

from inercal.calibration import SharedError
from inercal.estimate import Estimate
from inercal.parameters import Parameter, QualifiedParameters
from inercal.qualification.joint_prior import joint_prior
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
    columns = {
        k: slope[:count]
        for k in _acting(known, expected)
        if (slope := estimate.sensitivity(known.names[k], expected[known.names[k]].sd)) is not None
    }
    if not columns:
        return ()
    places = list(columns)
    root = np.linalg.cholesky(joint_prior(known)[1][np.ix_(places, places)])
    parts = np.stack(list(columns.values()), axis=-1) @ root
    return tuple(
        SharedError(
            known.names[k],
            expected[known.names[k]].unit,
            float(root[j, j]),
            parts[:, j] * root[j, j],
            known.determination[k],
            known.date[k],
        )
        for j, k in enumerate(places)
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
