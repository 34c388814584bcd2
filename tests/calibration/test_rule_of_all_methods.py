"""The documented rule of the verdict holds for every method, above and below the stated noise.

Readings scatter by a factor of the stated noise, on the bench that each method's kind declares; the
grade follows from the fields of the result by the rule of docs/reference/verdict.md, which is
written here a second time.
"""

import csv
import re
from collections.abc import Iterator
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri
from tests.base_seeds import chosen, evidence, slow
from tests.benches import generated_runs
from tests.benches.generated_runs import (
    kind_for,
    read_off,
    simulate_run,
    state_means,
    write_run,
)
from tests.calibration.short_lines import require_short
from tests.external_bench import register_example_bench

from inercal.calibration.files import load, save
from inercal.estimation.residual_scatter import WhitenedRows, noise_scale
from inercal.methods import METHODS
from inercal.pipeline import Outcome, calibrate
from inercal.pipeline.design.worksheet import build_worksheet, worksheet_csv
from inercal.runfile import read

LEVEL, MOST_SHIFT, LEAST_FACTOR = 0.01, 1.0, 1.3
MOST_SCATTER, MOST_SCATTER_OF_RESTS = 2.0, 3.0  # times as stated; as measured within rests
FACTORS = (1.0, 1.5, 2.5, 5.0, 1 / 1.5, 1 / 3)
TABLE_FACTORS = [
    one if one in (2.5, 1 / 3) else slow(one) if one == 1.0 else evidence(one) for one in FACTORS
]
TABLES = [
    name
    for name in METHODS
    if kind_for(name).sheet is not None and not METHODS[name].unknown_attitudes
]
# Of each method, whether uncertainties follow from [sensor] white where there is a recording.
WEIGHS_WHITE = {
    "turntable_kalman", "turntable_trajectory", "systematic", "temperature_ramp", "field_and_rates"
}  # fmt: skip
RECORDED = [
    evidence(name)
    if name == "turntable_trajectory"  # of the kinds of recordings that are followed, one more
    else slow(name)
    if kind_for(name).sampled or name == "field_and_rates"
    else name
    for name in METHODS
]


@pytest.fixture(autouse=True)
def known(tmp_path: Path) -> Iterator[None]:
    with register_example_bench(tmp_path):
        yield


def require_rule(outcome: Outcome) -> None:
    """Compare the grade with what the documented rule makes of the fields."""
    verdict, estimate = outcome.verdict, outcome.estimate
    best = verdict.best
    warned = any(one.severity == "warning" for one in outcome.findings)
    scores = any(
        reason == "no single cause explains the residuals"
        or reason.startswith("the residuals point to")
        for reason in verdict.reasons
    )
    rejected = any(test.adjusted < LEVEL for test in verdict.tests) or scores
    most = MOST_SCATTER_OF_RESTS if np.isfinite(estimate.noise_dof) else MOST_SCATTER
    bad = (rejected and verdict.scatter > most) or (best is not None and best.shift > MOST_SHIFT)
    far = [float(v) for n, v in zip(estimate.names, estimate.value, strict=True)
           if n.endswith((".k1", ".scale"))]  # fmt: skip
    bad = bad or any(not 0.65 < 1 + one < 1.5 for one in far)
    expected = "unreliable" if bad else "reservations" if rejected or warned else "consistent"
    assert verdict.grade == expected, verdict
    ratios = [(group.chi2 / group.dof) ** 0.5 for group in estimate.groups
              if group.dof and (group.enlarged or group.spread.excess)]  # fmt: skip
    if not estimate.groups and estimate.dof and estimate.chi2 > chdtri(estimate.dof, 0.05):
        ratios = [float(estimate.chi2 / estimate.dof) ** 0.5]
    assert verdict.scatter == pytest.approx(max([1.0, *ratios]))
    if verdict.grade == "consistent":
        assert "times as large" not in verdict.lines[0]
    require_short(verdict)
    assert len(set(verdict.statements)) == len(verdict.statements)
    assert len(set(verdict.reasons)) == len(verdict.reasons)
    assert all(one.factor > 0 for one in verdict.noise)


def table_of(method: str, folder: Path, scatter: float, patch: pytest.MonkeyPatch) -> Outcome:
    """Return the outcome of a table of means whose noise is `scatter` times as stated."""
    more = "turns = 10" if kind_for(method).rows_of_table else ""
    run = simulate_run(write_run(method, folder, more), 1)
    made = build_worksheet(run)
    header, *blank = csv.reader(StringIO(worksheet_csv(made)))
    with patch.context() as changed:
        for name, like in (("SD", "µg"), ("GYRO_SD", "°/h")):
            size = float(getattr(generated_runs, name).split()[0]) * scatter
            changed.setattr(generated_runs, name, f"{size:.9g} {like}")
        readings = read_off(run, np.random.default_rng(7))
    rows = [[*row, *[""] * (len(header) - len(row))] for row in blank]
    for row, step in zip(rows, made.sheet.rows, strict=True):
        for channel, value in zip(run.sensor.channels, readings[step.label], strict=True):
            row[header.index(channel)] = repr(value)
        if "seconds" in header:
            row[header.index("seconds")] = repr(step.seconds)
    with (folder / "sheet.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([header, *rows])
    state_means(run, "sheet.csv", labelled="label" in header)
    return calibrate(replace(read(run.path), truth=run.truth))


@pytest.mark.parametrize("scatter", TABLE_FACTORS)
@pytest.mark.parametrize("method", TABLES)
def test_the_grade_of_a_table_follows_the_rule(
    method: str, scatter: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    outcome = table_of(method, tmp_path, scatter, monkeypatch)
    require_rule(outcome)
    said = [one.factor for one in outcome.verdict.noise if one.what == "noise"]
    if scatter >= 1:
        assert said == []
    for factor in said:
        assert factor >= LEAST_FACTOR
        assert factor == pytest.approx(1 / scatter, rel=0.5)
    # A stated deviation is never reduced.
    file = save(outcome.calibration, tmp_path / "one.calibration.json")
    again = load(file).verdict
    assert again is not None
    assert (again.scatter, again.noise) == (outcome.verdict.scatter, outcome.verdict.noise)


@pytest.mark.slow
@pytest.mark.parametrize("method", RECORDED)
def test_a_white_noise_that_is_stated_too_large_is_told_with_its_factor(
    method: str, tmp_path: Path
):
    path = write_run(method, tmp_path)
    run = simulate_run(path, 1)
    text = run.path.read_text(encoding="utf-8")
    sensor = run.sensor
    for factor in (1.0, 1.5, 3.0) if method in WEIGHS_WHITE else (1.0, 3.0):

        def scaled(found: re.Match[str], by: float = factor) -> str:
            return f'white = "{float(found[1]) * by:.9g} {found[2]}"'

        path.write_text(re.sub(r'white = "([\d.]+) ([^"]+)"', scaled, text), encoding="utf-8")
        outcome = calibrate(path)
        require_rule(outcome)
        said = [one.factor for one in outcome.verdict.noise if one.what == "noise"]
        # In continuous motion, the noise of gyros is hidden by that of magnetometers.
        kinds = {axis.measures for axis in sensor.axes} if run.magnetometer is None else {"m"}
        assert len(said) == (len(kinds) if factor > 1 else 0)
        assert all(one == pytest.approx(factor, rel=0.25) for one in said)
        severe = factor > 1 and (method in WEIGHS_WHITE or factor > 2)
        if factor > 1:
            assert outcome.verdict.grade == ("reservations" if severe else "consistent")


@pytest.fixture(scope="module")
def attitudes() -> np.ndarray:
    ups = np.random.default_rng(1293).standard_normal((100, 3))
    return ups / np.linalg.norm(ups, axis=1)[:, None]


FREE = """\
[sensor]
name = "triad"
[sensor.accelerometer]
unit = "g"
[bench]
gravity = "9.80665 m/s² ± 0.2 mm/s²"
[data]
file = "means.csv"
kind = "means"
label = "position"
accelerometer = ["ax", "ay", "az"]
[data.sd]
accelerometer = "30 µg"
[method]
name = "multi_position"
"""


def free_rests(folder: Path, ups: np.ndarray, scatter: float, seed: int = 1) -> Outcome:
    """Return the outcome of 100 rests in unknown attitudes; their noise is `scatter` × 30 µg."""
    rng = np.random.default_rng(seed)
    y = ups * [1.003, 0.998, 1.001] + [0.01, -0.02, 0.005]
    y = y + scatter * 30e-6 * rng.standard_normal(ups.shape)
    rows = [f"r{k},{x!r},{b!r},{z!r}" for k, (x, b, z) in enumerate(y.tolist())]
    (folder / "means.csv").write_text("\n".join(["position,ax,ay,az", *rows]), encoding="utf-8")
    (folder / "run.toml").write_text(FREE, encoding="utf-8")
    return calibrate(folder / "run.toml")


@pytest.mark.parametrize("scatter", chosen([*FACTORS, 5.2, 0.2], (1.0, 1.5, 2.5, 1 / 3)))
def test_rests_in_unknown_attitudes_follow_the_rule(
    scatter: float, tmp_path: Path, attitudes: np.ndarray
):
    outcome = free_rests(tmp_path, attitudes, scatter)
    require_rule(outcome)
    verdict = outcome.verdict
    if scatter >= 2.5:
        assert verdict.grade == "unreliable"
        assert verdict.scatter == pytest.approx(scatter, rel=0.2)
    elif scatter > 1:
        assert verdict.grade == "reservations"
    if scatter < 1:
        (one,) = verdict.noise
        assert one.factor == pytest.approx(1 / scatter, rel=0.25)
        assert verdict.grade == "reservations"


@pytest.mark.slow
def test_a_stated_deviation_of_means_is_never_reduced(tmp_path: Path, attitudes: np.ndarray):
    usual = free_rests(tmp_path, attitudes, 1.0).calibration.std
    calm = free_rests(tmp_path, attitudes, 0.2).calibration.std
    np.testing.assert_allclose(calm, usual, rtol=0.02)


@pytest.mark.slow
def test_noise_as_stated_is_seldom_called_too_large(tmp_path: Path, attitudes: np.ndarray):
    said = [bool(free_rests(tmp_path, attitudes, 1.0, seed).verdict.noise) for seed in range(30)]
    assert sum(said) <= 1


@pytest.mark.slow
def test_the_deviation_of_gyros_is_judged_apart_from_that_of_accelerometers():
    rng = np.random.default_rng(4)
    ratios: list[tuple[float, float]] = []
    chosen = np.arange(60) < 30
    jacobian = rng.standard_normal((60, 6))
    prior = np.eye(6)[:3] * 5.0
    for _ in range(200):
        x = np.concatenate([rng.standard_normal(3) / 5, np.zeros(3)])
        y = jacobian @ x + np.where(chosen, 0.5, 1.0) * rng.standard_normal(60)
        rows = np.concatenate([jacobian, prior])
        found = np.linalg.lstsq(rows, np.concatenate([y, np.zeros(3)]), rcond=None)[0]
        at = WhitenedRows(y - jacobian @ found, jacobian, -prior @ found, prior, lambda a: a)
        one, two = noise_scale(at, chosen), noise_scale(at, ~chosen)
        assert one is not None
        assert two is not None
        ratios.append((one.ratio, two.ratio))
    assert np.median([one for one, _ in ratios]) == pytest.approx(2.0, rel=0.05)
    assert np.median([two for _, two in ratios]) == pytest.approx(1.0, rel=0.05)


def test_noise_that_priors_hide_is_not_judged():
    jacobian = np.eye(5)
    at = WhitenedRows(np.zeros(5), jacobian, np.zeros(5), 1e-3 * np.eye(5), lambda a: a)
    assert noise_scale(at, np.ones(5, dtype=bool)) is None
