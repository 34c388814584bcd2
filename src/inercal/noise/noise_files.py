"""Write sensor noise to files: run-file sections, ROS covariances, and blocks for estimators.

All axes of a triad share one value, which is the root mean square over the axes. Kalibr needs
values in continuous time: N in rad/s/√Hz and m/s²/√Hz, and K in rad/s²/√Hz and m/s³/√Hz.

VINS-Fusion and FAST-LIO need values for each sample, so they depend on the sampling interval Δ. In
one step the variances of a velocity v and of a bias b must grow by N² Δ and K² Δ::

    VINS-Fusion   v: 2 (Δ/2)² acc_n²   b: Δ² acc_w²      acc_n = N √(2/Δ), acc_w = K/√Δ
    FAST-LIO      v: Δ² acc_cov        b: Δ² b_acc_cov   acc_cov = N²/Δ, b_acc_cov = K²/Δ

and likewise for gyros. VINS-Fusion adds the noise of the two samples of a step as if they were
independent of those of the next step, so that acc_n is √2 times the standard deviation of a sample.
Sources: integration_base.h of HKUST-Aerial-Robotics/VINS-Fusion (GPL-3, noise and V), and
IMU_Processing.hpp and esekfom.hpp of hku-mars/FAST_LIO (GPL-2, Q and predict), described in words.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np

from inercal.basics.errors import InputError
from inercal.basics.units import format_value_and_uncertainty, si_factor
from inercal.noise.channel_noise import SI_UNIT, coefficient_unit
from inercal.noise.filter_file import filter_text
from inercal.noise.sensor_noise import SensorNoise, TriadNoise, require_rate
from inercal.noise.terms import FLICKER_FLOOR
from inercal.physics.quantities import SensorKind

HORIZON = 100.0  # s, time over which a filter without B should be correct
_KEYS = {"N": "white", "B": "bias_instability", "K": "random_walk"}
NOISE_KEYS = tuple(_KEYS.values())
_SHORT = {"accelerometer": "acc", "gyro": "gyr"}  # in the keys of VINS-Fusion and FAST-LIO
_MARK = "# inercal noise"


def section_lines(noise: TriadNoise) -> list[str]:
    """Return the keys for [sensor.gyro] or [sensor.accelerometer], with u in comments."""
    lines: list[str] = []
    for symbol, (value, u) in noise.values.items():
        unit = coefficient_unit(symbol, noise.quantity)
        size = si_factor(unit)
        number = f"{value / size:.4g}"
        if symbol in noise.limits:
            comment = "upper limit (95 %): not detected"
        elif u is None:
            comment = f"data sheet, without u: {noise.origins[symbol]}"
        else:
            number, spread = format_value_and_uncertainty(value / size, u / size)
            comment = f"u = {spread} {unit}"
        lines.append(f'{_KEYS[symbol]} = "{number} {unit}"  # {comment}')
    return lines + [f"{_MARK}: {one}" for one in noise.notes]


def run_file_sections(noise: SensorNoise) -> dict[str, list[str]]:
    """Return the lines for each section of a run file, by section name."""
    return {f"sensor.{quantity}": section_lines(one) for quantity, one in noise.triads.items()}


def merge_sections(
    text: str, sections: dict[str, list[str]], replaced: Collection[str] = ()
) -> str:
    """Insert noise keys into the text of a run file; the same keys in its sections are replaced.

    Parameters
    ----------
    text : str
        Text of the run file; empty for a new file, which then contains only the sections.
    sections : dict of str to list of str
        Lines from `run_file_sections`.
    replaced : collection of str
        Keys to remove even if the sections do not contain them, because an earlier analysis wrote
        them.
    """
    lines = text.splitlines()
    for name, new in sections.items():
        head = f"[{name}]"
        if head not in [line.split("#")[0].strip() for line in lines]:
            lines += ["", head] if lines else [head]
            lines += new
            continue
        start = next(k for k, line in enumerate(lines) if line.split("#")[0].strip() == head)
        stop = next(
            (k for k in range(start + 1, len(lines)) if lines[k].lstrip().startswith("[")),
            len(lines),
        )
        keys = {line.split("=")[0].strip() for line in new if not line.startswith("#")}
        keys |= set(replaced)
        body = [
            line
            for line in lines[start + 1 : stop]
            if line.split("=")[0].strip() not in keys and not line.startswith(f"{_MARK}: ")
        ]
        tail = len(body)
        while tail and not body[tail - 1].strip():
            tail -= 1
        lines[start + 1 : stop] = [*body[:tail], *new, *body[tail:]]
    return "\n".join(lines) + "\n"


def walk_for_filter(
    noise: TriadNoise, horizon: float, *, is_data_sheet: bool = False
) -> tuple[float, str]:
    """Return K, SI, and a text that states where this value comes from.

    If K was measured or stated, this value is returned. Otherwise the function returns 0.664 B
    √(3/τ_h) with a horizon τ_h, s, or the upper limit of K if B is unknown. K is 0 if a data sheet
    states neither B nor K.
    """
    origin, done = ("data sheet", "stated") if is_data_sheet else ("fit", "detected")
    if "K" in noise.values and "K" not in noise.limits:
        return noise.values["K"][0], f"from the {origin}"
    if "B" in noise.values:
        value = float(np.sqrt(FLICKER_FLOOR)) * noise.values["B"][0] * np.sqrt(3 / horizon)
        return float(value), (
            f"no random walk is {done}: K from the Allan deviation of B at {horizon:g} s"
        )
    if "K" in noise.values:
        return noise.values["K"][0], "upper limit (95 %): no random walk is detected"
    return 0.0, f"neither a random walk nor a bias instability is {done}"


def _white(noise: TriadNoise, *, is_data_sheet: bool) -> float:
    if "N" in noise.values:
        return noise.values["N"][0]
    if is_data_sheet:
        raise InputError(
            f"[datasheet.{noise.quantity}] states no white noise, but other programs need it; "
            "add white or rms",
            key=f"[datasheet.{noise.quantity}] white",
        )
    raise InputError(
        f"no white noise N was found for the {noise.quantity}s, but other programs need it; "
        "fit it, for example with --terms NBK",
        key="--terms",
    )


def _absence(noise: SensorNoise) -> str:
    return "not stated" if noise.is_data_sheet else "not measured"


@dataclass(frozen=True)
class _Block:
    """Noise of one kind of sensor for an estimator: N, K and the origin of K, and the rate, Hz."""

    quantity: SensorKind
    white: float
    walk: float
    why: str
    rate: float


def _blocks(noise: SensorNoise, horizon: float, program: str) -> tuple[list[_Block], list[str]]:
    """Return the noise of the kinds of sensors that are known, and lines about the others.

    Raises
    ------
    InputError
        There are no axes, an axis has no white noise or no random walk, or there is no sampling
        rate.
    """
    blocks: list[_Block] = []
    missing: list[str] = []
    kinds: tuple[SensorKind, ...] = ("accelerometer", "gyro")
    for quantity in kinds:
        triad = noise.triads.get(quantity)
        if triad is None:
            missing.append(f"# {'gyroscope' * (quantity == 'gyro') or quantity}: {_absence(noise)}")
            continue
        rate = require_rate(triad)
        walk, why = walk_for_filter(triad, horizon, is_data_sheet=noise.is_data_sheet)
        if not walk:  # filters do not accept this
            raise InputError(
                f"[datasheet.{quantity}] states neither random_walk nor bias_instability, but "
                "Kalibr, VINS-Fusion and FAST-LIO need one of them; add it, or record the sensor "
                "at rest",
                key=f"[datasheet.{quantity}] random_walk",
            )
        white = _white(triad, is_data_sheet=noise.is_data_sheet)
        blocks.append(_Block(quantity, white, walk, why, rate))
    if not blocks:
        raise InputError(f"the analysis has no axes, so there is nothing to write for {program}")
    return blocks, missing


def kalibr_text(noise: SensorNoise, horizon: float = HORIZON) -> str:
    """Return Kalibr's imu.yaml; the densities are written as they are, without a safety factor.

    Raises
    ------
    InputError
        There are no axes, an axis has no white noise, or there is no sampling rate.
    """
    blocks, lines = _blocks(noise, horizon, "Kalibr")
    for one in blocks:
        name = "gyroscope" if one.quantity == "gyro" else one.quantity
        unit = SI_UNIT[one.quantity]
        lines += [
            f"{name}_noise_density: {one.white:.6e}  # {unit}/√Hz",
            f"{name}_random_walk: {one.walk:.6e}  # {unit}/s/√Hz; {one.why}",
        ]
    head = f"{_MARK}: Kalibr, continuous-time, of {noise.source}"
    return "\n".join([head, *lines, "rostopic: /imu0", f"update_rate: {blocks[-1].rate:.6g}", ""])


def vins_text(noise: SensorNoise, horizon: float = HORIZON) -> str:
    """Return acc_n, acc_w, gyr_n and gyr_w of VINS-Fusion; see the module docstring.

    Raises
    ------
    InputError
        There are no axes, an axis has no white noise, or there is no sampling rate.
    """
    blocks, lines = _blocks(noise, horizon, "VINS-Fusion")
    for one in blocks:
        name, unit = _SHORT[one.quantity], SI_UNIT[one.quantity].replace("²", "^2")
        lines += [
            f"{name}_n: {one.white * np.sqrt(2 * one.rate):.6e}  # {unit} at {one.rate:.6g} Hz, "
            f"sqrt(2) times the scatter of a sample, {one.white * np.sqrt(one.rate):.3g} {unit}",
            f"{name}_w: {one.walk * np.sqrt(one.rate):.6e}  # {unit}/s; {one.why}",
        ]
    return "\n".join([f"{_MARK}: VINS-Fusion, for each sample, of {noise.source}", *lines, ""])


def fast_lio_text(noise: SensorNoise, horizon: float = HORIZON) -> str:
    """Return the covariances in section `mapping` of FAST-LIO; see the module docstring.

    Raises
    ------
    InputError
        There are no axes, an axis has no white noise, or there is no sampling rate.
    """
    blocks, missing = _blocks(noise, horizon, "FAST-LIO")
    lines = [f"{_MARK}: FAST-LIO, for each sample, of {noise.source}", *missing, "mapping:"]
    for one in blocks:
        name, unit = _SHORT[one.quantity], SI_UNIT[one.quantity].replace("²", "^2")
        lines += [
            f"    {name}_cov: {one.white**2 * one.rate:.6e}  # ({unit})^2 at {one.rate:.6g} Hz",
            f"    b_{name}_cov: {one.walk**2 * one.rate:.6e}  # ({unit}/s)^2; {one.why}",
        ]
    return "\n".join([*lines, ""])


def ros_text(noise: SensorNoise, horizon: float = HORIZON) -> str:
    """Return covariances, N²/Δ for each axis, and continuous-time densities.

    They are those of sensor_msgs/Imu, and of sensor_msgs/MagneticField if there are magnetometers.

    Raises
    ------
    InputError
        The axes of one kind of sensor have no white noise, or there is no sampling rate.
    """
    messages = "sensor_msgs/Imu"
    names: dict[SensorKind, tuple[str, str]] = {
        "gyro": ("angular_velocity", "gyroscope"),
        "accelerometer": ("linear_acceleration", "accelerometer"),
    }
    if "magnetometer" in noise.triads:
        messages += " and sensor_msgs/MagneticField"
        names["magnetometer"] = "magnetic_field", "magnetometer"
    lines = [f"{_MARK}: ROS {messages}, of {noise.source}"]
    for quantity, (field, prefix) in names.items():
        triad = noise.triads.get(quantity)
        if triad is None:
            lines.append(f"{field}_covariance: [-1, 0, 0, 0, 0, 0, 0, 0, 0]  # {_absence(noise)}")
            continue
        white = _white(triad, is_data_sheet=noise.is_data_sheet)
        rate = require_rate(triad)
        axes = [one.get("N", 0.0) ** 2 * rate for one in triad.axes][:3]
        axes += [axes[-1]] * (3 - len(axes))
        x, y, z = axes
        walk, why = walk_for_filter(triad, horizon, is_data_sheet=noise.is_data_sheet)
        lines += [
            f"{field}_covariance: [{x:.6e}, 0, 0, 0, {y:.6e}, 0, 0, 0, {z:.6e}]",
            f"{prefix}_noise_density: {white:.6e}",
            f"{prefix}_random_walk: {walk:.6e}  # {why}"
            if walk
            else f"# {prefix}_random_walk: {why}",
        ]
    return "\n".join([*lines, ""])


WRITERS: dict[str, Callable[[SensorNoise, float], str]] = {
    "kalibr": kalibr_text,
    "vins_fusion": vins_text,
    "fast_lio": fast_lio_text,
    "ros": ros_text,
    "filter": filter_text,
}
"""Functions that write the files for other programs, by the program's name."""
