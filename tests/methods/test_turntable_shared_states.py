"""Two filters with one error of the table: their scores together are those of all innovations."""

import numpy as np

from inercal.methods.turntable_kalman import filter_tests


def test_sums_of_two_filters_are_those_of_the_covariance_of_all_innovations():
    rng = np.random.default_rng(5)
    one, two, shared = rng.normal(size=(30, 4)), rng.normal(size=(20, 4)), [1, 3]
    one, two = 0.1 * one, 0.1 * two
    prior = np.array([[2.0, 0.5], [0.5, 1.0]])
    first, second = rng.normal(size=30), rng.normal(size=20)
    across = one[:, shared] @ prior @ two[:, shared].T
    whole = np.block([[np.eye(30), across], [across.T, np.eye(20)]])
    columns = np.concatenate([one, two])
    sums = [(a.T @ a, a.T @ z) for a, z in ((one, first), (two, second))]
    gram, product = filter_tests._joint_sums(sums, shared, prior)
    assert np.allclose(gram, columns.T @ np.linalg.solve(whole, columns))
    assert np.allclose(product, columns.T @ np.linalg.solve(whole, np.concatenate([first, second])))
    alone = filter_tests._joint_sums(sums[:1], shared, prior)
    assert np.array_equal(alone[0], sums[0][0])
    assert np.array_equal(alone[1], sums[0][1])
