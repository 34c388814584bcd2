"""Run the study of Xiao, Liu and Liu 2014: a ship model's accelerometer on a home-made rate table.

The paper prints conclusions and no data, and its formulas are illegible in our copy, so the study
simulates a table. Each module answers one question and builds the section of the page about it. The
text and the claims of a section are in the TOML file with the section's name.
"""

from itertools import islice

from inercal.basics.parallel import Executor, in_order
from inercal.studies.ship_model import estimators, optimiser, planar, wave_check
from inercal.studies.ship_model.simulated_rate_table import simulate
from inercal.studies.study import MessageCallback, Study, build_study

TRIALS_PER_DEVICE = 4  # number of trials in the tables
TRIALS_PER_SEARCH = 500


def run(trials: int, seed: int, say: MessageCallback, executor: Executor) -> Study:
    """Compute the study; see `inercal.studies.reproduce`."""
    devices, searches = max(trials // TRIALS_PER_DEVICE, 20), max(trials // TRIALS_PER_SEARCH, 3)
    say(f"estimators on {devices} devices")
    case = simulate(devices, seed)
    estimates = estimators.estimator_calls(case)
    calls = [*estimates, *optimiser.search_calls(case, searches, seed)]
    indices = [executor.submit(call) for call in calls]
    results = in_order(executor, indices[0])
    found = estimators.combine_estimators(case, seed, list(islice(results, len(estimates))))
    # Meanwhile the searches continue in other processes.
    for call in wave_check.wave_calls(found):
        executor.submit(call)
    say("the planar calibration")
    sections = [planar.section(found), estimators.rank_section(), estimators.damped_section(found)]
    say(f"global searches of {searches} devices")
    of_searches = list(islice(results, searches * len(optimiser.BOUNDS)))
    searched = optimiser.compare_searches(case, seed, of_searches)
    sections.append(optimiser.section(searched))
    reached = optimiser.median_of_few([one.vector_error["default"] / 1e-3 for one in searched])
    sections.append(estimators.section(found, reached, searches))
    say("the model in waves")
    sections.append(wave_check.section(found, list(results)))
    return build_study(__name__, sections, devices=devices, searches=searches, seed=seed)
