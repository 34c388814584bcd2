"""What a calibration of a run file says of errors that it shares with others, and of its ranges."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence, slow
from tests.runfile.run_file_texts import FERRARIS, SIX_POSITIONS, run_file
from tests.runs.test_pipeline import recorded

from inercal.calibration import Calibration, SharedError
from inercal.calibration.files import load, save
from inercal.pipeline import calibrate

ROOT = Path(__file__).parents[2]
EXAMPLES = [
    "six_position/run.toml",
    "centrifuge/lab.toml",
    "dividing_head/lab.toml",
    "dividing_head/tumble.toml",
    "rate_table/ship.toml",
    "verdict/left_out.toml",
]


def shared_errors(calibration: Calibration) -> Mapping[str, SharedError]:
    assert calibration.shared is not None
    return {one.name: one for one in calibration.shared}


def example(folder: Path, name: str, *changes: tuple[str, str]) -> Calibration:
    """Calibrate a copy of an example whose run file is changed, the data beside the original."""
    path = ROOT / "examples" / name
    text = path.read_text(encoding="utf-8")
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    for key in ('file = "', 'polygon = "', 'prior_from."'):
        text = text.replace(key, f"{key}{path.parent}/")
    copy = folder / "run.toml"
    copy.write_text(text, encoding="utf-8")
    return calibrate(copy).calibration


@pytest.mark.parametrize("name", EXAMPLES)
def test_shared_errors_are_part_of_the_covariance(name: str, tmp_path: Path):
    found = calibrate(ROOT / "examples" / name).calibration
    size = np.where(found.std > 0, found.std, 1.0)
    parts = [
        np.outer(one.covariance, one.covariance) / one.std**2
        for one in shared_errors(found).values()
    ]
    own = (found.covariance - sum(parts)) / np.outer(size, size)
    assert np.linalg.eigvalsh(own)[0] > 0
    again = load(save(found, tmp_path / "a.calibration.json"))
    assert (
        save(again, tmp_path / "b.json").read_bytes()
        == (tmp_path / "a.calibration.json").read_bytes()
    )


@pytest.mark.parametrize(
    ("name", "error", "stated", "moved", "by"),
    [
        evidence("centrifuge/lab.toml", "g", "9.81262 m/s²", "9.81272 m/s²", 1e-4),
        slow("centrifuge/lab.toml", "radius", "1.5 m ±", "1.50001 m ±", 1e-5),
        evidence("dividing_head/lab.toml", "g", "9.80123 m/s²", "9.801231 m/s²", 1e-6),
        ("verdict/left_out.toml", "g", "9.80123 m/s²", "9.801235 m/s²", 5e-6),
        ("rate_table/ship.toml", "radius", "250 mm ±", "250.1 mm ±", 1e-4),
    ],
)
def test_another_statement_moves_the_coefficients_by_p_over_u_squared(
    name: str, error: str, stated: str, moved: str, by: float, tmp_path: Path
):
    before = example(tmp_path, name)
    after = example(tmp_path, name, (stated, moved))
    step = shared_errors(before)[error].sensitivity * by
    assert np.abs(step).max() > 0
    # Weights of priors and of what is not linear move by parts in a thousand.
    assert np.abs(after.values - before.values - step).max() < 2e-3 * np.abs(step).max() + 1e-12
    assert shared_errors(after)[error].determination != shared_errors(before)[error].determination


@pytest.mark.slow
def test_one_statement_is_one_determination_and_gravity_is_of_the_place(tmp_path: Path):
    arm, table = (
        example(tmp_path, name) for name in ("centrifuge/lab.toml", "rate_table/ship.toml")
    )
    assert {one.date for one in shared_errors(arm).values()} == {None}
    again = example(tmp_path, "centrifuge/lab.toml", ("[bench]\n", '[bench]\nname = "arm 2"\n'))
    alike = {
        name
        for name, one in shared_errors(arm).items()
        if one.determination == shared_errors(again)[name].determination
    }
    assert alike == {"g"}
    assert shared_errors(arm)["g"].determination != shared_errors(table)["g"].determination
    same = [
        example(tmp_path, name, (old, "9.81 m/s² ± 20 µm/s²"))
        for name, old in (
            ("centrifuge/lab.toml", "9.81262 m/s² ± 0.1 mm/s²"),
            ("rate_table/ship.toml", "9.7936 m/s² ± 0.5 mm/s²"),
        )
    ]
    assert len({shared_errors(one)["g"].determination for one in same}) == 1


def test_a_bench_that_is_taken_as_certain_shares_nothing(tmp_path: Path):
    run = recorded(
        tmp_path, SIX_POSITIONS, ('"six_position"', '"six_position"\nestimator = "classical"')
    )
    assert calibrate(run).calibration.shared == ()


def test_an_exact_gravity_is_not_shared(tmp_path: Path):
    run = recorded(tmp_path, SIX_POSITIONS, ("± 0.2 mm/s²", "± 0"))
    assert calibrate(run).calibration.shared == ()


def test_ranges_are_those_of_the_means_and_of_the_samples_of_turns(tmp_path: Path):
    outcome = calibrate(recorded(tmp_path, FERRARIS))
    found = outcome.calibration.validity
    assert found is not None
    means = outcome.observations.mean
    assert found.force is not None
    assert found.rate is not None
    assert found.force == (means[:, :3].min(), means[:, :3].max())
    assert found.rate[0] <= means[:, 3:].min()
    assert found.rate[1] >= means[:, 3:].max()
    assert found.force[0] < -9.5 < 9.5 < found.force[1]
    # Turned by 360° in 4 s, smoothly: at most twice as fast as on average.
    assert found.rate[1] == pytest.approx(np.pi, rel=0.1)
    assert found.temperature is None


def test_the_range_of_temperature_is_that_of_the_sections_that_were_used(tmp_path: Path):
    run = recorded(tmp_path, FERRARIS)
    _, first, *lines = run.file(run.data.file).read_text(encoding="utf-8").splitlines()
    rows = [f"{line},{20 + k / len(lines)!r}" for k, line in enumerate(lines)]
    run.file(run.data.file).write_text("\n".join([f"{first},oven", *rows]), encoding="utf-8")
    path = run_file(tmp_path, FERRARIS, ('time = "time"', 'time = "time"\ntemperature = "oven"'))
    outcome = calibrate(path)
    found = outcome.calibration.validity
    assert found is not None
    assert found.temperature is not None
    ends = min(m.start for m in outcome.marks), max(m.stop for m in outcome.marks) - 1
    expected = [293.15 + k / len(lines) for k in ends]
    assert found.temperature == pytest.approx(expected, abs=1e-9)
    assert 0 < ends[0] < ends[1] < len(lines) - 1
    assert replace(found, temperature=None).ranges.keys() == {"rate", "force"}
