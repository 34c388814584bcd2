"""Estimation: a problem in, an estimate with covariance and its null space out. No sensor words."""

from inercal.estimate.candidate_scores import score_tests
from inercal.estimate.filter_history import FilterHistory, SmoothedStates
from inercal.estimate.least_squares import Cauchy, least_squares
from inercal.estimate.nullspace import NullDirection
from inercal.estimate.priors_and_gauges import Gauge, Gaussian
from inercal.estimate.problem import Problem
from inercal.estimate.result import Estimate, ResidualGroup
from inercal.estimate.scores import Candidate, ModelTest, ScoreTest, ScoreTestSet
from inercal.estimate.trial_blocks import least_squares_of_trials

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
