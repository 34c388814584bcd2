"""The verb, and run files that name its file: the example from end to end, and refusals."""

import json
import shutil
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from tests.base_seeds import evidence
from tests.program import run_program
from tests.refusals import refused
from tests.type_prior.cases import calibrations, nine, patent_nees
from tests.type_prior.example_files import (
    FOLDER,
    SEED,
    example_tables,
    example_truth,
    table_text,
)
from tests.type_prior.populations import draw

import inercal
from inercal.calibration.type_prior import load_type_prior
from inercal.laboratory.store import Register
from inercal.physics.sensors import G0
from inercal.runfile import read

SENSORS = range(21, 26)


@pytest.fixture(scope="module")
def example(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a copy of the example with the calibrations of its tumble tests."""
    folder = tmp_path_factory.mktemp("example") / "prior"
    shutil.copytree(FOLDER, folder)
    for n in SENSORS:
        found = inercal.calibrate(folder / f"QA_{n}.toml").calibration
        inercal.save(found, folder / f"QA_{n}.calibration.json")
    return folder


def files(folder: Path) -> list[Path]:
    return [folder / f"QA_{n}.calibration.json" for n in SENSORS]


def test_the_tables_of_the_example_are_those_of_the_independent_generator():
    for name, table in example_tables().items():
        assert (FOLDER / name).read_text(encoding="utf-8") == table_text(*table)


@pytest.mark.slow
def test_the_prior_of_the_example_is_what_the_verb_writes(example: Path, tmp_path: Path):
    out = tmp_path / "QA.prior.toml"
    ended = run_program("prior", *files(example), "--out", out)
    assert ended.status == 0, ended.error
    made, kept = load_type_prior(out), load_type_prior(FOLDER / "QA.prior.toml")
    assert made.names == kept.names == ("k2", "k3", "kip")
    for one, other in zip(made.coefficient, kept.coefficient, strict=True):
        assert (one.mean, one.sd) == pytest.approx((other.mean, other.sd), rel=1e-6)
    truth = example_truth(np.random.default_rng(SEED))
    for one in made.coefficient:
        scale = {"k2": 1 / G0, "k3": 1 / G0**2, "kip": 1 / G0}[one.name]
        # The last rows are accelerometers that were not tested.
        new = truth[one.name][5:].ravel() * scale
        assert np.mean(np.abs(new - one.mean) < 2 * one.sd) >= 0.75
    assert run_program("prior", *files(example), "--out", out).status == 2
    out.write_text("mine", encoding="utf-8")
    assert run_program("prior", *files(example), "--out", out).status == 2
    assert out.read_text(encoding="utf-8") == "mine"
    assert run_program("prior", *files(example), "--out", out, "--force").status == 0


@pytest.mark.parametrize("estimator", ["patent", "joint", "dual"])
def test_the_pair_of_the_example_agrees_with_its_truth(example: Path, estimator: str):
    text = (example / "pair.toml").read_text(encoding="utf-8")
    run = example / f"{estimator}.toml"
    run.write_text(text.replace('"patent"', f'"{estimator}"'), encoding="utf-8")
    if estimator == "dual":
        drop = 'autocollimation = "pairs"\nautocollimator = "0.1 ″"\n'
        run.write_text(run.read_text(encoding="utf-8").replace(drop, ""), encoding="utf-8")
    outcome = inercal.calibrate(run)
    truth = example_truth(np.random.default_rng(SEED))
    off, covariance = nine(outcome.estimate, truth, 5)
    # The 0.1 % and 99.9 % points of χ² with nine degrees of freedom.
    assert 1.15 < off @ np.linalg.solve(covariance, off) < 27.9


def test_a_prior_of_the_type_is_used_by_every_axis(example: Path):
    run = read(example / "pair.toml")
    known = load_type_prior(example / "QA.prior.toml")
    (prior,) = run.priors
    assert set(prior.names) == {f"{axis}.{name}" for axis in "ab" for name in known.names}
    for name, mean, sd in zip(
        prior.names, prior.mean, np.sqrt(np.diag(prior.covariance)), strict=True
    ):
        one = known.coefficient[known.names.index(name.partition(".")[2])]
        assert (mean, sd) == (one.mean, pytest.approx(one.sd))


def run_file(folder: Path, *changes: tuple[str, str], more: str = "") -> Path:
    text = (folder / "pair.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "changed.toml"
    path.write_text(text + more, encoding="utf-8")
    return path


def test_what_does_not_fit_the_run_is_refused(example: Path):
    key = "[method] prior_type"
    with refused(key="[method]", names=("a.kip",)):
        read(run_file(example, more='prior."a.kip" = "0 ± 20 µg/g²"\n'))
    with refused(key=key, names=("a",)):
        read(run_file(example, ('scale = "3 V/g"', 'scale = "2 V/g"')))
    only = run_file(example, ('"patent"', '"joint"'), more='coefficients = ["bias", "scale"]\n')
    with refused(key=key):
        read(only)
    with refused(file="none.toml"):
        read(run_file(example, ("QA.prior.toml", "none.toml")))
    # Coefficients that this run does not estimate are not used.
    fewer = run_file(example, ('"patent"', '"joint"'), more='coefficients = ["k0", "k1", "kip"]\n')
    assert read(fewer).priors[0].names == ("a.kip", "b.kip")


def test_a_prior_from_the_sensor_or_the_recording_itself_is_refused(example: Path):
    text = (example / "QA_21.toml").read_text(encoding="utf-8")
    text = text.replace("[method]", '[method]\nprior_type = "QA.prior.toml"')
    run = example / "again.toml"
    for own in (text, text.replace('"QA 21"', '"QA 31"')):
        run.write_text(own, encoding="utf-8")
        with refused(key="[method] prior_type", names=("QA 21",)):
            inercal.calibrate(run)


def test_a_result_names_its_prior_and_the_number_of_sensors(example: Path):
    found = inercal.calibrate(example / "pair.toml").calibration
    assert found.conditions["prior of the type"] == "QA.prior.toml, from 5 sensors"
    digest = sha256((example / "QA.prior.toml").read_bytes()).hexdigest()
    assert found.provenance["prior of the type"] == "QA.prior.toml"
    assert found.provenance["prior of the type sha256"] == digest
    assert found.verdict is not None
    explained = [line for _, lines in found.verdict.explanation for line in lines]
    assert any("QA.prior.toml" in line and "5 sensors" in line for line in explained)


def test_the_other_keys_keep_their_meaning_beside_it(example: Path):
    run_program("prior", *files(example), "-c", "kip", "-o", example / "kip.prior.toml")
    more = 'prior."a.k3" = "0 ± 5 µg/g³"\n[method.prior_from."QA_21.calibration.json"]\n'
    more += '"b.k3" = "a.k3"\n'
    priors = read(run_file(example, ("QA.prior.toml", "kip.prior.toml"), more=more)).priors
    assert [one.names for one in priors] == [("a.k3",), ("b.k3",), ("a.kip", "b.kip")]


def test_the_file_is_an_input_of_the_run_which_a_bundle_carries(example: Path):
    run = read(example / "pair.toml")
    assert example / "QA.prior.toml" in run.input_files()


def test_sensors_of_a_register_are_found_by_their_type(example: Path, tmp_path: Path):
    address = str(tmp_path / "register.db")
    with Register(address) as register:
        register.enter_calibrations(files(example))
    chosen = ("--register", address, "--type", "Q-Flex QA 3000")
    ended = run_program("prior", *chosen, "--json")
    content = json.loads(ended.output)
    assert content["type_name"] == "Q-Flex QA 3000"
    assert sorted(one["name"] for one in content["sensor"]) == [f"QA {n}" for n in SENSORS]
    direct = json.loads(run_program("prior", *files(example), "--json").output)
    assert content["coefficient"] == direct["coefficient"]
    assert run_program("prior", *chosen[:2], "--type", "QA 3001").status == 2
    assert run_program("prior", *chosen, "-c", "koo").status == 2


def test_wrong_calls_are_refused_in_one_line(example: Path):
    named = files(example)
    for arguments in (
        (),
        (*named, "--type", "QA"),
        (*named, "--register", "r.db"),
        (*named, "--out", "prior.json"),
        (*named, "--out", named[0]),
        (*named[:2],),
        (*named, named[0]),
        (*named, "-c", "koo"),
        (*named, "-c", "delta_o"),
    ):
        assert run_program("prior", *arguments).status == 2


def test_the_output_names_an_outlying_sensor(tmp_path: Path):
    drawn = draw(np.random.default_rng(2), 10, np.array([10.0]), np.array([2.0]))
    drawn.values[3] += 400
    written = [inercal.save(one, tmp_path / name) for name, one in calibrations(drawn).items()]
    assert "S4" in run_program("prior", *written).output
    without = json.loads(run_program("prior", *written, "--without", "S4", "--json").output)
    assert without["outlying"] == []


@pytest.mark.slow
@pytest.mark.parametrize("estimator", [evidence("patent"), "joint"])
def test_the_nine_parameters_are_as_uncertain_as_stated_in_a_sample(estimator: str, tmp_path: Path):
    found, _ = patent_nees(estimator, 1, 100, 5, tmp_path)
    # The sampling band of 100 populations is wider than 0.9 to 1.1.
    assert np.mean(found) == pytest.approx(1, abs=3.3 * np.sqrt(2 / 9 / 100))
