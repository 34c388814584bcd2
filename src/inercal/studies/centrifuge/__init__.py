"""The study of Wang and Li 2021: accelerometers on a precision centrifuge by norm observation.

Each module takes one question: what comes out, and the section of the page that shows it. Its
words, and the claims that it judges, stand in the TOML file of the section's name.
"""

from inercal.studies.centrifuge import (
    bench,
    efficiency,
    equations,
    misalignment,
    table1,
    table2,
    taylor,
)
from inercal.studies.centrifuge.trials import SHARE, repeat
from inercal.studies.section import Say, Study
from inercal.studies.words import study_of


def run(trials: int, seed: int, say: Say) -> Study:
    """Return the study; see `inercal.studies.reproduce`."""
    say("Table 1: screening the printed outputs")
    first = table1.section()
    say(f"repeating the experiment {trials} times")
    repeated = repeat(trials, seed)
    clean = repeated.clean["paper"]
    second = table2.section(repeated)
    say("Fig. 4: misalignments")
    fourth = misalignment.section(clean)
    say("Taylor orders and equations")
    orders, printed = taylor.section(), equations.section(repeated)
    say("bounds and plans")
    bounds = efficiency.section(repeated)
    say("Table 3: lever arms, earth's rate, acceleration")
    third = bench.section(clean, repeated.bound, max(trials // SHARE, 20), seed)
    sections = (first, second, fourth, third, orders, printed, bounds)
    return study_of(__name__, sections, trials=trials, of_ml=len(repeated.error["ml"]), seed=seed)
