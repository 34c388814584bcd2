"""Worksheets: the uncertainties that a plan will give, and what its operator does."""

from inercal.pipeline.design.plan_rehearsal import RehearsalResult, default_run_file, rehearse_plan

__all__ = ["RehearsalResult", "default_run_file", "rehearse_plan"]
