"""Measure how a fleet grows, and draw it: ``python -m tools.fleet_growth``, a quarter of an hour.

Tasks of the engine that compute nothing, the client's memory, and entries into a register of a
file; CPU time, at 10³, 10⁴ and 10⁵ sensors of twelve coefficients. Each size is measured in a
process of its own, as memory that was once taken is not given back.
"""

import json
import multiprocessing
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.fleet import engine_cost

import inercal
from inercal.calibration.files import calibration_object, canonical_text
from inercal.fleet import results
from inercal.fleet.inputs import ABSENT, INSTALLED
from inercal.fleet.latest import enter_results
from inercal.fleet.line import Line, SensorRow
from inercal.laboratory.store import Register

ROOT = Path(__file__).parents[1]
RUN_FILE = ROOT / "examples" / "six_position" / "run.toml"
PICTURE = ROOT / "docs" / "images" / "fleet-growth.svg"
SIZES = (1_000, 10_000, 100_000)
PART = 200  # sensors in a part of the results


def engine(size: int) -> dict[str, float]:
    """Return CPU time, s, and growth of the client's memory, MB."""
    cost, grown = engine_cost(None, size)
    return {"tasks": cost.processor, "memory": max(grown, 0.1)}


def register(size: int) -> dict[str, float]:
    """Return the CPU time of entering all results into a new register, s, and its size, MB."""
    with TemporaryDirectory() as name:
        folder, path = Path(name) / results.FOLDER, Path(name) / "register.db"
        sensors = tuple(SensorRow(f"S{k:06d}", "absent") for k in range(size))
        line = Line(Path(name), {}, sensors)
        for rows in _parts(line):
            results.ResultWriter(folder, 1).write(rows)
        with Register(str(path)) as opened:
            begin = time.process_time()
            enter_results(line, folder, opened)
            taken = time.process_time() - begin
        return {"register": taken, "disk": path.stat().st_size / 1e6}


def _parts(line: Line) -> Iterator[list[dict[str, object]]]:
    size = len(line.rows)
    first = inercal.calibrate(RUN_FILE).calibration
    rng = np.random.default_rng(1)
    for begin in range(0, size, PART):
        part: list[dict[str, object]] = []
        for k in range(begin, min(begin + PART, size)):
            one = replace(
                first,
                sensor=replace(first.sensor, name=f"S{k:06d}"),
                values=first.values + first.std * rng.standard_normal(first.values.size),
                provenance={**first.provenance, "recording sha256": f"{k:064x}"},
            )
            text = canonical_text(calibration_object(one))
            row: dict[str, object] = {"key": str(k), "id": one.sensor.name, "table": []}
            row |= {"status": results.DONE, "created": "2026-01-01T00:00:00+00:00"}
            row |= {"sections_sha256": line.digest(line.rows[k]), "inercal": INSTALLED}
            row |= {"size": ABSENT.size, "mark": ABSENT.mark}
            part.append(row | {"calibration": text})
        yield part


def measure() -> dict[int, dict[str, float]]:
    """Measure each size; print and return what was found."""
    found: dict[int, dict[str, float]] = {}
    for size in SIZES:
        found[size] = {k: v for one in (engine, register) for k, v in _alone(one, size).items()}
        print(f"{size:>7}", json.dumps(found[size]), flush=True)
    return found


def _alone(function: Callable[[int], dict[str, float]], size: int) -> dict[str, float]:
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, spawn) as pool:  # not a Pool, whose workers may start no workers
        return pool.submit(function, size).result()


def draw(found: dict[int, dict[str, float]]) -> None:
    """Draw times and memory against the number of sensors; write the picture."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 3.4), layout="constrained")
    times, sizes = figure.subplots(1, 2)
    shown = {
        times: (("register", "entries in the register"), ("tasks", "tasks of the engine")),
        sizes: (("disk", "register on disk"), ("memory", "memory of the client")),
    }
    for axes, curves in shown.items():
        for (name, label), mark in zip(curves, "os", strict=True):
            values = [one[name] for one in found.values()]
            axes.loglog(list(found), values, f"{mark}-", label=label)
        axes.set_xlabel("sensors")
        axes.grid(which="major", color="0.85")
        axes.legend(frameon=False)
    times.set_ylabel("CPU time, s")
    sizes.set_ylabel("MB")
    figure.savefig(PICTURE, metadata={"Date": None})


if __name__ == "__main__":
    draw(measure())
