"""Live filters against the recording's calibration: to the last bit, whatever went wrong."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2
from tests.base_seeds import evidence
from tests.host.synthetic_log import LAYOUT, PATH, Bench, Faults, run_file
from tests.refusals import refused

import inercal
from inercal.benches import Turntable
from inercal.benches.turntable.reading.track_observation import observe
from inercal.host import recording_writer
from inercal.host.assembly import SampleAssembler
from inercal.host.live_estimator import LiveEstimator
from inercal.host.run_log import LogFrame, RunLog
from inercal.methods import METHODS
from inercal.methods.turntable_kalman.combined_estimate import run_filter, split_priors
from inercal.methods.turntable_kalman.filter_config import FILTER_CONFIGS, FILTER_KINDS
from inercal.methods.turntable_kalman.filter_tests import FilterResult
from inercal.pipeline import calibrate
from inercal.runfile import Run, read

HARD = Faults(lost=0.01, repeated=0.01, changed=0.01, outages=((55.0, 400.0),))
METHOD = 'name = "turntable_kalman"'


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("run")


@pytest.fixture(scope="module")
def bench(folder: Path) -> Bench:
    run = run_file(
        folder, **{'latency = "0 ms ± 5 ms"': 'latency = "0 ms ± 5 ms"\nclock = "20 ppm"'}
    )
    return Bench(run, seed=2, wraps=300.0, clock=11e-6, latency=2e-3, faults=HARD)


@pytest.fixture(scope="module")
def logged(bench: Bench, folder: Path) -> list[LogFrame]:
    frames = bench.frames()
    with RunLog(folder / "log") as log:
        for frame in frames:
            log.append(*frame)
    recording_writer.write_recording(bench.run, LAYOUT, folder / "log", folder)
    return frames


def followed(run: Run, logged: list[LogFrame], cuts: list[int]) -> LiveEstimator:
    made, live = SampleAssembler(run, LAYOUT), LiveEstimator(run)
    bounds: list[int] = [0, *cuts, len(logged)]
    for start, stop in pairwise(bounds):
        for frame in logged[start:stop]:
            made.feed(frame)
        if (block := made.take()) is not None:
            live.feed(block)
    return live


def by_recording(run: Run) -> dict[str, FilterResult]:
    """Return what both filters make of the recording, as the pipeline gathers it."""
    assert isinstance(run.bench, Turntable)
    track = observe(run).observations.track
    assert track is not None
    way, priors = run.filter or FILTER_CONFIGS[run.estimator], split_priors(run.sensor, run.priors)
    return {
        kind: run_filter(kind, run.sensor, run.bench, track, way, priors) for kind in FILTER_KINDS
    }


@pytest.mark.parametrize(
    ("estimator", "keys"),
    [
        evidence("full", {}),
        pytest.param("drift", {}, marks=pytest.mark.slow),
        pytest.param("paper", {}, marks=pytest.mark.slow),
        (
            "full",
            {
                "readback_sd": "3 ″",
                "velocity_sd": "0.1 mm/s",
                "epoch": "0.05 s",
                "bias_drift": False,
                "table_states": "lean",
                "initial": {"gyro_bias": "100 °/h", "attitude": "30 ″"},
            },
        ),
    ],
)
def test_live_is_the_recordings_calibration_to_the_last_bit(
    bench: Bench, logged: list[LogFrame], folder: Path, estimator: str, keys: dict[str, object]
):
    run = read(folder / "mimu.toml", {"estimator": estimator} | ({"filter": keys} if keys else {}))
    rng = np.random.default_rng(4)
    cuts = np.sort(rng.choice(np.arange(1, len(logged)), 150, replace=False)).tolist()
    live = followed(run, logged, cuts)
    stored = by_recording(run)
    for kind, found in live.partial_estimates.items():
        own = len(found.names)
        assert found.names == stored[kind].triad.sensor.coefficients
        assert found.value.tobytes() == stored[kind].value[:own].tobytes()
        assert found.covariance.tobytes() == stored[kind].covariance[:own, :own].tobytes()
    assert set(live.partial_estimates) == {"w", "f"}
    outcome = calibrate(run)
    p = len(run.sensor.coefficients)
    assert outcome.estimate.value[:p].tobytes() == live.values.tobytes()
    for kind, (squares, components) in live.innovations.items():
        assert squares == stored[kind].nis
        # Of the recording the coefficients take degrees of freedom off.
        taken = components - stored[kind].dof
        assert 0 <= taken <= len(stored[kind].triad.sensor.coefficients)
    assert set(live.innovations) == {"w", "f"}


@pytest.mark.slow
def test_the_truth_is_recovered_over_losses_and_an_outage(
    bench: Bench, logged: list[LogFrame], folder: Path
):
    run = bench.run
    live = followed(run, logged, list(range(500, len(logged), 500)))
    truth = np.array([run.truth[name] for name in live.names])
    off = live.values - truth
    for kind, found in live.partial_estimates.items():
        assert found.names == run.sensor.select_axes("w" if kind == "w" else "f").coefficients
        at, p = [live.names.index(name) for name in found.names], len(found.names)
        nees = float(off[at] @ np.linalg.solve(found.covariance, off[at]))
        assert chi2.ppf(1e-3, p) < nees < chi2.ppf(1 - 1e-3, p)
    assert np.abs(off / live.std).max() < 4
    outcome = calibrate(run)
    latency = dict(zip(outcome.estimate.names, outcome.estimate.value, strict=True))["latency"]
    assert abs(latency - 2e-3) < 5e-3
    assert not [one for one in outcome.findings if one.severity == "refused"]


def test_nothing_is_known_before_the_rest_has_lasted(bench: Bench, logged: list[LogFrame]):
    run = bench.run
    made, live = SampleAssembler(run, LAYOUT), LiveEstimator(run)
    assert np.isnan([live.time, *live.values, *live.std]).all()
    assert live.innovations == {}
    begun: list[float] = []
    for k, frame in enumerate(logged):
        made.feed(frame)
        if k % 50 == 0 and (block := made.take()) is not None:
            live.feed(block)
            if live.has_estimate:
                begun.append(live.time)
        if begun:
            break
    assert begun[0] == pytest.approx(20.0 + 0.26, abs=0.6)
    assert np.isfinite(live.values).all()
    assert (live.std > 0).all()
    assert set(live.innovations) == {"w", "f"}


def test_a_rest_that_is_too_short_is_said(tmp_path: Path):
    run = run_file(tmp_path, PATH.replace("0,0,0,24", "0,0,0,12"))
    logged = Bench(run, seed=1).frames()
    with refused(key="hold"):
        followed(run, logged, list(range(100, len(logged), 100)))


def test_another_method_is_not_followed(tmp_path: Path):
    run = run_file(tmp_path, **{METHOD: 'name = "turntable_discrete"', 'path = "path.csv"': ""})
    with refused(key="[method] name", names=("turntable_discrete",), file=run.path):
        LiveEstimator(run)


def test_neither_host_nor_terminal_names_a_method():
    source = Path(inercal.__file__).parent
    files = [*(source / "host").rglob("*.py"), *source.glob("cli/bench*.py")]
    assert len(files) > 90
    texts = {file.name: file.read_text(encoding="utf-8") for file in files}
    assert [(file, one) for file, text in texts.items() for one in METHODS if one in text] == []
