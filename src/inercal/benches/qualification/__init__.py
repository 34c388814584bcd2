"""Bench qualification: values of a bench's parameters from separate measurements.

`qualify` estimates the parameters with their covariance. The result is a file
(`result.save`), which a run file can name under [bench] qualification in place of typed
numbers (`bench_keys`).
"""

from inercal.benches.qualification.bench_keys import KEY, UsedQualifications
from inercal.benches.qualification.result import Qualification, QualifiedParameter

NO_QUALIFICATIONS = UsedQualifications()

__all__ = ["KEY", "NO_QUALIFICATIONS", "Qualification", "QualifiedParameter", "UsedQualifications"]
