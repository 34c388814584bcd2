"""The files of a noise analysis for other programs, by their names."""

from collections.abc import Callable

from inercal.noise.channel_noise import NoiseAnalysis
from inercal.noise.filter_file import filter_text
from inercal.noise.noise_files import kalibr_text, ros_text

WRITERS: dict[str, Callable[[NoiseAnalysis, float], str]] = {
    "kalibr": kalibr_text,
    "ros": ros_text,
    "filter": filter_text,
}
