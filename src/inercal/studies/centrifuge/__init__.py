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

SOURCE = (
    "Wang Shiming, Li Mengzhen, Navigation Positioning and Timing 8(6), 2021, "
    "doi 10.19306/j.cnki.2095-8110.2021.06.019"
)


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
    return Study(
        "centrifuge",
        "Accelerometers on a centrifuge, by norm observation",
        SOURCE,
        "Twenty positions on the arm of a precision centrifuge at three rates give sixty readings "
        "of three accelerometers; their norm alone is to give nine coefficients. What is printed "
        "of it, formulas, numbers and claims, is recomputed here and judged from the numbers.",
        (
            ("Experiment", "R = 1 m, g = 9.8 m/s²\nω = 2π, 4π, 6π rad/s\n4.0, 16.1, 36.3 g"),
            ("Noise", "10⁻⁵ V in each reading"),
            (
                "Monte Carlo",
                f"{trials} trials of closed formulas\n{len(repeated.error['ml'])} of ml, "
                f"seed {seed}",
            ),
        ),
        sections,
    )
