"""Messages of a made-up run, as the server sends them: 24 coefficients, 31 steps, 200 Hz."""

from itertools import count
from math import cos, exp, radians, sin
from typing import Any

Message = dict[str, Any]
_numbers = count(1)
RATE = 200  # Hz
LABELS = ("warm up", "x up", "x down", "y up", "y down", "z up", "z down", "turn about outer")
CHANNELS = (("ax", "f", "g"), ("ay", "f", "g"), ("az", "f", "g"),
            ("gx", "w", "°/s"), ("gy", "w", "°/s"), ("gz", "w", "°/s"))  # fmt: skip
OWN = {"f": (("k0", "µg"), ("k1", "ppm"), ("delta_o", "″"), ("delta_p", "″")),
       "w": (("bias", "°/h"), ("scale", "ppm"), ("delta_o", "″"), ("delta_p", "″"))}  # fmt: skip
MEANING = {
    "k0": "bias",
    "bias": "bias",
    "k1": "scale-factor error",
    "scale": "scale-factor error",
    "delta_o": "misalignment about O",
    "delta_p": "misalignment about P",
}
SYMBOL = {"k0": "K₀", "k1": "K₁−1", "bias": "ε", "scale": "κ", "delta_o": "δ_O", "delta_p": "δ_P"}
NAVIGATED = ("navigation", "roll", "pitch", "heading", "apart", "velocity")
STEPS = 31
SECONDS = 1421.0


def plan(**changed: Any) -> Message:
    """Return the plan of a run."""
    steps = [
        {
            "label": f"{LABELS[i % 8]} {i // 8 + 1}" if i else "warm up",
            "what": "turn" if i % 8 == 7 else "hold",
            "seconds": 60.0 if i else 120.0,
        }
        for i in range(STEPS)
    ]
    coefficients = [
        {
            "name": f"{axis}.{own}",
            "axis": axis,
            "own": own,
            "symbol": SYMBOL[own],
            "meaning": MEANING[own],
            "measures": measures,
            "unit": unit,
        }
        for axis, measures, _ in CHANNELS
        for own, unit in OWN[measures]
    ]
    return {
        "kind": "plan",
        "run": "mimu-20261122-140000",
        "sensor": "MIMU #17",
        "plan": "mimu.toml",
        "simulated": True,
        "seconds": SECONDS,
        "axes": ["outer", "middle", "inner"],
        "channels": [{"name": n, "measures": m, "unit": u} for n, m, u in CHANNELS],
        "steps": steps,
        "coefficients": coefficients,
        **changed,
    }


def angles(time: float) -> tuple[float, float, float]:
    """Return the table's angles, °, at a time."""
    return 20 * sin(time / 9), 35 * sin(time / 5), (30 * time) % 360


def matrix(time: float, off: float = 0.0) -> list[float]:
    """Return the attitude, row by row, of a body that is turned by those angles."""
    a, b, c = (radians(x) for x in angles(time))
    c += off
    about_x = [[1, 0, 0], [0, cos(a), -sin(a)], [0, sin(a), cos(a)]]
    about_y = [[cos(b), 0, sin(b)], [0, 1, 0], [-sin(b), 0, cos(b)]]
    about_z = [[cos(c), -sin(c), 0], [sin(c), cos(c), 0], [0, 0, 1]]
    return [round(x, 7) for row in _product(about_x, _product(about_y, about_z)) for x in row]


def _product(a: list[list[float]], b: list[list[float]]) -> list[list[float]]:
    return [[sum(a[i][n] * b[n][k] for n in range(3)) for k in range(3)] for i in range(3)]


def state(time: float, **changed: Any) -> Message:
    """Return the state at a time, s; the steps take as long as one another."""
    done = min(int(time / SECONDS * STEPS), STEPS)
    turned = [round(angle, 6) for angle in angles(time)]
    return {
        "kind": "state",
        "time": time,
        "phase": "work" if done < STEPS else "done",
        "paused": "",
        "trouble": "",
        "done": done,
        "remaining": max(SECONDS - time, 0.0),
        "speed": 1.0,
        "live": "waits" if time < 20 else "on",
        "table": {
            "axes": [
                {
                    "angle": angle,
                    "rate": rate,
                    "error": 0.1 * (i + 1),
                    "state": "turns" if i else "holds",
                    "fault": False,
                }
                for i, (angle, rate) in enumerate(zip(turned, (2.2, 7.0, 30.0), strict=True))
            ],
        },
        "imu": {
            "packets": int(RATE * time),
            "lost": 0,
            "failed": 0,
            "thrown": 0,
            "samples": int(RATE * time) - 80,
            "no_angle": 0,
            "temperature": 25.12,
        },
        "attitude": {
            "table": matrix(time),
            **dict.fromkeys(NAVIGATED),
        }
        if time < 20
        else {
            "table": matrix(time),
            "navigation": matrix(time, 3e-5),
            "roll": 1.234,
            "pitch": -5.678,
            "heading": (30 * time) % 360,
            "apart": [1.2, -0.4, 3.1],
            "velocity": [0.001, -0.002, 0.0],
        },
        **changed,
    }


def samples(begin: float, end: float, **changed: Any) -> Message:
    """Return the samples from one time until before another, s."""
    times = [i / RATE for i in range(round(begin * RATE), round(end * RATE))]
    channels: list[list[float]] = [[] for _ in CHANNELS]
    for t in times:
        c = matrix(t)
        noise = sin(1e4 * t * t)
        for k in range(3):
            channels[k].append(round(c[6 + k] + 3e-3 * noise * cos(k), 6))
        rates = (2.2 * cos(t / 9), 7 * cos(t / 5), 30 + 0.1 * noise)
        for k, rate in enumerate(rates):
            channels[3 + k].append(round(rate + 0.2 * noise, 6))
    times = [round(t, 4) for t in times]
    return {"kind": "samples", "t": times, "y": channels, "every": 1, **changed}


def estimates(time: float) -> Message:
    """Return what the filters have found at a time: nothing for 20 s, then less and less doubt."""
    values: list[float | None] = []
    spreads: list[float | None] = []
    for i in range(24):
        spread = (400 + 150 * (i % 5)) * (exp(-time / (25 + 9 * (i % 7))) + 0.004)
        found = time >= 20
        value = 1000 * sin(2.0 * i) + 0.4 * spread * sin(time / 17 + i)
        values.append(round(value, 3) if found else None)
        spreads.append(round(spread, 3) if found else None)
    good = {"level": "good", "words": "consistent"}
    nis = {"w": {"ratio": 1.02, **good}, "f": {"ratio": 0.98, **good}} if time >= 20 else {}
    return {"kind": "estimates", "time": time, "values": values, "u2": spreads, "nis": nis}


def event(time: float, words: str, level: str = "info") -> Message:
    """Return something that was said."""
    at = f"2026-11-22T14:{int(time / 60) % 60:02d}:{int(time) % 60:02d}+00:00"
    return {
        "kind": "event",
        "n": next(_numbers),
        "at": at,
        "time": time,
        "level": level,
        "words": words,
    }


def done(**changed: Any) -> Message:
    """Return the end of a run."""
    run = "mimu-20261122-140000"
    return {
        "kind": "done",
        "run": run,
        "state": "done",
        "words": "24 coefficients were found; residuals are as stated.",
        "report": f"/runs/{run}/report",
        "calibration": f"/runs/{run}/calibration",
        "history": "/history/1",
        "verdict": {"level": "good", "words": "consistent", "reasons": []},
        "final": None,
        **changed,
    }


def setup(**changed: Any) -> dict[str, Any]:
    """Return what there is to choose."""
    one = {
        "id": "mimu",
        "file": "mimu.toml",
        "sensor": "simulated MIMU",
        "steps": 31,
        "seconds": 1421.0,
        "method": "turntable_kalman",
        "bytes": 32_000_000,
        "trouble": "",
    }
    trouble = 'old.toml: [data] hold is missing, such as hold = "hold"'
    return {
        "register": "sqlite:///register.db",
        "free": 500_000_000_000,
        "plans": [
            one,
            {**one, "id": "quick", "file": "quick.toml", "steps": 15, "seconds": 312.0},
            {**one, "id": "old", "file": "old.toml", "trouble": trouble},
        ],
        "sensors": [
            {"id": 1, "name": "MIMU #17", "calibrations": 3, "last": "2026-11-20"},
            {"id": 2, "name": "MIMU #18", "calibrations": 0, "last": None},
        ],
        "tables": [
            {"id": "simulated", "what": "simulated bench"},
            {"id": "given", "what": "pmac://10.0.0.5:1025"},
            {"id": "port-0", "what": "motor on serial:/dev/ttyUSB0 (FTDI)"},
        ],
        "imus": [
            {"id": "simulated", "what": "simulated bench"},
            {"id": "given", "what": "serial:/dev/ttyUSB0?preset=xsens"},
            {"id": "port-0", "what": "serial:/dev/ttyUSB0 (FTDI)"},
        ],
        "presets": [
            {"name": "fixed", "protection": "CRC-16"},
            {"name": "xsens", "protection": "a sum of 8 bits"},
        ],
        "runs": [
            _run("mimu-20261122-101500", "MIMU #17", "interrupted", report=False),
            _run("mimu-20261120-090000", "MIMU #17", "done", report=True),
        ],
        "trouble": "",
        **changed,
    }


def _run(name: str, sensor: str, how: str, *, report: bool) -> dict[str, Any]:
    begun = "2026-11-22T10:15:00+00:00"
    return {"id": name, "sensor": sensor, "begun": begun, "state": how, "report": report}
