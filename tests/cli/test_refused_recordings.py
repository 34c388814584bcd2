"""What a run by hand says of rests that it cannot use, and what it draws."""

from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused

from inercal.basics.errors import InercalError
from inercal.cli.app import main
from inercal.pipeline import calibrate
from inercal.runfile import read

RATE, SECONDS = 100.0, 6.0
RUN = """\
[sensor.accelerometer]
unit = "g"

[bench]
gravity = "9.80665 m/s² ± 0.2 mm/s²"

[data]
file = "log.csv"
accelerometer = ["ax", "ay", "az"]
time = "time"
label = "part"

[method]
name = "six_position"
"""
FACES = {"x_p": 0, "x_a": 3, "y_p": 1, "y_a": 4, "z_p": 2, "z_a": 5}


def session(noise: dict[str, float], seed: int = 1, leave_out: str = "") -> dict[str, np.ndarray]:
    """Return columns of six rests with a noise of their own, g, and moves of 1.5 s between them."""
    rng = np.random.default_rng(seed)
    faces = np.vstack([np.eye(3), -np.eye(3)])
    parts, labels, before = [], [], None
    for label, face in FACES.items():
        if label == leave_out:
            continue
        if before is not None:
            way = 0.5 - 0.5 * np.cos(np.linspace(0, np.pi, 150))[:, None]
            shake = 0.3 * rng.normal(size=(150, 3)) * np.sin(np.pi * way)
            parts.append(before * (1 - way) + faces[face] * way + shake)
            labels += [""] * 150
        n = round(RATE * SECONDS)
        sd = noise.get(label, noise["others"])
        parts.append(faces[face] + 0.01 + sd * rng.normal(size=(n, 3)))
        labels += [label] * n
        before = faces[face]
    data = np.concatenate(parts)
    time = np.arange(len(data)) / RATE
    axes = dict(zip(("ax", "ay", "az"), data.T, strict=True))
    return {"time": time, **axes, "part": np.array(labels)}


def write(folder: Path, columns: dict[str, np.ndarray], *changes: tuple[str, str]) -> Path:
    lines = [",".join(columns)]
    lines += [
        ",".join(cell if isinstance(cell, str) else f"{cell:.9g}" for cell in row)
        for row in zip(*columns.values(), strict=True)
    ]
    (folder / "log.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = RUN
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    (folder / "run.toml").write_text(text, encoding="utf-8")
    return folder / "run.toml"


def refusal(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str | Path
) -> str:
    monkeypatch.setattr("sys.argv", ["inercal", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    assert stop.value.code == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    return line


LOUD = {"x_p": 6e-3, "y_a": 9e-3, "z_p": 13e-3, "others": 2e-3}


@pytest.mark.parametrize("seed", range(3))
def test_positions_that_scatter_six_times_as_much_as_others_are_found(tmp_path: Path, seed: int):
    outcome = calibrate(write(tmp_path, session(LOUD, seed)))
    assert {mark.label for mark in outcome.marks} == set(FACES)
    assert min(mark.stop - mark.start for mark in outcome.marks) > 0.8 * RATE * SECONDS


@pytest.mark.slow
def test_a_missing_position_is_refused_with_what_was_found_and_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    run = write(tmp_path, session({"others": 2e-3}, leave_out="z_a"))
    line = refusal(monkeypatch, capsys, "calibrate", run, "--out", tmp_path)
    page = tmp_path / "run.refused.html"
    assert "no rest fits z_a: 5 rests" in line
    assert "threshold" in line
    assert str(page) in line
    drawn = page.read_text(encoding="utf-8")
    assert drawn.count("<svg") == 2
    for label in set(FACES) - {"z_a"}:
        assert f'<th scope="row">{label}</th>' in drawn


def test_no_picture_is_drawn_where_no_report_is_wanted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    run = write(tmp_path, session({"others": 2e-3}, leave_out="z_a"))
    line = refusal(monkeypatch, capsys, "calibrate", run, "--out", tmp_path, "--no-report")
    assert "no rest fits z_a" in line
    assert {path.name for path in tmp_path.iterdir()} == {"run.toml", "log.csv"}


@pytest.mark.slow
def test_a_recording_without_rests_is_refused_with_a_picture(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    columns = session({"others": 2e-3})
    rng = np.random.default_rng(4)
    for name in ("ax", "ay", "az"):
        columns[name] = columns[name] + np.cumsum(rng.normal(scale=0.02, size=columns[name].size))
        columns[name] = np.clip(columns[name], -1.5, 1.5) + 1e-6 * rng.normal(
            size=columns["ax"].size
        )
    for method in ("six_position", "multi_position"):
        run = write(tmp_path, columns, ("six_position", method))
        line = refusal(monkeypatch, capsys, "calibrate", run, "--out", tmp_path)
        assert str(tmp_path / "run.refused.html") in line
        (tmp_path / "run.refused.html").unlink()


MARKED = ('label = "part"', 'label = "part"\nmarks = "labels"')


def moved(folder: Path, more: str) -> Path:
    columns = session({"others": 1e-3})
    at = np.flatnonzero(np.array(columns["part"]) == "y_p")
    columns["ax"][at[at.size // 2 :]] += 0.03
    return write(folder, columns, (MARKED[0], MARKED[1] + more))


def test_a_section_that_moves_is_accepted_on_the_users_word_with_a_warning(tmp_path: Path):
    with refused(InercalError) as refusal:
        calibrate(moved(tmp_path, ""))
    assert "accept_moving" in str(refusal.value)
    assert "y_p" in str(refusal.value)
    outcome = calibrate(moved(tmp_path, '\naccept_moving = ["y_p"]'))
    assert [f.what for f in outcome.findings if f.severity == "warning"] == ["moving"]


@pytest.mark.parametrize(("stated", "wrong"), [('["p11"]', "'p11'"), ('["y_p", "x_p"]', "'x_p'")])
def test_accepting_what_is_no_moving_rest_is_refused(tmp_path: Path, stated: str, wrong: str):
    with refused(InercalError) as refusal:
        calibrate(moved(tmp_path, f"\naccept_moving = {stated}"))
    assert wrong in str(refusal.value)


def test_accepting_rests_that_are_found_is_refused(tmp_path: Path):
    run = write(
        tmp_path,
        session({"others": 1e-3}),
        ("six_position", "multi_position"),
        ('time = "time"', 'time = "time"\naccept_moving = ["r01"]'),
    )
    with refused(InercalError) as refusal:
        calibrate(run)
    assert "accept_moving" in str(refusal.value)


@pytest.mark.parametrize("method", ["six_position", "multi_position"])
@pytest.mark.parametrize(("factor", "unit", "stated"), [(9.80665, "m/s²", "g"), (1.0, "g", "m/s²")])
def test_accelerometers_in_another_unit_are_refused_with_the_key(
    tmp_path: Path, method: str, factor: float, unit: str, stated: str
):
    columns = session({"others": 1e-3})
    for name in ("ax", "ay", "az"):
        columns[name] = columns[name] * factor
    run = write(tmp_path, columns, ('"g"', f'"{stated}"'), ("six_position", method))
    with refused(InercalError) as refusal:
        calibrate(run)
    assert f'unit = "{unit}"' in str(refusal.value)


def test_means_in_another_unit_are_refused_with_the_key(tmp_path: Path):
    example = Path(__file__).parents[2] / "examples" / "six_position"
    text = (example / "run.toml").read_text(encoding="utf-8")
    assert 'unit = "g"' in text
    (tmp_path / "positions.csv").write_bytes((example / "positions.csv").read_bytes())
    run = tmp_path / "run.toml"
    run.write_text(text.replace('unit = "g"', 'unit = "m/s²"'), encoding="utf-8")
    with refused(InercalError) as refusal:
        calibrate(run)
    assert 'unit = "g"' in str(refusal.value)


def test_a_dead_column_of_means_is_refused(tmp_path: Path):
    example = Path(__file__).parents[2] / "examples" / "six_position"
    (tmp_path / "run.toml").write_bytes((example / "run.toml").read_bytes())
    lines = (example / "positions.csv").read_text(encoding="utf-8").splitlines()
    head = next(k for k, line in enumerate(lines) if not line.startswith("#"))
    rows = [line.split(",") for line in lines[head:]]
    for row in rows[1:]:
        row[2] = "0"
    (tmp_path / "positions.csv").write_text(
        "\n".join(",".join(row) for row in rows) + "\n", encoding="utf-8"
    )
    with refused(InercalError) as refusal:
        calibrate(tmp_path / "run.toml")
    assert f"'{rows[0][2]}'" in str(refusal.value)


def test_a_centrifuge_s_readings_in_another_unit_are_refused(tmp_path: Path):
    example = Path(__file__).parents[2] / "examples" / "centrifuge"
    text = (example / "lab.toml").read_text(encoding="utf-8")
    assert "0.1 V/g" in text
    (tmp_path / "lab.csv").write_bytes((example / "lab.csv").read_bytes())
    (tmp_path / "lab.toml").write_text(text.replace("0.1 V/g", "0.98 V/g"), encoding="utf-8")
    with refused(InercalError) as refusal:
        calibrate(tmp_path / "lab.toml")
    assert "m/s²" in str(refusal.value)


def test_a_column_of_milliseconds_is_refused_in_a_run_file_until_its_unit_is_stated(tmp_path: Path):
    columns = session({"others": 1e-3})
    columns = {"t_ms": 1e3 * columns.pop("time"), **columns}
    with refused(InercalError) as refusal:
        calibrate(write(tmp_path, columns, ('"time"', '"t_ms"')))
    assert 'time_unit = "ms"' in str(refusal.value)
    run = read(write(tmp_path, columns, ('"time"', '"t_ms"\ntime_unit = "ms"')))
    recording = calibrate(run).recording
    assert recording is not None
    assert recording.rate_hz == pytest.approx(RATE)
