"""The step between positions: what g² shows, which estimators work, and whether 30° is best."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from inercal.arrays import Array
from inercal.benches.dividing_head.bench import Index, positions
from inercal.benches.dividing_head.passes import near
from inercal.errors import NotObserved
from inercal.methods.dual_orthogonal import square
from inercal.studies.claim import shown
from inercal.studies.dual_orthogonal.experiment import JUDGED, NOISE, ratio
from inercal.studies.dual_orthogonal.methods import FACES, tried
from inercal.studies.dual_orthogonal.observation import rank
from inercal.studies.rms import Rms, rms
from inercal.studies.section import Chart, Line, Panel, Section, Table
from inercal.studies.words import words_of

WORDS = words_of("inercal.studies.dual_orthogonal", "step")

COUNTS = (6, 7, 8, 9, 10, 12, 16, 18, 24)
WITHIN = range(9, 19)  # positions of whole turns in steps from 40° to 20°
BEST = 12
_OF_DUAL = 8  # one trial of dual for so many: at eight positions they go one by one
_SHOWN = 1.0  # µg, the most in the chart


def with_cardinals(n: int) -> tuple[Index, ...]:
    """Return n even positions and those of the four cardinal ones that are not among them."""
    steps = positions(n)
    lacking = [
        Index(f"c{k}", k * pi / 2)
        for k in range(4)
        if not near(k * pi / 2, [step.angle for step in steps])
    ]
    return tuple(sorted((*steps, *lacking), key=lambda step: step.angle))


def error(
    name: str, steps: Sequence[Index], trials: int, seed: int, noise: float = NOISE
) -> Array | None:
    """Return the errors in `JUDGED`, (trials, 9) µg; None where a method refuses."""
    try:
        found = tried(name, trials, seed, steps, noise=noise)
    except NotObserved:
        return None
    return np.concatenate([found[column].reshape(trials, -1) for column in JUDGED], axis=1)


@dataclass(frozen=True, eq=False)
class Step:
    """What a step does: errors by way, as of `error`.

    Parameters
    ----------
    n, rank : int
        Even positions, and the rank of g² there.
    dual : array or None
    each, total : mapping of str to array or None
        By way; as many readings at each position, or in all.
    """

    n: int
    rank: int
    dual: Array | None
    each: Mapping[str, Array | None]
    total: Mapping[str, Array | None]


_ADDED = "patent, cardinals added"
_WAYS = {
    "patent": ("patent", positions),
    _ADDED: ("patent", with_cardinals),
    "joint": ("joint", positions),
    FACES: (FACES, positions),
}


def steps(trials: int, seed: int) -> list[Step]:
    """Return what each step does."""
    found: list[Step] = []
    for n in COUNTS:
        each: dict[str, Array | None] = {}
        total: dict[str, Array | None] = {}
        for way, (name, plan) in _WAYS.items():
            visited = plan(n)
            each[way] = error(name, visited, trials, seed)
            # As many readings in all as BEST positions have, shared by more or fewer positions.
            shared = NOISE * sqrt(len(visited) / BEST)
            total[way] = error(name, visited, trials, seed, shared)
        told = rank(square.design(2 * pi * np.arange(n) / n))
        dual = error("dual, Bayes", positions(n), max(trials // _OF_DUAL, 20), seed)
        found.append(Step(n, told, dual, each, total))
    return found


def over_the_rest(by_count: Mapping[int, Array | None]) -> tuple[Rms, int]:
    """Return the RMS at 30° over the least at other steps, and how many positions that one has."""
    others = {n: e for n, e in by_count.items() if e is not None and n != BEST}
    n = min(others, key=lambda k: rms(others[k]).value)
    here = by_count[BEST]
    assert here is not None
    return ratio(here, others[n]), n


def best_step(by_count: Mapping[int, Array | None]) -> tuple[float, float, str]:
    """Return the step with the least RMS, °, its standard uncertainty, and the reason.

    Where another step is better than 30°, the two are as many uncertainties apart as their ratio of
    RMS is from one: the Monte Carlo error may make a step the best that is not.
    """
    over, n = over_the_rest(by_count)
    words = f"RMS at 30° over that at {360 / n:g}° is {over.value:.3f} ± {over.u:.3f} (k = 1)"
    if over.value <= 1:
        return 360 / BEST, 0.0, words
    return 360 / n, abs(360 / BEST - 360 / n) * over.u / (over.value - 1), words


def section(trials: int, seed: int) -> Section:
    """Return the section of the step."""
    found = steps(trials, seed)
    serving, helped = (
        [n for n in WITHIN if error("patent", plan(n), 20, seed) is not None]
        for plan in (positions, with_cardinals)
    )
    why = (
        f"{len(serving)} of {len(WITHIN)} even steps serve: the four points are among "
        f"{' and '.join(map(str, serving))} positions alone; with the cardinal ones added "
        f"{len(helped)} serve"
    )
    findings = [
        WORDS.judge(claim, 360 / n, 0.0, why)
        for claim, n in (("finest", max(serving)), ("coarsest", min(serving)))
    ]
    for claim in ("each", "total"):
        added = {s.n: (s.each if claim == "each" else s.total)[_ADDED] for s in found}
        at, u, words = best_step(added)
        text = f"{words}; cardinal positions are added where a step lacks them"
        findings.append(WORDS.judge(claim, at, u, text))
    finer, here = found[-1], next(s for s in found if s.n == BEST)
    full = next(s.n for s in found if s.rank == max(t.rank for t in found))
    fewest = next(s.n for s in found if s.each["patent"] is not None)
    return WORDS.section(
        findings,
        (_table(found),),
        (_chart(found),),
        full=full,
        full_step=360 / full,
        fewest=fewest,
        finer=finer.n,
        reached=_cell(finer.total[FACES]),
        here=_cell(here.total[FACES]),
    )


def _cell(e: Array | None) -> str:
    return "refused" if e is None else shown(rms(e).value, 3)


def _table(found: Sequence[Step]) -> Table:
    rows = [
        (f"{s.n}, {360 / s.n:.4g}°",
         [str(s.rank), _cell(s.dual),
          *(_cell(by[way]) for way in _WAYS for by in (s.each, s.total))])
        for s in found
    ]  # fmt: skip
    heads = [f"{way},\n{what}" for way in _WAYS for what in ("each alike", "in all alike")]
    return Table(
        "Rank of g² and RMS, µg, by the number of positions",
        "positions, step", ("rank", "dual, Bayes", *heads), rows,
    )  # fmt: skip


def _chart(found: Sequence[Step]) -> Chart:
    def lines(totals: bool) -> list[Line]:
        made: list[Line] = []
        for way in (_ADDED, "joint", FACES):
            values = [(s.total if totals else s.each)[way] for s in found]
            kept = [(k, rms(e).value) for k, e in enumerate(values) if e is not None]
            x, y = np.array([(k, value) for k, value in kept if value < _SHOWN]).T
            made.append(Line(way.removesuffix(", cardinals added"), x, y))
        return made

    names = [str(s.n) for s in found]
    return Chart(
        "step",
        "RMS by the number of positions, as many readings at each (left) or in all (right). For "
        "patent cardinal positions are added; joint without both pairs, at more than "
        f"{_SHOWN:g} µg, is left out.",
        [
            Panel("", "", "RMS, µg", lines(totals), log_y=False, names=names)
            for totals in (False, True)
        ],
    )
