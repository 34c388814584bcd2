"""Determine sensor noise from a recording at rest: deviations, coefficients, disturbances.

`analyse_noise` returns the `NoiseAnalysis` of a recording. If a recording is too long for the
memory, `analyse_noise_stream` reads it piece by piece and returns the same kind of result.
Internally, all values are in SI.
"""

from inercal.noise.analysis import analyse_noise
from inercal.noise.channel_noise import ChannelNoise, NoiseAnalysis, NoiseCoefficient
from inercal.noise.deviations import Deviations, deviations
from inercal.noise.stream_analysis import NoiseStream, analyse_noise_stream

__all__ = [
    "ChannelNoise",
    "Deviations",
    "NoiseAnalysis",
    "NoiseCoefficient",
    "NoiseStream",
    "analyse_noise",
    "analyse_noise_stream",
    "deviations",
]
