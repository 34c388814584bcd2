"""Run files that are none, contradict themselves, or state what cannot be."""

from tests.bad_inputs.bad_input import BadInput, Change, swap
from tests.bad_inputs.recordings import CALIBRATE, MEANS

GRAVITY = 'gravity = "9.81 m/s² ± 0.2 mm/s²"'


def keys(old: str, new: str, *words: str) -> BadInput:
    """Return a run file with one line changed."""
    return BadInput(CALIBRATE, ("run.toml", *words), {"run.toml": swap(old, new)})


def more_data(line: str, *words: str) -> BadInput:
    """Return a run file with a further line in [data]."""
    return keys('time = "time"', f'time = "time"\n{line}', *words)


def whole(content: Change, *words: str) -> BadInput:
    return BadInput(CALIBRATE, ("run.toml", *words), {"run.toml": content})


CASES: dict[str, BadInput] = {
    "a folder": BadInput("calibrate @ --out @", ("run.toml", "--force")),
    "a log with a run file": BadInput("calibrate @log.csv @run.toml --out @", ("run.toml",)),
    "the calibration": BadInput(
        "calibrate @run.calibration.json --out @", ("run.calibration.json", "JSON", ".toml")
    ),
    "a device": BadInput("calibrate /dev/null --out @", ("/dev/null", "regular file")),
    "no byte": whole(b"", "[sensor]"),
    "UTF-16": whole(lambda text: text.encode("utf-16"), "UTF-16"),
    "Latin-1": whole(lambda text: text.encode("latin-1", "replace"), "line 6", "UTF-8"),
    "a section twice": keys("[data]", "[data]\n[data]", "twice"),
    "a key twice": keys('rate = "50 Hz"', 'rate = "50 Hz"\nrate = "60 Hz"', "line 20", "twice"),
    "a list of sections": keys("[bench]", "[[bench]]", "bench"),
    "a mistyped section": keys("[method]", "[methods]", "[methods]"),
    "a negative rate": keys('"50 Hz"', '"-50 Hz"', "[data] rate", "positive"),
    "a period as rate": keys('"50 Hz"', '"20 ms"', "[data] rate", "time"),
    "an infinite rate": keys('"50 Hz"', '"inf Hz"', "[data] rate"),
    "an uncertain rate": keys('"50 Hz"', '"50 ± 1 Hz"', "[data] rate", "uncertainty"),
    "a rate in words": keys('"50 Hz"', '"fifty"', "[data] rate", "fifty"),
    "gravity of the moon": keys(GRAVITY, 'gravity = "1.62 m/s²"', "[bench] gravity"),
    "gravity known to half": keys(
        GRAVITY, 'gravity = "9.81 m/s² ± 5 m/s²"', "[bench] gravity", "±"
    ),
    "gravity of negative uncertainty": keys(
        GRAVITY, 'gravity = "9.81 m/s² ± -1 m/s²"', "[bench] gravity", "negative"
    ),
    "a height alone": keys(GRAVITY, 'height = "520 m"', "[bench]", "latitude"),
    "a latitude beyond the pole": keys(GRAVITY, 'latitude = "95 °"', "latitude", "95"),
    "a latitude in metres": keys(GRAVITY, 'latitude = "48 m"', "[bench] latitude", "length"),
    "a latitude with its hemisphere": keys(
        GRAVITY, 'latitude = "48.1 N"', "[bench] latitude", "'N'"
    ),
    "a tilt of most of a turn": keys('"0.3 °"', '"300 °"', "[bench] tilt"),
    "a tilt in seconds": keys('tilt = "0.3 °"', 'tilt = "0.3 s"', "[bench] tilt", "time"),
    "a negative tilt": keys('tilt = "0.3 °"', 'tilt = "-0.3 °"', "[bench] tilt", "negative"),
    "noise without its root": keys('"100 µg/√Hz"', '"100 µg"', "[sensor.accelerometer] white"),
    "accelerometers in °/s": keys('unit = "g"', 'unit = "°/s"', "[sensor.accelerometer] unit"),
    "a scale beside g": keys('unit = "g"', 'unit = "g"\nscale = "2 V/g"', "scale"),
    "a scale of zero": keys('unit = "g"', 'unit = "V"\nscale = "0 V/g"', "scale", "zero"),
    "a scale of another output": keys('unit = "g"', 'unit = "V"\nscale = "2 LSB/g"', "scale"),
    "a negative range": keys('unit = "g"', 'unit = "g"\nfull_scale = "-2 g"', "full_scale"),
    "the truth of no axis": keys('"ax.k0"', '"bx.k0"', "bx.k0", "ax, ay, az"),
    "a truth of another unit": keys('"32 mg"', '"32 ms"', "[sensor.truth] ax.k0", "time"),
    "a truth without quotes": keys('"ax.k0" =', "ax.k0 =", "[sensor.truth] ax"),
    "a method of gyros": keys('"six_position"', '"ferraris"', "ferraris", "gyros"),
    "a method of another bench": keys(
        '"six_position"', '"tumble"', "[bench] kind", "dividing_head"
    ),
    "an estimator of no method": keys(
        '"six_position"', '"six_position"\nestimator = "ols"', "'ols'", "classical"
    ),
    "a group of gyros": keys(
        '"six_position"', '"six_position"\nalso = ["g"]', "'g'", "groups: bias"
    ),
    "a text for a list": keys('"six_position"', '"six_position"\nalso = "k2"', "[method] also"),
    "seconds in metres": keys('seconds = "4 s"', 'seconds = "4 m"', "[method] seconds", "length"),
    "a column of two quantities": more_data('temperature = "acc_x"', "'acc_x'"),
    "a label among the axes": keys('label = "label"', 'label = "acc_x"', "'acc_x'"),
    "a time among the axes": keys('time = "time"', 'time = "acc_x"', "'acc_x'"),
    "an axis twice": more_data('accelerometer = ["acc_x", "acc_x", "acc_z"]', "'acc_x'"),
    "a negative skip": more_data("skip = -1", "[data] skip"),
    "a sheet of a text": more_data("sheet = 2", "[data] sheet", "xlsx"),
    "a unit of no time": more_data('time_unit = "fortnight"', "time_unit", "fortnight"),
    "a unit that gives no rate": BadInput(
        CALIBRATE,
        ("log.csv", "'time'", "time_unit"),
        {"run.toml": swap('time = "time"', 'time = "time"\ntime_unit = "h"')},
    ),
    "more lines to skip than there are": BadInput(
        CALIBRATE,
        ("log.csv", "99999"),
        {"run.toml": swap('time = "time"', 'time = "time"\nskip = 99999')},
    ),
    "a deviation of zero": BadInput(
        MEANS, ("means.toml", "[data.sd] accelerometer"), {"means.toml": swap('"30 µg"', '"0 µg"')}
    ),
    "a deviation of gyros": BadInput(
        MEANS,
        ("means.toml", "[data.sd] gyro"),
        {"means.toml": swap('"30 µg"', '"30 µg"\ngyro = "5 °/h"')},
    ),
    "a deviation of another unit": BadInput(
        MEANS,
        ("means.toml", "[data.sd] accelerometer"),
        {"means.toml": swap('"30 µg"', '"30 °/h"')},
    ),
    "a height above all mountains": BadInput(
        MEANS, ("means.toml", "height"), {"means.toml": swap('"520 m"', '"520 km"')}
    ),
    "a column of no table": BadInput(
        MEANS,
        ("positions.csv", "'pos'"),
        {"means.toml": swap('label = "position"', 'label = "pos"')},
    ),
}
