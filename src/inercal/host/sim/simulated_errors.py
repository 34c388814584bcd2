"""The imperfections of a simulated bench, which are the same for table and IMU processes.

A host relates the clocks of table and IMU by the arrival of readings. A latency τ of the readback
therefore means that the readback arrives τ later than the IMU's readings. Both are late. The IMU's
readings are late because they depend on servo cycles of the table that must be computed first, and
the readback is late by an additional τ.

The IMU's clock is slower than the table's clock by χ: in 1 s of the table's clock, which is bench
time, the IMU's clock advances by (1 − χ) s (see `inercal.benches.turntable.bench`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import cos, sin
from typing import Any, Literal

import numpy as np
from numpy.random import Generator

from inercal.basics.errors import InputError
from inercal.benches.motion_control import MotionControl, SensedMotion
from inercal.host.sim.dynamics import AxisDynamics, SimulatedTable, three_axes
from inercal.physics.plan import Step
from inercal.physics.section_settings import key_error
from inercal.runfile import Run

# Number of servo cycles: the two cycles around a time and one more on each side must be in the
# past.
_LOOKAHEAD_CYCLES = 4
_NOISE_BLOCK = 4096  # number of readings in a block of noise
_SEED_STEP = 1_000_003  # from the seed of one IMU to that of the next


@dataclass(frozen=True)
class SimulatedErrors:
    """A bench and its imperfections.

    Parameters
    ----------
    bench : bench
        A bench that a host can drive.
    seed : int
    values : mapping of str to float
        Values of all bench parameters, SI, by name.
    motion_control : MotionControl
        Motion control of the bench.
    steps : sequence of Step
        Steps of the plan.
    """

    bench: Any
    seed: int
    values: dict[str, float]
    motion_control: MotionControl
    steps: Sequence[Step]

    @property
    def clock_ratio(self) -> float:
        """Seconds by which the IMU's clock advances in one second of the table's clock."""
        return 1.0 - self.values.get("clock", 0.0)

    def sensed_motion(self) -> SensedMotion:
        """Return the function that computes the motion that a sensor on this bench senses."""
        return self.motion_control.sensed_motion(self.bench, self.steps, self.values)

    def latencies(self, period: float) -> tuple[float, float]:
        """Return the delays of IMU readings and of the readback for a servo period, s."""
        latency = self.values.get("latency", 0.0)
        imu = max(_LOOKAHEAD_CYCLES * period, -latency)
        return imu, latency + imu

    def axes(self, period: float) -> tuple[AxisDynamics, ...]:
        """Return the axes of a turntable, from outer to inner; index pulses are at the zeros."""
        built = {axis.name: axis for axis in three_axes()}
        delay = self.latencies(period)[1]
        return tuple(
            replace(
                built[name],
                index=0.0,
                reading=self._harmonics(name),
                noise=_readback_noise(self.bench.white, self.seed, i) if self.bench.white else None,
                delay=delay,
            )
            for i, name in enumerate(self.bench.names)
        )

    def _harmonics(self, name: str) -> Callable[[float], float] | None:
        amplitudes = [
            (h, self.values[f"sin{h}[{name}]"], self.values[f"cos{h}[{name}]"])
            for h in range(1, len(self.bench.harmonics) + 1)
        ]
        if not amplitudes:
            return None

        def reading(angle: float) -> float:
            said = angle
            for h, s, c in amplitudes:
                said += s * sin(h * angle) + c * cos(h * angle)
            return said

        return reading


def draw_errors(run: Run, seed: int) -> SimulatedErrors:
    """Draw the errors of a bench from normal distributions with the stated deviations.

    Raises
    ------
    InputError
        No host can drive the bench, or a latency exceeds the stored history of the table.
    """
    control, bench = run.motion_control, run.bench
    rng = np.random.default_rng(seed)
    values = {
        name: p.value + p.sd * float(rng.standard_normal())
        for name, p in control.errors(bench, run.steps).items()
    }
    drawn = SimulatedErrors(bench, seed, values, control, run.steps)
    if not control.has_attitude:
        return drawn
    try:
        SimulatedTable(drawn.axes(1 / 2000))
    except InputError as error:
        raise key_error("[bench] latency", str(error), run.path) from None
    return drawn


def numbered_imu(run: Run, drawn: SimulatedErrors, number: int) -> tuple[Run, SimulatedErrors]:
    """Return the run and the errors from which the IMU with a number, from 1 on, is simulated.

    Its true coefficients are those in the run file divided by its number, and it has other noise.
    """
    truth = {name: value / number for name, value in run.truth.items()}
    return replace(run, truth=truth), replace(drawn, seed=drawn.seed + (number - 1) * _SEED_STEP)


def noise_generator(seed: int, what: Literal["white", "drift", "readback"], *key: int) -> Generator:
    """Return the random generator for one kind of noise, independent of the other kinds.

    A sequence cannot be the seed, because [5, 1] and [5, 1, 0] give the same numbers.
    """
    purpose = ("white", "drift", "readback").index(what)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(purpose, *key)))


def _readback_noise(white: float, seed: int, axis: int) -> Callable[[int], float]:
    """Return a function that returns the readback noise in a servo cycle, rad.

    For the same cycle, the function always returns the same noise.
    """

    @lru_cache(1)
    def drawn(block: int) -> list[float]:
        rng = noise_generator(seed, "readback", axis, block)
        return rng.normal(0.0, white, _NOISE_BLOCK).tolist()

    def noise(cycle: int) -> float:
        block, place = divmod(cycle, _NOISE_BLOCK)
        return drawn(block)[place]

    return noise
