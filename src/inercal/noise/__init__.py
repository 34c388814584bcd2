"""What a sensor's noise is, from a recording at rest: deviations, coefficients and disturbances.

`analyse_noise` is the way from a recording to a `NoiseAnalysis`, and `analyse_noise_stream` that
from pieces of one that is too long for the memory. Values inside are in SI.
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
