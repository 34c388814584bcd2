"""The files of a sensor's noise for other programs, by their names."""

from collections.abc import Callable

from inercal.noise.filter_file import filter_text
from inercal.noise.noise_files import kalibr_text, ros_text
from inercal.noise.sensor_noise import SensorNoise

WRITERS: dict[str, Callable[[SensorNoise, float], str]] = {
    "kalibr": kalibr_text,
    "ros": ros_text,
    "filter": filter_text,
}
