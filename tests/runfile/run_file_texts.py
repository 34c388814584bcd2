"""Run files that tests change a line of."""

from pathlib import Path

FERRARIS = """\
[sensor]
name = "board 7"

[sensor.accelerometer]
unit = "LSB"
scale = "2048 LSB/g"
full_scale = "16 g"
white = "100 µg/√Hz"

[sensor.gyro]
unit = "°/s"
white = "0.3 °/√h"
bias_instability = "8 °/h"

[sensor.truth]
"ax.k0" = "32 mg"
"ay.k1" = "-0.5 %"
"az.delta_p" = "22 ′"
"gx.scale" = "1.1 %"
"gy.bias" = "0.5 °/s"
"gz.g_i" = "110 °/h/g"

[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
latitude = "47 °"
tilt = "0.3 °"
turn_angle = "0.5 °"
turn_tilt = "0.3 °"

[data]
file = "log.csv"
rate = "50 Hz"
time = "time"
marks = "found"

[method]
name = "ferraris"
seconds = "4 s"
turn = "360 °"
turn_seconds = "4 s"
"""

SIX_POSITIONS = """\
[sensor]
name = "triad 3"

[sensor.accelerometer]
unit = "g"
white = "100 µg/√Hz"

[sensor.truth]
"ax.k0" = "32 mg"
"ay.k1" = "-0.5 %"
"az.delta_p" = "22 ′"

[bench]
gravity = "9.81 m/s² ± 0.2 mm/s²"
tilt = "0.3 °"

[data]
file = "log.csv"
rate = "50 Hz"
time = "time"

[method]
name = "six_position"
seconds = "4 s"
"""


def changed(text: str, *changes: tuple[str, str]) -> str:
    """Return the text with parts replaced, each of which must be there once."""
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    return text


def run_file(folder: Path, text: str, *changes: tuple[str, str]) -> Path:
    """Write a run file."""
    path = folder / "run.toml"
    path.write_text(changed(text, *changes), encoding="utf-8")
    return path
