"""Bench qualification: values of a bench's parameters from measurements of their own.

`qualify` estimates them with their covariance; the result is a file (`qualification_file`), and
[bench] qualification of a run file takes it in place of typed numbers (`bench_keys`).
"""

from inercal.benches.qualification.bench_keys import KEY, UsedQualifications
from inercal.benches.qualification.result import Qualification, QualifiedParameter

NO_QUALIFICATIONS = UsedQualifications()

__all__ = [
    "KEY",
    "NO_QUALIFICATIONS",
    "Qualification",
    "QualifiedParameter",
    "UsedQualifications",
]
