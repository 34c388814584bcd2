import json
from dataclasses import replace
from hashlib import sha256
from math import inf
from pathlib import Path

import pytest
from numpy.testing import assert_allclose
from tests.refusals import refused
from tests.runfile.key_sweep import EXAMPLES, Content, example, toml
from tests.runfile.run_file_texts import FERRARIS

from inercal.basics.errors import InputError
from inercal.calibration.files import calibration_object, canonical_text, load, parse, save
from inercal.calibration.specification import (
    Conformity,
    LimitResult,
    limit_row,
    probability_text,
)
from inercal.physics.sensors import G0, triad
from inercal.pipeline import calibrate
from inercal.report.calibration_page import calibration_page
from inercal.runfile import read
from inercal.runfile.schema import SpecificationSection

MG = 1e-3 * G0


def limits(tmp_path: Path, text: str, base: str = FERRARIS) -> dict[str, tuple[float, float]]:
    path = tmp_path / "run.toml"
    path.write_text(f"{base}\n{text}", encoding="utf-8")
    run = read(path)
    assert run.specification is not None
    return dict(run.specification.limits)


def stated(tmp_path: Path, *lines: str) -> dict[str, tuple[float, float]]:
    return limits(tmp_path, "[specification.limits]\n" + "\n".join(lines))


def test_the_most_special_key_counts(tmp_path: Path):
    special = ('"ax.bias" = "± 8 mg"', '"ay.k0" = "± 7 mg"')
    for general, sizes in (('bias = "± 9 mg"', [8, 7, 9]), ('k0 = "± 6 mg"', [8, 7, 6])):
        found = stated(tmp_path, general, *special)
        assert_allclose([found[f"a{k}.k0"][1] / MG for k in "xyz"], sizes)


def test_a_group_limits_what_its_unit_fits(tmp_path: Path):
    assert set(stated(tmp_path, 'bias = "± 9 mg"')) == {"ax.k0", "ay.k0", "az.k0"}
    assert set(stated(tmp_path, 'bias = "± 9 °/h"')) == {"gx.bias", "gy.bias", "gz.bias"}


@pytest.mark.parametrize(
    ("text", "lower", "upper"),
    [
        ('"± 20 mg"', -20, 20),
        ('"+/- 20 mg"', -20, 20),
        ('"5 mg ± 20 mg"', -15, 25),
        ('["-1 mg", "2 mg"]', -1, 2),
        ('"≤ 2 mg"', -inf, 2),
        ('"≥ -2 mg"', -2, inf),
    ],
)
def test_notations_of_a_limit(tmp_path: Path, text: str, lower: float, upper: float):
    found = stated(tmp_path, f'"ax.k0" = {text}')
    assert_allclose([x / MG for x in found["ax.k0"]], [lower, upper])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[specification]",
        "[specification.limits]",
        '[specification.limits]\n"ax.k0" = "20 mg"',
        '[specification.limits]\n"ax.k0" = "± 20 mg (k=2)"',
        '[specification.limits]\n"ax.k0" = "± 20 °/h"',
        '[specification.limits]\nscale = "± 2"',
        '[specification.limits]\nscale = ["-1", "2 %"]',
        '[specification.limits]\n"ax.k0" = ["2 mg", "-1 mg"]',
        '[specification.limits]\n"ax.k0" = ["2 mg"]',
        '[specification.limits]\n"ax.k0" = ["1 mg ± 1 mg", "2 mg"]',
        '[specification.limits]\n"ax.k9" = "± 20 mg"',
        '[specification.limits]\n"ax.k2" = "± 20 µg/g²"',
        '[specification.limits]\nbias = "± 20 mg"\nk0 = "± 20 mg"',
        '[specification.limits]\nmisalignment = "± 1 °"\nnonorthogonality = "± 1 °"',
        '[specification]\nuncertainty = "next_use"\nlimits = { k0 = "± 20 mg" }',
        '[specification]\nfactor = 0.0\nlimits = { k0 = "± 20 mg" }',
        '[specification]\nrule = "simple"\nfactor = 0.5\nlimits = { k0 = "± 20 mg" }',
    ],
)
def test_what_limits_nothing_is_refused(tmp_path: Path, text: str):
    if not text:
        path = tmp_path / "run.toml"
        path.write_text(FERRARIS, encoding="utf-8")
        assert read(path).specification is None
        return
    with pytest.raises(InputError, match="specification") as refusal:
        limits(tmp_path, text)
    assert "('" not in str(refusal.value)  # no tuple of Python


def judged(content: Content, folder: Path) -> Conformity:
    (folder / "positions.csv").write_bytes((EXAMPLES / "six_position/positions.csv").read_bytes())
    path = folder / "run.toml"
    path.write_text(toml(content), encoding="utf-8")
    found = calibrate(path).calibration.conformity
    assert found is not None
    return found


BASE = {"limits": {"bias": "± 10 mg", "az.k0": ["-1 mg", "11.45 mg"], "scale": "± 1 %"}}


def test_every_key_of_the_specification_counts(tmp_path: Path):
    others = {
        "rule": "simple",
        "factor": 0.1,
        "uncertainty": "next_use",  # without the file; tests/repeatability has both
        "repeatability": "x.json",
        "limits": {"bias": "± 11 mg"},
    }
    assert set(others) == set(SpecificationSection.model_fields)
    content = example("six_position/run.toml") | {"specification": BASE}
    base = judged(content, tmp_path)
    for key, value in others.items():
        changed = content | {"specification": BASE | {key: value}}
        if key in ("uncertainty", "repeatability"):
            with pytest.raises(InputError, match="next_use"):
                judged(changed, tmp_path)
        else:
            assert judged(changed, tmp_path) != base, key


def test_a_coefficient_in_its_guard_band_passes_conditionally(tmp_path: Path):
    """az.k0 is 11.442 mg with U = 43 µg: within 11.45 mg, not by U; ax.k0 is well within."""
    content = example("six_position/run.toml") | {"specification": BASE}
    found = judged(content, tmp_path)
    results = {one.name: one.result for one in found.limits}
    assert results["az.k0"] == found.result == "conditional pass"
    assert results["ax.k0"] == "pass"
    assert not found.accepted
    at_limit = next(one for one in found.limits if one.name == "az.k0")
    assert 0.6 < at_limit.probability < 0.7
    assert_allclose(found.probability, at_limit.probability, atol=1e-3)


@pytest.mark.slow
def test_conformity_is_in_file_report_and_lines(tmp_path: Path):
    outcome = calibrate(EXAMPLES / "six_position" / "specification.toml")
    calibration = outcome.calibration
    assert calibration.conformity is not None
    assert len(calibration.conformity.limits) == 12
    again = load(save(calibration, tmp_path / "a.calibration.json"))
    assert again.conformity == calibration.conformity
    assert calibration_object(again) == calibration_object(calibration)
    assert len(calibration.conformity_lines) == 1
    assert calibration_page(outcome, None).count("<td>pass</td>") == 12
    assert calibration.in_frame("triangular").conformity is None


def test_limits_of_a_result_that_is_not_to_be_relied_on_are_in_doubt():
    calibration = calibrate(EXAMPLES / "six_position" / "specification.toml").calibration
    assert calibration.verdict is not None
    doubtful = replace(calibration, verdict=replace(calibration.verdict, grade="unreliable"))
    assert "U is doubtful" in doubtful.conformity_lines[0]
    assert "U is doubtful" not in calibration.conformity_lines[0]


def test_a_file_whose_conformity_contradicts_its_rule_is_refused(tmp_path: Path):
    calibration = calibrate(EXAMPLES / "six_position" / "specification.toml").calibration
    content = calibration_object(calibration)
    del content["sha256"]
    for key, value in (("factor", -1.0), ("result", "perhaps"), ("rule", "lenient")):
        changed = content | {"conformity": content["conformity"] | {key: value}}
        digest = sha256(canonical_text(changed).encode()).hexdigest()
        text = json.dumps(changed | {"sha256": digest}, ensure_ascii=False)
        with pytest.raises(InputError, match=key):
            parse(text, "a.calibration.json")


def test_a_guard_band_is_rounded_like_u_and_a_probability_has_two_digits():
    term = triad("t", "f", "a").with_coefficients("bias").coefficient("ax.k0")
    for u in (1016.0, 43.7, 0.0234):
        one = LimitResult("ax.k0", -1.0, 1.0, 0.0, u / 2 * term.si, u * term.si, "pass", 0.5)
        row = limit_row(one, term)
        assert row.guard == row.expanded
    texts = [probability_text(one) for one in (0.6031, 0.0228, 0.9754, 0.99954)]
    assert texts == ["60 %", "2.3 %", "97.5 %", "99.954 %"]


@pytest.mark.parametrize("limit", ["± -15 mg", "±−15 mg", "+/- -15 mg"])
def test_a_negative_limit_is_not_called_an_uncertainty(tmp_path: Path, limit: str):
    with pytest.raises(InputError) as refusal:
        limits(tmp_path, f'[specification.limits]\n"ax.k0" = "{limit}"')
    assert refusal.value.key == "[specification.limits] ax.k0"
    assert "limit" in str(refusal.value).partition(limit)[2]
    assert "uncertainty" not in str(refusal.value)


@pytest.mark.parametrize(
    ("stated_rule", "named"),
    [
        ("factor = -1.0", "-1"),
        ('rule = "simple"\nfactor = 1.5', "simple"),
        ('rule = "simple"\nfactor = 1.0', "simple"),  # the default, but stated
    ],
)
def test_an_impossible_decision_rule_is_refused_with_its_reason(
    tmp_path: Path, stated_rule: str, named: str
):
    path = tmp_path / "run.toml"
    path.write_text(f'{FERRARIS}\n[specification]\n{stated_rule}\nlimits = {{ k0 = "± 20 mg" }}')
    with refused(key="[specification] factor") as refusal:
        read(path)
    assert named in str(refusal.value)
