"""The example of qualify, from readings to a calibration, its shared errors and its withdrawal."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.program import run_program
from tests.refusals import refused

from inercal.benches.qualification import Qualification
from inercal.benches.qualification.input_file import qualify
from inercal.benches.qualification.result import drift_between, load, qualification_object, save
from inercal.calibration import SharedError, shared_errors
from inercal.calibration.files import load as load_calibration
from inercal.calibration.files import save as save_calibration
from inercal.laboratory.store import CertificateFiles, CertificateRequest, Register
from inercal.pipeline import Outcome, calibrate
from inercal.pipeline.batch import calibrate_batch
from inercal.pipeline.budget.experiment_from_runfile import experiment_from_run
from inercal.recordings.io.read import read_table
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples" / "qualify"
INPUTS = ("gravity", "head", "rate", "radius")  # radius uses gravity and rate
ARM = """
[sensor]
name = "SN 0417"

[sensor.accelerometer]
unit = "V"
scale = "0.1 V/g"

[bench]
kind = "centrifuge"
name = "arm 1"
qualification = "radius.qualification.json"
latitude = "52.1 ° ± 0.1 °"
tilt = "2 ″"
sense = "clockwise"

[data]
kind = "means"
file = "lab.csv"
label = "position"
accelerometer = ["ax", "ay", "az"]
arm_rate = "rpm"

[data.sd]
accelerometer = "1 µV"

[method]
name = "centrifuge_norm"
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a folder with the example and its qualifications."""
    for file in EXAMPLES.iterdir():
        if file.suffix in (".toml", ".csv"):
            shutil.copy(file, tmp_path)
    for name in INPUTS:
        save(qualify(tmp_path / f"{name}.toml"), tmp_path / f"{name}.qualification.json")
    shutil.copy(EXAMPLES.parent / "centrifuge" / "lab.csv", tmp_path)
    return tmp_path


def changed(folder: Path, *changes: tuple[str, str], name: str = "tumble") -> Path:
    text = (folder / f"{name}.toml").read_text(encoding="utf-8")
    for old, new in changes:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path = folder / "changed.toml"
    path.write_text(text, encoding="utf-8")
    return path


def arm(folder: Path, *changes: tuple[str, str]) -> Outcome:
    (folder / "arm.toml").write_text(ARM, encoding="utf-8")
    return calibrate(changed(folder, *changes, name="arm"))


def by_name(outcome: Outcome) -> Mapping[str, SharedError]:
    assert outcome.calibration.shared is not None
    return {one.name: one for one in outcome.calibration.shared}


def with_covariance(found: Qualification, covariance: np.ndarray) -> Qualification:
    return replace(found, covariance=covariance)


def test_the_example_finds_the_sensor_with_head_and_gravity_as_qualified(folder: Path):
    found = calibrate(folder / "tumble.toml").calibration
    truth = {"a.k0": 6.5e-4 * 9.80665, "a.k1": 1.2e-3}
    for name, true in truth.items():
        k = found.sensor.coefficients.index(name)
        assert abs(found.values[k] - true) < 3 * found.std[k]
    head, gravity = (load(folder / f"{n}.qualification.json") for n in ("head", "gravity"))
    determinations = {one.name: one.determination for one in found.shared or ()}
    assert determinations["g"] == gravity.determination
    assert {determinations[n] for n in head.names} == {head.determination}
    dates = {one.name: one.date for one in found.shared or ()}
    assert dates["sin1"] == "2026-03-01"
    assert set(found.provenance.values()) >= {head.determination, gravity.determination}
    again = load_calibration(save_calibration(found, folder / "again.calibration.json"))
    assert [one.determination for one in again.shared or ()] == list(determinations.values())


def test_without_the_map_of_the_head_the_residuals_show_it(folder: Path):
    known = calibrate(folder / "tumble.toml").estimate
    path = changed(
        folder,
        ('["head.qualification.json", "gravity', '["gravity'),
        ('division = "0.05 ″"', 'division = "0.05 ″"\nharmonics = ["0.027 ″", "0.027 ″"]'),
    )
    assert known.chi2 < 29 < 60 < calibrate(path).estimate.chi2  # 95 % of 18 degrees: 28.9


@pytest.mark.slow
def test_correlated_parameters_enter_covariance_and_shared_errors(folder: Path):
    outcome = arm(folder)
    found = load(folder / "radius.qualification.json")
    alone = with_covariance(found, np.diag(found.std**2))
    save(alone, folder / "alone.qualification.json")
    other = arm(folder, ("radius.qualification", "alone.qualification"))
    p = len(outcome.calibration.values)
    before, after = other.estimate, outcome.estimate
    names = found.names
    places = [before.names.index(n) for n in names]
    informed = before.covariance[np.ix_(places, places)]
    # Without the prior: information of the data on the parameters, then with the joint one.
    within = np.linalg.inv(
        np.linalg.inv(informed) - np.diag(1 / found.std**2) + np.linalg.inv(found.covariance)
    )
    assert after.covariance[np.ix_(places, places)] == pytest.approx(within, rel=1e-6)
    change = after.covariance[:p, :p] - before.covariance[:p, :p]
    size = np.sqrt(np.outer(*[np.diagonal(before.covariance)[:p]] * 2))
    assert np.abs(change / size).max() > 0.01
    # The shared part is J Σ Jᵀ with J = P_cb Σ⁻¹.
    cross = after.covariance[:p][:, places]
    j = cross @ np.linalg.inv(found.covariance)
    total = shared_errors.shared_covariance(
        outcome.calibration.shared,
        tuple(one for one in outcome.calibration.shared or () if one.name in names),
        (range(p), range(p)),
    )
    assert total == pytest.approx(j @ found.covariance @ j.T, rel=1e-6, abs=1e-18)


@pytest.mark.slow
def test_gravity_of_a_radius_is_that_of_the_house(folder: Path):
    gravity = load(folder / "gravity.qualification.json").determination
    alone = arm(folder)
    assert by_name(alone)["g"].determination == gravity
    tumble = by_name(calibrate(folder / "tumble.toml"))
    assert tumble["g"].determination == gravity
    # Both files: gravity is of one determination, and comes once.
    both = arm(
        folder,
        (
            '"radius.qualification.json"',
            '["gravity.qualification.json", "radius.qualification.json"]',
        ),
    )
    assert both.calibration.covariance == pytest.approx(alone.calibration.covariance)


def test_a_larger_covariance_enlarges_u(folder: Path):
    found = load(folder / "gravity.qualification.json")
    save(with_covariance(found, 100 * found.covariance), folder / "wide.qualification.json")
    wide = calibrate(changed(folder, ("gravity.qualification", "wide.qualification"))).calibration
    near = calibrate(folder / "tumble.toml").calibration
    k = near.sensor.coefficients.index("a.k1")
    g = 9.8012266
    expected = near.std[k] ** 2 + 99 * (float(found.std[0]) / g) ** 2
    assert wide.std[k] ** 2 == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (('lean = "10 ″"', 'lean = "10 ″"\nharmonics = ["1 ″"]'), "[bench] harmonics"),
        (('lean = "10 ″"', 'lean = "10 ″"\ngravity = "9.8 m/s²"'), "[bench] gravity"),
        (('name = "head 2"', 'name = "head 1"'), "[bench] qualification"),
        (('name = "head 2"\n', ""), "[bench] qualification"),
        (("head.qualification", "rate.qualification"), "[bench] qualification"),
        (("head.qualification", "none.qualification"), "[bench] qualification"),
        (("head.qualification.json", "head.csv"), "[bench] qualification"),
        (
            ('"gravity.qualification.json"]', '"gravity.qualification.json", "other.json"]'),
            "[bench] qualification",
        ),
    ],
)
def test_what_does_not_fit_is_refused(folder: Path, change: tuple[str, str], key: str):
    other = qualify(changed(folder, ("20 µGal", "30 µGal"), name="gravity"))
    save(other, folder / "other.json")
    with refused(key=key):
        read(changed(folder, change))


def renamed(found: Qualification, name: str, **more: Any) -> Qualification:
    return replace(
        found,
        parameters=(replace(found.parameters[0], name=name, **more), *found.parameters[1:]),
    )


@pytest.mark.parametrize("name", ["tilt_z", "trim", "radius", "sin1[outer]"])
def test_an_unknown_parameter_is_refused(folder: Path, name: str):
    found = load(folder / "head.qualification.json")
    save(renamed(found, name), folder / "head.qualification.json")
    with refused(key="[bench] qualification", names=(name,)):
        read(folder / "tumble.toml")


def test_a_parameter_of_each_position_has_no_value(folder: Path):
    found = load(folder / "head.qualification.json")
    diagonal = with_covariance(found, np.diag(np.diagonal(found.covariance)))
    wrong = replace(diagonal, parameters=(*diagonal.parameters[:3], replace(
        diagonal.parameters[3], name="division", value=1e-7)))  # fmt: skip
    save(wrong, folder / "head.qualification.json")
    path = changed(folder, ('division = "0.05 ″"\n', ""))
    with refused(key="[bench] qualification", names=("division",)):
        read(path)


def test_a_file_that_was_changed_by_hand_is_refused(folder: Path):
    path = folder / "head.qualification.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    content["parameters"][0]["value"] *= 1.01
    path.write_text(json.dumps(content), encoding="utf-8")
    with refused(file="head.qualification.json"):
        load(path)
    content = qualification_object(load(folder / "rate.qualification.json"))
    del content["covariance"]
    path.write_text(json.dumps(content), encoding="utf-8")
    with refused(file="head.qualification.json"):
        load(path)


def test_an_expired_qualification_is_said_in_the_verdict(folder: Path):
    found = load(folder / "head.qualification.json")
    save(replace(found, parameters=tuple(
        replace(one, valid_until=date(2026, 4, 1)) for one in found.parameters
    )), folder / "head.qualification.json")  # fmt: skip
    outcome = calibrate(folder / "tumble.toml")
    (finding,) = [one for one in outcome.findings if one.what == "qualification"]
    assert finding.severity == "warning"
    assert finding.message in outcome.calibration.notes
    dated = changed(folder, ("[data]\n", "[job]\nmeasured = 2026-03-20\n\n[data]\n"))
    assert not [one for one in read(dated).findings if one.what == "qualification"]


@pytest.mark.slow
def test_a_withdrawn_qualification_lists_what_used_it_and_is_refused(folder: Path):
    register = folder / "register.db"
    with Register(str(register)) as opened:
        for name in ("tumble", "arm"):
            (folder / "arm.toml").write_text(ARM, encoding="utf-8")
            opened.enter_calibration(calibrate(folder / f"{name}.toml").calibration)
        made = CertificateRequest(
            "{year}-{sequence}", date(2026, 4, 1), "", "", lambda *_: CertificateFiles(b"p", b"d")
        )
        opened.issue_certificate(opened.calibration(1).calibration, made, "2026-03-20")
    for name, used in (("gravity", {1: {"g"}, 2: {"g"}}), ("rate", {2: {"rate"}}),
                       ("head", {1: {"sin1", "cos1", "sin2", "cos2"}})):  # fmt: skip
        path = folder / f"{name}.qualification.json"
        ended = run_program(
            "qualify", path, "--withdraw", "certificate recalled", "--register", register, "--json"
        )
        assert ended.status == 0, ended.error
        uses = json.loads(ended.output)["uses"]
        found = {one["calibration"]: set(one["parameters"]) for one in uses}
        certificates = {one["calibration"]: one["certificates"] for one in uses}
        assert certificates.get(1, ["2026-1"]) == ["2026-1"]
        assert certificates.get(2, []) == []
        assert found == used
        assert load(path).withdrawn
    with refused(key="[bench] qualification"):
        read(folder / "tumble.toml")


def test_two_qualifications_show_the_walk_between_them(folder: Path):
    earlier = load(folder / "rate.qualification.json")
    later = replace(
        earlier,
        date=date(2027, 3, 4),
        parameters=(replace(earlier.parameters[0], value=earlier.parameters[0].value + 1e-6),),
    )
    (found,) = drift_between(earlier, later)
    u = float(earlier.std[0])
    assert found.walk == pytest.approx((1e-12 - 2 * u**2) / (365 / 365.25), rel=1e-6)
    assert found.u_year == pytest.approx((u**2 + found.walk) ** 0.5, rel=1e-6)
    with refused():
        drift_between(later, earlier)


def test_the_verb_writes_once_and_only_with_force_again(folder: Path):
    out = folder / "new.qualification.json"
    first = run_program("qualify", folder / "head.toml", "--out", out, "--json")
    assert first.status == 0, first.error
    assert json.loads(first.output)["parameters"][0]["name"] == "sin1"
    assert run_program("qualify", folder / "head.toml", "--out", out).status == 2
    assert run_program("qualify", folder / "head.toml", "--out", out, "--force").status == 0
    assert load(out).determination == load(folder / "head.qualification.json").determination
    assert run_program("qualify", folder / "head.toml", "--drift").status == 2


@pytest.mark.parametrize(
    ("name", "change", "key"),
    [
        ("head", ('kind = "head_map"', 'kind = "map"'), "[qualification] kind"),
        ("head", ('"dividing_head"', '"rate_table"'), "[qualification] bench"),
        ("head", ('"dividing_head"', '"lathe"'), "[qualification] bench"),
        ("head", ("harmonics = 2", "harmonics = 18"), "[measurement] harmonics"),
        ("head", ('autocollimator = "0.1 ″"\n', ""), "[measurement] autocollimator"),
        ("head", ('"0.1 ″"', '"0.1 s"'), "[measurement] autocollimator"),
        ("head", ('"0.1 ″"', '"0 ″"'), "[measurement] autocollimator"),
        ("head", ('"head.csv"', '"none.csv"'), "[measurement] file"),
        ("head", ("harmonics = 2", "waves = 2"), "[measurement] waves"),
        ("head", ("valid_until = 2028", "valid_until = 2025"), "[qualification] valid_until"),
        ("gravity", ('kind = "gravity"', 'kind = "gravity"\nbench = "hand"'),
         "[qualification] bench"),
        ("gravity", (" ± 20 µGal", ""), "[measurement] gravity"),
        ("radius", ('k2 = "0 µg/g² ± 0.1 µg/g²"\n', ""), "[measurement] k2"),
        ("rate", ('certificate = ', 'uses = ["gravity.qualification.json"]\ncertificate = '),
         "[qualification] uses"),
    ],
)  # fmt: skip
def test_an_input_file_that_does_not_fit_is_refused(
    folder: Path, name: str, change: tuple[str, str], key: str
):
    with refused(key=key):
        qualify(changed(folder, change, name=name))


LEVEL = """
[qualification]
kind = "{kind}"
bench = "{bench}"
date = 2026-03-01
method = "level"

[measurement]
file = "level.csv"
level = "0.2 ″"
{more}
"""


def test_a_level_on_the_base_is_refused_and_one_on_the_table_gives_the_lean(folder: Path):
    angle = np.arange(8) * 45.0
    rows = [f"{a:g},{10 + 5 * np.cos(np.radians(a)):.3f},1" for a in angle]
    (folder / "level.csv").write_text("\n".join(["angle,reading,sense", *rows]), encoding="utf-8")

    def made(kind: str, bench: str, more: str) -> Qualification:
        path = folder / "level.toml"
        path.write_text(LEVEL.format(kind=kind, bench=bench, more=more), encoding="utf-8")
        return qualify(path)

    arcsec = np.pi / 648000
    found = made("table_tilt", "turntable", 'azimuth = "0 °"')
    assert np.array([one.value for one in found.parameters]) / arcsec == pytest.approx(
        [5, 0], abs=2e-3
    )
    table = made("table_tilt", "rate_table", "")
    assert table.std / arcsec == pytest.approx([5 / 2**0.5] * 2, rel=1e-2)
    with refused(key="[measurement] level_at"):
        made("table_tilt", "turntable", 'azimuth = "0 °"\nlevel_at = "base"')
    with refused(key="[measurement] azimuth"):
        made("table_tilt", "turntable", "")
    with refused(key="[measurement] sense"):
        made("right_angle", "turntable", 'axes = "zxy"')


@pytest.mark.slow
def test_a_budget_draws_correlated_parameters_as_the_fit_counts_them(folder: Path):
    plan = 'rates = ["60 rpm", "120 rpm", "180 rpm"]\n'
    (folder / "arm.toml").write_text(ARM + plan, encoding="utf-8")
    experiment = experiment_from_run(read(folder / "arm.toml"))
    p = len(experiment.sensor.coefficients)
    expected = np.diagonal(experiment.estimate().covariance)[:p]
    z = np.random.default_rng(1).normal(size=(2000, experiment.size))
    ratio = np.var(experiment(z), axis=0) / expected
    # Standard deviation of a variance of 2 000 draws: 3.2 %.
    assert np.abs(ratio - 1).max() < 0.13
    radius = load(folder / "radius.qualification.json")
    drawn = {name: k for k, name in enumerate(radius.names)}
    assert set(drawn) <= set(experiment.bench_parameters)


@pytest.mark.slow
def test_a_batch_has_the_joint_prior(folder: Path):
    one = arm(folder).calibration
    table = read_table(folder / "lab.csv", text=("position",))
    columns = {name: np.asarray(table.columns[name]) for name in ("position", "rpm")}
    readings = {name: np.stack([table.numbers(name)] * 2) for name in ("ax", "ay", "az")}
    batch = calibrate_batch(
        columns | readings,
        method="centrifuge_norm",
        sensor={"accelerometer": {"unit": "V", "scale": "0.1 V/g"}},
        bench={
            "kind": "centrifuge",
            "name": "arm 1",
            "qualification": str(folder / "radius.qualification.json"),
            "latitude": "52.1 ° ± 0.1 °",
            "tilt": "2 ″",
            "sense": "clockwise",
        },
        label="position",
        accelerometer=["ax", "ay", "az"],
        arm_rate="rpm",
        sd={"accelerometer": "1 µV"},
    )
    size = np.sqrt(np.outer(*[np.diagonal(one.covariance)] * 2))
    assert (np.abs(batch.covariance[1] - one.covariance) < 1e-4 * size + 1e-30).all()
    assert (np.abs(batch.values[1] - one.values) < 1e-3 * one.std).all()


def test_the_files_of_the_example_are_those_of_its_readings(folder: Path):
    for name in INPUTS:
        stored = load(EXAMPLES / f"{name}.qualification.json")
        anew = load(folder / f"{name}.qualification.json")
        assert stored.names == anew.names
        assert stored.covariance == pytest.approx(anew.covariance, rel=1e-6)
        values = [[p.value for p in one.parameters] for one in (stored, anew)]
        assert np.abs((np.array(values[0]) - values[1]) / stored.std).max() < 1e-6


def test_a_harmonic_that_the_model_lacks_is_said_to_who_qualifies_and_who_calibrates(folder: Path):
    path = changed(folder, ("harmonics = 2", "harmonics = 1"), name="head")
    out = folder / "head.qualification.json"
    ended = run_program("qualify", path, "--out", out, "--force")
    assert ended.status == 3
    (suspect,) = load(out).suspects
    findings = [f for f in read(folder / "tumble.toml").findings if f.what == "qualification"]
    assert [suspect in one.message for one in findings] == [True]


def test_a_simulation_draws_the_bench_with_its_covariance(folder: Path):
    (folder / "arm.toml").write_text(ARM, encoding="utf-8")
    run, found = read(folder / "arm.toml"), load(folder / "radius.qualification.json")
    declared = {one.name: one for one in run.bench.parameters}
    drawn = run.qualified.parameters.draw(declared, np.random.default_rng(1), 20_000)
    made = np.cov([drawn[name] for name in found.names])
    size = np.outer(found.std, found.std)
    assert (np.abs(made - found.covariance) / size).max() < 0.04


@pytest.mark.slow
def test_gravity_is_shared_through_a_radius_that_builds_on_it(folder: Path):
    """Two arms in one house with radii by sensors: their errors are correlated by gravity."""
    first = by_name(arm(folder))
    rate = changed(folder, ('name = "arm 1"', 'name = "arm 2"'), name="rate")
    save(qualify(rate), folder / "rate.qualification.json")
    other = changed(folder, ('name = "arm 1"', 'name = "arm 2"'), name="radius")
    save(qualify(other), folder / "radius.qualification.json")
    second = by_name(arm(folder, ('name = "arm 1"', 'name = "arm 2"')))
    alike = {n for n in first if n in second and first[n].determination == second[n].determination}
    assert alike == {"g"}
