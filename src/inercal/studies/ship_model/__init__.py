"""The study of Xiao, Liu and Liu 2014: a ship model's accelerometer on a home-made rate table.

The paper prints conclusions and no data, and its formulas are lost in the copy at hand, so that a
simulated table has to answer. Each module takes one question: what comes out, and the section of
the page that shows it. Its words, and the claims that it judges, stand in the TOML file of the
section's name.
"""

from inercal.studies.section_texts import build_study
from inercal.studies.ship_model import (
    damping,
    equation_rank,
    estimators,
    optimiser,
    planar,
    wave_check,
)
from inercal.studies.study_content import MessageCallback, Study

TRIALS_PER_DEVICE = 4  # of the tables
TRIALS_PER_SEARCH = 500


def run(trials: int, seed: int, say: MessageCallback) -> Study:
    """Return the study; see `inercal.studies.reproduce`."""
    devices, searches = max(trials // TRIALS_PER_DEVICE, 20), max(trials // TRIALS_PER_SEARCH, 3)
    say(f"estimators on {devices} devices")
    found = estimators.compare_estimators(devices, seed)
    say("the planar calibration")
    sections = [planar.section(found), equation_rank.section(), damping.section(found)]
    say(f"global searches of {searches} devices")
    searched = optimiser.compare_searches(found.case, searches, seed)
    sections.append(optimiser.section(searched))
    reached = optimiser.median_of_few([one.vector_error["default"] / 1e-3 for one in searched])
    sections.append(estimators.section(found, reached, searches))
    say("the model in waves")
    sections.append(wave_check.section(found))
    return build_study(__name__, sections, devices=devices, searches=searches, seed=seed)
