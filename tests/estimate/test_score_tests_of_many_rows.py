"""Score tests of long recordings, whose rows are first rotated into few dimensions."""

import numpy as np
from numpy.testing import assert_allclose

from inercal.estimation.candidate_scores import score_tests
from inercal.estimation.scores import Candidate


def test_rotated_rows_have_the_tests_of_all_rows():
    rng = np.random.default_rng(3)
    residual, jacobian = rng.standard_normal(6000), rng.standard_normal((6000, 4))
    candidates = [
        Candidate(name, "coefficient", (name,), ("rad",), rng.standard_normal((6000, 1)))
        for name in ("a", "b", "c")
    ]
    rotated = score_tests(residual, jacobian, candidates)
    whole = score_tests(residual, jacobian, iter(candidates))  # an iterator is not rotated
    assert rotated.dof == whole.dof == 5996
    assert rotated.span == whole.span
    assert_allclose(rotated.chi2, whole.chi2, rtol=1e-12)
    for one, other in zip(rotated.scores, whole.scores, strict=True):
        assert_allclose([one.chi2, *one.size, *one.sd], [other.chi2, *other.size, *other.sd],
                        rtol=1e-9)  # fmt: skip
