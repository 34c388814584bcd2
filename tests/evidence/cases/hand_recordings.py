"""Recordings by hand: six positions sample by sample, and many positions in unknown attitudes."""

import io
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from tests.accuracy import handheld
from tests.accuracy.ferraris import Imu
from tests.evidence import sensor_models
from tests.evidence.cases import hand
from tests.evidence.csv_text import csv
from tests.evidence.sensor_models import PPM
from tests.evidence.visibility_model import G0, Case, Files, Unknown, Values, Violation

Array = NDArray[np.float64]
DEGREE = np.pi / 180
EARTH = 7.292115e-5  # rad/s, WGS 84
WHITE_A, WHITE_G = 100e-6 * G0, 0.005 * DEGREE  # of a mean over one second


def npz_archive(**columns: NDArray[np.generic]) -> bytes:
    """Return an archive of columns."""
    raw = io.BytesIO()
    np.savez(raw, **columns)  # pyright: ignore[reportArgumentType]
    return raw.getvalue()


def _slow_noise(rng: np.random.Generator, n: int, hz: float, v: Values) -> Array:
    """Return noise with a memory of some seconds, (n, 3), with "of_run" about its own mean."""
    memory = v.get("memory", 1.0)
    kept = np.exp(-1 / (hz * memory))
    white = np.sqrt(1 - kept**2) * rng.standard_normal((n, 3))
    white[0] = rng.standard_normal(3)
    slow = v["slow"] * np.asarray(lfilter([1.0], [1.0, -kept], white, axis=0), dtype=float)
    return slow - slow.mean(axis=0) if v.get("of_run", 0.0) else slow


_SIX = """\
[sensor]
name = "triad"
[sensor.accelerometer]
unit = "g"
white = "100 µg/√Hz"
[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
tilt = "0.1 °"
[data]
file = "log.npz"
time = "time"
label = "part"
marks = "labels"
accelerometer = ["ax", "ay", "az"]
[method]
name = "six_position"
"""
BATCHES = 4  # of a rest, as rows
_STEP = ("x_p", "ax[x_p]")  # the section, and its channel, as a test within sections names them


def six_position() -> Case:
    """Return six rests of ten seconds at 100 Hz."""
    hz, seconds, pause = 100.0, 10.0, 2.0
    n = round(seconds * hz)
    each = n // BATCHES
    start = np.arange(6) * (seconds + pause)
    run = start[-1] + seconds

    def at(v: Values, time: Array, rest: NDArray[np.int64]) -> Array:
        """Return readings without noise at times, of samples in these rests."""
        g = hand.GRAVITY + v.get("g", 0.0)
        ups = [
            hand.rotated_up(v, hand.tilted_axis(v, "tilt", t, up)) for t, up in hand.FACES.items()
        ]
        f = g * np.array(ups)[rest]
        y = sensor_models.accelerometers(v, f, time / run - 0.5)
        late = time - start[rest] >= seconds / 2
        y[:, 0] += v.get("step", 0.0) * (late & (rest == 0))
        return y

    middle = (np.arange(BATCHES) + 0.5) * seconds / BATCHES
    times = (start[:, None] + middle).ravel()
    of_rows = np.repeat(np.arange(6), BATCHES)
    shape = (6 * BATCHES, 3)

    def readings(v: Values) -> Array:
        return at(v, times, of_rows).ravel()

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        time = (start[:, None] + np.arange(n) / hz).ravel()
        rest = np.repeat(np.arange(6), n)
        y = at(v, time, rest)
        y = y + WHITE_A * np.sqrt(hz) * rng.standard_normal(y.shape)
        if v.get("slow", 0.0):
            y = y + _slow_noise(rng, len(y), hz, v)
        y = sensor_models.mistaken(y, gross)
        names = np.array(hand.typed_labels(v, [*hand.FACES]))[rest]
        columns = {f"a{a}": y[:, k] / G0 for k, a in enumerate("xyz")}
        return {"run.toml": _SIX, "log.npz": npz_archive(time=time, part=names, **columns)}

    def clipped(y: Array) -> Array:
        """Return readings of a converter that ends a little above 1 g."""
        return np.clip(y, -G0, G0)

    noise = np.full(shape[0] * 3, WHITE_A / np.sqrt(each / hz))
    unknowns = sensor_models.triad(0.03 * G0, 0.01, 0.01) | {"g": Unknown(hand.GRAVITY_SD)}
    unknowns |= {f"tilt{k}[{t}]": Unknown(hand.TILT) for t in hand.FACES for k in (1, 2)}
    bench = tuple(one for one in hand.BENCH if "step" not in one.change)
    more = (
        Violation("step in the middle of one rest", "mg", 1e-3 * G0, {"step": 1.0}, _STEP, 1e3),
        Violation("clipping at 1 g", gross=clipped),
        sensor_models.made_otherwise("slow noise, 0.5 mg of 1 s", slow=5e-4 * G0),
    )
    left_out = sensor_models.accelerometer_violations("k2", "k3", "k1_prime", "drift")
    gross = (
        sensor_models.low_pass_filter(hz, 5.0, parts=6),
        sensor_models.rounding("5 mg", (5e-3 * G0,)),
        sensor_models.made_otherwise("two labels exchanged", exchanged=1.0),
        sensor_models.swap_columns(0, 1),
        sensor_models.reverse_axis(1),
        sensor_models.change_unit(G0),
        sensor_models.zero_channel(2),
        sensor_models.freeze_channel(2),
    )
    violations = (*bench, *more, *left_out, *gross)
    return Case(
        "six_position",
        unknowns,
        readings,
        noise,
        violations,
        files,
        shape,
        (),
        sensor_models.rival_coefficients("a"),
    )


_FREE = """\
[sensor]
name = "triad"
[sensor.accelerometer]
unit = "g"
[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
[data]
file = "means.csv"
kind = "means"
label = "position"
accelerometer = ["ax", "ay", "az"]
[data.sd]
accelerometer = "30 µg"
[method]
name = "multi_position"
"""
POSITIONS = 24
CUT = 0.45  # s of a rest at each end that finding it costs
AT_START = 0.28  # s of the first rest, whose begin is the recording's
_ALSO = {name: f'estimate it with also = ["{name}"]' for name in ("k2", "k3")}


@lru_cache(maxsize=1)
def _up_directions() -> Array:
    """Return directions up in the body, (24, 3), the same for all devices."""
    return handheld.directions(POSITIONS, np.random.default_rng(1293))


def _perpendicular_axes(u: Array) -> Array:
    """Return two unit vectors across each of u (n, 3): (n, 2, 3)."""
    first = np.cross(u, np.eye(3)[np.argmin(np.abs(u), axis=-1)])
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return np.asarray(np.stack([first, np.cross(u, first)], axis=1), dtype=float)


def _triangular(bias: float, scale: float, cross: float) -> dict[str, Unknown]:
    """Return what norms see: biases, scales, and M below its diagonal."""
    sd = {"k0": bias, "k1": scale}
    made = {f"a{a}.{n}": Unknown(s, "coefficient") for a in "xyz" for n, s in sd.items()}
    names = ("ay.delta_p", "az.delta_o", "az.delta_p")
    return made | {name: Unknown(cross, "coefficient") for name in names}


_GRAVITY = Violation(
    "gravity",
    "ppm",
    hand.GRAVITY * 1e-6,
    {"g": 1.0},
    ("g",),
    5e4,
    None,
    "state the ± of [bench] gravity; the error is common to all scale factors",
)


def multi_position_means() -> Case:
    """Return 24 attitudes that nobody knows, three accelerometers, by their means."""
    ups = _up_directions()
    across = _perpendicular_axes(ups)

    def readings(v: Values) -> Array:
        lean = [[v.get(f"aim{j}[{k}]", 0.0) for j in (1, 2)] for k in range(POSITIONS)]
        u = ups + np.einsum("kj,kji->ki", np.array(lean), across)
        u /= np.linalg.norm(u, axis=1, keepdims=True)
        place = np.linspace(-0.5, 0.5, POSITIONS)
        y = sensor_models.accelerometers(v, (hand.GRAVITY + v.get("g", 0.0)) * u, place)
        y[0, 0] += v.get("step", 0.0)
        return y.ravel()

    noise = np.full(3 * POSITIONS, hand.NOISE)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        y = sensor_models.noisy_means(readings(v), noise, rng, gross, 3)
        labels = [f"r{k + 1:02d}" for k in range(POSITIONS)]
        table = csv(("position", "ax", "ay", "az"), labels, y / G0)
        return {"run.toml": _FREE, "means.csv": table}

    unknowns = _triangular(0.03 * G0, 0.01, 0.01) | {"g": Unknown(hand.GRAVITY_SD)}
    unknowns |= {f"aim{j}[{k}]": Unknown(1e-3, "open") for k in range(POSITIONS) for j in (1, 2)}
    violations = (
        _GRAVITY,
        Violation("one outlying rest", "mg", 1e-3 * G0, {"step": 1.0}, ("r01", "ax[r01]"), 1e4),
        *sensor_models.accelerometer_violations(
            "k2", "k3", "k1_prime", "kip", "drift", counted=_ALSO
        ),
        replace(sensor_models.swap_columns(0, 1), symmetric=True),
        replace(sensor_models.reverse_axis(1), symmetric=True),
        sensor_models.change_unit(1 / G0),
        sensor_models.shift_decimal(2),
        sensor_models.zero_channel(2),
        sensor_models.freeze_channel(2),
    )
    shape = (POSITIONS, 3)
    labels = tuple(f"r{k + 1:02d}" for k in range(POSITIONS))
    return Case(
        "multi_position",
        unknowns,
        readings,
        noise,
        violations,
        files,
        shape,
        labels,
        sensor_models.rival_coefficients("a"),
    )


_IMU = """\
[sensor]
name = "IMU"
[sensor.accelerometer]
unit = "g"
white = "100 µg/√Hz"
[sensor.gyro]
unit = "°/s"
white = "0.005 °/s/√Hz"
[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
latitude = "47 °"
timebase = "100 ppm"
[data]
file = "log.npz"
time = "time"
accelerometer = ["ax", "ay", "az"]
gyro = ["gx", "gy", "gz"]
[method]
name = "multi_position"
"""
_SESSION = handheld.Session(
    positions=POSITIONS, rate_hz=100.0, gravity=hand.GRAVITY, latitude=hand.LATITUDE
)
_PATH = 7  # seed of the hand's ways, the same for all devices: η is theirs
_IDEAL = Imu(np.eye(3), np.zeros(3), np.eye(3), np.zeros(3), np.zeros((3, 3)))


# Rates of a rest weigh in its turns as 1 − t/T, t/T, and a triangle: ∫ of their products over T.
_WITHIN = np.linalg.cholesky(np.array([[4, 2, 3], [2, 4, 3], [3, 3, 4]]) / 12)
# As candidates and the test of a rest that was cut name it.
_STEP_FREE = ("change within r01", "change of ax within r01", "ax[r01]")


def _expm(v: Array) -> Array:
    """Return the rotations by vectors (..., 3)."""
    size = np.linalg.norm(v, axis=-1)[..., None, None]
    x, y, z = np.moveaxis(v, -1, 0)
    o = np.zeros_like(x)
    k = np.stack([o, -z, y, z, o, -x, -y, x, o], axis=-1).reshape(*v.shape, 3)
    half = np.sinc(size / (2 * np.pi)) ** 2 / 2
    return np.asarray(np.eye(3) + np.sinc(size / np.pi) * k + half * (k @ k), dtype=float)


def _product(turns: Array) -> Array:
    """Return the product of rotations (n, 3, 3) in their order."""
    while len(turns) > 1:
        odd = turns[-1:] if len(turns) % 2 else turns[:0]
        turns = np.concatenate([turns[: len(turns) // 2 * 2 : 2] @ turns[1::2], odd])
    return np.asarray(turns[0], dtype=float)


def multi_position(directions: Array | None = None) -> Case:
    """Return a recording of an IMU in attitudes that nobody knows; `directions` are up, (n, 3).

    η is that of a thinned problem: mean readings of halves of each rest, as far as it is found, and
    the direction up as gyros carry it from one rest to the next. A hand may turn the sensor within
    a rest: from half to half the accelerometers tilt by as much as the gyros' noise leaves open.
    """
    hz = _SESSION.rate_hz
    given = _up_directions() if directions is None else directions
    positions = len(given)
    path = handheld.record(_IDEAL, _SESSION, np.random.default_rng(_PATH), ups=given)
    data, rests = path.data[0], path.rests
    ups = path.ups[0]
    across = _perpendicular_axes(ups)
    run = len(data) / hz
    hold = (rests[0][1] - rests[0][0]) / hz - 2 * CUT
    ways = [(a[1], b[0]) for a, b in pairwise(rests)]
    exact = [_product(_expm(data[a:b, 3:] / hz)) for a, b in ways]
    # The attitude of each rest, body to a frame that stands: up is its third axis.
    first = np.concatenate([across[0], ups[:1]])
    attitudes = [first]
    for turn in exact:
        attitudes.append(attitudes[-1] @ turn)

    def swayed(v: Values, k: int) -> Array:
        """Return what a hand may turn the sensor in rest k beyond the gyros' noise, (3, 2) rad.

        From its start to its mean, from its mean to its end, and from half to half.
        """
        unit = [[v.get(f"sway{i}{j}[{k}]", 0.0) for j in (1, 2)] for i in range(3)]
        return WHITE_G * np.sqrt(hold) * _WITHIN @ np.array(unit)

    def readings(v: Values) -> Array:
        clock = 1 - v.get("timebase", 0.0)
        g = (hand.GRAVITY + v.get("g", 0.0)) / hand.GRAVITY
        phi = hand.LATITUDE + v.get("latitude", 0.0)
        more = EARTH * (np.sin(phi) - np.sin(hand.LATITUDE))
        parts: list[Array] = []
        lean = np.array([[v.get(f"aim{j}[{k}]", 0.0) for j in (1, 2)] for k in range(positions)])
        middles = np.array([[(3 * a + b) / 4, (a + 3 * b) / 4] for a, b in rests]) / hz
        level = np.array([v.get("earth_e", 0.0), v.get("earth_n", 0.0), 0.0])
        for k, (a, _) in enumerate(rests):
            f = (data[a, :3] + hand.GRAVITY * lean[k] @ across[k]) * g
            w = data[a, 3:] + more * ups[k] + attitudes[k].T @ level
            place = middles[k] / run - 0.5
            tilt = hand.GRAVITY * swayed(v, k)[2] @ across[k] / 2
            two_f, two_w = np.stack([f - tilt, f + tilt]), np.stack([w, w])
            y = sensor_models.accelerometers(v, two_f, place)
            y[1, 0] += v.get("step", 0.0) * (k == 0)
            parts += [y.ravel(), sensor_models.gyros(v, two_w, two_f, place).ravel()]
        for k, (a, b) in enumerate(ways):
            place = np.full(b - a, (a + b) / 2 / hz / run - 0.5)
            felt = sensor_models.gyros(v, data[a:b, 3:], data[a:b, :3], place)
            turn = _product(_expm(felt * clock / hz))
            off = across[k + 1] @ (turn.T @ ups[k] - ups[k + 1])
            before, after = lean[k] + swayed(v, k)[1], lean[k + 1] - swayed(v, k + 1)[0]
            off = off - across[k + 1] @ (exact[k].T @ (before @ across[k])) + after
            parts.append(off)
        return np.concatenate(parts)

    one = np.sqrt(hold / 2)
    sd = [np.repeat([WHITE_A / one, WHITE_G / one], 6)] * positions
    sd += [np.full(2, WHITE_G * np.sqrt((b - a) / hz + 2 * CUT)) for a, b in ways]
    noise = np.concatenate(sd)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        latitude = hand.LATITUDE + v.get("latitude", 0.0)
        session = handheld.replace(
            _SESSION, gravity=hand.GRAVITY + v.get("g", 0.0), latitude=latitude
        )
        made = handheld.record(_IDEAL, session, np.random.default_rng(_PATH), ups=given)
        f, w = made.data[0, :, :3], made.data[0, :, 3:]
        place = made.time / made.time[-1] - 0.5
        y = np.concatenate(
            [sensor_models.accelerometers(v, f, place), sensor_models.gyros(v, w, f, place)], axis=1
        )
        # The middle of what is found of the first rest, before which nothing moves.
        stop = made.rests[0][1]
        y[round((AT_START - CUT) * hz + stop) // 2 : stop, 0] += v.get("step", 0.0)
        y += np.repeat([WHITE_A, WHITE_G], 3) * np.sqrt(hz) * rng.standard_normal(y.shape)
        if v.get("slow", 0.0):
            y[:, :3] += _slow_noise(rng, len(y), hz, v)
        y = sensor_models.mistaken(y, gross)
        columns = {f"a{a}": y[:, k] / G0 for k, a in enumerate("xyz")}
        columns |= {f"g{a}": y[:, 3 + k] / DEGREE for k, a in enumerate("xyz")}
        time = sensor_models.drifting_clock(v, made.time / (1 + v.get("timebase", 0.0)))
        return {"run.toml": _IMU, "log.npz": npz_archive(time=time, **columns)}

    unknowns = _triangular(0.03 * G0, 0.01, 0.01)
    unknowns |= sensor_models.gyro_triad(0.5 * DEGREE, 0.01, 0.01)
    level = EARTH * np.cos(hand.LATITUDE) / np.sqrt(2)
    unknowns |= {
        "g": Unknown(hand.GRAVITY_SD),
        "timebase": Unknown(1e-4),
        "earth_e": Unknown(level),
        "earth_n": Unknown(level),
    }
    unknowns |= {f"aim{j}[{k}]": Unknown(1e-3, "open") for k in range(positions) for j in (1, 2)}
    unknowns |= {
        f"sway{i}{j}[{k}]": Unknown(1.0) for k in range(positions) for j in (1, 2) for i in range(3)
    }
    violations = (
        _GRAVITY,
        Violation(
            "timebase",
            "ppm",
            PPM,
            {"timebase": 1.0},
            ("timebase",),
            1e5,
            None,
            "state [bench] timebase; the error is common to the gyros' scale factors",
        ),
        Violation(
            "latitude",
            "°",
            DEGREE,
            {"latitude": 1.0},
            ("latitude", "earth_up"),
            90,
            None,
            "latitude left out",
        ),
        Violation(
            "step in the middle of one rest", "mg", 1e-3 * G0, {"step": 1.0}, _STEP_FREE, 1e3
        ),
        *sensor_models.accelerometer_violations("k2", "k3", "k1_prime", "drift", counted=_ALSO),
        *sensor_models.gyro_violations("g", "scale_prime", "drift"),
        sensor_models.made_otherwise("slow noise, 0.5 mg of 1 s", slow=5e-4 * G0),
        sensor_models.low_pass_filter(hz, 5.0),
        sensor_models.rounding("5 mg, 0.5 °/s", (*3 * [5e-3 * G0], *3 * [0.5 * DEGREE])),
        sensor_models.late_columns(round(0.2 * hz), slice(3, 6), "gyros late by 0.2 s"),
        sensor_models.made_otherwise("clock that drifts by 0.4 % in the run", clock=0.004),
        sensor_models.swap_columns(0, 1),
        sensor_models.reverse_axis(4),
        sensor_models.change_unit(180 / np.pi, slice(3, 6)),
        sensor_models.zero_channel(5),
        sensor_models.freeze_channel(5),
    )
    return Case(
        "multi_position",
        unknowns,
        readings,
        noise,
        violations,
        files,
        rivals=sensor_models.rival_coefficients("ag"),
    )
