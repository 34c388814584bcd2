"""The study of CN101852817A: two orthogonal accelerometers on a dividing head, by g² observation.

The patent prints claims and no data, so the study simulates a bench. Each module computes one
question and its section of the page; the text and the claims of a section are in the TOML file of
its name.
"""

from inercal.studies.dual_orthogonal import (
    cardinal_points,
    error_allocation,
    head_error,
    method_accuracy,
    squared_observation,
    step_angle,
)
from inercal.studies.section_texts import build_study
from inercal.studies.study_content import MessageCallback, Study

TRIAL_RATIO = 4  # trials of the table of methods per trial of each further question


def run(trials: int, seed: int, say: MessageCallback) -> Study:
    """Return the study; see `inercal.studies.reproduce`."""
    fewer = max(trials // TRIAL_RATIO, 20)
    say(f"the methods, {trials} trials each")
    compared = method_accuracy.compare_methods(trials, seed)
    say("heads of several sizes")
    heads = head_error.section(head_error.compare_heads(fewer, seed))
    say("error allocation")
    budget = error_allocation.section(fewer, seed)
    say("g² and the four points")
    seen, points = squared_observation.section(fewer, seed), cardinal_points.section(trials, seed)
    say("steps")
    steps = step_angle.section(fewer // 2, seed)
    return build_study(
        __name__,
        (
            method_accuracy.section(compared),
            heads,
            method_accuracy.faces_section(compared),
            steps,
            budget,
            points,
            seen,
        ),
        trials=trials,
        fewest=fewer // 2,
        fewer=fewer,
        seed=seed,
    )
