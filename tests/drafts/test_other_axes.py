"""Drafts for sensors that are not a triad: clusters, single axes, and analogue gyros."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.pipeline import calibrate
from inercal.pipeline.drafts import Draft, draft_run_file

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "axes.md"
PLAYER = Path(__file__).parents[2] / "examples" / "single_axis" / "record_player.csv"
OBLIQUE = np.array([[1, 0, 0.2], [-0.3, 1, 0], [0, -0.4, 1], [1, 1, -1]])
OBLIQUE /= np.linalg.norm(OBLIQUE, axis=1, keepdims=True)


def cluster(folder: Path, names: str) -> Path:
    """Write rests with each axis up and down, of as many axes of a cluster as there are names."""
    rng, faces = np.random.default_rng(1), np.vstack([np.eye(3), -np.eye(3)])
    up = np.vstack(
        [np.vstack([np.tile(one, (500, 1)), rng.standard_normal((100, 3))]) for one in faces]
    )
    read = 9.81 * up @ OBLIQUE[: len(names.split())].T
    read += 0.01 * rng.standard_normal(read.shape)
    rows = [f"{k / 100},{','.join(map(str, row))}" for k, row in enumerate(read.tolist())]
    (folder / "log.csv").write_text("\n".join([f"time,{','.join(names.split())}", *rows]))
    return folder / "log.csv"


@pytest.mark.parametrize("names", ["s1 s2 s3 s4", "acc_0 acc_1 acc_2 acc_3"])
def test_a_cluster_of_four_is_not_drafted_as_a_triad(tmp_path: Path, names: str):
    log = cluster(tmp_path, names)
    with refused(key="data.accelerometer", names=names.split()):
        draft_run_file([log], tmp_path / "run.toml", typical=True)


def test_columns_that_the_user_states_are_a_triad(tmp_path: Path):
    log = cluster(tmp_path, "s1 s2 s3 s4")
    stated = {"data.accelerometer": '["s1", "s2", "s3"]'}
    made = draft_run_file([log], tmp_path / "run.toml", stated, typical=True)
    assert made.roles.triads["accelerometer"] == ("s1", "s2", "s3")


@pytest.mark.parametrize("header", ["time_s,gyro_z", "t,ax,ay"])
def test_too_few_columns_get_no_advice_to_state_the_time_as_an_axis(tmp_path: Path, header: str):
    width = header.count(",")
    rows = [f"{k / 50},{','.join([str(k % 7)] * width)}" for k in range(200)]
    (tmp_path / "log.csv").write_text("\n".join([header, *rows]))
    with refused() as refusal:
        draft_run_file([tmp_path / "log.csv"], tmp_path / "run.toml")
    title = PAGE.read_text(encoding="utf-8").partition("\n")[0].removeprefix("# ")
    assert title in str(refusal.value)
    assert "--set" not in str(refusal.value)


def drafted_player(folder: Path) -> Draft:
    log, stated = folder / "record_player.csv", {"bench.latitude": "50 °"}
    return draft_run_file([log], folder / "run.toml", stated, typical=True)


def test_the_offset_of_an_analogue_gyro_is_no_bias(tmp_path: Path):
    shutil.copy(PLAYER, tmp_path)
    made = drafted_player(tmp_path)
    keys = {one.dotted: one.value for one in made.entries}
    assert keys["sensor.gyro.unit"] == "V"
    (tmp_path / "run.toml").write_text(made.text)
    bias = calibrate(tmp_path / "run.toml").calibration.value("gz.bias")
    assert abs(np.degrees(bias)) < 1  # of 220 °/s if the offset is left out


def test_columns_of_deviations_are_used(tmp_path: Path):
    header, *rows = PLAYER.read_text().splitlines()
    lines = [header.replace("gz [V]", "gz,gz_sd"), *(f"{row},4e-05" for row in rows)]
    (tmp_path / "record_player.csv").write_text("\n".join(lines))
    made = drafted_player(tmp_path)
    assert "data.sd.gyro" not in {one.dotted for one in made.entries}
    assert not any("not used" in fact for fact in made.facts)
    assert made.method is not None
