"""A sensor calibrated once a year; its x axis drifts 40 µg a year. What the register says of it."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import inercal
from inercal.calibration.comparison.run_to_run import format_en
from inercal.laboratory.store import Register
from inercal.laboratory.store.history_text import drift_text, format_point, history_lines
from inercal.physics.sensors import G0
from inercal.pipeline import apply_data_columns, simulate
from inercal.recordings.io.write import write_recording
from inercal.report import write_history
from inercal.runfile import read

run = read(Path(__file__).parents[1] / "ferraris_simulated" / "run.toml")
# Known of the sensor: U need not hold what the slopes within the rests leave open.
steady = [
    replace(axis, noise=replace(axis.noise, bias_instability=10e-6 * G0))
    if axis.measures == "f"
    else axis
    for axis in run.sensor.axes
]
run = replace(run, sensor=replace(run.sensor, axes=tuple(steady)))
with TemporaryDirectory() as folder, Register(f"{folder}/register.db", by="Ada") as register:
    for year in range(5):
        truth = {**run.truth, "ax.k0": run.truth["ax.k0"] + year * 40e-6 * G0}
        session = replace(run, path=Path(folder) / "run.toml", truth=truth)
        recording = apply_data_columns(session, simulate(session, seed=year))
        write_recording(recording, session.file(session.data.file))
        found = inercal.calibrate(session).calibration
        register.enter_calibration(found, measured=f"{2021 + year}-03-01")
    history = register.history(run.sensor.name)

for name in ("ax.k0", "ay.k0", "gx.scale"):
    course = history.trend(name)
    print(f"{name}: {course.verdict}; {drift_text(course)}")
    for k, place in enumerate(course.points):
        date, value = history.entries[place].measured[:10], " ± ".join(format_point(course, k))
        print(f"  {date}  {value} {course.unit}  {format_en(course.normalised_errors[k])}".rstrip())
for line in history_lines(history):
    print(line)
write_history(history, "five_years.html")
