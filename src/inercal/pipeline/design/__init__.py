"""Worksheets: the expected uncertainties of a plan, and the steps for the operator."""

from inercal.pipeline.design.plan_rehearsal import RehearsalResult, default_run_file, rehearse_plan

__all__ = ["RehearsalResult", "default_run_file", "rehearse_plan"]
