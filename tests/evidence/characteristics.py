"""Hysteresis, threshold, dead band and resolution of simulated sensors: bias, coverage, alarms.

`python -m tests.evidence.characteristics` works out the table and writes
docs/evidence/characteristics.md; with another number of `--devices`, it only prints the table.
"""

import argparse
from collections.abc import Iterator
from functools import partial
from multiprocessing import Pool, cpu_count
from typing import NamedTuple

import numpy as np
from scipy.stats import binom
from tests.evidence import stored_counts
from tests.evidence.characteristic_devices import (
    APPLIED,
    DEG_PER_H,
    HALF,
    LATITUDE,
    OTHER_SLOPE,
    SENSORS,
    UG,
    Effects,
    G,
    Head,
    RateTable,
    Readings,
)

from inercal.basics.units import Measured
from inercal.benches.characteristics import Characteristic
from inercal.benches.dividing_head.bench import DividingHead, mounted_sensor
from inercal.benches.dividing_head.characteristics import head_characteristics
from inercal.benches.rate_platform import RatePlatform
from inercal.benches.rate_platform.linearity import gyro_characteristics
from inercal.benches.rate_platform.sections import RateDwell
from inercal.physics.plan import Index
from inercal.physics.sensors import triad
from inercal.recordings import Observations

SEEDS, DEVICES = (1, 2, 3), 200  # devices for each seed
PAGE = stored_counts.FOLDER / "characteristics.md"
UNIT = {"gyro": (DEG_PER_H, "°/h"), "accelerometer": (UG, "µg")}
_SIZES = {  # hysteresis and half width
    "gyro": {"small": (6, 14.4), "large": (60, 54)},  # 14.4 °/h = 0.004 °/s
    "accelerometer": {"small": (3, 10), "large": (30, 40)},
}
_GAPS = {"small": (0, 4), "large": (1, 5)}  # a jump is anywhere between these inputs
NAMES = ("hysteresis", "threshold", "dead band", "resolution")
_PAGE = """\
# Characteristics: hysteresis, threshold, dead band and resolution

Written by `make evidence`; do not edit. A generator that is independent of inercal
(`tests/evidence/characteristic_devices.py`) made gyros on a rate table and accelerometers on a
dividing head. The errors of the bench were drawn as stated, and the slope at small inputs differs
by 0.1 % (1 σ). "Bias" is the mean error divided by the mean u. "Coverage" is the share of devices
whose 95 % interval contains the true value. "Reported" is the share of devices in which the effect
is called detected. If the true coverage is 95 %, the coverage counted in 600 devices is between
91.8 and 97.7 % with a probability of 99.9 %. The devices in the last rows have no effect, so each
effect that is reported there is a false alarm.

Hysteresis was only counted in sensors without a dead band, because the readings inside a dead band
do not show the errors of the bench. In the other sensors, hysteresis is a nuisance. If the output
jumps, the data only show between which two inputs the jump lies. The widths of these devices were
therefore drawn uniformly over several such intervals. Lock-in occurs in laser gyros.

| sensor | law | size | effect | true value | mean u | bias / u | coverage, % | reported, % |
|---|---|---|---|--:|--:|--:|--:|--:|
{rows}

Base seeds {seeds}, {devices} devices each. Commit {commit}; {machine}.
"""


class Case(NamedTuple):
    """A sensor, a law of response, and the size of its effects."""

    sensor: str
    law: str
    size: str

    @property
    def effects(self) -> Effects:
        """Return the effects in SI."""
        if self.size == "none":
            return Effects()
        unit = UNIT[self.sensor][0]
        loop, width = (unit * one for one in _SIZES[self.sensor][self.size])
        if self.law == "none":
            return Effects(loop)
        width *= 2.0 if self.law == "lock-in" else 1.0
        if self.law != "jump":
            return Effects(loop, width, width, self.law)
        low, high = (APPLIED[self.sensor][k] for k in _GAPS[self.size])
        middle = (low + high) / 2
        other = middle * OTHER_SLOPE[self.sensor]
        return Effects(loop, middle, other, self.law, (high - low) / (high + low))


CASES = [
    Case(sensor, law, size)
    for sensor in SENSORS
    for law in ("none", *HALF)
    for size in ("small", "large")
] + [Case(sensor, "none", "none") for sensor in SENSORS]


def observations(made: Readings, device: int, channel: tuple[str, ...], sd: float) -> Observations:
    """Return the readings of a device; the axes that are not tested read zero."""
    r, m = len(made.at), len(channel)
    mean = np.zeros((r, m))
    mean[:, 0] = made.reading[device]
    return Observations(
        labels=tuple(map(str, range(r))),
        mean=mean,
        covariance=np.tile(sd**2 * np.eye(m), (r, 1, 1)),
        duration=np.ones(r),
        samples=np.ones(r, dtype=np.int64),
        time=np.arange(r, dtype=float),
        channels=channel,
        timed=False,
    )


def characteristics(sensor: str, made: Readings, device: int) -> dict[str, Characteristic]:
    """Return the characteristics of a device by name."""
    if sensor == "gyro":
        table = RateTable()
        stated = {k: v for k, v in table.__dict__.items() if k != "noise"}
        bench = RatePlatform(Measured(G, 0.0), Measured(LATITUDE, 0.0), **stated)
        steps = [
            RateDwell(str(k), "x", float(rate), float(seconds))
            for k, (rate, seconds) in enumerate(zip(made.at, made.sense, strict=True))
        ]
        own = triad("t", "w", "g")
        found = gyro_characteristics(
            observations(made, device, own.channels, table.noise), own, bench, steps
        )
    else:
        head = Head()
        stated = {k: v for k, v in head.__dict__.items() if k != "noise"}
        bench = DividingHead(Measured(G, 0.0), **stated, collimated="none")
        steps = [
            Index(str(k), float(angle), 1 if sense > 0 else -1)
            for k, (angle, sense) in enumerate(zip(made.at, made.sense, strict=True))
        ]
        own = mounted_sensor(axes=("a",))
        found = head_characteristics(
            observations(made, device, own.channels, head.noise), own, bench, steps
        )
    return {one.name: one for one in found if one.axis == own.channels[0]}


class Outcomes(NamedTuple):
    """Errors, u, coverage and detections of an effect, (devices,) each, and its true values."""

    true: np.ndarray
    error: np.ndarray
    u: np.ndarray
    covered: np.ndarray
    reported: np.ndarray


def outcomes(case: Case, devices: int, seed: int) -> dict[str, Outcomes]:
    """Return the outcomes of each effect."""
    rng = np.random.default_rng([seed, CASES.index(case)])
    made = SENSORS[case.sensor](case.effects, devices, rng)
    half = HALF.get(case.law, 1.0)
    truth = {
        "hysteresis": np.full(devices, case.effects.hysteresis),
        "threshold": half * made.true_band,
        "dead band": made.true_band,
        "resolution": half * made.true_other,
    }
    every = [characteristics(case.sensor, made, k) for k in range(devices)]
    result: dict[str, Outcomes] = {}
    for name, true in truth.items():
        figures = [one[name].figure for one in every]
        value, u, low, high = (
            np.array([getattr(one, key) for one in figures])
            for key in ("value", "u", "low", "high")
        )
        reported = np.array([one.detected for one in figures])
        covered = (low <= true) & (true <= high)
        result[name] = Outcomes(true, value - true, u, covered, reported)
    return result


def pooled(parts: list[dict[str, Outcomes]]) -> dict[str, Outcomes]:
    """Return the outcomes of all seeds together."""
    return {
        name: Outcomes(
            *(np.concatenate(each) for each in zip(*(part[name] for part in parts), strict=True))
        )
        for name in NAMES
    }


def sampling_band(devices: int) -> tuple[float, float]:
    """Return the allowed coverage: 93 to 97 %, or the 99.9 % band of the draws if it is wider."""
    low, high = (float(binom.ppf(p, devices, 0.95)) / devices for p in (0.0005, 0.9995))
    return min(low, 0.93), max(high, 0.97)


def rows(case: Case, found: dict[str, Outcomes]) -> Iterator[str]:
    """Yield a line of the table for each effect."""
    unit, name = UNIT[case.sensor]
    for effect, one in found.items():
        # Inside a dead band a sensor does not show the errors of the bench, so the loop is tested
        # without a band.
        if case.size != "none" and (effect == "hysteresis") != (case.law == "none"):
            continue
        head = f"| {case.sensor} | {case.law} | {case.size} | {effect} |"
        alarms = f"{100 * one.reported.mean():.1f}"
        if case.size == "none":
            yield f"{head} 0 {name} | | | | {alarms} |"
            continue
        true, u = (float(x.mean()) / unit for x in (one.true, one.u))
        bias = float(one.error.mean() / one.u.mean())
        yield (
            f"{head} {true:.3g} {name} | {u:.2g} {name} | {bias:+.2f} | "
            f"{100 * one.covered.mean():.1f} | {alarms} |"
        )


def main() -> None:
    """Work out the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--devices", type=int, default=DEVICES)
    devices: int = parser.parse_args().devices
    lines: list[str] = []
    with Pool(cpu_count()) as pool:
        for case in CASES:
            parts = pool.map(partial(outcomes, case, devices), SEEDS)
            own = list(rows(case, pooled(parts)))
            lines += own
            print("\n".join(own), flush=True)
    if devices == DEVICES:
        text = _PAGE.format(
            rows="\n".join(lines),
            seeds=", ".join(map(str, SEEDS)),
            devices=devices,
            commit=stored_counts.current_commit(),
            machine=stored_counts.describe_machine(),
        )
        PAGE.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
