"""What a user of a turntable may get wrong is named where it was made."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.refusals import refused
from tests.runs.test_turntable_runs import Change, copy_run, path_with_labels, refused_run

from inercal.basics.errors import InputError
from inercal.pipeline import Outcome, apply_data_columns, calibrate, simulate
from inercal.recordings import Recording
from inercal.recordings.io.write import write_recording
from inercal.runfile import Run


@pytest.fixture(scope="module")
def example_recording(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Return the example's recording."""
    run = copy_run(tmp_path_factory.mktemp("plain"))
    return apply_data_columns(run, simulate(run, 0))


def write_changed_example(
    folder: Path,
    made: Recording,
    *changes: Change,
    change: Callable[[Recording], Recording] = lambda one: one,
) -> Run:
    """Return the example's run file, changed, beside its recording, changed."""
    run = copy_run(folder, *changes)
    write_recording(change(made), run.file(run.data.file))
    return run


@pytest.fixture(scope="module")
def nominal_outcome(
    tmp_path_factory: pytest.TempPathFactory, example_recording: Recording
) -> Outcome:
    """Return what it is calibrated to where nothing is mistaken."""
    return calibrate(write_changed_example(tmp_path_factory.mktemp("sound"), example_recording))


def find_warning(outcome: Outcome, words: str) -> str:
    """Return the only warning that has these words."""
    (found,) = [f for f in outcome.findings if f.severity == "warning" and words in f.message]
    assert found.message in outcome.verdict.statements
    return found.message


@pytest.mark.slow
def test_gyros_may_stand_in_a_file_of_their_own(tmp_path: Path, example_recording: Recording):
    run = write_changed_example(
        tmp_path, example_recording, ('label = "step"', 'label = "step"\ngyro_file = "gyro.npz"')
    )
    (tmp_path / "gyro.npz").write_bytes((tmp_path / "mimu.npz").read_bytes())
    assert calibrate(run).estimate.consistent


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        (
            'azimuth = "0 ° ± 0.1 °"',
            'azimuth = "90 ° ± 0.1 °"',
            r"azimuth −?[0-9]° .* 90° and 38°",
        ),
        ('latitude = "38 °"', 'latitude = "-38 °"', r"azimuth .* latitude 3[0-9]°.* 0° and −38°"),
    ],
)
def test_the_earth_rate_detects_a_wrong_azimuth_or_hemisphere(
    tmp_path: Path, example_recording: Recording, old: str, new: str, place: str
):
    run = write_changed_example(tmp_path, example_recording, (old, new))
    with refused(names=("[bench] azimuth", "[bench] latitude")) as refusal:
        calibrate(run)
    assert re.search(place, str(refusal.value))


def test_an_outer_readback_that_is_zero_elsewhere_is_an_azimuth(
    tmp_path: Path, example_recording: Recording
):
    def turned(one: Recording) -> Recording:
        return replace(one, readback={**one.readback, "outer": one.readback["outer"] + 90.0})

    run = write_changed_example(tmp_path, example_recording, change=turned)
    refused_run(run, names=("[bench] azimuth", "[bench] latitude"))


@pytest.mark.slow
def test_gravity_that_disagrees_with_the_latitude_is_reported(
    tmp_path: Path, example_recording: Recording
):
    run = write_changed_example(tmp_path, example_recording, ("9.80123 m/s²", "9.77123 m/s²"))
    said = find_warning(calibrate(run), "gravity")
    assert said.startswith("gravity 9.77123 does not fit latitude 38° (9.7")
    assert "gravity is stated as 9.77123 m/s²; normal gravity at 38° of latitude" in said


@pytest.mark.parametrize(
    ("old", "new", "key"),
    [
        ('"0 ° ± 0.1 °"', '"0 ° ± 10 °"', "[bench] azimuth"),
        ('noise = "0.5 ″"', 'lever = ["80 m", "0 m", "0 m"]', "[bench] lever"),
    ],
)
def test_bounds_of_the_bench(tmp_path: Path, old: str, new: str, key: str):
    with refused(file="mimu.toml", key=key):
        copy_run(tmp_path, (old, new))


@pytest.mark.slow
def test_latency_far_from_its_stated_value_is_reported(
    tmp_path: Path, example_recording: Recording
):
    def late(one: Recording) -> Recording:
        said = {n: np.interp(one.time - 0.03, one.time, a) for n, a in one.readback.items()}
        return replace(one, readback=said)

    said = find_warning(
        calibrate(write_changed_example(tmp_path, example_recording, change=late)),
        "delay of the readback",
    )
    assert re.search(r"give 3[0-3]\.\d+ ± 0\.\d+ ms, but 0\.0 ± 5\.0 ms is stated \(6\.\d ", said)
    assert said.endswith("[bench] latency")


@pytest.mark.slow
def test_lean_far_from_its_stated_value_is_reported(tmp_path: Path, nominal_outcome: Outcome):
    run = copy_run(tmp_path, ('lean = "5 ″"', 'lean = "30 ″"'))
    leant = apply_data_columns(run, simulate(run, 4))
    outcome = calibrate(write_changed_example(tmp_path, leant))
    assert any("lean of the base" in f.message for f in outcome.findings)
    assert not any(f.what == "bench" for f in nominal_outcome.findings)


@pytest.mark.slow
def test_innovations_twice_as_large_as_stated_are_not_relied_on(
    tmp_path: Path, example_recording: Recording
):
    changes = ('"0.1 °/√h"', '"0.003 °/√h"'), ('"60 µg/√Hz"', '"2 µg/√Hz"')
    outcome = calibrate(write_changed_example(tmp_path, example_recording, *changes))
    assert outcome.verdict.grade == "unreliable"


def reverse_column(one: Recording, *names: str) -> Recording:
    sign = np.array([-1.0 if name in names else 1.0 for name in one.channels])
    said = {n: -a if n in names else a for n, a in one.readback.items()}
    return replace(one, data=one.data * sign, readback=said)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "key", "stated"),
    [
        (("outer",), "table", '["outer", "middle", "inner"]'),
        evidence(("gx", "gz"), "gyro", '["gx", "gy", "gz"]'),
        (("ax", "ay", "az"), "accelerometer", '["ax", "ay", "az"]'),
    ],
)
def test_advice_on_columns_can_be_followed_to_the_letter(
    tmp_path: Path,
    example_recording: Recording,
    nominal_outcome: Outcome,
    names: tuple[str, ...],
    key: str,
    stated: str,
):
    run = write_changed_example(
        tmp_path, example_recording, change=lambda one: reverse_column(one, *names)
    )
    with pytest.raises(InputError) as caught:
        calibrate(run)
    (advice,) = caught.value.names
    assert advice.startswith(f"[data] {key} = ")
    corrected = copy_run(tmp_path, (f"{key} = {stated}", advice.removeprefix("[data] ")))
    found = calibrate(replace(corrected, path=run.path)).calibration.values
    np.testing.assert_allclose(found, nominal_outcome.calibration.values, rtol=1e-6, atol=1e-9)


@pytest.mark.slow
def test_a_simulation_writes_reversed_columns_as_the_run_file_reads_them(tmp_path: Path):
    changes = ('["outer", ', '["-outer", '), ('["gx", ', '["-gx", ')
    run = copy_run(tmp_path, *changes)
    write_recording(apply_data_columns(run, simulate(run, 0)), run.file(run.data.file))
    assert calibrate(run).estimate.consistent


def test_a_wrong_order_of_axes_is_identified(tmp_path: Path, example_recording: Recording):
    run = write_changed_example(tmp_path, example_recording, ("[bench]", '[bench]\naxes = "zyx"'))
    refused_run(run, names=('[bench] axes = "zxy"',))


def at_row(name: str, value: float) -> Callable[[Recording], Recording]:
    """Return a change of one reading, in line 5002 of a text."""

    def change(one: Recording) -> Recording:
        if name in one.readback:
            said = one.readback[name].copy()
            said[5000] = value
            return replace(one, readback={**one.readback, name: said})
        data = one.data.copy()
        data[5000, one.channels.index(name)] = value
        return replace(one, data=data)

    return change


def with_readback(one: Recording, of: Callable[[str, np.ndarray], np.ndarray]) -> Recording:
    return replace(one, readback={name: of(name, a) for name, a in one.readback.items()})


def zero_channel(one: Recording) -> Recording:
    return with_readback(one, lambda name, a: 0 * a if name == "inner" else a)


def freeze_channel(one: Recording) -> Recording:
    return with_readback(one, lambda _, a: np.where(one.time < 130, a, a[13_000]))


def clip_channel(one: Recording) -> Recording:
    data = one.data.copy()
    data[:, 3:] = np.clip(data[:, 3:], -25, 25)
    return replace(one, data=data)


def cut_gap(one: Recording) -> Recording:
    return one.take((one.time < 10) | (one.time > 15))


def halve_time(one: Recording) -> Recording:
    return replace(one, time=one.time / 2)


def time_in_milliseconds(one: Recording) -> Recording:
    return replace(one, time=one.time * 1e3)


@pytest.mark.parametrize(
    ("change", "mention", "data"),
    [
        (at_row("outer", 9999.0), "sample 5000 (50 s)", {"names": ("outer",)}),
        (zero_channel, "", {"names": ("inner",)}),
        (freeze_channel, " 131 s", {"names": ("outer", "middle", "inner")}),
        (clip_channel, "gx stays at 25", {"names": ("gx",)}),
        (cut_gap, "9.99 s", {}),
        (halve_time, "200 Hz", {"key": "[data] rate"}),
        (time_in_milliseconds, '"ms"', {}),
    ],
    ids=["spike", "dead", "stuck", "clipped", "torn", "faster", "in ms"],
)
def test_faulty_samples_are_identified_by_their_kind(
    tmp_path: Path,
    example_recording: Recording,
    change: Callable[[Recording], Recording],
    mention: str,
    data: dict[str, Any],
):
    run = write_changed_example(tmp_path, example_recording, change=change)
    refused_run(run, mention, **data)


@pytest.mark.slow
def test_an_outlying_reading_is_reported(tmp_path: Path, example_recording: Recording):
    outcome = calibrate(
        write_changed_example(tmp_path, example_recording, change=at_row("ax", 8.0))
    )
    (found,) = [f for f in outcome.findings if f.what == "outlier"]
    assert (found.channel, found.start, found.stop) == ("ax", 5000, 5001)


@pytest.mark.slow
def test_a_repeating_readback_is_reported_once(tmp_path: Path, example_recording: Recording):
    def held(one: Recording) -> Recording:
        return with_readback(one, lambda _, a: np.repeat(a[::10], 10)[: a.size])

    outcome = calibrate(write_changed_example(tmp_path, example_recording, change=held))
    (found,) = [f for f in outcome.findings if f.what == "readback"]
    assert re.findall(r"([\d.]+) Hz", found.message) == ["10", "100"]
    assert not any(f.what == "slip" for f in outcome.findings)


@pytest.mark.slow
def test_a_readback_that_is_rounded_or_zero_elsewhere_has_lost_nothing(
    tmp_path: Path, example_recording: Recording
):
    def coarse(one: Recording) -> Recording:
        return with_readback(one, lambda _, a: np.round(a, 2))

    def offset(one: Recording) -> Recording:
        return with_readback(one, lambda name, a: a + 10.0 * (name == "middle"))

    for change in (coarse, offset):
        outcome = calibrate(write_changed_example(tmp_path, example_recording, change=change))
        assert not any(f.what == "slip" for f in outcome.findings)


@pytest.mark.slow
def test_a_declared_latency_is_removed_before_the_readback_is_checked(
    tmp_path: Path, example_recording: Recording
):
    def late(one: Recording) -> Recording:
        return with_readback(one, lambda _, a: np.interp(one.time - 0.7, one.time, a))

    change = ('"0 ms ± 5 ms"', '"700 ms ± 5 ms"')
    outcome = calibrate(write_changed_example(tmp_path, example_recording, change, change=late))
    assert not any(f.what in ("slip", "gap", "turns") for f in outcome.findings)


def test_a_latency_that_may_be_anything_is_refused(tmp_path: Path, example_recording: Recording):
    run = write_changed_example(tmp_path, example_recording, ('"0 ms ± 5 ms"', '"0 ms ± 100 ms"'))
    refused_run(run, "100 ms", file=run.path, key="[bench] latency")


def truncate_recording(one: Recording) -> Recording:
    return one.take(one.time < 150)


def replace_label(old: str, new: str) -> Callable[[Recording], Recording]:
    def change(one: Recording) -> Recording:
        assert one.labels is not None
        return replace(one, labels=np.where(one.labels == old, new, one.labels))

    return change


@pytest.mark.slow
@pytest.mark.parametrize("changes", [(), (('label = "step"\n', ""),)], ids=["labels", "none"])
def test_a_recording_that_was_cut_lacks_steps_of_its_path(
    tmp_path: Path, example_recording: Recording, changes: tuple[Change, ...]
):
    said = find_warning(
        calibrate(
            write_changed_example(tmp_path, example_recording, *changes, change=truncate_recording)
        ),
        "steps of the path are missing",
    )
    assert re.search(r"(x\+, )?x-, y\+, y-, z\+, z-(, rest| and 1 more)", said)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("y up", "z down", "z down: .* axes at 0°, 180°, 0°"),
        ("y up", "", "1 step .*: hold"),
        evidence("y up", "yup", "1 step .*: yup"),
    ],
)
def test_labels_missing_from_the_plan_are_reported(
    tmp_path: Path,
    example_recording: Recording,
    nominal_outcome: Outcome,
    old: str,
    new: str,
    words: str,
):
    outcome = calibrate(
        write_changed_example(tmp_path, example_recording, change=replace_label(old, new))
    )
    told = [f.message for f in outcome.findings if f.what == "label"]
    assert any(re.search(words, text) for text in told)
    assert not any(f.what in ("label", "path") for f in nominal_outcome.findings)


@pytest.mark.slow
def test_accelerometers_a_fifth_too_large_are_asked_about(
    tmp_path: Path, example_recording: Recording
):
    def larger(one: Recording) -> Recording:
        return replace(one, data=one.data * np.repeat([1.2, 1.0], 3))

    outcome = calibrate(write_changed_example(tmp_path, example_recording, change=larger))
    (found,) = [f for f in outcome.findings if f.what == "units"]
    assert " 1.2 " in found.message


@pytest.mark.parametrize(
    ("old", "new", "mention"),
    [
        ('"60 µg/√Hz"', '"-60 µg/√Hz"', "[sensor.accelerometer] white: '-60 µg/√Hz'"),
        ('"10 g"', '"-10 g"', "[sensor.accelerometer] full_scale: '-10 g'"),
        ("latency =", "latncy =", "latency"),
        ("[method]", '[method]\nalso = ["bia"]', "bias_dT"),
    ],
)
def test_typing_errors_are_reported_in_terms_of_the_run_file(
    tmp_path: Path, old: str, new: str, mention: str
):
    with pytest.raises(InputError) as refusal:
        copy_run(tmp_path, (old, new))
    assert mention in str(refusal.value)


@pytest.mark.parametrize(
    ("row", "mention"),
    [
        ("a,rotation,,,,,outer,360,-30", "rate is -30 °/s"),
        ("a,rotation,,,,,outer,0,30", "angle is 0"),
        ("a,position,0,0,0,1e9,,,", "seconds is 1e+09"),
        ("a,position,0,0,0,-1,,,", "seconds is -1"),
    ],
)
def test_rows_of_a_path_are_judged_in_their_own_units(tmp_path: Path, row: str, mention: str):
    with pytest.raises(InputError) as refusal:
        _ = copy_run(tmp_path, path=path_with_labels() + row + "\n").steps
    assert mention in str(refusal.value)


@pytest.mark.slow
def test_the_source_estimator_states_the_information_of_its_last_rest(
    tmp_path: Path, example_recording: Recording
):
    run = write_changed_example(
        tmp_path,
        example_recording,
        ('"turntable_kalman"', '"turntable_kalman"\nestimator = "paper"'),
    )
    (said,) = [
        line for line in calibrate(run).calibration.notes if "the source's 0.004 °/min" in line
    ]
    # 0.1 °/√h is 0.1 °/min in one second.
    found = re.search(r"last rest of (\d+\.?\d*) s .* u = (0\.\d+) °/min", said)
    assert found is not None
    seconds, least = map(float, found.groups())
    assert least == pytest.approx(0.1 / seconds**0.5, rel=0.05)
