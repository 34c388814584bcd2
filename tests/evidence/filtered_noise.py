"""Noise of sensors with a low-pass filter of their own: what is found, counted.

Recordings of tests/noise/filtered_generator.py, which knows nothing of inercal: gyros of 0.3 °/√h,
30 min. Rows "B, K" have 10 °/h, 1 °/h/√s and steps of 0.0076 °/s, too.

`python -m tests.evidence.filtered_noise` works out all of it and writes
docs/evidence/filtered-noise.json and the page beside it; `--runs` with another number prints it
only.
"""

from dataclasses import replace
from typing import Any

import numpy as np
from tests.evidence.stored_counts import FOLDER
from tests.evidence.stored_runs import store_runs
from tests.noise.filtered_generator import DEG_H, FilteredTruth, readings

import inercal
from inercal.noise.channel_noise import ChannelNoise
from inercal.recordings import Recording

RUNS = 40
DATA, PAGE = FOLDER / "filtered-noise.json", FOLDER / "filtered-noise.md"
_FILTERS = {
    "none": FilteredTruth(),
    "5 Hz, one pole": FilteredTruth("pole", 5),
    "10 Hz, one pole": FilteredTruth("pole", 10),
    "20 Hz, one pole": FilteredTruth("pole", 20),
    "20 Hz, one pole, digital": FilteredTruth("pole, digital", 20),
    "42 Hz, one pole": FilteredTruth("pole", 42),
    "average of 2": FilteredTruth("average", 2),
    "average of 4": FilteredTruth("average", 4),
    "20 Hz, Butterworth, 200 Hz": FilteredTruth("Butterworth", 20, 200.0),
}
_LOADED = {"flicker": 10.0, "walk": 1.0, "step": 0.0076}
ROWS = _FILTERS | {f"{name}; B, K": replace(one, **_LOADED) for name, one in _FILTERS.items()}
RIGHT = {"pole": "one pole", "pole, digital": "one pole, digital",
         "Butterworth": "Butterworth, digital"}  # fmt: skip
OTHERS = {
    "N": FilteredTruth(),
    "N, B": FilteredTruth(flicker=10.0),
    "N, K": FilteredTruth(walk=1.0),
    "N and Q": FilteredTruth(increments=3e-4),
    "N, B and Q": FilteredTruth(flicker=10.0, increments=3e-4),
    "G of 4 times N², T 0.1 s": FilteredTruth(markov=4.0, markov_time=0.1),
    "G of 4 times N², T 1 s": FilteredTruth(markov=4.0, markov_time=1.0),
    "G of 4 times N², T 30 s": FilteredTruth(markov=4.0, markov_time=30.0),
}
"""Unfiltered sensors."""
HARD = {
    "Chebyshev of order 4, 20 Hz": FilteredTruth("Chebyshev", 20),
    "Chebyshev of order 4, 20 Hz; B, K": FilteredTruth("Chebyshev", 20, flicker=10.0, walk=1.0),
    "1 Hz, one pole; B, K": FilteredTruth("pole", 1, flicker=10.0, walk=1.0),
    "0.3 Hz, one pole; B, K": FilteredTruth("pole", 0.3, flicker=10.0, walk=1.0),
    "0.1 Hz, one pole; B, K": FilteredTruth("pole", 0.1, flicker=10.0, walk=1.0),
    "0.03 Hz, one pole; B, K": FilteredTruth("pole", 0.03, flicker=10.0, walk=1.0),
}
"""Filters that no candidate describes, and those near the flicker: a right N, or a refusal."""
TABLES = {"filters": ROWS, "unfiltered": OTHERS, "hard": HARD}


def analyse(truth: FilteredTruth, seed: int) -> ChannelNoise:
    y = readings(truth, seed)
    time = truth.dt * np.arange(float(y.size))
    return inercal.analyse_noise(Recording(time, y[:, None], ("gx",), ("°/s",)), kinds=()).channels[
        0
    ]


def row(task: tuple[str, str, int]) -> dict[str, Any]:
    """Return what was found in one recording, over the truth."""
    table, name, run = task
    truth = TABLES[table][name]
    number = list(TABLES).index(table) * 100 + list(TABLES[table]).index(name)
    found = analyse(truth, 50_000_000 + 10_000 * number + run)
    output = found.output
    entry: dict[str, Any] = {
        "shape": None if output is None else output.shape.name,
        "refused": found.refusal is not None,
        "band": bool(np.isfinite(found.band)),
        "model": "".join(found.fit.symbols),
    }
    if output is not None and output.shape.has_cutoff:
        entry["cutoff"] = [output.cutoff, output.u]
    for symbol, unit in (("N", 1.0), ("B", DEG_H), ("K", DEG_H)):
        one = found.coefficient(symbol)
        if one is None:
            continue
        true = truth.sampled_white if symbol == "N" else unit * (
            truth.flicker if symbol == "B" else truth.walk
        )  # fmt: skip
        size = np.pi / 180
        entry[symbol] = {
            "value": one.value / size,
            "u": min(one.u / size, 1e9),
            "inside": bool(one.low / size <= true <= one.high / size),
            "claimed": not one.is_limit,
        }
    return entry


def summary(truth: FilteredTruth, found: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the counts of one row."""
    right = RIGHT.get(truth.kind)
    if truth.kind == "average":
        right = f"average of {int(truth.cutoff)}"
    stated = [one for one in found if "N" in one]
    ratio = np.array([one["N"]["value"] / truth.sampled_white for one in stated])
    entry: dict[str, Any] = {
        "filter": sum(one["shape"] is not None for one in found) / len(found),
        "right": sum(one["shape"] == right for one in found) / len(found),
        "refused": sum(one["refused"] for one in found) / len(found),
        "band": sum(one["band"] for one in found) / len(found),
        "B claimed": sum(one["B"]["claimed"] for one in stated) / max(len(stated), 1),
    }
    if stated:
        entry["N"] = {
            "median": round(float(np.median(ratio)), 5),
            "rms": round(float(np.sqrt(np.mean((ratio - 1) ** 2))), 5),
            "covered": sum(one["N"]["inside"] for one in stated) / len(stated),
        }
        entry["K covered"] = sum(one["K"]["inside"] for one in stated if "K" in one) / len(stated)
    if cuts := [one["cutoff"] for one in found if "cutoff" in one and one["shape"] == right]:
        values, u = np.array(cuts).T
        entry["cutoff"] = {
            "median": round(float(np.median(values)), 4),
            "sd": round(float(values.std()), 4),
            "u": round(float(np.median(u)), 4),
            "covered": float(np.mean(np.abs(values - truth.cutoff) <= 2 * u)),
        }
    flicker = [one["B"] for one in stated if one["B"]["claimed"]]
    if truth.flicker and flicker:
        b = np.array([one["value"] for one in flicker]) / (truth.flicker * DEG_H)
        entry["B"] = {
            "median": round(float(np.median(b)), 4),
            "rms": round(float(np.sqrt(np.mean((b - 1) ** 2))), 4),
            "covered": sum(one["inside"] for one in flicker) / len(flicker),
        }
    return entry


def work_out(runs: int, pool: Any) -> dict[str, Any]:
    found: dict[str, Any] = {"runs": runs, "fewer": max(runs // 2, 1)}
    for table, rows in TABLES.items():
        found[table] = {}
        count = runs if table == "filters" else max(runs // 2, 1)
        for name, truth in rows.items():
            entries = pool.map(row, [(table, name, run) for run in range(count)], chunksize=2)
            found[table][name] = summary(truth, entries)
            print(table, name, found[table][name], flush=True)
    return found


def _number(one: dict[str, Any], *keys: str) -> str:
    value: Any = one
    for key in keys:
        if key not in value:
            return ""
        value = value[key]
    return f"{value:.4g}"


def page(found: dict[str, Any]) -> str:
    """Return the page of the stored counts."""
    lines = [
        "# Noise behind a sensor's own filter, counted",
        "",
        "Written by `python -m tests.evidence.filtered_noise`; do not edit. Recordings were made",
        "by `tests/noise/filtered_generator.py`, which is independent of inercal. Each recording",
        "contains 30 min of a gyro with 0.3 °/√h, sampled at 100 Hz unless another rate is",
        f"stated. There are {found['runs']} recordings in each row of the first table, and",
        f"{found['fewer']} in each row of the other tables. In rows with B, K, the gyro also has",
        "10 °/h, 1 °/h/√s and readings in steps of 0.0076 °/s. The true N is that of the",
        'readings, so it includes the rounding. "Covered" is the share of true values within ±2u',
        "or within the profile-likelihood interval.",
        "",
        "## Filters",
        "",
        "| filter | chosen rightly | f_c: median, sd, u, Hz | covered | N: rms | covered "
        "| B stated | B: median, rms | covered | K covered |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name, one in found["filters"].items():
        cut = ", ".join(_number(one, "cutoff", key) for key in ("median", "sd", "u"))
        b = ", ".join(_number(one, "B", key) for key in ("median", "rms"))
        lines.append(
            f"| {name} | {one['right']:.3f} | {cut.strip(', ')} "
            f"| {_number(one, 'cutoff', 'covered')} "
            f"| {_number(one, 'N', 'rms')} | {_number(one, 'N', 'covered')} "
            f"| {one['B claimed']:.3f} | {b.strip(', ')} | {_number(one, 'B', 'covered')} "
            f"| {_number(one, 'K covered')} |"
        )
    lines += ["", "## Sensors without a filter", "",
              "A Gauss–Markov process has the same spectrum as white noise behind one pole. If "
              "there is also white noise of a quarter of its plateau, they can be told apart.", "",
              "| truth | called a filter | refused | N: median, rms | covered |",
              "|---|---|---|---|---|"]  # fmt: skip
    for name, one in found["unfiltered"].items():
        lines.append(_short(name, one, one["filter"]))
    lines += ["", "## Filters that no candidate describes, and filters near the flicker", "",
              "At 0.05 Hz, flicker of 10 °/h is as large as white noise of 0.3 °/√h.", "",
              "| truth | a part of the band used | refused | N: median, rms | covered |",
              "|---|---|---|---|---|"]  # fmt: skip
    for name, one in found["hard"].items():
        lines.append(_short(name, one, one["band"]))
    return "\n".join([*lines, ""])


def _short(name: str, one: dict[str, Any], share: float) -> str:
    n = ", ".join(_number(one, "N", key) for key in ("median", "rms"))
    return (
        f"| {name} | {share:.3f} | {one['refused']:.3f} | {n.strip(', ')} "
        f"| {_number(one, 'N', 'covered')} |"
    )


if __name__ == "__main__":
    store_runs(__doc__, work_out, page, (DATA, PAGE), RUNS)
