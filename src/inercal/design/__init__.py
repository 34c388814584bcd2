"""What a plan will give before anything is moved, and what its operator does."""

from inercal.design.plan_rehearsal import RehearsalResult, default_run_file, rehearse_plan

__all__ = ["RehearsalResult", "default_run_file", "rehearse_plan"]
