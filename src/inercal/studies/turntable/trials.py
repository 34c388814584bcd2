"""All devices through all filters: what each made of them, by the name of the run."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from inercal.benches.turntable.paths import discrete, fast, paper
from inercal.methods.turntable import model
from inercal.studies.section import Say
from inercal.studies.turntable.experiment import DEG_MIN, LATE, TABLE, Case, sensor, simulate
from inercal.studies.turntable.filters import (
    ACCELEROMETERS,
    GYROS,
    TURNING,
    Found,
    by_steps,
    filter_of,
    follow,
    gyros,
    open_loop,
)

LATE_TABLE = replace(TABLE, latency=replace(TABLE.latency, value=LATE))
BY_STEPS = "discrete, 19 min"
BOTH_WAYS = "±1080° at 30 °/s, full, own path"
REST = "72 s of rest alone"
OPEN = "15 states, nothing fed back"
FELT_OWN = "10 °/h/g unmodelled, 15 states, own path"
FELT = "10 °/h/g unmodelled, full, whole recording"
FELT_STATES = "10 °/h/g, with nine more states"
LATE_15, LATE_19 = "20 ms late, 15 states, own path", "20 ms late, 19 states, own path"
_SENSITIVE = sensor("g")


@dataclass(eq=False)
class Trials:
    """What the filters made of the same devices; of the two kinds by the name of the run."""

    gyros: dict[str, list[Found]] = field(default_factory=dict[str, list[Found]])
    accelerometers: dict[str, list[Found]] = field(default_factory=dict[str, list[Found]])
    decided: list[int] = field(default_factory=list[int])  # with attitudes at the ends of turns

    def add(self, kind: str, name: str, found: Found) -> None:
        """Append what one run found."""
        kept = self.gyros if kind == "g" else self.accelerometers
        kept.setdefault(name, []).append(found)


def run(devices: int, seed: int, say: Say) -> Trials:
    """Return so many devices through all filters."""
    made = Trials()
    parts: Sequence[Callable[[int, Trials], None]] = (_paper, _fast, _late, _discrete)
    for k in range(devices):
        say(f"device {k + 1} of {devices}")
        for one in parts:
            one(seed * 1_000_003 + k, made)
    return made


def _paper(seed: int, made: Trials) -> None:
    case = simulate(paper(), seed)
    for name, of_gyros in GYROS.items():
        made.add("g", name, of_gyros(case))
    for name, of_accelerometers in ACCELEROMETERS.items():
        made.add("a", name, of_accelerometers(case))
    made.add("g", OPEN, open_loop(case))
    made.add("g", REST, gyros("drift", "rest")(case))
    made.decided.append(at_ends(case))
    felt = case.sensitive(seed)
    made.add("g", FELT_OWN, gyros("paper", TURNING)(felt))
    made.add("g", FELT, gyros("full")(felt))
    made.add("g", FELT_STATES, gyros("full", sensor=_SENSITIVE)(felt))


def _fast(seed: int, made: Trials) -> None:
    case = simulate(fast(), seed)
    made.add("g", BOTH_WAYS, gyros("full", TURNING)(case))


def _late(seed: int, made: Trials) -> None:
    case = simulate(paper(), seed, LATE_TABLE)
    made.add("g", LATE_15, gyros("paper", TURNING)(case))
    made.add("g", LATE_19, gyros("drift", TURNING)(case))


def _discrete(seed: int, made: Trials) -> None:
    for kind, found in by_steps(simulate(discrete(), seed)).items():
        made.add(kind, BY_STEPS, found)


def at_ends(case: Case) -> int:
    """Return how many of 12 coefficients attitudes at the ends of turns decide."""
    filter_ = filter_of(case, "drift")
    ends = follow(replace(filter_, turning=False), case, case.first(TURNING))
    return 12 - len(model.undecided(filter_.part, ends.covariance))


def reached(found: Sequence[Found], biases: Sequence[int], bound: float) -> float:
    """Return the share of devices with all biases within a bound, °/min."""
    worst = np.array([np.abs(one.off[list(biases)]).max() for one in found]) / DEG_MIN
    return float(np.mean(worst <= bound))
