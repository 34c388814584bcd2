"""The imperfections of a simulated bench, drawn once: the same in the processes of table and IMU.

A host ties the clocks of table and IMU by when readings arrive, so a latency τ of the readback
means that it comes τ later than the IMU's readings do. Both are late: the IMU's readings, because
the servo cycles of the table that they are made of must be known first, and the readback by τ more.

The IMU's clock is slower than the table's by χ: (1 − χ) s pass on it in 1 s of the table's, which
is the bench's time (see `inercal.benches.turntable.bench`).
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

# Servo cycles: of the two about a time and one beside them, none may be to come
_LOOKAHEAD_CYCLES = 4
_NOISE_BLOCK = 4096  # of noise


@dataclass(frozen=True)
class SimulatedErrors:
    """A bench and what is off of it.

    Parameters
    ----------
    bench : bench
        That a host drives.
    seed : int
    values : mapping of str to float
        All of the bench's parameters by name, SI.
    motion_control : MotionControl
        Of the bench.
    steps : sequence of Step
        Of the plan.
    """

    bench: Any
    seed: int
    values: dict[str, float]
    motion_control: MotionControl
    steps: Sequence[Step]

    @property
    def clock_ratio(self) -> float:
        """Seconds that pass on the IMU's clock in one of the table's."""
        return 1.0 - self.values.get("clock", 0.0)

    def sensed_motion(self) -> SensedMotion:
        """Return the function that gives what is sensed on this bench."""
        return self.motion_control.sensed_motion(self.bench, self.steps, self.values)

    def latencies(self, period: float) -> tuple[float, float]:
        """Return how late the IMU's readings and the readback are, s; `period` is the servo's."""
        latency = self.values.get("latency", 0.0)
        imu = max(_LOOKAHEAD_CYCLES * period, -latency)
        return imu, latency + imu

    def axes(self, period: float) -> tuple[AxisDynamics, ...]:
        """Return the axes of a table of angles, outer to inner; index pulses are at their zeros."""
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
    """Draw a run's bench from normal distributions of its stated deviations.

    Raises
    ------
    InputError
        No host drives the bench, or a latency is longer than the table's memory.
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


def noise_generator(seed: int, what: Literal["white", "drift", "readback"], *key: int) -> Generator:
    """Return the generator of one kind of noise, independent of that of the others.

    A sequence as seed would not do: [5, 1] and [5, 1, 0] give the same numbers.
    """
    purpose = ("white", "drift", "readback").index(what)
    return np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(purpose, *key)))


def _readback_noise(white: float, seed: int, axis: int) -> Callable[[int], float]:
    """Return the readback's noise, rad, in a servo cycle, whoever asks for it and how often."""

    @lru_cache(1)
    def drawn(block: int) -> list[float]:
        rng = noise_generator(seed, "readback", axis, block)
        return rng.normal(0.0, white, _NOISE_BLOCK).tolist()

    def noise(cycle: int) -> float:
        block, place = divmod(cycle, _NOISE_BLOCK)
        return drawn(block)[place]

    return noise
