"""What a user of a turntable may get wrong is named where it was made."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.test_turntable_runs import Change, refused, run_of

from inercal.errors import InputError
from inercal.io.write import write_recording
from inercal.pipeline import Outcome, calibrate, named_as_in, simulate
from inercal.pipeline.judgement import judge
from inercal.recording import Recording
from inercal.runfile import Run


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    """Return the example's recording."""
    run = run_of(tmp_path_factory.mktemp("plain"))
    return named_as_in(run, simulate(run, 0))


def unlike(
    folder: Path,
    made: Recording,
    *changes: Change,
    change: Callable[[Recording], Recording] = lambda one: one,
) -> Run:
    """Return the example's run file, changed, beside its recording, changed."""
    run = run_of(folder, *changes)
    write_recording(change(made), run.file(run.data.file))
    return run


def warned(outcome: Outcome, words: str) -> str:
    """Return the only warning that has these words."""
    (found,) = [f for f in outcome.findings if f.severity == "warning" and words in f.message]
    assert found.message in outcome.verdict
    return found.message


def test_gyros_may_stand_in_a_file_of_their_own(tmp_path: Path, made: Recording):
    run = unlike(tmp_path, made, ('label = "step"', 'label = "step"\ngyro_file = "gyro.npz"'))
    (tmp_path / "gyro.npz").write_bytes((tmp_path / "mimu.npz").read_bytes())
    assert calibrate(run).estimate.consistent


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'azimuth = "0 ° ± 0.1 °"',
            'azimuth = "90 ° ± 0.1 °"',
            "azimuth −?[0-9]° .* stated are 90° and 38°",
        ),
        (
            'latitude = "38 °"',
            'latitude = "-38 °"',
            "azimuth .* latitude 3[0-9]°, and stated are 0° and −38°",
        ),
    ],
)
def test_the_earths_rate_tells_a_wrong_azimuth_and_hemisphere(
    tmp_path: Path, made: Recording, old: str, new: str, words: str
):
    run = unlike(tmp_path, made, (old, new))
    refused(run, f"see the earth turn by .* it would be so at {words}; look at .bench. azimuth and")


def test_an_outer_readback_that_is_zero_elsewhere_is_an_azimuth(tmp_path: Path, made: Recording):
    def turned(one: Recording) -> Recording:
        return replace(one, readback={**one.readback, "outer": one.readback["outer"] + 90.0})

    refused(unlike(tmp_path, made, change=turned), "the zero of the outer axis' readback")


def test_a_gravity_that_is_not_the_latitudes_is_told(tmp_path: Path, made: Recording):
    run = unlike(tmp_path, made, ("9.80123 m/s²", "9.50123 m/s²"))
    said = warned(calibrate(run), "gravity")
    assert said.startswith("gravity 9.50123 m/s² against 9.8 m/s² of the latitude")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"0 ° ± 0.1 °"', '"0 ° ± 10 °"', r"azimuth: '0 ° ± 10 °': its deviation is more than 5°"),
        ('noise = "0.5 ″"', 'lever = ["80 m", "0 m", "0 m"]', "lever: 80 m, .* no more than 1 m"),
    ],
)
def test_bounds_of_the_bench(tmp_path: Path, old: str, new: str, words: str):
    with pytest.raises(InputError, match=words):
        run_of(tmp_path, (old, new))


def test_a_latency_far_from_what_is_stated_is_told(tmp_path: Path, made: Recording):
    def late(one: Recording) -> Recording:
        said = {n: np.interp(one.time - 0.03, one.time, a) for n, a in one.readback.items()}
        return replace(one, readback=said)

    said = warned(calibrate(unlike(tmp_path, made, change=late)), "delay of the readback")
    assert re.search(r"found 3[0-3]\.\d+ ± 0\.\d+ ms, stated 0\.0 ± 5\.0 ms, 6\.\d sta", said)
    assert said.endswith("look at [bench] latency")


def test_a_lean_far_from_what_is_stated_is_told(tmp_path: Path, made: Recording):
    run = run_of(tmp_path, ('lean = "5 ″"', 'lean = "30 ″"'))
    leant = named_as_in(run, simulate(run, 4))
    outcome = calibrate(unlike(tmp_path, leant))
    assert any("lean of the base" in f.message for f in outcome.findings)
    assert not any(f.what == "bench" for f in calibrate(unlike(tmp_path, made)).findings)


def test_innovations_twice_as_large_as_stated_are_not_relied_on(tmp_path: Path, made: Recording):
    changes = ('"0.1 °/√h"', '"0.003 °/√h"'), ('"60 µg/√Hz"', '"2 µg/√Hz"')
    outcome = calibrate(unlike(tmp_path, made, *changes))
    assert judge(outcome).tone == "bad"


def reversed_(one: Recording, *names: str) -> Recording:
    sign = np.array([-1.0 if name in names else 1.0 for name in one.channels])
    said = {n: -a if n in names else a for n, a in one.readback.items()}
    return replace(one, data=one.data * sign, readback=said)


@pytest.mark.parametrize(
    ("names", "key", "stated"),
    [
        (("outer",), "table", '["outer", "middle", "inner"]'),
        (("gx", "gz"), "gyro", '["gx", "gy", "gz"]'),
        (("ax", "ay", "az"), "accelerometer", '["ax", "ay", "az"]'),
    ],
)
def test_advice_on_columns_can_be_followed_to_the_letter(
    tmp_path: Path, made: Recording, names: tuple[str, ...], key: str, stated: str
):
    run = unlike(tmp_path, made, change=lambda one: reversed_(one, *names))
    with pytest.raises(InputError, match="they fit with") as caught:
        calibrate(run)
    advice = re.search(rf"\[data\] {key} = (\[[^]]*\])", str(caught.value))
    assert advice is not None
    mended = run_of(tmp_path, (f"{key} = {stated}", f"{key} = {advice[1]}"))
    plain = calibrate(unlike(tmp_path / "..", made)).calibration.values
    found = calibrate(replace(mended, path=run.path)).calibration.values
    np.testing.assert_allclose(found, plain, rtol=1e-6, atol=1e-9)


def test_a_simulation_writes_reversed_columns_as_the_run_file_reads_them(tmp_path: Path):
    changes = ('["outer", ', '["-outer", '), ('["gx", ', '["-gx", ')
    run = run_of(tmp_path, *changes)
    write_recording(named_as_in(run, simulate(run, 0)), run.file(run.data.file))
    assert calibrate(run).estimate.consistent


def test_another_order_of_axes_is_named_as_such(tmp_path: Path, made: Recording):
    run = unlike(tmp_path, made, ("[bench]", '[bench]\naxes = "zyx"'))
    refused(run, r'they fit with \[bench\] axes = "zxy"')
