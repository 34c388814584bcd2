"""Warm-up drift and short-term stability of simulated accelerometers: bias, coverage, alarms.

`python -m tests.evidence.warm_up` works out the table and writes docs/evidence/warm-up.md; with
another number of `--devices`, it only prints the table.
"""

import argparse
from collections.abc import Iterator
from functools import partial
from multiprocessing import Pool, cpu_count

import numpy as np
from tests.evidence import stored_counts
from tests.evidence.characteristics import Outcomes
from tests.evidence.warm_up_devices import (
    BASE,
    NOISE,
    PIER,
    READINGS,
    UG,
    Effects,
    G,
    accelerometers,
    true_values,
)

from inercal.basics.units import Measured
from inercal.benches.dividing_head.bench import DividingHead, mounted_sensor
from inercal.benches.dividing_head.characteristics import head_characteristics
from inercal.physics.plan import Index
from inercal.recordings import Observations

SEEDS, DEVICES = (1, 2, 3), 200  # devices for each seed
PAGE = stored_counts.FOLDER / "warm-up.md"
BAND = 1.0 * UG
CASES = {
    "none": Effects(0.0, 300.0, 0.0),
    "small": Effects(10.0 * UG, 400.0, 0.6 * UG),
    "large": Effects(-60.0 * UG, 300.0, 2.0 * UG),
}
NAMES = ("warm-up drift", "short-term stability", "warm-up time constant", "warm-up time")
_PAGE = """\
# Warm-up drift and short-term stability

Written by `make evidence`; do not edit. A generator that is independent of inercal
(`tests/evidence/warm_up_devices.py`) made accelerometers that were just switched on. Each
accelerometer is read once a minute, {readings} times, at 0° of a dividing head, before a tumble
test. "Bias" is the mean error divided by the mean u. "Coverage" is the share of devices whose 95 %
interval contains the true value. "Reported" is the share of devices in which the effect is called
detected, or for which a time is stated. If the true coverage is 95 %, the coverage counted in 600
devices is between 91.8 and 97.7 % with a probability of 99.9 %. The devices in the first rows have
no effect, so each effect that is reported there is a false alarm. The warm-up time is the time
after which the reading stays within {band:g} µg of the last reading.

| size | effect | true value | mean u | bias / u | coverage, % | reported, % |
|---|---|--:|--:|--:|--:|--:|
{rows}

Base seeds {seeds}, {devices} devices each. Commit {commit}; {machine}.
"""


def outcomes(size: str, devices: int, seed: int) -> dict[str, Outcomes]:
    """Return the outcomes of each effect; u is NaN where a time is not stated."""
    effects = CASES[size]
    rng = np.random.default_rng([seed, list(CASES).index(size)])
    made = accelerometers(effects, devices, rng)
    bench = DividingHead(Measured(G, 0.0), base=BASE, pier=PIER, collimated="none")
    rows = range(len(made.time))
    steps = [Index(str(k), float(made.angle[k])) for k in rows]
    sensor = mounted_sensor(axes=("a",))
    truth = true_values(effects, BAND)
    result: dict[str, list[tuple[float, ...]]] = {name: [] for name in truth}
    for k in range(devices):
        seen = Observations(
            labels=tuple(map(str, rows)),
            mean=made.reading[k][:, None],
            covariance=np.full((len(rows), 1, 1), NOISE**2),
            duration=np.ones(len(rows)),
            samples=np.ones(len(rows), dtype=np.int64),
            time=made.time,
            channels=("a",),
        )
        found = {c.name: c.figure for c in head_characteristics(seen, sensor, bench, steps, BAND)}
        for name, true in truth.items():
            one = found.get(name)
            if one is None:
                result[name].append((true, np.nan, np.nan, False, False))
                continue
            covered = one.low <= true <= one.high
            result[name].append((true, one.value - true, one.u, covered, one.detected))
    return {name: Outcomes(*np.array(each, dtype=float).T) for name, each in result.items()}


def pooled(parts: list[dict[str, Outcomes]]) -> dict[str, Outcomes]:
    """Return the outcomes of all seeds together."""
    return {
        name: Outcomes(
            *(np.concatenate(each) for each in zip(*(part[name] for part in parts), strict=True))
        )
        for name in NAMES
    }


def rows(size: str, found: dict[str, Outcomes]) -> Iterator[str]:
    """Yield a line of the table for each effect."""
    for name, one in found.items():
        unit, text = (1.0, "s") if "time" in name else (UG, "µg")
        reported = f"{100 * one.reported.mean():.1f}"
        if size == "none":
            yield f"| {size} | {name} | none | | | | {reported} |"
            continue
        stated = np.isfinite(one.u)
        true, u = float(one.true.mean()) / unit, float(one.u[stated].mean()) / unit
        bias = float(one.error[stated].mean() / one.u[stated].mean())
        yield (
            f"| {size} | {name} | {true:.3g} {text} | {u:.2g} {text} | {bias:+.2f} | "
            f"{100 * one.covered[stated].mean():.1f} | {reported} |"
        )


def main() -> None:
    """Work out the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=DEVICES)
    devices: int = parser.parse_args().devices
    lines: list[str] = []
    with Pool(cpu_count()) as pool:
        for size in CASES:
            parts = pool.map(partial(outcomes, size, devices), SEEDS)
            own = list(rows(size, pooled(parts)))
            lines += own
            print("\n".join(own), flush=True)
    if devices == DEVICES:
        text = _PAGE.format(
            readings=READINGS,
            band=BAND / UG,
            rows="\n".join(lines),
            seeds=", ".join(map(str, SEEDS)),
            devices=devices,
            commit=stored_counts.current_commit(),
            machine=stored_counts.describe_machine(),
        )
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
