"""Run the study of Wang and Li 2021: accelerometers on a precision centrifuge by norm observation.

Each module answers one question and builds the section of the page about it. The text and the
claims of a section are in the TOML file with the section's name.
"""

from inercal.basics.parallel import Executor
from inercal.studies.centrifuge import (
    bench_effects,
    efficiency,
    equations,
    misalignment,
    printed_tables,
)
from inercal.studies.centrifuge.simulated_centrifuge import ML_TRIAL_RATIO, repeat_experiment
from inercal.studies.study import MessageCallback, Study, build_study


def run(trials: int, seed: int, say: MessageCallback, executor: Executor) -> Study:
    """Return the study; see `inercal.studies.reproduce`.

    The study is not divided into tasks, because it takes only 2 s, hardly longer than starting
    other processes.
    """
    say("Table 1: screening the printed outputs")
    first = printed_tables.outputs_section()
    say(f"repeating the experiment {trials} times")
    repeated = repeat_experiment(trials, seed)
    clean = repeated.noise_free["paper"]
    second = printed_tables.estimates_section(repeated)
    say("Fig. 4: misalignments")
    fourth = misalignment.section(clean)
    say("Taylor orders and equations")
    orders, printed = equations.taylor_section(), equations.equations_section(repeated)
    say("bounds and plans")
    bounds = efficiency.section(repeated)
    say("Table 3: lever arms, earth's rate, acceleration")
    third = bench_effects.section(clean, repeated.bound, max(trials // ML_TRIAL_RATIO, 20), seed)
    sections = (first, second, fourth, third, orders, printed, bounds)
    return build_study(
        __name__, sections, trials=trials, of_ml=len(repeated.error["ml"]), seed=seed
    )
