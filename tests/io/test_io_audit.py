"""The audit: what it refuses, warns of, notes and accepts."""

import dataclasses
import re
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.physics.sensors import Readout, triad
from inercal.recordings import Finding, Mark, Recording
from inercal.recordings.io.audit import audit, require_accepted
from inercal.recordings.io.read import Columns, read_recording
from inercal.recordings.io.rest_norm import audit_rest_norm, norm_finding
from inercal.recordings.io.row_checks import copied_sections

G0 = 9.80665


def recording(n: int = 1000, **changes: object) -> Recording:
    rng = np.random.default_rng(3)
    made = Recording(
        time=np.arange(n) / 100,
        data=rng.normal(size=(n, 2)),
        channels=("x", "y"),
        units=("g", "g"),
        source="run.csv",
        first_row=2,
    )
    return dataclasses.replace(made, **changes)  # type: ignore[arg-type]


def kinds(audited: Recording) -> list[tuple[str, str]]:
    return [(f.severity, f.what) for f in audited.findings]


def only(audited: Recording) -> Finding:
    (finding,) = audited.findings
    return finding


def test_a_clean_recording_has_no_findings_and_is_accepted():
    audited = audit(recording())
    assert audited.findings == ()
    assert require_accepted(audited) is audited


def test_a_few_false_counts_are_not_the_negative_ones_of_signed_counts():
    counts = np.rint(450 + 450 * np.sin(np.arange(1000) / 50))
    for spikes, found in (
        ([47779.0, 47789.0], []),
        ([65535.0, 65530.0], [("refused", "unsigned")]),
    ):
        made = recording()
        made.data[:, 0] = counts
        made.data[[300, 301], 0] = spikes
        assert [one for one in kinds(audit(made)) if one[1] == "unsigned"] == found


def test_the_message_on_unsigned_counts_states_what_the_channel_reads():
    made = recording()
    made.data[:, 0] = np.rint(900 * np.sin(np.arange(1000) / 50)) % 65536
    (refusal,) = (one for one in audit(made).findings if one.what == "unsigned")
    assert all(text in refusal.message for text in ("900", "64636", "65533", "16 bits"))


def test_rows_without_numbers_are_refused_or_dropped():
    made = recording()
    made.data[[5, 6, 40], 1] = [np.nan, np.inf, np.nan]
    unusable = audit(made)
    finding = only(unusable)
    assert (finding.severity, finding.what) == ("refused", "nonfinite")
    assert (finding.channel, finding.start, finding.stop) == ("y", 5, 6)
    with refused(file="run.csv", line=7, names=["y"]):
        require_accepted(unusable)
    dropped = require_accepted(audit(made, nonfinite="drop"))
    assert dropped.time.size == 997
    assert dropped.first_row == 0
    assert kinds(dropped) == [("warning", "nonfinite"), ("note", "gap")]
    assert (dropped.findings[1].start, dropped.findings[1].stop) == (4, 6)


def test_nothing_but_missing_numbers_is_refused_even_when_dropped():
    made = recording(data=np.full((1000, 2), np.nan))
    assert kinds(audit(made, nonfinite="drop")) == [("refused", "nonfinite")]


def test_time_that_goes_back_is_refused_with_its_line():
    time = np.arange(1000) / 100
    time[500:] -= 2.5
    unusable = audit(recording(time=time))
    assert kinds(unusable) == [("refused", "order")]
    with refused(line=502):
        require_accepted(unusable)


def test_lines_stay_right_after_rows_were_dropped():
    time = np.arange(1000) / 100
    time[500:] -= 2.5
    time[3] = np.nan
    with refused(line=502):
        require_accepted(audit(recording(time=time), nonfinite="drop"))


def test_sections_stored_by_label_are_put_in_the_order_of_time():
    labels = np.repeat(["b", "c", "a"], [300, 300, 400])
    time = np.concatenate([np.arange(300, 600), np.arange(700, 1000), np.arange(-100, 300)]) / 100
    audited = audit(recording(time=time, labels=labels, readback={"t": time}))
    assert kinds(audited) == [("note", "order"), ("note", "gap")]
    labels[labels == "c"] = ""  # the time between two sections is none
    told = audit(recording(time=time, labels=labels)).findings[0].message
    assert told.startswith("the 2 labelled sections")
    assert (np.diff(audited.time) > 0).all()
    assert audited.labels is not None
    assert audited.labels[[0, 400, 700]].tolist() == ["a", "b", "c"]
    np.testing.assert_array_equal(audited.readback["t"], audited.time)


def test_labelled_sections_of_one_clock_that_overlap_are_refused():
    labels = np.repeat(["a", "b"], 500)
    time = np.tile(np.arange(500), 2) / 100
    later = time + 1e-4 * (labels == "b")
    assert kinds(audit(recording(time=later, labels=labels))) == [("refused", "order")]
    assert kinds(audit(recording(time=time, labels=labels))) == [("refused", "order")]


def test_repeated_rows_are_dropped_with_a_note():
    made = recording()
    rows = np.sort(np.r_[np.arange(1000), 10, 10, 50])
    audited = audit(dataclasses.replace(made.take(rows), first_row=2))
    assert kinds(audited) == [("note", "repeated")]
    np.testing.assert_array_equal(audited.data, made.data)


def test_rows_stored_twice_at_different_times_are_named():
    made = recording()
    twice = made.take(np.repeat(np.arange(1000), 2))
    time = twice.time + np.tile([0, 5e-5], 1000)
    finding = only(audit(dataclasses.replace(twice, time=time)))
    assert (finding.severity, finding.what, finding.start) == ("refused", "repeated", 0)
    other = np.r_[made.data, made.data[::-1]]  # different readings at the same times
    finding = only(audit(dataclasses.replace(twice, time=time, data=other)))
    assert finding.what == "time unit"


def test_two_readings_of_one_time_are_refused():
    time = np.floor(np.arange(1000) / 2) / 100
    with refused(line=3):
        require_accepted(audit(recording(time=time)))


@pytest.mark.parametrize("lost", [0.02, 5.0])
def test_gaps_are_a_note_while_they_lose_less_than_a_hundredth(lost: float):
    time = np.arange(1000) / 100
    time[500:] += lost
    finding = only(audit(recording(time=time)))
    assert finding.severity == ("note" if lost < 0.1 else "warning")
    assert (finding.what, finding.start, finding.stop) == ("gap", 499, 501)
    assert f"{lost:g} s lost" in finding.message


def test_gaps_between_labelled_sections_are_a_note_however_long():
    time = np.arange(1000) / 100
    time[500:] += 60
    audited = audit(recording(time=time, labels=np.repeat(["a", "b"], 500)))
    assert kinds(audited) == [("note", "gap")]


def test_jitter_is_noted_with_its_size():
    time = np.arange(1000) / 100 + np.random.default_rng(0).normal(scale=1e-4, size=1000)
    finding = only(audit(recording(time=time)))
    assert finding.what == "jitter"
    assert "0.000138 s rms" in finding.message


def test_jitter_of_rounded_stamps_names_the_mean_rate():
    time = np.floor(np.arange(5000) * 1000 / 104.4) / 1000
    finding = only(audit(dataclasses.replace(recording(5000), time=time)))
    assert finding.what == "jitter"
    (rate,) = re.findall(r"mean rate is ([\d.]+) Hz", finding.message)
    assert float(rate) == pytest.approx(104.4, rel=1e-4)


def test_saturation_is_a_warning_with_its_samples():
    made = recording()
    made.data[:, 0] *= 3
    made.data[200:260, 0] = 20.0
    made.data[270:300, 0] = 20.0
    finding = only(audit(made))
    assert finding.severity == "warning"
    assert (finding.what, finding.channel, finding.start, finding.stop) == (
        "saturation",
        "x",
        200,
        300,
    )


def test_stated_limits_decide_alone():
    made = recording()
    made.data[200:260, 0] = 20.0
    assert kinds(audit(made, limits={"x": (-30.0, 30.0)})) == [("warning", "stuck")]
    made.data[:, 0] = np.linspace(0, 20, 1000)
    finding = only(audit(made, limits={"x": (-20.0, 20.0)}))
    assert (finding.what, finding.start, finding.stop) == ("saturation", 999, 1000)
    with refused(names=["q"]):
        audit(made, limits={"q": (-1.0, 1.0)})


def test_a_channel_that_never_changes_is_refused():
    made = recording()
    made.data[:, 1] = 2.5
    finding = only(audit(made))
    assert (finding.severity, finding.what, finding.channel) == ("refused", "stuck", "y")


@pytest.mark.parametrize(("start", "stop"), [(0, 700), (300, 1000), (200, 800)])
def test_a_channel_that_dies_for_half_of_the_time_is_refused(start: int, stop: int):
    made = recording()
    made.data[start:stop, 1] = 0.0
    finding = only(audit(made))
    assert (finding.severity, finding.what, finding.channel) == ("refused", "stuck", "y")
    assert (finding.start, finding.stop) == (start, stop)


def test_channels_that_hold_their_values_together_rest():
    made = recording()
    made.data[100:900] = [0.25, 1.0]  # steps above the noise: at rest each channel is one number
    assert "refused" not in {f.severity for f in audit(made).findings}


def test_a_copy_of_another_channel_is_refused():
    made = recording()
    made.data[:, 1] = made.data[:, 0]
    finding = only(audit(made))
    assert (finding.severity, finding.what, finding.channel) == ("refused", "copy", "y")
    made.data[500, 1] += 1e-9
    assert kinds(audit(made)) == []


def test_readings_cut_off_at_1_g_are_saturated_with_the_key_to_state():
    rng = np.random.default_rng(8)
    made = recording()
    made.data[:] = np.round(rng.normal(scale=0.3, size=(1000, 2)), 4)
    made.data[400:800, 0] = np.clip(np.round(1 + rng.normal(scale=2e-3, size=400), 4), -1, 1)
    made.data[:, 0] = np.clip(made.data[:, 0], -1, 1)
    finding = only(audit(made))
    assert (finding.severity, finding.what, finding.channel) == ("warning", "saturation", "x")
    assert "at 1 g" in finding.message
    assert audit(made, limits={"x": (-2, 2), "y": (-2, 2)}).findings == ()


def test_a_single_sample_and_trials_are_refused():
    assert kinds(audit(recording(1))) == [("refused", "order")]
    with refused():
        audit(recording(data=np.zeros((3, 1000, 2))))


@pytest.mark.parametrize(
    ("declared", "ratio", "severity", "unit"),
    [
        ("right", 1.0, None, ""),
        ("a scale error of 7 %", 1.07, None, ""),
        ("a scale error of 29 %", 1.29, "warning", ""),
        ("g as m/s²", 1 / G0, "refused", 'unit = "g"'),
        ("m/s² as g", G0, "refused", 'unit = "m/s²"'),
        ("mg as g", 1000.0, "refused", 'unit = "mg"'),
        ("g as mg", 0.001, "refused", 'unit = "g"'),
        ("counts", 16384.0, "refused", ""),
    ],
)
def test_units_are_judged_by_gravity_at_rest(
    declared: str, ratio: float, severity: str | None, unit: str
):
    rng = np.random.default_rng(5)
    norm = 9.81 + rng.normal(scale=0.02, size=6000)
    norm[1000:4000] += rng.normal(scale=5, size=3000)  # turned by hand
    readout = Readout(scale=-2.0, offset=7.0)
    force = np.stack([0 * norm, 0.6 * norm, 0.8 * norm], axis=-1) * ratio
    data = np.insert(7.0 - 2.0 * force, 1, 1e9, axis=1)
    made = recording(6000, data=data, channels=("x", "t", "y", "z"), units=("LSB",) * 4)
    findings = audit_rest_norm(made, triad(readout=readout), 9.81).findings
    assert [f.severity for f in findings] == ([] if severity is None else [severity]), declared
    assert all(unit in f.message and ("unit =" in f.message) == bool(unit) for f in findings)


def test_points_for_thousands_are_named():
    rng = np.random.default_rng(5)
    counts = np.rint(rng.normal([100, -20, 8500], 10, (2000, 3)))
    readout = Readout(scale=8192 / G0, unit="LSB")
    for data in (np.where(np.abs(counts) < 1000, counts, counts / 1000), counts / 4):
        made = recording(2000, data=data, channels=("x", "y", "z"), units=("LSB",) * 3)
        (finding,) = audit_rest_norm(made, triad(readout=readout), G0).findings
        assert ("a point for thousands" in finding.message) == (data[0, 2] < 10)


@pytest.mark.parametrize(
    ("unit", "ratio", "named"),
    [
        ("V", 0.01, ["100 times too large"]),
        ("V", 10.0, ["10 times too small"]),
        ("LSB", 1 / G0, ["9.81 times too large", "per m/s² instead of per g"]),
        ("LSB", G0, ["9.81 times too small", "per g instead of per m/s²"]),
        ("g", G0, ['unit = "m/s²"']),
        ("mm/s²", 1e-3 / G0, ['unit = "g"']),
        ("mm/s²", 1e-3, ['unit = "m/s²"']),
        ("mm/s²", 30.0, ["check the units"]),
        ("g", 0.01, ["units"]),  # mg would need columns that are declared as m/s²
    ],
)
def test_a_wrong_norm_names_only_a_unit_or_a_scale_that_was_stated(
    unit: str, ratio: float, named: list[str]
):
    finding = norm_finding(9.81 * ratio, 9.81, "norm", unit)
    assert finding is not None
    assert all(text in finding.message for text in named), finding.message
    assert ("declared as" in finding.message) == (named[0].startswith("unit ="))
    assert ("instead of" in finding.message) == (len(named) > 1)


AXES = ("ax", "ay", "az", "gx", "gy", "gz")
IMUCAL = tuple((a, f"{'acc' if a[0] == 'a' else 'gyr'}_{a[1]}", "LSB") for a in AXES)
XSENS = tuple((axis, str(k), "LSB") for k, axis in enumerate("xyz", 2))
REAL = {
    "ferraris_imucal/annotated_session.csv": Columns(
        IMUCAL, time="samples", time_unit="sample", rate_hz=204.8, label="part"
    ),
    "ferraris_imucal/example_ferraris_session.csv": Columns(
        IMUCAL, time="n_samples", time_unit="sample", rate_hz=102.4
    ),
    "mpu9150_multiposition/imu0.log": Columns(
        tuple((a, str(k), "m/s²" if a[0] == "a" else "rad/s") for k, a in enumerate(AXES, 1)),
        rate_hz=100,
    ),
    "xsens_mti_multiposition/xsens_acc.mat": Columns(XSENS, time="1"),
    "xsens_mti_multiposition/xsens_gyro.mat": Columns(XSENS, time="1"),
}


@pytest.mark.parametrize("name", REAL)
def test_real_recordings_raise_no_false_alarm(data_dir: Path, name: str):
    read = read_recording(data_dir / name, REAL[name])
    assert {finding.severity for finding in read.findings} <= {"note"}


def test_the_annotated_session_is_one_recording_once_in_order(data_dir: Path):
    name = "ferraris_imucal/annotated_session.csv"
    read = read_recording(data_dir / name, REAL[name])
    np.testing.assert_allclose(np.diff(read.time) * 204.8, 1)
    assert read.labels is not None
    assert read.labels[[0, 1500, 5000, 6000, -1]].tolist() == [
        "x_p",
        "x_a",
        "z_a",
        "x_rot",
        "z_rot",
    ]


def test_a_section_that_is_present_twice_is_named_once():
    made = recording()
    marks = [Mark(str(k), 100 * k, 100 * (k + 1)) for k in range(10)]
    assert copied_sections(made, marks) == ()
    made.data[200:300] = made.data[600:700]
    made.data[300:400] = made.data[700:800]
    (found,) = copied_sections(made, marks)
    assert "2 and 6 (and 1 more pair)" in found.message
    made.data[:] = 1.0
    assert copied_sections(made, marks) == ()
