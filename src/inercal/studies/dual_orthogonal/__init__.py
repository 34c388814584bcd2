"""Run the study of CN101852817A: two orthogonal accelerometers on a dividing head, with g².

The patent prints claims and no data, so the study simulates a bench. Each module answers one
question and builds the section of the page about it. The text and the claims of a section are in
the TOML file with the section's name.
"""

from functools import partial

from inercal.basics.parallel import Executor
from inercal.studies.dual_orthogonal import (
    cardinal_points,
    error_allocation,
    method_accuracy,
    squared_observation,
)
from inercal.studies.study import MessageCallback, Study, build_study, compute_stages

TRIAL_RATIO = 4  # trials for the table of methods per trial for each other question


def run(trials: int, seed: int, say: MessageCallback, executor: Executor) -> Study:
    """Compute the study; see `inercal.studies.reproduce`."""
    fewer = max(trials // TRIAL_RATIO, 20)
    stages = {
        f"the methods, {trials} trials each": method_accuracy.method_accuracy_calls(trials, seed),
        "heads of several sizes": method_accuracy.head_calls(fewer, seed),
        "error allocation": error_allocation.allocation_calls(fewer, seed),
        "g² and the four points": [
            partial(squared_observation.section, fewer, seed),
            partial(cardinal_points.section, trials, seed),
        ],
        "steps": squared_observation.step_calls(fewer // 2, seed),
    }
    methods, heads, items, (seen, points), steps = compute_stages(stages, say, executor)
    compared = method_accuracy.combine_methods(methods)
    return build_study(
        __name__,
        (
            method_accuracy.accuracy_section(compared),
            method_accuracy.head_section(method_accuracy.combine_heads(heads)),
            method_accuracy.faces_section(compared),
            squared_observation.step_section(steps),
            error_allocation.section(items),
            points,
            seen,
        ),
        trials=trials,
        fewest=fewer // 2,
        fewer=fewer,
        seed=seed,
    )
