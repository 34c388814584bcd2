"""The report as a file: whole, self-contained, safe, small, and faithful to the numbers."""

import re
import sys
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from tests.refusals import refused
from tests.report.page_tags import parsed

from inercal.basics.errors import InputError
from inercal.basics.units import format_value_and_uncertainty
from inercal.benches import Hand
from inercal.benches.hand.kind import directions
from inercal.physics.plan import Hold
from inercal.pipeline import Outcome, apply_data_columns, calibrate, simulate
from inercal.recordings import Finding, Recording
from inercal.recordings.io.write import write_recording
from inercal.report import write_report
from inercal.report.calibration_page import calibration_page
from inercal.report.figures import residuals
from inercal.report.report_tables import bench_tables, coefficients, strongest_correlations
from inercal.report.traces import MAX_POINTS, envelope, missing_faces
from inercal.runfile import Run, read


def simulated(folder: Path, run_file: str) -> Run:
    """Return a run of that text, with its recording simulated."""
    path = folder / "run.toml"
    path.write_text(run_file, encoding="utf-8")
    run = read(path)
    write_recording(apply_data_columns(run, simulate(run, 3)), folder / run.data.file)
    return run


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    run_file = Path(__file__).parent / "mems.toml"
    return simulated(tmp_path_factory.mktemp("mems"), run_file.read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def by_hand(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    run_file = files("inercal").joinpath("hand_held.toml").read_text(encoding="utf-8")
    return calibrate(simulated(tmp_path_factory.mktemp("hand"), run_file))


@pytest.fixture(scope="module")
def outcome(run: Run) -> Outcome:
    return calibrate(run)


@pytest.fixture(scope="module")
def text(outcome: Outcome, run: Run) -> str:
    return calibration_page(outcome, run.truth)


@pytest.fixture(scope="module")
def plain(outcome: Outcome) -> str:
    """Return the page without a truth."""
    return calibration_page(outcome, None)


def renamed(outcome: Outcome, name: str) -> Outcome:
    calibration = outcome.calibration
    sensor = replace(calibration.sensor, name=name)
    return replace(outcome, calibration=replace(calibration, sensor=sensor))


def without(outcome: Outcome, label: str) -> Outcome:
    """Return the outcome as if a step had not been measured; its residuals are left out."""
    kept = [k for k, step in enumerate(outcome.steps) if step.label != label]
    old = outcome.observations
    observations = replace(
        old,
        labels=tuple(old.labels[k] for k in kept),
        mean=old.mean[kept],
        covariance=old.covariance[kept],
        duration=old.duration[kept],
        samples=old.samples[kept],
        time=old.time[kept],
    )
    none = np.zeros(0)
    estimate = outcome.estimate.select(outcome.calibration.sensor.coefficients)
    estimate = replace(estimate, residual=none, whitened=none)
    steps = tuple(outcome.steps[k] for k in kept)
    return replace(outcome, observations=observations, steps=steps, estimate=estimate)


@pytest.mark.slow
def test_the_page_asks_for_nothing_outside_itself(text: str):
    assert "http:" not in text
    assert "https:" not in text
    assert not {"script", "link", "img", "iframe", "object"} & set(parsed(text).seen)
    targets = re.findall(r'(?:href|src)="([^"]*)"', text) + re.findall(r"url\(([^)]*)\)", text)
    assert targets
    assert all(target.startswith("#") for target in targets)


def test_ids_are_unique_and_every_reference_has_its_target(text: str):
    ids = parsed(text).ids
    assert len(set(ids)) == len(ids)
    referred = re.findall(r'href="#([^"]*)"', text) + re.findall(r"url\(#([^)]*)\)", text)
    assert set(referred) <= set(ids)


def test_no_stand_in_colour_is_left(text: str):
    assert "#010a" not in text


def test_every_coefficient_is_there_with_value_and_expanded_uncertainty(
    text: str, outcome: Outcome
):
    calibration = outcome.calibration
    rows = {row.name: row for g in coefficients(outcome, None) for axis in g.axes for row in axis}
    assert tuple(rows) == calibration.sensor.coefficients
    for name, value, std in zip(rows, calibration.values, calibration.std, strict=True):
        si = calibration.sensor.coefficient(name).si
        shown, expanded = format_value_and_uncertainty(value / si, 2 * std / si)
        assert (rows[name].value.replace("−", "-"), rows[name].expanded) == (shown, expanded)
        row = re.search(rf'<th scope="row">{re.escape(name)}</th>.*?</tr>', text, re.DOTALL)
        assert row
        assert f">{rows[name].value}<" in row[0]
        assert f">{expanded}<" in row[0]


@pytest.mark.slow
def test_the_error_column_appears_only_with_a_truth(text: str, plain: str):
    assert "error / u" in text
    assert "error / u" not in plain


def test_errors_against_the_truth_are_in_standard_uncertainties(outcome: Outcome):
    calibration = outcome.calibration
    truth = {"ax.k0": calibration.value("ax.k0") - 4 * calibration.uncertainty("ax.k0")}
    row = coefficients(outcome, truth)[0].axes[0][0]
    assert (row.name, row.error, row.error_is_large) == ("ax.k0", "+4.00", True)


@pytest.mark.slow
def test_hostile_names_and_labels_stay_text_and_a_million_samples_under_two_megabytes(
    outcome: Outcome,
):
    name = '<script>alert("1")</script>'
    finding = Finding("warning", "<b>", "<img src=x>", "<i>")
    label = '<script x="$y^{">漢'
    labels = (label, *outcome.observations.labels[1:])
    marks = (replace(outcome.marks[0], label=label), *outcome.marks[1:])
    first = outcome.steps[0]
    assert isinstance(first, Hold)
    steps = (replace(first, label=label), *outcome.steps[1:])
    observations = replace(outcome.observations, labels=labels)
    names = tuple(
        n.replace(f"[{outcome.steps[0].label}]", f"[{label}]") for n in outcome.estimate.names
    )
    old = outcome.recording
    assert old is not None
    n = 1_000_000
    data = np.random.default_rng(1).normal(0, 1000, (n, len(old.channels)))
    changed = replace(
        renamed(outcome, name),
        findings=(finding,),
        recording=Recording(np.arange(n) / 1000.0, data, old.channels, old.units),
        observations=observations,
        marks=marks,
        steps=steps,
        estimate=replace(outcome.estimate, names=names),
    )
    text = calibration_page(changed, None)
    tags = parsed(text)
    assert not {"script", "img", "b", "i"} & set(tags.seen)
    assert name in "".join(tags.text)
    assert len(text.encode()) < 2e6


def test_the_envelope_keeps_spikes_ends_and_gaps():
    n = 100_003
    time = np.arange(n) / 100.0
    time[60_000:] += 50.0
    data = np.zeros((n, 1))
    data[12_345], data[-1] = 7.0, -3.0
    when, y = envelope(Recording(time, data, ("ax",), ("g",)), 0)
    assert y.size <= MAX_POINTS + 4
    assert when[np.nanargmax(y)] == time[12_345]
    assert (when[-1], y[-1]) == (time[-1], -3.0)
    assert np.isnan(y).sum() == 1
    assert np.all(np.diff(when) >= 0)


def test_short_recordings_are_drawn_sample_by_sample():
    data = np.arange(50.0)[:, None]
    when, y = envelope(Recording(np.arange(50.0) + 1e9, data, ("ax",), ("g",)), 0)
    np.testing.assert_array_equal(y, data[:, 0])
    assert when[0] == 0


@pytest.mark.slow
def test_rests_found_by_hand_make_a_page_with_the_scatter_they_were_found_by(by_hand: Outcome):
    tags = parsed(calibration_page(by_hand, None))
    assert any(name.startswith("scatters-") for name in tags.ids)
    assert "".join(tags.text).count("time from the first sample, s") == 2


def test_rows_of_residuals_by_the_same_rests_name_them_once(by_hand: Outcome):
    norms, rates, rotations = by_hand.estimate.groups
    assert norms.labels == rates.labels != rotations.labels
    names = [text.strip() for text in parsed(residuals(by_hand)).text]
    assert names.count(norms.labels[0]) == 2  # left and right
    assert names.count(rotations.labels[0]) == 2


@pytest.mark.slow
def test_means_and_a_nonlinear_model_make_a_page_without_traces_and_without_a_matrix(
    outcome: Outcome,
):
    calibration = outcome.calibration
    tilted = replace(calibration, sensor=replace(calibration.sensor, form="tilted"))
    text = calibration_page(replace(outcome, calibration=tilted, recording=None, marks=()), None)
    assert "no recording to draw" in text
    assert 'id="traces' not in text
    assert "<code>correct</code> inverts" in text
    parsed(text)


@pytest.mark.slow
def test_an_estimate_without_residuals_says_what_its_uncertainty_lacks(run: Run):
    text = calibration_page(calibrate(replace(run, estimator="classical")), None)
    assert "U includes only the noise of the means" in " ".join(text.split())
    assert "Consistent" in text  # by the problem of ml: the formulas leave no residuals
    assert "the bench as exact" in text


def test_each_linked_term_is_defined_once_at_the_end(plain: str):
    linked = set(re.findall(r'<a class="term" href="#(term-[a-z0-9-]+)"', plain))
    defined = re.findall(r'<dt id="(term-[a-z0-9-]+)"', plain)
    assert len(linked) > 10
    assert sorted(linked) == sorted(defined)


@pytest.mark.slow
def test_faces_without_a_position_are_named(outcome: Outcome):
    assert missing_faces(directions(outcome)) == []
    hold = next(s for s in outcome.steps if isinstance(s, Hold) and s.up == (0.0, 0.0, -1.0))
    lacking = without(outcome, hold.label)
    assert missing_faces(directions(lacking)) == ["−z"]
    text = calibration_page(lacking, None)
    assert "No position had\n−z up." in text
    assert "−z: no position" in text


def test_attitudes_are_near_nominal_and_turns_about_their_axes(outcome: Outcome):
    assert all(attitude.deviation_angle < np.deg2rad(2) for attitude in directions(outcome))


def test_the_bench_table_compares_found_with_stated(outcome: Outcome):
    grids, pulls = bench_tables(outcome)
    assert [grid.title for grid in grids] == ["The whole run", "By position", "By turn"]
    assert set(pulls) == {"run", *outcome.observations.labels}
    k = outcome.estimate.names.index("tilt1[x_p]")
    found = dict(pulls["x_p"])["tilt1"]
    assert isinstance(outcome.bench, Hand)
    assert found == pytest.approx(outcome.estimate.value[k] / outcome.bench.tilt)


def test_strong_correlations_are_named_strongest_first(outcome: Outcome):
    estimate = outcome.estimate
    covariance = np.diag(np.diag(estimate.covariance))
    sd = np.sqrt(np.diag(covariance))
    for a, b, r in ((0, 1, -0.6), (2, 3, 0.9), (4, 5, 0.4)):
        covariance[a, b] = covariance[b, a] = r * sd[a] * sd[b]
    a = estimate.names
    assert strongest_correlations(replace(estimate, covariance=covariance)) == [
        f"{a[2]} and {a[3]}: +0.90",
        f"{a[0]} and {a[1]}: −0.60",
    ]


@pytest.mark.parametrize("missing", ["matplotlib", "jinja2"])
def test_missing_extras_are_named(
    outcome: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: str
):
    for name in list(sys.modules):
        if name.startswith("inercal.report."):
            monkeypatch.delitem(sys.modules, name)
        if name.partition(".")[0] == missing:
            monkeypatch.setitem(sys.modules, name, None)
    with refused(InputError) as refusal:
        write_report(outcome, tmp_path / "one.html")
    assert "inercal[report]" in str(refusal.value)
    assert list(tmp_path.iterdir()) == []


def test_a_page_that_fails_leaves_the_old_file(outcome: Outcome, tmp_path: Path):
    path = tmp_path / "one.html"
    path.write_text("old")
    broken = replace(outcome, estimate=replace(outcome.estimate, whitened=np.ones(5)))
    with pytest.raises(ValueError) as failure:  # noqa: PT011
        write_report(broken, path)
    assert not isinstance(failure.value, InputError)
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]
