"""Design runs: the steps that an operator carries out, and the uncertainties to expect."""

from inercal.pipeline.design.plan_rehearsal import RehearsalResult, default_run_file, rehearse_plan

__all__ = ["RehearsalResult", "default_run_file", "rehearse_plan"]
