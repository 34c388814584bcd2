"""Estimation on plain arrays, independent of sensors: least squares, score tests, uncertainty.

The names below are only loaded when they are first used, because a check of a run file does not
need them.
"""

from typing import TYPE_CHECKING

from inercal.basics.lazy_names import lazy_names

if TYPE_CHECKING:
    from inercal.estimation.candidate_scores import score_tests
    from inercal.estimation.fitting import Cauchy, least_squares
    from inercal.estimation.innovations import FilterHistory, SmoothedStates
    from inercal.estimation.nullspace import NullDirection
    from inercal.estimation.problem import Gauge, Gaussian, Problem
    from inercal.estimation.result import Estimate, ResidualGroup
    from inercal.estimation.scores import Candidate, ModelTest, ScoreTest, ScoreTestSet
    from inercal.estimation.trial_blocks import least_squares_of_trials

_NAMES = {
    "candidate_scores": ("score_tests",),
    "fitting": ("Cauchy", "least_squares"),
    "innovations": ("FilterHistory", "SmoothedStates"),
    "nullspace": ("NullDirection",),
    "problem": ("Gauge", "Gaussian", "Problem"),
    "result": ("Estimate", "ResidualGroup"),
    "scores": ("Candidate", "ModelTest", "ScoreTest", "ScoreTestSet"),
    "trial_blocks": ("least_squares_of_trials",),
}


__getattr__ = lazy_names(__name__, {one: module for module, of in _NAMES.items() for one in of})


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
