"""Describe a measuring axis: its name, directions, readout and random errors.

The axes of a sensor measure components of the motion (f, ω, m). Three independent axes of a kind
measure a vector, so its components are those along x, y and z. One or two axes measure only the
components along their own directions.

The random errors are described by the Allan deviation. Symbols and two-sided spectra follow IEEE
Std 952, annex B::

    white            N    S(f) = N²             mean over T has sd N/√T
    bias instability B    S(f) = B²/(2π f)      Allan floor √(2 ln2/π) B = 0.664 B
    random walk      K    S(f) = (K/(2π f))²    increments over dt have variance K² dt
    quantisation     step the output is rounded to a multiple of it

With a correlation time τ, the bias drift is a Gauss–Markov process with standard deviation B
instead of flicker noise. Many filters and papers assume this: S(f) = 2 B² τ/(1 + (2π f τ)²).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.physics.quantities import KINDS, Measures


@dataclass(frozen=True)
class Noise:
    """The noise coefficients of one axis, in SI units.

    Parameters
    ----------
    white : float
        N, m/s²/√Hz or rad/s/√Hz: velocity or angle random walk.
    bias_instability : float
        B, m/s² or rad/s.
    random_walk : float
        K, m/s²/√s or rad/s/√s.
    quantisation : float
        Quantisation step of the reading, m/s² or rad/s; 0 means none.
    correlation : float
        Correlation time τ of a Gauss–Markov drift with standard deviation B, s; 0 means flicker
        noise.

    Raises
    ------
    InputError
        A value is negative or not finite.
    """

    white: float = 0.0
    bias_instability: float = 0.0
    random_walk: float = 0.0
    quantisation: float = 0.0
    correlation: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not (np.isfinite(value) and value >= 0):
                raise InputError(
                    f"noise {name} = {value}: must be a finite number, 0 or more", names=(name,)
                )

    def rounded(self, rate_hz: float) -> "Noise":
        """Return the noise with rounding to steps q added as white noise (q²/12 per sample)."""
        return replace(self, white=np.hypot(self.white, self.quantisation / (12 * rate_hz) ** 0.5))

    def draw(self, rng: "np.random.Generator", shape: tuple[int, ...], rate_hz: float) -> Array:
        """Return simulated noise in SI, sampled at `rate_hz` along the last axis, not quantised."""
        dt = 1.0 / rate_hz
        noise = np.zeros(shape)
        if self.white:
            noise += self.white * rate_hz**0.5 * rng.standard_normal(shape)
        if self.bias_instability:
            if self.correlation:
                noise += self.bias_instability * _markov(rng, shape, dt / self.correlation)
            else:
                noise += self.bias_instability * _flicker(rng, shape)
        if self.random_walk:
            steps = rng.standard_normal(shape)
            steps[..., 0] = 0.0  # the walk starts at the bias that is estimated
            noise += self.random_walk * dt**0.5 * np.cumsum(steps, axis=-1)
        return noise

    def quantise(self, reading: Array) -> Array:
        """Return the readings, SI, rounded to the quantisation step."""
        if not self.quantisation:
            return reading
        return np.round(reading / self.quantisation) * self.quantisation


def _markov(rng: "np.random.Generator", shape: tuple[int, ...], step: float) -> Array:
    """Return a unit Gauss–Markov process, stationary from the start; `step` is Δt/τ."""
    # Imported here because the import takes 1.6 s (it loads scipy.stats) and few simulations need
    # it.
    from scipy.signal import lfilter

    factor = np.exp(-step)
    white = rng.standard_normal(shape)
    white[..., 1:] *= np.sqrt(1 - factor**2)
    return np.asarray(lfilter([1.0], [1.0, -factor], white, axis=-1), dtype=float)


def _flicker(rng: "np.random.Generator", shape: tuple[int, ...]) -> Array:
    """Return unit flicker noise, S(f) = 1/(2π f), by filtering white noise in the frequency domain.

    The noise is generated with twice the length, and half of it is returned, because the transform
    is periodic and the noise is not. It contains no frequency below the inverse of that length: a
    constant offset belongs to the bias, not to its instability.
    """
    n = 2 * shape[-1]
    spectrum = np.fft.rfft(rng.standard_normal((*shape[:-1], n)), axis=-1)
    cycles_per_sample = np.fft.rfftfreq(n)
    gain = np.zeros_like(cycles_per_sample)
    gain[1:] = (2 * np.pi * cycles_per_sample[1:]) ** -0.5
    return np.fft.irfft(spectrum * gain, n=n, axis=-1)[..., : shape[-1]]


_OUTPUT_UNITS = ("LSB", "V", "A", "Hz")


def output_unit(unit: str) -> str | None:
    """Return the SI unit of an output that needs a scale factor, "V" for "mV"; None for others."""
    for one in _OUTPUT_UNITS:
        with suppress(InputError):
            si_factor(unit, one)
            return one
    return None


@dataclass(frozen=True)
class Readout:
    """The readout of an axis: output = offset + scale · (reading in SI units).

    Parameters
    ----------
    scale : float
        Nominal scale factor, output units per m/s², per rad/s or per T.
    offset : float
        Output at zero reading, in output units.
    unit : str
        Name of the output unit.
    full_scale : float or None
        Largest magnitude of output − offset within the measuring range, in output units.
    """

    scale: float = 1.0
    offset: float = 0.0
    unit: str = "SI"
    full_scale: float | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.scale) and self.scale != 0 and np.isfinite(self.offset)):
            raise InputError(
                f"readout: scale {self.scale} and offset {self.offset}: both must be finite, and "
                "the scale not zero",
                names=("scale", "offset"),
            )


@dataclass(frozen=True)
class Axis:
    """One measuring axis.

    Parameters
    ----------
    name : str
        Name of the axis, such as "x" or "gz".
    measures : "f", "w" or "m"
        Specific force (an accelerometer), angular rate (a gyro) or magnetic flux density (a
        magnetometer).
    i, p : tuple of 3 floats
        Nominal input and pendulous axes, orthogonal unit vectors in the sensor's frame; O = I × P.
    readout, noise
        Conversion from reading to output, and noise of the reading.
    """

    name: str
    measures: Measures
    i: tuple[float, float, float]
    p: tuple[float, float, float]
    readout: Readout = Readout()
    noise: Noise = Noise()

    def __post_init__(self) -> None:
        frame = self.frame
        if not np.allclose(frame @ frame.T, np.eye(3), atol=1e-9):
            raise InputError(
                f"axis {self.name}: input axis i {self.i} and pendulous axis p {self.p} must be "
                "orthogonal unit vectors",
                names=(self.name,),
            )

    def __hash__(self) -> int:
        return hash((self.name, self.measures, self.i))  # quick, because much is kept by axes

    @cached_property
    def frame(self) -> Array:
        """The directions I, P and O in the sensor's frame, as rows, (3, 3)."""
        return np.array([self.i, self.p, np.cross(self.i, self.p)])


class SensedMotion(NamedTuple):
    """The q components of the motion that a sensor measures.

    Parameters
    ----------
    names : tuple of q str
        "fx", "wz", …; "f1", "f2", … for one or two axes that are not along different case axes.
    measures : tuple of q "f", "w" or "m"
    rows : (q, width) array
        Direction of each component in (f, ω), or in (f, ω, m) if there are magnetometers.
    basis : (width, k) array
        Orthonormal basis of these directions; k < q if some of them are parallel.
    """

    names: tuple[str, ...]
    measures: tuple[Measures, ...]
    rows: Array
    basis: Array


@lru_cache
def sensed_motion(axes: tuple[Axis, ...]) -> SensedMotion:
    """Return the components of the motion that the axes of a sensor measure."""
    names: list[str] = []
    measures: list[Measures] = []
    rows: list[Array] = []
    basis: list[Array] = []
    width = motion_width(axes)
    for kind in KINDS[: width // 3]:
        own = np.array([axis.i for axis in axes if axis.measures == kind]).reshape(-1, 3)
        rank = int(np.linalg.matrix_rank(own))
        if rank == len("xyz"):
            own = orthonormal = np.eye(3)
        else:
            orthonormal = np.linalg.svd(own)[2][:rank]
        names += [kind + name for name in case_letters(own) or map(str, range(1, len(own) + 1))]
        measures.extend(kind for _ in own)
        place = np.eye(3, width, 3 * KINDS.index(kind))
        rows += list(own @ place)
        basis += list(orthonormal @ place)
    return SensedMotion(
        tuple(names), tuple(measures), np.array(rows), np.ascontiguousarray(np.transpose(basis))
    )


def motion_width(axes: Sequence[Axis]) -> int:
    """Return the number of components of the motion: 6 for (f, ω), 9 for (f, ω, m)."""
    return 3 * (len(KINDS) if any(axis.measures == "m" for axis in axes) else len("fw"))


def case_letters(directions: Array) -> tuple[str, ...]:
    """Return the letters of unit vectors, (m, 3), along different case axes; empty for others.

    >>> case_letters(np.array([[0, 0, 1], [1, 0, 0]]))
    ('z', 'x')
    >>> case_letters(np.array([[0, 0, 1], [0, 0, 1]])), case_letters(np.array([[0, 0, -1]]))
    ((), ())
    """
    letters = tuple("xyz"[k] for k in directions.argmax(axis=1).tolist())
    along = bool((directions.max(axis=1, initial=0) == 1).all())
    return letters if along and len(set(letters)) == len(letters) else ()
