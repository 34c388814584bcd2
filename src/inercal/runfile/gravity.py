"""A stated gravity against the normal gravity of the place, where both are stated."""

from math import degrees, sin

from inercal.earth import normal_gravity
from inercal.recording import Finding
from inercal.section_settings import BenchSection, measured_constant, si_value

_ANOMALY = 1e-3  # m/s², 100 mGal: 2.5 standard deviations of free-air anomalies
_HIGHEST = 3000.0  # m: a laboratory whose height is not stated
_BY_LATITUDE = 0.0517  # m/s² a radian at 45°, times the sine of twice the latitude
_COVERAGE = 3.0


def check_stated_gravity(section: BenchSection) -> tuple[Finding, ...]:
    """Return how a stated gravity agrees with that of latitude and height; nothing without both.

    A warning where it is farther from normal gravity than an anomaly of 100 mGal and three
    standard uncertainties explain; without a height anything from 0 to 3000 m is possible.

    Parameters
    ----------
    section : section of [bench]
        Its values are known to be readable.
    """
    if section.gravity is None or section.latitude is None:
        return ()
    stated = measured_constant(section.gravity, "m/s²", "[bench] gravity")
    place = measured_constant(section.latitude, "°", "[bench] latitude")
    height = None if section.height is None else si_value(section.height, "m", "[bench] height")
    normal = normal_gravity(place.value, height or 0.0).value
    lowest = normal if height is not None else normal_gravity(place.value, _HIGHEST).value
    slope = _BY_LATITUDE * abs(sin(2 * place.value))
    margin = _ANOMALY + _COVERAGE * (stated.sd + slope * place.sd)
    at = f"{degrees(place.value):.6g}° of latitude and " + (
        "0 to 3000 m, the height not being stated" if height is None else f"{height:g} m"
    )
    of_place = f"{normal:.5f} m/s²" if height is not None else f"{lowest:.4f} to {normal:.4f} m/s²"
    both = f"gravity is stated as {stated.value:.5f} m/s²; normal gravity at {at} is {of_place}"
    if lowest - margin <= stated.value <= normal + margin:
        off = f", {1e5 * (stated.value - normal):+.0f} mGal off" if height is not None else ""
        return (Finding("note", "gravity", both + off),)
    text = (
        f"{both}: no anomaly is that large, and scale factors take it over; check [bench] gravity"
    )
    return (Finding("warning", "gravity", text + ", latitude and height"),)
