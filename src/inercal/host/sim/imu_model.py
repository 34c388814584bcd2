"""The readings of the IMU on a simulated bench, computed in small blocks.

The motion at the sample times is interpolated between servo cycles. The commanded rate r_k of a
cycle is the mean rate in this cycle, so the rate at its end is (r_k + r_k+1)/2. Between the ends of
two cycles, the angle is a cubic through the two angles and rates. Rate and acceleration are the
derivatives of this cubic, so the integral of the rate equals the angle, apart from rounding.

Attitude, f, ω and the derivative of ω are defined as in `inercal.benches.turntable.attitude`. The
terms of the sensor are defined as in `inercal.physics.sensors.axis_model`, in the reference form.
Each term is a product of at most `MAX_FACTORS` components of the motion that its axis senses.
"""
# Numba's decorator is not typed.
# pyright: reportUntypedFunctionDecorator=false

from dataclasses import replace
from math import floor, inf, isnan

import numpy as np

from inercal.basics.arrays import Array, Indices
from inercal.basics.errors import InputError
from inercal.basics.keys import CoefficientName
from inercal.estimation.kernel_options import njit
from inercal.host.packets.packet_format import AXES
from inercal.host.sim.motion_link import MotionBlock
from inercal.host.sim.simulated_errors import SimulatedErrors, noise_generator
from inercal.physics.sensors import Sensor
from inercal.physics.sensors.coefficient_tables import COMPONENTS
from inercal.runfile import Run

RING_SIZE = 8192  # number of stored servo cycles, a power of 2
MAX_FACTORS = 4  # largest number of components in a product
COMPONENT_COUNT = len(COMPONENTS)


@njit(cache=True, nogil=True)
def store_motion(ring: Array, first: int, motion: Array) -> None:
    """Store angles and rates, (n, k, 3), from cycle `first` on, in `ring`, (KEPT, k, 2)."""
    for j in range(motion.shape[0]):
        for i in range(motion.shape[1]):
            ring[(first + j) & (RING_SIZE - 1), i, 0] = motion[j, i, 0]
            ring[(first + j) & (RING_SIZE - 1), i, 1] = motion[j, i, 1]


@njit(cache=True, nogil=True)
def interpolate_motion(ring: Array, period: float, times: Array, out: Array) -> None:
    """Compute angle, rate and acceleration at `times`, (n,), s, in `out`, (n, k, 3)."""
    last = RING_SIZE - 1
    for n in range(times.size):
        cycle = floor(times[n] / period)
        u = times[n] / period - cycle
        for i in range(out.shape[1]):
            a, b = ring[cycle & last, i, 0], ring[(cycle + 1) & last, i, 0]
            middle = ring[(cycle + 1) & last, i, 1]
            v = 0.5 * (ring[cycle & last, i, 1] + middle) * period
            w = 0.5 * (middle + ring[(cycle + 2) & last, i, 1]) * period
            d = b - a
            out[n, i, 0] = a + u * (v + u * (3 * d - 2 * v - w + u * (v + w - 2 * d)))
            out[n, i, 1] = (v + u * (2 * (3 * d - 2 * v - w) + 3 * u * (v + w - 2 * d))) / period
            out[n, i, 2] = (2 * (3 * d - 2 * v - w) + 6 * u * (v + w - 2 * d)) / period**2


@njit(cache=True, nogil=True)
def noise_free_readings(
    motion: Array,
    temperature_offset: float,
    frames: Array,
    along: Indices,
    of_axis: Indices,
    factors: Array,
    products: Indices,
    out: Array,
) -> None:
    """Compute noise-free readings in `out`, (n, m), from f, ω and ω's derivative, (n, 9).

    `temperature_offset` is the temperature minus the reference, K. `frames`, (m, 3, 3), contains
    the directions I, P and O of the axes. `along`, (m,), states which component is the error-free
    reading of each axis. A term has a factor, an axis, and the components in its product: a row of
    `products`, (terms, MAX_FACTORS), filled up with −1.
    """
    seen = np.zeros(COMPONENT_COUNT)  # dTdt stays 0: the simulated temperature is constant
    for n in range(motion.shape[0]):
        term = 0
        for k in range(along.size):
            for kind in range(3):
                for i in range(3):
                    part = 0.0
                    for j in range(3):
                        part += frames[k, i, j] * motion[n, 3 * kind + j]
                    seen[3 * kind + i] = part
            seen[9], seen[10], seen[11] = np.sign(seen[0]), np.sign(seen[3]), temperature_offset
            reading = seen[along[k]]
            while term < of_axis.size and of_axis[term] == k:
                value = factors[term]
                for j in range(MAX_FACTORS):
                    if products[term, j] >= 0:
                        value *= seen[products[term, j]]
                reading += value
                term += 1
            out[n, k] = reading


@njit(cache=True, nogil=True)
def add_noise_and_limits(
    reading: Array, noise: Array, step: Array, low: Array, high: Array
) -> None:
    """Add noise, (n, m), round to steps, (m,), and limit the range, in place."""
    for n in range(reading.shape[0]):
        for k in range(reading.shape[1]):
            value = reading[n, k] + noise[n, k]
            if step[k] > 0.0:
                value = np.rint(value / step[k]) * step[k]
            reading[n, k] = min(max(value, low[k]), high[k])


_TIME_TOLERANCE = 1e-9  # s; tolerance for times that were computed in different ways


class SensorResponse:
    """Computes the noise-free readings of a sensor from the motion that it senses, SI.

    Raises
    ------
    InputError
        The sensor has the tilted form, in which the input axes are rotated.
    """

    def __init__(self, sensor: Sensor, c: Array):
        if sensor.form != "reference":
            raise InputError(
                f"sensor {sensor.name}: the simulation needs the reference form, not the form "
                f"{sensor.form!r}; convert the sensor first",
                key="form",
                names=(sensor.form,),
            )
        terms: list[tuple[int, float, list[int]]] = []
        for name, value in zip(sensor.coefficients, c.tolist(), strict=True):
            for product in sensor.coefficient(name).basis.products:
                parts = [COMPONENTS.index(part) for part in product.components]
                parts += [-1] * (MAX_FACTORS - len(parts))
                axis = sensor.channels.index(CoefficientName(name).axis)
                terms.append((axis, value * product.factor, parts))
        terms.sort(key=lambda term: term[0])
        self._arguments = (
            np.array([axis.frame for axis in sensor.axes]),
            np.array([COMPONENTS.index(axis.measures + "i") for axis in sensor.axes]),
            np.array([term[0] for term in terms], dtype=np.int64),
            np.array([term[1] for term in terms], dtype=np.float64),
            np.array([term[2] for term in terms], dtype=np.int64).reshape(-1, MAX_FACTORS),
        )
        self._channels = len(sensor.axes)

    def __call__(self, motion: Array, temperature_offset: float = 0.0) -> Array:
        """Return the readings, (n, m), for f, ω and the derivative of ω, `motion`, (n, 9).

        `temperature_offset` is the temperature minus the reference temperature of the model, K.
        """
        out = np.empty((len(motion), self._channels))
        noise_free_readings(motion, temperature_offset, *self._arguments, out)
        return out


class SimulatedImu:
    """A simulated IMU that computes its successive readings from the motion of the bench.

    Parameters
    ----------
    run : Run
    drawn : SimulatedErrors
    rate_hz : float
        Sampling rate.
    seconds : float
        Duration for which noise is drawn in one block, s.

    Raises
    ------
    InputError
        The sensor does not consist of three accelerometers, with or without three gyros.
    """

    def __init__(self, run: Run, drawn: SimulatedErrors, rate_hz: float, seconds: float):
        sensor = run.sensor.with_coefficients(*run.truth)
        kinds = [axis.measures for axis in sensor.axes]
        if sorted(kinds) not in (["f"] * 3, ["f"] * 3 + ["w"] * 3):
            raise InputError(
                "[sensor]: the simulated IMU needs three accelerometers, and three "
                "gyros or none; add the missing axes",
                key="[sensor]",
                names=tuple(axis.name for axis in sensor.axes),
            ).located(run.path)
        c = np.array([run.truth[name] for name in sensor.coefficients])
        self._channel_order = [k for kind in "fw" for k, one in enumerate(kinds) if one == kind]
        self._is_ordered = self._channel_order == sorted(self._channel_order)
        self._sensor, self._errors, self._rate = sensor, drawn, rate_hz
        self._sensed_motion, self._response = drawn.sensed_motion(), SensorResponse(sensor, c)
        readouts = [axis.readout for axis in sensor.axes]
        reach = np.array([(one.full_scale or inf) / abs(one.scale) for one in readouts])
        steps = np.array([axis.noise.quantisation for axis in sensor.axes])
        self._limits = steps, -reach, reach
        self._clock_ratio = drawn.clock_ratio
        self._rng = noise_generator(drawn.seed, "white")
        self._block = noise_block_size(seconds, rate_hz)
        self._blocks = 0
        self._noise = self._draw_noise()
        self._noise_start = 0
        self._axes = len(drawn.bench.names)
        self._ring = np.zeros((RING_SIZE, self._axes, 2))
        self.next_number = 0
        # No reading is computed, but the kernels are compiled now and not while a table waits.
        self.read_block(MotionBlock(0.0, 1e-3, 0, np.zeros((1, self._axes, 3))))

    def read_block(self, part: MotionBlock) -> Array:
        """Return the readings that are due at the end of a block of motion, (n, 6).

        The readings of missing gyros are 0.
        """
        until, period, first, moved, mounting, temperature = part
        if first == 0:
            # Before time 0, the table was at rest.
            self._ring[:] = moved[0, :, :2]
        store_motion(self._ring, first, moved)
        last = int((until * self._clock_ratio + _TIME_TOLERANCE) * self._rate)
        numbers = np.arange(self.next_number, max(last, self.next_number))
        self.next_number += len(numbers)
        times = (numbers + 1) / (self._rate * self._clock_ratio) - self._errors.latencies(period)[0]
        between = np.empty((len(numbers), self._axes, 3))
        interpolate_motion(self._ring, period, np.maximum(times, 0.0), between)
        # Rates are per second of the IMU's own clock, because its coefficients are defined in this
        # way.
        between[..., 1] /= self._clock_ratio
        between[..., 2] /= self._clock_ratio**2
        warmth = 0.0 if isnan(temperature) else temperature - self._sensor.reference_temperature
        reading = self._response(self._sensed_motion(between, mounting), warmth)
        add_noise_and_limits(reading, self._next_noise(numbers), *self._limits)
        if not self._is_ordered:
            reading = reading[:, self._channel_order]
        missing = len(AXES) - reading.shape[1]
        return np.pad(reading, ((0, 0), (0, missing))) if missing else reading

    def _next_noise(self, numbers: Indices) -> Array:
        """Return the noise of the next readings, and draw more if necessary."""
        if not numbers.size:
            return self._noise[:0]
        while numbers[-1] >= self._noise_start + len(self._noise):
            kept = self._noise[numbers[0] - self._noise_start :]
            self._noise_start += len(self._noise) - len(kept)
            self._noise = np.concatenate([kept, self._draw_noise()])
        start = int(numbers[0]) - self._noise_start
        return self._noise[start : start + len(numbers)]

    def _draw_noise(self) -> Array:
        white = [
            replace(axis.noise, bias_instability=0.0, random_walk=0.0).draw(
                self._rng, (self._block,), self._rate
            )
            for axis in self._sensor.axes
        ]
        drift = draw_bias_drift(
            self._sensor, self._errors.seed, self._block, self._rate, self._blocks
        )
        self._blocks += 1
        return np.stack(white, axis=-1) + drift


def noise_block_size(seconds: float, rate_hz: float) -> int:
    """Return the number of readings in one block of noise that covers some seconds."""
    # Flicker noise is computed by Fourier transforms, which are slow for sizes with a large prime
    # factor.
    return 1 << round(seconds * rate_hz).bit_length()


def draw_bias_drift(sensor: Sensor, seed: int, count: int, rate_hz: float, block: int = 0) -> Array:
    """Return the drift of the biases in a block of simulated readings, (count, m), SI.

    The drift is drawn separately, because its mean over a run is part of the bias and must be
    reported.
    """
    rng = noise_generator(seed, "drift", block)
    drawn = [replace(axis.noise, white=0.0).draw(rng, (count,), rate_hz) for axis in sensor.axes]
    return np.stack(drawn, axis=-1)
