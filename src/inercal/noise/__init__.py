"""The noise of a sensor from a recording at rest: deviations, coefficients and disturbances.

`analyse_noise` returns the `NoiseAnalysis` of a recording. `analyse_noise_stream` returns that of
a recording that is too long for the memory, from its pieces. Values inside are in SI.
"""

from inercal.noise.analysis import analyse_noise, analyse_noise_stream
from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis, NoiseCoefficient
from inercal.noise.deviations import Deviations, deviations

__all__ = [
    "ChannelNoise",
    "Deviations",
    "NoiseAnalysis",
    "NoiseCoefficient",
    "analyse_noise",
    "analyse_noise_stream",
    "deviations",
]
