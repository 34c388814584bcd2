"""The study of CN101852817A: two orthogonal accelerometers on a dividing head, by g² observation.

The patent prints claims and no data, so that a simulated bench has to answer. Each module takes
one question: what comes out, and the section of the page that shows it. Its words, and the claims
that it judges, stand in the TOML file of the section's name.
"""

from inercal.studies.dual_orthogonal import (
    accuracy,
    allocation,
    four_points,
    head,
    observation,
    step,
)
from inercal.studies.section import Say, Study
from inercal.studies.words import study_of

SHARE = 4  # one trial of each further question for so many of the table of methods


def run(trials: int, seed: int, say: Say) -> Study:
    """Return the study; see `inercal.studies.reproduce`."""
    fewer = max(trials // SHARE, 20)
    say(f"the methods, {trials} trials each")
    compared = accuracy.compare(trials, seed)
    say("heads of several sizes")
    heads = head.section(head.compare(fewer, seed))
    say("error allocation")
    budget = allocation.section(fewer, seed)
    say("g² and the four points")
    seen, points = observation.section(fewer, seed), four_points.section(trials, seed)
    say("steps")
    steps = step.section(fewer // 2, seed)
    return study_of(
        __name__,
        (accuracy.section(compared), heads, accuracy.faces(compared), steps, budget, points, seen),
        trials=trials,
        fewest=fewer // 2,
        fewer=fewer,
        seed=seed,
    )
