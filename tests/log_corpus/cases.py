"""All logs of the corpus: how each is written, and the one answer that its data do not give."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np
from tests.log_corpus.file_cases import FILES, PAIRS, write_pair
from tests.log_corpus.motion import GRAVITY, GRAVITY_SD, by_hand
from tests.log_corpus.table_cases import LATITUDE, RATES, TABLES
from tests.log_corpus.text_cases import CLOCKS, DEVICES, PHONES, ROBOTS, SKETCHES, TextCase
from tests.log_corpus.text_forms import Written, write_text

Writer = Callable[[Path, int, float], Written]
"""Writes a log into a folder, from a seed and the local gravity, m/s²."""


class Case(NamedTuple):
    """A log, and what the user states about it."""

    write: Writer
    stated: Mapping[str, str] = {}
    typical: bool = False  # accept typical errors of a bench


def _text(name: str, case: TextCase, folder: Path, seed: int, gravity: float) -> Written:
    return write_text(by_hand(seed, case.motion, gravity), case.form, folder, name)


def _file(name: str, folder: Path, seed: int, gravity: float) -> Written:
    write, motion = FILES[name]
    return write(folder, by_hand(seed, motion, gravity))


TEXTS = PHONES | DEVICES | ROBOTS | SKETCHES | CLOCKS
CASES: dict[str, Case] = {
    **{
        name: Case(partial(_text, re.sub("[/,]", "", name), case), case.stated)
        for name, case in TEXTS.items()
    },
    **{name: Case(partial(write_pair, pair), pair.stated) for name, pair in PAIRS.items()},
    **{name: Case(partial(_file, name)) for name in FILES},
    # The tilts of six faces explain any scatter of their means.
    **{
        name: Case(write, {"data.sd.accelerometer": "0.2 mg"} if "six" in name else {})
        for name, write in TABLES.items()
    },
    **{
        name: Case(write, {"bench.latitude": f"{LATITUDE} °"}, typical=True)
        for name, write in RATES.items()
    },
}


def gravities(count: int) -> np.ndarray:
    """Return local gravities in m/s², evenly spread over what a draft assumes, in random order.

    All scale factors of a log share the error of gravity, so that only one independent draw for
    each log would make the root mean square of all errors far less certain than it need be.
    """
    spread = [NormalDist(GRAVITY, GRAVITY_SD).inv_cdf((k + 0.5) / count) for k in range(count)]
    return np.random.default_rng(12).permutation(spread)


__all__ = ["CASES", "Case", "Written", "gravities"]
