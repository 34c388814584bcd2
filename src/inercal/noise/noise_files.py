"""A noise analysis for other programs: run-file sections, Kalibr's imu.yaml, ROS covariances.

A triad has one value for all axes: the root mean square over its axes. Kalibr's numbers are
continuous-time: N in rad/s/√Hz and m/s²/√Hz, K in rad/s²/√Hz and m/s³/√Hz.
"""

from dataclasses import dataclass

import numpy as np

from inercal.errors import InputError
from inercal.noise.channel_noise import SI_UNIT, ChannelNoise, NoiseAnalysis, Quantity
from inercal.noise.terms import FLICKER_FLOOR
from inercal.units import format_value_and_uncertainty, si_factor

HORIZON = 100.0  # s, over which a filter without B is to be right
MARKOV_PEAK = 0.617  # of σ: the largest Allan deviation of a Gauss–Markov process
_KEYS = {"N": "white", "B": "bias_instability", "K": "random_walk"}
_UNITS: dict[Quantity, dict[str, str]] = {
    "gyro": {"N": "°/√h", "B": "°/h", "K": "°/h/√s"},
    "accelerometer": {"N": "µg/√Hz", "B": "µg", "K": "µg/√s"},
}
_MARK = "# inercal noise"


@dataclass(frozen=True)
class TriadNoise:
    """Noise of the axes of one kind, SI: root mean squares over the axes.

    Parameters
    ----------
    quantity : "gyro" or "accelerometer"
    values : dict of symbol to (value, u)
        N, B and K; without those that no axis shows.
    notes : tuple of str
        Origin of a value that is not a coefficient of an axis.
    rate_hz : float
    """

    quantity: Quantity
    values: dict[str, tuple[float, float]]
    notes: tuple[str, ...]
    rate_hz: float


def triad_noise(analysis: NoiseAnalysis, quantity: Quantity) -> TriadNoise | None:
    """Return the noise of the axes of one kind; None without such axes.

    A Gauss–Markov process counts as a bias instability of equal peak, B = 0.617 σ/0.664.
    """
    axes = analysis.of(quantity)
    if not axes:
        return None
    values: dict[str, tuple[float, float]] = {}
    notes: list[str] = []
    for symbol in _KEYS:
        pairs = [_pair(one, symbol) for one in axes]
        if not any(value for value, _ in pairs):
            continue
        squares = np.array([value**2 for value, _ in pairs])
        mean = float(np.sqrt(squares.mean()))
        sums = sum((value * u) ** 2 for value, u in pairs if value)
        values[symbol] = mean, float(np.sqrt(sums)) / (len(pairs) * mean)
    for one in axes:
        if one.value("G"):
            notes.append(
                f"{one.channel}: Gauss–Markov process with a time constant of "
                f"{one.value('T'):.3g} s, stated as the bias instability of equal peak"
            )
    return TriadNoise(quantity, values, tuple(notes), 1 / axes[0].dt)


def _pair(channel: ChannelNoise, symbol: str) -> tuple[float, float]:
    found = channel.coefficient(symbol)
    if symbol == "B" and (markov := channel.coefficient("G")) is not None and markov.value:
        factor = MARKOV_PEAK / float(np.sqrt(FLICKER_FLOOR))
        value = 0.0 if found is None else found.value
        total = float(np.hypot(value, factor * markov.value))
        return total, factor * markov.u
    if found is None or not found.value:
        return 0.0, 0.0
    return found.value, found.u


def section_lines(noise: TriadNoise) -> list[str]:
    """Return the keys of [sensor.gyro] or [sensor.accelerometer] with ± u as comments."""
    lines: list[str] = []
    for symbol, (value, u) in noise.values.items():
        unit = _UNITS[noise.quantity][symbol]
        size = si_factor(unit)
        number, spread = format_value_and_uncertainty(value / size, u / size)
        lines.append(f'{_KEYS[symbol]} = "{number} {unit}"  # u = {spread} {unit}')
    return lines + [f"# {one}" for one in noise.notes]


def run_file_sections(analysis: NoiseAnalysis) -> dict[str, list[str]]:
    """Return the lines of each section of a run file, by its name."""
    found: dict[str, list[str]] = {}
    quantities: tuple[Quantity, ...] = ("accelerometer", "gyro")
    for quantity in quantities:
        noise = triad_noise(analysis, quantity)
        if noise is not None:
            found[f"sensor.{quantity}"] = section_lines(noise)
    return found


def merge_sections(text: str, sections: dict[str, list[str]]) -> str:
    """Return the text of a run file with these lines in its sections, in place of the same keys.

    Parameters
    ----------
    text : str
        Empty for a new file, which then holds the sections alone.
    sections : dict of str to list of str
        Of `run_file_sections`.
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
        body = [line for line in lines[start + 1 : stop] if line.split("=")[0].strip() not in keys]
        tail = len(body)
        while tail and not body[tail - 1].strip():
            tail -= 1
        lines[start + 1 : stop] = [*body[:tail], *new, *body[tail:]]
    return "\n".join(lines) + "\n"


def walk_for_filter(noise: TriadNoise, horizon: float) -> tuple[float, str]:
    """Return K, SI, and its origin: the fit, or K = 0.664 B √(3/τ_h) of a horizon τ_h, s."""
    if "K" in noise.values:
        return noise.values["K"][0], "from the fit"
    if "B" in noise.values:
        value = float(np.sqrt(FLICKER_FLOOR)) * noise.values["B"][0] * np.sqrt(3 / horizon)
        return float(value), (
            f"no random walk is seen: K with the Allan deviation of B at {horizon:g} s"
        )
    return 0.0, "neither a random walk nor a bias instability is seen"


def _white(noise: TriadNoise) -> float:
    if "N" not in noise.values:
        raise InputError(
            f"no white noise N was found for the {noise.quantity}s, which Kalibr and ROS need: fit "
            "it, as by --terms NBK",
            key="--terms",
        )
    return noise.values["N"][0]


def kalibr_text(analysis: NoiseAnalysis, horizon: float = HORIZON) -> str:
    """Return Kalibr's imu.yaml, with densities as measured: nothing is inflated.

    Raises
    ------
    InputError
        There is no axis to write, or one without white noise.
    """
    lines = [f"{_MARK}: Kalibr, continuous-time, of {analysis.source or 'a recording'}"]
    rate = 0.0
    names: dict[Quantity, str] = {"accelerometer": "accelerometer", "gyro": "gyroscope"}
    for quantity, name in names.items():
        unit = SI_UNIT[quantity]
        noise = triad_noise(analysis, quantity)
        if noise is None:
            lines.append(f"# the recording has no {name}")
            continue
        rate = noise.rate_hz
        walk, why = walk_for_filter(noise, horizon)
        lines += [
            f"{name}_noise_density: {_white(noise):.6e}  # {unit}/√Hz",
            f"{name}_random_walk: {walk:.6e}  # {unit}/s/√Hz; {why}",
        ]
    if not rate:
        raise InputError("the analysis has no axes: nothing to write for Kalibr")
    return "\n".join([*lines, "rostopic: /imu0", f"update_rate: {rate:.6g}", ""])


def ros_text(analysis: NoiseAnalysis, horizon: float = HORIZON) -> str:
    """Return covariances of sensor_msgs/Imu, N² Δ⁻¹ of each axis, and continuous-time densities.

    Raises
    ------
    InputError
        A kind of axes has no white noise.
    """
    lines = [f"{_MARK}: ROS sensor_msgs/Imu, of {analysis.source or 'a recording'}"]
    names: dict[Quantity, tuple[str, str]] = {
        "gyro": ("angular_velocity", "gyroscope"),
        "accelerometer": ("linear_acceleration", "accelerometer"),
    }
    for quantity, (field, prefix) in names.items():
        noise = triad_noise(analysis, quantity)
        if noise is None:
            lines.append(f"{field}_covariance: [-1, 0, 0, 0, 0, 0, 0, 0, 0]  # not measured")
            continue
        axes = [one.value("N") ** 2 / one.dt for one in analysis.of(quantity)][:3]
        axes += [axes[-1]] * (3 - len(axes))
        x, y, z = axes
        walk, why = walk_for_filter(noise, horizon)
        lines += [
            f"{field}_covariance: [{x:.6e}, 0, 0, 0, {y:.6e}, 0, 0, 0, {z:.6e}]",
            f"{prefix}_noise_density: {_white(noise):.6e}",
            f"{prefix}_random_walk: {walk:.6e}  # {why}",
        ]
    return "\n".join([*lines, ""])
