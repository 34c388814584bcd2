"""Estimation on plain arrays, independent of sensors: least squares, score tests, uncertainty.

The names below are loaded at their first use, because checking a run file does not need them.
"""

from typing import TYPE_CHECKING

from inercal.basics.lazy_names import lazy_names

if TYPE_CHECKING:
    from inercal.estimation.candidate_scores import score_tests
    from inercal.estimation.filter_history import FilterHistory, SmoothedStates
    from inercal.estimation.fitting import Cauchy, least_squares
    from inercal.estimation.nullspace import NullDirection
    from inercal.estimation.priors_and_gauges import Gauge, Gaussian
    from inercal.estimation.problem import Problem
    from inercal.estimation.result import Estimate, ResidualGroup
    from inercal.estimation.scores import Candidate, ModelTest, ScoreTest, ScoreTestSet
    from inercal.estimation.trial_blocks import least_squares_of_trials

_MODULES = {
    "Candidate": "scores",
    "Cauchy": "fitting",
    "Estimate": "result",
    "FilterHistory": "filter_history",
    "Gauge": "priors_and_gauges",
    "Gaussian": "priors_and_gauges",
    "ModelTest": "scores",
    "NullDirection": "nullspace",
    "Problem": "problem",
    "ResidualGroup": "result",
    "ScoreTest": "scores",
    "ScoreTestSet": "scores",
    "SmoothedStates": "filter_history",
    "least_squares": "fitting",
    "least_squares_of_trials": "trial_blocks",
    "score_tests": "candidate_scores",
}


__getattr__ = lazy_names(__name__, _MODULES)


__all__ = [
    "Candidate",
    "Cauchy",
    "Estimate",
    "FilterHistory",
    "Gauge",
    "Gaussian",
    "ModelTest",
    "NullDirection",
    "Problem",
    "ResidualGroup",
    "ScoreTest",
    "ScoreTestSet",
    "SmoothedStates",
    "least_squares",
    "least_squares_of_trials",
    "score_tests",
]
