"""The study of Xiao, Liu and Liu 2014: a ship model's accelerometer on a home-made rate table.

The paper prints conclusions and no data, and its formulas are lost in the copy at hand, so that a
simulated table has to answer. Each module takes one question: what comes out, and the section of
the page that shows it. Its words, and the claims that it judges, stand in the TOML file of the
section's name.
"""

from inercal.studies.section import Say, Study
from inercal.studies.ship_model import check, damping, estimators, optimiser, planar, rank

SOURCE = (
    "Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014, "
    "10.13873/J.1000-9787(2014)10-0021-04"
)
SHARE, SEARCHES = 4, 500  # trials for one device of the tables, and of the searches


def run(trials: int, seed: int, say: Say) -> Study:
    """Return the study; see `inercal.studies.reproduce`."""
    devices, searches = max(trials // SHARE, 20), max(trials // SEARCHES, 3)
    say(f"estimators on {devices} devices")
    found = estimators.compare(devices, seed)
    say("the planar calibration")
    sections = [planar.section(found), rank.section(), damping.section(found)]
    say(f"global searches of {searches} devices")
    searched = optimiser.compare(found.case, searches, seed)
    sections.append(optimiser.section(searched))
    reached = optimiser.few([one.off["default"] / 1e-3 for one in searched])
    sections.append(estimators.section(found, reached, searches))
    say("the model in waves")
    sections.append(check.section(found))
    return Study(
        "ship-model",
        "A ship model's accelerometer on a rate table",
        SOURCE,
        "Twelve coefficients by least squares in three level mountings; then sixteen tilted "
        "groups, of which norms alone are used, solved by damped least squares and by an optimiser "
        "whose agreement is taken for proof. What the paper concludes is judged here by "
        "simulation, where the truth is known.",
        (
            ("Table", "radius 0.25 m, level at 0, 46, 86 r/min\n10 tilted poses at 86, 6 at 46"),
            ("Mountings, 1σ", "0.2° about each axis, 0.5 mm"),
            ("Speeds, readings, 1σ", "0.05 %, 0.3 mg each mean"),
            ("Devices, 1σ", "scale 2 %, cross-axis 0.012\nbias 40 mg"),
            ("Monte Carlo", f"{devices} devices, 300 fresh poses\n"
             f"{searches} searched, seed {seed}"),
        ),
        sections,
    )  # fmt: skip
