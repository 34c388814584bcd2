"""The random errors of an axis, described by its Allan deviation.

Symbols and two-sided spectra follow IEEE Std 952, annex B::

    white            N    S(f) = N²             mean over T has sd N/√T
    bias instability B    S(f) = B²/(2π f)      Allan floor √(2 ln2/π) B = 0.664 B
    random walk      K    S(f) = (K/(2π f))²    increments over dt have variance K² dt
    quantisation     step the output is rounded to a multiple of it

With a correlation time τ, the bias drift is a Gauss–Markov process with standard deviation B
instead of flicker noise. Many filters and papers assume this: S(f) = 2 B² τ/(1 + (2π f τ)²).
"""
# SciPy has no stubs.
# pyright: reportMissingTypeStubs=false, reportUnknownVariableType=false

from dataclasses import dataclass, replace

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError


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
