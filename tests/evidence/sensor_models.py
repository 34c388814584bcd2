"""Readings of accelerometers and gyros from the model equations of IEEE Std 1293 and 952.

Nothing of inercal is imported. Seen from axis I, P and O follow cyclically. Coefficients by name in
SI, such as "ax.k3"; those missing are zero. A drift is the change of a bias over the whole run.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from tests.evidence.visibility_model import G0, Unknown, Values, Violation

Array = NDArray[np.float64]
UG, PPM, ARCSEC = 1e-6 * G0, 1e-6, np.pi / 648_000
DEG_H = np.pi / 180 / 3600
AXES = "xyz"


def accelerometers(v: Values, f: Array, place: Array | None = None) -> Array:
    """Return readings (r, 3) of specific force (r, 3), m/s².

    `place` is where each row stands in the run, −½ to ½; without it there is no drift. A drift is
    linear, or with "settling" exponential with this share of the run as its time constant.
    """
    y = np.empty_like(f)
    if place is not None and v.get("settling", 0.0):
        place = settling_course(place, v["settling"])
    for i, axis in enumerate(AXES):
        own, p, o = f[:, i], f[:, (i + 1) % 3], f[:, (i + 2) % 3]
        at = f"a{axis}."

        def c(name: str, at: str = at) -> float:
            return v.get(at + name, 0.0)

        y[:, i] = (
            own
            + c("k0")
            + c("k1") * own
            + c("delta_o") * p
            - c("delta_p") * o
            + c("k2") * own**2
            + c("k3") * own**3
            + c("koq") * np.abs(own) * own
            + c("k0_prime") * 0.5 * np.sign(own)
            + c("k1_prime") * 0.5 * np.abs(own)
            + c("kip") * own * p
            + c("kio") * own * o
            + c("kpo") * p * o
            + c("kpp") * p**2
            + c("koo") * o**2
        )
        if place is not None:
            y[:, i] += c("drift") * place
    return y


def settling_course(place: Array, constant: float) -> Array:
    """Return an exponential course over a run, −½ to ½: its mean is zero, it rises by one."""
    whole = -np.expm1(-1 / constant)
    return np.asarray((constant * whole - np.exp(-(place + 0.5) / constant)) / whole, dtype=float)


def gyros(v: Values, w: Array, f: Array, place: Array | None = None) -> Array:
    """Return readings (r, 3) of rates (r, 3), rad/s, under specific force."""
    y = np.empty_like(w)
    for i, axis in enumerate(AXES):
        p, o = (i + 1) % 3, (i + 2) % 3
        at = f"g{axis}."

        def c(name: str, at: str = at) -> float:
            return v.get(at + name, 0.0)

        y[:, i] = (
            w[:, i] * (1 + c("scale"))
            + c("bias")
            + c("delta_o") * w[:, p]
            - c("delta_p") * w[:, o]
            + c("scale_prime") * 0.5 * np.abs(w[:, i])
            + c("scale2") * w[:, i] ** 2
            + c("g_i") * f[:, i]
            + c("g_p") * f[:, p]
            + c("g_o") * f[:, o]
        )
        if place is not None:
            y[:, i] += c("drift") * place
    return y


def triad(bias: float, scale: float, cross: float) -> dict[str, Unknown]:
    """Return the twelve coefficients of three accelerometers: deviations in SI."""
    sd = {"k0": bias, "k1": scale, "delta_o": cross, "delta_p": cross}
    return {f"a{a}.{n}": Unknown(s, "coefficient") for a in AXES for n, s in sd.items()}


def gyro_triad(
    bias: float, scale: float, cross: float, by_g: float | None = None
) -> dict[str, Unknown]:
    """Return the twelve coefficients of three gyros, or with g-sensitivity 21."""
    sd = {"bias": bias, "scale": scale, "delta_o": cross, "delta_p": cross}
    if by_g is not None:
        sd |= dict.fromkeys(("g_i", "g_p", "g_o"), by_g)
    return {f"g{a}.{n}": Unknown(s, "coefficient") for a in AXES for n, s in sd.items()}


def common_change(kind: str, name: str, size: float = 1.0) -> dict[str, float]:
    """Return a change of one coefficient of all three axes alike."""
    return {f"{kind}{a}.{name}": size for a in AXES}


def rival_coefficients(kinds: str, *estimated: str) -> dict[str, tuple[str, ...]]:
    """Return the coefficients that could be suspected, all axes together, but those estimated.

    `kinds` is "a", "g" or both.
    """
    names = {
        "a": ("k2", "k3", "koq", "k1_prime", "kip", "kio", "kpo", "kpp", "koo", "drift"),
        "g": ("scale_prime", "scale2", "g_i", "g_p", "g_o", "drift"),
    }
    words = {"a": "drift of accelerometers", "g": "drift of gyros"}
    return {
        words[kind] if name == "drift" else name: tuple(f"{kind}{a}.{name}" for a in AXES)
        for kind in kinds
        for name in names[kind]
        if name not in estimated
    }


NO_KEY = "the run file has no key for it; use the limit in the data sheet"
_OTHER_METHODS = "or estimate it with tumble, centrifuge_norm, or multi_position with `also`"
NO_KEYS = {
    "k2": f"{NO_KEY}, {_OTHER_METHODS}",
    "k3": f"{NO_KEY}, {_OTHER_METHODS}",
    "drift": (
        "repeat the first position at the end; for a recording, state [sensor] bias_instability"
    ),
}
NO_GYRO_KEY = f"{NO_KEY}, or measure at several constant rates"


def accelerometer_violations(
    *left_out: str, counted: Mapping[str, str] | None = None
) -> tuple[Violation, ...]:
    """Return what accelerometers may have that is left out, all axes alike, by short name.

    `counted` says by name what counts it in U, where that is not `NO_KEY`.
    """
    keys = dict(counted or {})
    said = dict.fromkeys(left_out, NO_KEY) | NO_KEYS | keys
    known = {
        "k2": ("second-order nonlinearity k2", "µg/g²", UG / G0**2, 1e5),
        "k3": ("third-order nonlinearity k3", "µg/g³", UG / G0**3, 1e5),
        "koq": ("odd quadratic nonlinearity", "µg/g²", UG / G0**2, 1e5),
        "k0_prime": ("asymmetry of the bias", "µg", UG, 1e5),
        "k1_prime": ("asymmetry of the scale factor", "ppm", PPM, 2e5),
        "kip": ("cross-axis nonlinearity", "µg/g²", UG / G0**2, 1e5),
        "kpo": ("cross-coupling P–O", "µg/g²", UG / G0**2, 1e5),
        "delta_o": ("non-orthogonality", "″", ARCSEC, 36_000),
    }
    made: list[Violation] = []
    for name in left_out:
        if name == "drift":
            change, suspects = (
                common_change("a", "drift"),
                ("drift of accelerometers", *_coefficient_violations("a")),
            )
            made.append(
                Violation(
                    "drift of the accelerometers",
                    "µg",
                    UG,
                    change,
                    suspects,
                    1e5,
                    None,
                    said["drift"],
                    limit="drift of accelerometers",
                )
            )
            continue
        words, unit, si, most = known[name]
        suspects = (name, *common_change("a", name))
        if name == "delta_o":
            suspects += ("delta_p", *common_change("a", "delta_p"))
        limit = "" if name in keys else name
        made.append(
            Violation(
                words,
                unit,
                si,
                common_change("a", name),
                suspects,
                most,
                None,
                said[name],
                limit=limit,
            )
        )
    return tuple(made)


def gyro_violations(*left_out: str) -> tuple[Violation, ...]:
    """Return what gyros may have that is left out."""
    made: list[Violation] = []
    for name in left_out:
        if name == "drift":
            change, suspects = (
                common_change("g", "drift"),
                ("drift of gyros", *_coefficient_violations("g")),
            )
            made.append(
                Violation(
                    "drift of the gyros",
                    "°/h",
                    DEG_H,
                    change,
                    suspects,
                    1e6,
                    None,
                    NO_KEYS["drift"],
                    limit="drift of gyros",
                )
            )
        elif name == "scale_prime":
            change = common_change("g", name)
            words = "asymmetry of the gyros' scale factor"
            suspects = (name, *change)
            made.append(
                Violation(words, "ppm", PPM, change, suspects, 2e5, None, NO_GYRO_KEY, limit=name)
            )
        elif name == "g":
            change = (
                common_change("g", "g_i") | common_change("g", "g_p") | common_change("g", "g_o")
            )
            suspects = ("g_i", "g_p", "g_o", *change)
            words = "sensitivity of the gyros to acceleration"
            also = 'also = ["g"]'
            made.append(Violation(words, "°/h/g", DEG_H / G0, change, suspects, 1e6, None, also))
        elif name == "scale2":
            change = common_change("g", name)
            words = "second-order nonlinearity of the gyros"
            suspects = (name, *change)
            made.append(
                Violation(
                    words,
                    "ppm/(rad/s)",
                    PPM,
                    change,
                    suspects,
                    1e6,
                    None,
                    NO_GYRO_KEY,
                    limit=name,
                )
            )
    return tuple(made)


def _coefficient_violations(kind: str) -> tuple[str, ...]:
    return tuple(f"drift of {kind}{a}" for a in AXES)


def mistaken(y: Array, gross: Violation | None) -> Array:
    """Return readings (..., m) with a violation that has no size; others change nothing here."""
    return y if gross is None or gross.gross is None else gross.gross(y)


def noisy_means(
    exact: Array, noise: Array, rng: np.random.Generator, gross: Violation | None, channels: int
) -> Array:
    """Return mean readings (r, channels): exact ones (r * channels,), noise, and a mistake."""
    y = exact + noise * rng.standard_normal(noise.size)
    return mistaken(y.reshape(-1, channels), gross)


def swap_columns(first: int, second: int) -> Violation:
    """Return two columns in each other's place."""

    def change(y: Array) -> Array:
        y = y.copy()
        y[..., [first, second]] = y[..., [second, first]]
        return y

    return Violation("swapped axes", gross=change, limit="exchanged")


def reverse_axis(axis: int) -> Violation:
    """Return one column of the other sign."""

    def change(y: Array) -> Array:
        y = y.copy()
        y[..., axis] *= -1
        return y

    return Violation("reversed axis", gross=change, limit="reversed axis")


def change_unit(factor: float, columns: slice = slice(None)) -> Violation:
    """Return readings that are in another unit than declared."""

    def change(y: Array) -> Array:
        y = y.copy()
        y[..., columns] *= factor
        return y

    return Violation("wrong unit", gross=change)


def shift_decimal(row: int) -> Violation:
    """Return a row whose readings have lost a decimal place."""

    def change(y: Array) -> Array:
        y = y.copy()
        y[row, np.argmax(np.abs(y[row]))] *= 10
        return y

    return Violation("decimal shift in one row", gross=change)


def keep_readings(y: Array) -> Array:
    """Return the readings as they are: what is wrong is in how they were made."""
    return y


def made_otherwise(words: str, **change: float) -> Violation:
    """Return a violation of fixed size: how the device or its files are made, by these values."""
    return Violation(words, change=change, gross=keep_readings)


def low_pass_filter(hz: float, cutoff_hz: float, parts: int = 1) -> Violation:
    """Return readings (n, m), sampled at hz, after a filter of first order in the sensor.

    The filter has settled at the begin of each of the parts, which are equally long.
    """
    kept = np.exp(-2 * np.pi * cutoff_hz / hz)

    def change(y: Array) -> Array:
        made = [
            lfilter([1 - kept], [1.0, -kept], part, axis=0, zi=kept * part[:10].mean(0)[None])[0]
            for part in np.split(y, parts)
        ]
        return np.concatenate(made)

    return Violation(f"low-pass filter, {cutoff_hz:g} Hz", gross=change)


def rounding(words: str, steps: tuple[float, ...]) -> Violation:
    """Return readings (n, m) rounded to whole multiples of a step of each channel."""

    def change(y: Array) -> Array:
        return np.asarray(np.round(y / steps) * steps, dtype=float)

    return Violation(f"rounding to {words}", gross=change)


def drifting_clock(v: Values, time: Array) -> Array:
    """Return times of a clock whose rate changes steadily by "clock" from start to end."""
    return time + v.get("clock", 0.0) * time * (time / time[-1] - 1) / 2


def typed_rates(v: Values, rates: Array) -> Array:
    """Return rates as somebody typed them: the first of the largest may be wrong by a part."""
    return rates * (1 + v.get("typed", 0.0) * (np.arange(len(rates)) == np.argmax(rates)))


def late_columns(samples: int, columns: slice, words: str) -> Violation:
    """Return readings (n, m) some of whose columns are some samples late."""

    def change(y: Array) -> Array:
        y = y.copy()
        y[samples:, columns] = y[:-samples, columns]
        return y

    return Violation(words, gross=change)


def freeze_channel(axis: int) -> Violation:
    """Return a channel that reads the same throughout."""

    def change(y: Array) -> Array:
        y = y.copy()
        y[..., axis] = y[..., 0, axis]
        return y

    return Violation("constant channel", gross=change)


def zero_channel(axis: int) -> Violation:
    """Return a channel that reads zero throughout."""

    def change(y: Array) -> Array:
        y = y.copy()
        y[..., axis] = 0.0
        return y

    return Violation("dead channel", gross=change)
