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

SOURCE = "Chinese patent CN101852817A, Harbin Institute of Technology, 2010"
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
    return Study(
        "dual-orthogonal",
        "Two orthogonal accelerometers on a dividing head",
        SOURCE,
        "Two accelerometers at right angles err in opposite ways where a dividing head errs, so "
        "that g², which they feel together, is free of it; an autocollimator makes up for what g² "
        "does not tell. What the patent claims of this is judged here by simulation.",
        (
            ("Head", "3″ rms, zero 5″, lean 20″\n40 % one turn, 30 % half a turn, 30 % white"),
            ("Autocollimator", "0.1″ each reading"),
            ("Readings", "12 positions, 0.2 µg of noise"),
            ("Accelerometers, 1σ", "K0 300 µg, k1 200 ppm, δ 100″\nK2 10 µg, K3 5 µg, Kip 20 µg"),
            ("Monte Carlo", f"{trials} trials of the methods\n{fewer // 2} to {fewer} elsewhere, "
             f"seed {seed}"),
        ),
        (accuracy.section(compared), heads, accuracy.faces(compared), steps, budget, points, seen),
    )  # fmt: skip
