"""An IMU on a three-axis turntable: a recording, and a thinned problem for η.

The path and its moves are those of `tests.accuracy.turntable`. The readback is taken at its word,
and the true angles are off by what the bench may be off by: harmonics, right angles, lean, azimuth,
latency. η is that of mean forces over each hold and mean rates over segments of up to a second,
whose noise is white plus flicker; an approximation, whose uncertainties are within a tenth of
inercal's.
"""

from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from tests.accuracy.turntable import TEN, Stand, Table, Turn, rotation_about, simulate_travel
from tests.evidence import sensor_models
from tests.evidence.cases.hand_recordings import npz_archive
from tests.evidence.sensor_models import ARCSEC, DEG_H
from tests.evidence.visibility_model import G0, Case, Files, Unknown, Values, Violation

Array = NDArray[np.float64]
DEGREE = np.pi / 180
EARTH = 7.292115e-5  # rad/s, WGS 84
GRAVITY, GRAVITY_SD, LATITUDE = 9.80123, 1e-5, 38 * DEGREE
HZ, THIN = 50.0, 5
# rad/s³. Accelerations that begin exactly at a sample, all of them, would leave what rates miss
# within a sample with one sign: no table does so, and scale factors would show it.
JERK = 300 * DEGREE
WHITE_A, WHITE_G = 60e-6 * G0, 0.1 * DEGREE / 60  # per √Hz
FLICKER_A, FLICKER_G = 15e-6 * G0, 0.5 * DEG_H
TIMES = 10.0 ** np.arange(-0.5, 5.0, 0.5)  # s, of Gauss–Markov processes that sum to flicker
_ALSO = {"k2": 'also = ["k2"]'}
NAMES = ("outer", "middle", "inner")
HARMONICS = ((1, 2 * ARCSEC), (2, 1 * ARCSEC))
_RUN = """\
[sensor]
name = "IMU"
[sensor.accelerometer]
unit = "g"
white = "{vrw}"
bias_instability = "{acc_instability}"
[sensor.gyro]
unit = "°/s"
white = "{arw}"
bias_instability = "{gyro_instability}"
[bench]
kind = "turntable"
gravity = "9.80123 m/s² ± 10 µm/s²"
latitude = "38 °"
azimuth = "0 ° ± 0.1 °"
lean = "5 ″"
square = "2 ″"
harmonics = ["2 ″", "1 ″"]
noise = "0.5 ″"
latency = "0 ms ± 5 ms"
[data]
file = "log.npz"
time = "time"
accelerometer = ["ax", "ay", "az"]
gyro = ["gx", "gy", "gz"]
table = ["outer", "middle", "inner"]
label = "step"
[method]
name = "{method}"
path = "path.csv"
"""
Path = list[Stand | Turn]


def fast() -> Path:
    """Return ten positions and a turn there and back about each axis: five minutes."""
    path: Path = [("warm-up", (0, 0, 0), 30.0)]
    path += [(f"p{k + 1}", angles, 10.0) for k, angles in enumerate(TEN)]
    for name, axis in (("x", 1), ("y", 2), ("z", 0)):
        if axis == 1:
            path.append(("home", (0, 0, 0), 3.0))
        path += [(f"{name}+", axis, 360.0, 30.0), (f"{name}-", axis, -360.0, 30.0)]
    return [*path, ("rest", (0, 0, 0), 20.0)]


SIX = {
    "z_p": (0, 0, 0), "y_p": (0, 90, 0), "z_a": (0, 180, 0), "y_a": (0, 270, 0),
    "x_a": (0, 0, 90), "x_p": (0, 0, -90),
}  # fmt: skip


def discrete() -> Path:
    """Return six positions with a turn there and back about the vertical in each."""
    path: Path = [("warm-up", (0, 0, 0), 30.0)]
    for name, (outer, middle, inner) in SIX.items():
        path.append((name, (float(outer), float(middle), float(inner)), 20.0))
        path += [(f"{name}+", 0, 360.0, 30.0), (f"{name}-", 0, -360.0, 30.0)]
    return path


def run_text(
    method: str,
    arw: str = "0.1 °/√h",
    vrw: str = "60 µg/√Hz",
    gyro_instability: str = "0.5 °/h",
    acc_instability: str = "15 µg",
) -> str:
    """Return the run file of a method, with the noise of its sensor."""
    return _RUN.format(
        method=method,
        arw=arw,
        vrw=vrw,
        gyro_instability=gyro_instability,
        acc_instability=acc_instability,
    )


def path_text(path: Path) -> str:
    """Return a path as the file of steps that a run names."""
    rows = ["label,kind,outer [°],middle [°],inner [°],seconds [s],axis,angle [°],rate [°/s]"]
    for step in path:
        if len(step) == 3:
            label, angles, seconds = step
            rows.append(f"{label},position,{','.join(f'{a:g}' for a in angles)},{seconds:g},,,")
        else:
            label, axis, angle, rate = step
            rows.append(f"{label},rotation,,,,,{NAMES[axis]},{angle:g},{rate:g}")
    return "\n".join(rows) + "\n"


def _typed_path(v: Values, path: Path) -> Path:
    """Return the path as somebody typed it: the middle angle of the second hold may be wrong."""
    typed: Path = []
    for step in path:
        if len(step) == 3 and sum(len(one) == 3 for one in typed) == 1:
            label, (outer, middle, inner), seconds = step
            step = (label, (outer, middle + v.get("typed", 0.0), inner), seconds)
        typed.append(step)
    return typed


def readback(v: Values, angles: Array) -> Array:
    """Return what the table says, without noise, at angles (n, 3)."""
    said = angles.copy()
    for k, name in enumerate(NAMES):
        for h in (1, 2, 3):
            said[:, k] += v.get(f"sin{h}[{name}]", 0.0) * np.sin(h * angles[:, k])
            said[:, k] += v.get(f"cos{h}[{name}]", 0.0) * np.cos(h * angles[:, k])
    return said


def sensed_motion(v: Values, true: Array, speed: Array) -> tuple[Array, Array]:
    """Return specific force and rate in the body, (n, 3) each, at true angles and speeds (n, 3)."""
    tilted = rotation_about(0, np.array(v.get("lean_x", 0.0))) @ rotation_about(
        1, np.array(v.get("lean_y", 0.0))
    )
    tilted = tilted @ rotation_about(2, np.array(-v.get("azimuth", 0.0)))
    inner = rotation_about(2, np.array(v.get("square_2", 0.0))) @ rotation_about(1, true[:, 2])
    middle = (
        rotation_about(1, np.array(v.get("square_1", 0.0))) @ rotation_about(0, true[:, 1]) @ inner
    )
    mat = tilted @ rotation_about(2, true[:, 0]) @ middle
    phi = LATITUDE + v.get("latitude", 0.0)
    back = np.swapaxes(mat, 1, 2)
    w = back @ (EARTH * np.array([0.0, np.cos(phi), np.sin(phi)]))
    w += speed[:, :1] * middle[:, 2] + speed[:, 1:2] * inner[:, 0]
    w[:, 1] += speed[:, 2]
    return (GRAVITY + v.get("g", 0.0)) * mat[:, 2], w


def noise_free_readings(v: Values, true: Array, speed: Array) -> Array:
    """Return readings without noise, (n, 6)."""
    f, w = sensed_motion(v, true, speed)
    place = np.linspace(-0.5, 0.5, len(true))
    both = sensor_models.accelerometers(v, f, place), sensor_models.gyros(v, w, f, place)
    return np.concatenate(both, axis=1)


def flicker_variance(size: float) -> float:
    """Return the variance of each of the processes whose sum has the Allan floor of `size`.

    Flicker h/f (one-sided) has the Allan variance 2 ln 2 h, and B the floor √(2 ln 2/π) B (IEEE Std
    952, annex C): h = B²/π. Processes of variance σ² at times of ratio r sum to σ²/(ln r f).
    """
    return size**2 * np.log(TIMES[1] / TIMES[0]) / np.pi


def flicker(rng: np.random.Generator, n: int, hz: float, size: float) -> Array:
    """Return flicker noise (n, 3) about its mean, as a sum of Gauss–Markov processes.

    The bias of a run is the mean of what drifts over it: flicker has no other.
    """
    made = np.zeros((n, 3))
    for tau in TIMES:
        kept = np.exp(-1 / (hz * tau))
        noise = np.sqrt(1 - kept**2) * rng.standard_normal((n, 3))
        noise[0] = rng.standard_normal(3)
        one = np.asarray(lfilter([1.0], [1.0, -kept], noise, axis=0), dtype=float)
        made += np.sqrt(flicker_variance(size)) * one
    return made - made.mean(axis=0)


def covariance(start: Array, stop: Array, white: float, size: float, run: float) -> Array:
    """Return the covariance (r, r) of means over intervals: white noise and flicker.

    Of a process of covariance C the means over a to b and c to d have
    (G(d − a) + G(c − b) − G(d − b) − G(c − a))/((b − a)(d − c)), G″ = C; flicker is that about its
    mean over the run.
    """
    a, b = np.append(start, 0.0)[:, None], np.append(stop, run)[:, None]
    c, d = a.T, b.T
    whole = np.zeros((len(start) + 1,) * 2)
    for tau in TIMES:

        def g(u: Array, tau: float = tau) -> Array:
            return tau * np.abs(u) + tau**2 * np.expm1(-np.abs(u) / tau)

        whole += (g(d - a) + g(c - b) - g(d - b) - g(c - a)) / ((b - a) * (d - c))
    about = np.eye(len(start), len(start) + 1)
    about[:, -1] = -1.0
    made = flicker_variance(size) * about @ whole @ about.T
    return np.asarray(made + np.diag(white**2 / (stop - start)), dtype=float)


@cache
def _travelled_path(which: str) -> tuple[Array, NDArray[np.str_]]:
    path = fast() if which == "fast" else discrete()
    angles, _, _, labels = simulate_travel(path, Table(jerk=JERK), HZ)
    return angles, labels


def _segments(labels: NDArray[np.str_], *, moves: bool) -> list[tuple[int, int, bool]]:
    """Return first and last sample and whether the table holds: turns and moves in short parts."""
    edges = [0, *(np.flatnonzero(labels[1:] != labels[:-1]) + 1), len(labels)]
    made: list[tuple[int, int, bool]] = []
    for a, b in pairwise(edges):
        name = labels[a]
        if name and name[-1] not in "+-":
            made.append((a, b, True))
            continue
        if not name and not moves:
            continue
        count = max(1, round((b - a) / HZ))
        cuts = np.linspace(a, b, count + 1).round().astype(int).tolist()
        made += [(x, y, False) for x, y in pairwise(cuts)]
    return [(a, b, held) for a, b, held in made if b - a >= 2 * THIN]


def _case(method: str, which: str, *, whole_turns: bool = False) -> Case:
    angles, labels = _travelled_path(which)
    path = fast() if which == "fast" else discrete()
    n = len(angles)
    segments = _segments(labels, moves=not whole_turns)
    if whole_turns:  # one row for each turn
        merged: list[tuple[int, int, bool]] = []
        for a, b, held in segments:
            if not held and merged and not merged[-1][2] and labels[merged[-1][0]] == labels[a]:
                merged[-1] = (merged[-1][0], b, False)
            else:
                merged.append((a, b, held))
        segments = merged
    start, stop = (np.array([s[k] for s in segments]) / HZ for k in (0, 1))
    held = np.array([s[2] for s in segments])
    thin = angles[THIN // 2 :: THIN]
    pace = np.gradient(thin, THIN / HZ, axis=0)
    of = np.full(n, -1)
    for k, (a, b, _) in enumerate(segments):
        of[a:b] = k
    of = of[THIN // 2 :: THIN]
    count = np.bincount(of[of >= 0], minlength=len(segments))

    def means(y: Array) -> Array:
        """Return means over segments, (segments, 6)."""
        sums = np.zeros((len(segments), y.shape[1]))
        np.add.at(sums, of[of >= 0], y[of >= 0])
        return sums / count[:, None]

    def readings(v: Values) -> Array:
        # The readback is taken at its word: the true angles are off the other way.
        true = thin - (readback(v, thin) - thin) + v.get("latency", 0.0) * pace
        y = means(noise_free_readings(v, true, np.gradient(true, THIN / HZ, axis=0)))
        y[0, 0] += v.get("step", 0.0)
        return np.concatenate([y[held, :3].T.ravel(), y[:, 3:].T.ravel()])

    run = n / HZ
    a = covariance(start[held], stop[held], WHITE_A, FLICKER_A, run)
    w = covariance(start, stop, WHITE_G, FLICKER_G, run)
    noise = np.zeros((3 * (len(a) + len(w)),) * 2)
    at = 0
    for block in (a, a, a, w, w, w):
        noise[at : at + len(block), at : at + len(block)] = block
        at += len(block)

    def files(v: Values, rng: np.random.Generator, gross: Violation | None) -> Files:
        table = Table(latency=v.get("latency", 0.0), jerk=JERK)
        true, speed, late, steps = simulate_travel(path, table, HZ)
        n = len(true)
        y = noise_free_readings(v, true, speed)
        drifts = 1 + v.get("flicker", 0.0)
        for part, white, size in (
            (slice(0, 3), WHITE_A, FLICKER_A),
            (slice(3, 6), WHITE_G, FLICKER_G),
        ):
            y[:, part] += white * np.sqrt(HZ) * rng.standard_normal((n, 3))
            y[:, part] += flicker(rng, n, HZ, size * drifts)
        said = readback(v, late) + 0.5 * ARCSEC * rng.standard_normal((n, 3))
        y = sensor_models.mistaken(y, gross)
        columns = {f"a{x}": y[:, k] / G0 for k, x in enumerate("xyz")}
        columns |= {f"g{x}": y[:, 3 + k] / DEGREE for k, x in enumerate("xyz")}
        columns |= {name: said[:, k] / DEGREE for k, name in enumerate(NAMES)}
        time = sensor_models.drifting_clock(v, np.arange(n) / HZ)
        return {
            "run.toml": run_text(method),
            "path.csv": path_text(_typed_path(v, path)),
            "log.npz": npz_archive(time=time, step=steps, **columns),
        }

    unknowns = sensor_models.triad(10e-3 * G0, 5e-3, 15 / 60 * DEGREE)
    unknowns |= sensor_models.gyro_triad(0.3 * DEGREE, 5e-3, 15 / 60 * DEGREE)
    unknowns |= {
        "g": Unknown(GRAVITY_SD),
        "lean_x": Unknown(5 * ARCSEC),
        "lean_y": Unknown(5 * ARCSEC),
        "azimuth": Unknown(0.1 * DEGREE),
        "square_1": Unknown(2 * ARCSEC),
        "square_2": Unknown(2 * ARCSEC),
    }
    violations = _violations()
    if whole_turns:  # from rest to rest: where the table was a little earlier does not matter
        violations = tuple(one for one in violations if one.name != "latency")
    else:
        unknowns["latency"] = Unknown(5e-3)
    unknowns |= {
        f"{wave}{h}[{name}]": Unknown(size)
        for name in NAMES
        for h, size in HARMONICS
        for wave in ("sin", "cos")
    }
    return Case(
        method,
        unknowns,
        readings,
        noise,
        violations,
        files,
        rivals=sensor_models.rival_coefficients("ag"),
    )


def _violations() -> tuple[Violation, ...]:
    def bench(name: str, key: str, unit: str, si: float, most: float, counted: str) -> Violation:
        return Violation(name, unit, si, {key: 1.0}, (key,), most, None, counted)

    return (
        bench(
            "right angle of the outer axes", "square_1", "″", ARCSEC, 36_000, "state [bench] square"
        ),
        bench(
            "right angle of the inner axes", "square_2", "″", ARCSEC, 36_000, "state [bench] square"
        ),
        bench(
            "first harmonic of the outer readback",
            "sin1[outer]",
            "″",
            ARCSEC,
            3600,
            "[bench] harmonics",
        ),
        bench(
            "second harmonic of the outer readback",
            "sin2[outer]",
            "″",
            ARCSEC,
            3600,
            "[bench] harmonics",
        ),
        bench(
            "third harmonic of the outer readback",
            "sin3[outer]",
            "″",
            ARCSEC,
            3600,
            "[bench] harmonics, a third",
        ),
        bench("lean of the base", "lean_x", "″", ARCSEC, 36_000, "[bench] lean"),
        bench("azimuth", "azimuth", "°", DEGREE, 180, "its ± in [bench] azimuth"),
        replace(
            bench("latency", "latency", "ms", 1e-3, 2e4, "its ± in [bench] latency"),
            followed=True,
        ),
        bench("gravity", "g", "ppm", GRAVITY * 1e-6, 5e4, "state its ± in [bench] gravity"),
        bench("latitude", "latitude", "°", DEGREE, 90, "state it as it is: it is taken as exact"),
        *sensor_models.accelerometer_violations("k2", "k3", "k1_prime", "drift", counted=_ALSO),
        *sensor_models.gyro_violations("g", "scale_prime", "scale2", "drift"),
        sensor_models.made_otherwise("bias instability ten times what is stated", flicker=9.0),
        sensor_models.low_pass_filter(HZ, 5.0),
        sensor_models.rounding("5 mg, 0.5 °/s", (*3 * [5e-3 * G0], *3 * [0.5 * DEGREE])),
        sensor_models.made_otherwise("clock that drifts by 0.4 % in the run", clock=0.004),
        sensor_models.made_otherwise("one attitude typed wrongly, by 10°", typed=10.0),
        sensor_models.swap_columns(0, 1),
        sensor_models.reverse_axis(4),
        sensor_models.change_unit(180 / np.pi, slice(3, 6)),
        sensor_models.zero_channel(5),
        sensor_models.freeze_channel(5),
    )


def turntable_kalman() -> Case:
    """Return ten positions and turns, followed by filters."""
    return _case("turntable_kalman", "fast")


def turntable_trajectory() -> Case:
    """Return the same recording for generalised least squares."""
    return _case("turntable_trajectory", "fast")


def turntable_discrete() -> Case:
    """Return six positions with turns, by their means."""
    return _case("turntable_discrete", "discrete", whole_turns=True)
