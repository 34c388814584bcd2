"""Estimation: a problem in, an estimate with covariance and its null space out. No sensor words."""

from inercal.estimate.course import Course, Smoothed
from inercal.estimate.factors import Gauge, Gaussian
from inercal.estimate.least_squares import least_squares
from inercal.estimate.linear import linear
from inercal.estimate.loss import Cauchy, Huber
from inercal.estimate.nullspace import NullDirection
from inercal.estimate.problem import Problem
from inercal.estimate.result import Estimate, Group
from inercal.estimate.scores import Candidate, Score, Scored, Test, scored

__all__ = [
    "Candidate",
    "Cauchy",
    "Course",
    "Estimate",
    "Gauge",
    "Gaussian",
    "Group",
    "Huber",
    "NullDirection",
    "Problem",
    "Score",
    "Scored",
    "Smoothed",
    "Test",
    "least_squares",
    "linear",
    "scored",
]
