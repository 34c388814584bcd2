"""Which cause a verdict names, which it never names, and what it says where no cause explains."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray
from tests.accuracy import ramps
from tests.accuracy.centrifuge import EARTH, PAPER_G, RATES, full_circle, sensed_motion, ups
from tests.accuracy.ferraris import DEGREE, mems
from tests.accuracy.handheld import Session, record
from tests.base_seeds import evidence
from tests.evidence import temperature_ramps
from tests.evidence.violation_cells import base_cells, calibrate_device, find_case
from tests.methods.test_centrifuge_norm import BENCH, TRUTH
from tests.methods.test_centrifuge_norm import NOISE as ACCELEROMETER_NOISE
from tests.methods.test_centrifuge_norm import table as centrifuge_table
from tests.suspects.rate_platform_runs import LATITUDE, NOISE, arguments, table

import inercal
from inercal.basics.units import Measured, parse_quantity
from inercal.benches import Hand
from inercal.calibration.grade import NO_SINGLE_CAUSE, Assessment, assess
from inercal.calibration.suspect_text import format_component
from inercal.calibration.verdict import verdict
from inercal.estimation import Candidate, Estimate, Problem, least_squares
from inercal.estimation.scores import SIGNIFICANCE_LEVEL, CandidateKind
from inercal.methods import METHODS, Fit
from inercal.methods.centrifuge_norm import ml
from inercal.methods.temperature_ramp import ramp, remarks, rest
from inercal.physics.sensors import imu, triad
from inercal.pipeline import Outcome
from inercal.recordings import Mark, Recording
from inercal.recordings.segments import (
    average_sections,
    holds_from_marks,
    holds_from_observations,
    transitions_between_rests,
)

Array = NDArray[np.float64]
Settings = NDArray[np.str_]


def platform(seed: int, method: dict[str, Any] | None = None, **made: Any) -> Outcome:
    """Return the outcome of a table of means on a rate platform."""
    return inercal.calibrate(table(np.random.default_rng(seed), **made), **arguments(method))


def switched(y: Array, w: Array, setting: Settings) -> None:
    """Change the biases of one setting, as after another turn-on."""
    y[setting == "y"] += np.array([0.004, -0.003, 0.005])


def clipped(y: Array, w: Array, setting: Settings) -> None:
    np.clip(y, -70, 70, out=y)


def one_rate_off(y: Array, w: Array, setting: Settings) -> None:
    y[np.abs(w) > 90] *= 0.99


def stepped(y: Array, w: Array, setting: Settings) -> None:
    y[len(y) // 2 :, 2] += 0.01


def settling(y: Array, w: Array, setting: Settings) -> None:
    y += 0.02 * np.exp(-np.arange(len(y)) / 10)[:, None]


def quadratic(y: Array, w: Array, setting: Settings) -> None:
    y += 0.02 * (np.linspace(-1, 1, len(y)) ** 2)[:, None]


def hysteresis(y: Array, w: Array, setting: Settings) -> None:
    y += 0.005 * np.sign(np.gradient(w.sum(axis=1)))[:, None]


def cubic(y: Array, w: Array, setting: Settings) -> None:
    y += 2e-7 * w**3


@pytest.mark.slow
def test_biases_that_differ_between_settings_are_named_turn_on():
    found = [platform(seed, change=switched).verdict for seed in range(2)]
    assert [one.suspect and one.suspect.name.partition("[")[0] for one in found] == ["turn_on"] * 2
    for one in found:
        (advice,) = [given for given in one.advice if given.changes]
        assert [(c.section, c.key) for c in advice.changes] == [("bench", "turn_on")]


@pytest.mark.slow
def test_a_wrong_latitude_is_named_and_not_a_sensitivity_to_acceleration():
    names = [platform(seed, latitude=60.0).verdict.suspect for seed in range(2)]
    assert [one and one.name for one in names] == ["latitude"] * 2


def test_the_next_step_on_a_wrong_latitude_is_about_it_although_a_row_is_wrong_too():
    def wrong_row(y: Array, w: Array, setting: Settings) -> None:
        y[5, 0] += 20 * NOISE

    verdict = platform(2, latitude=-LATITUDE, change=wrong_row).verdict
    assert verdict.suspect is None  # because it explains only a part
    assert verdict.best is not None
    assert verdict.best.name == "latitude"
    (step,) = [line for line in verdict.lines if line.startswith("Next: ")]
    assert "latitude" in step


@pytest.mark.parametrize("change", [clipped, one_rate_off, stepped, hysteresis])
@pytest.mark.parametrize("axes", ["z", evidence("xyz")])
def test_a_scale_of_all_rates_is_never_named_where_scale_factors_are_free(
    change: Callable[[Array, Array, Settings], None], axes: str
):
    method = (
        {} if axes == "xyz" else {"coefficients": ["gx.bias", "gy.bias", "gz.bias", "gz.scale"]}
    )
    verdict = platform(3, method, change=change, axes=axes).verdict
    assert verdict.grade != "consistent"
    for one in (verdict.suspect, verdict.best):
        assert one is None or "rate_scale" not in (one.name, *one.indistinguishable)


@pytest.mark.parametrize("change", [stepped, settling, quadratic, hysteresis])
def test_causes_that_are_no_candidates_have_no_name_but_what_they_leave(
    change: Callable[[Array, Array, Settings], None],
):
    verdict = platform(4, change=change).verdict
    assert verdict.grade != "consistent"
    assert verdict.suspect is None
    assert verdict.best is None or verdict.best.remaining_p_value < SIGNIFICANCE_LEVEL
    assert not any(reason.startswith("the residuals point to") for reason in verdict.reasons)


@pytest.mark.slow
def test_a_cubic_scale_is_recommended_only_where_the_rates_determine_it():
    several, one = platform(5, change=cubic), platform(5, change=cubic, speeds=(0.0, 50.0))
    assert [given.coefficients for given in several.verdict.advice] == [("scale3",)]
    assert not any("scale3" in given.coefficients for given in one.verdict.advice)


def line(
    extra: Array, readings: Array, kind: CandidateKind = "bench", unit: str = "m", **stated: Any
) -> Estimate:
    """Return the fit of a constant to readings of sd 1, with one candidate."""

    def candidates(_: Array) -> list[Candidate]:
        names = tuple(f"c{k}" for k in range(extra.shape[1]))
        return [Candidate("cause", kind, names, (unit,) * len(names), extra, **stated)]

    return constant_fit(readings, candidates)


def constant_fit(readings: Array, candidates: Callable[[Array], list[Candidate]]) -> Estimate:
    """Return the fit of a constant to readings of sd 1."""
    rows = len(readings)
    design = np.ones((rows, 1))
    return least_squares(
        Problem(
            ("k0",),
            np.zeros(1),
            lambda x: (readings - x @ design.T, design),
            np.ones(rows),
            np.ones(1),
            candidates=candidates,
        )
    )


def test_a_cause_that_uses_up_the_degrees_of_freedom_is_not_named():
    readings = np.array([0.0, 20.0, -15.0, 7.0])
    whole = line(np.eye(4)[:, :3], readings)
    assert whole.score_tests.dof == whole.score_tests.scores[0].dof == 3
    assert assess(whole, 1).scores_reject
    assert assess(whole, 1).best is None


def test_a_cause_of_impossible_size_is_not_named():
    ramp_of_rows = np.linspace(-1, 1, 20)[:, None]
    readings = 30 * ramp_of_rows[:, 0] + np.random.default_rng(1).standard_normal(20)
    possible = line(ramp_of_rows, readings, "coefficient", largest=np.array([30.0]))
    impossible = line(ramp_of_rows, readings, "coefficient", largest=np.array([10.0]))
    assert assess(possible, 1).suspect is not None
    assert assess(impossible, 1).best is None


def test_a_statement_that_is_hardly_visible_and_departs_by_more_than_six_sd_is_not_named():
    wave = np.linspace(-1, 1, 20)
    readings = 20 * wave + np.random.default_rng(2).standard_normal(20)
    column = (1e5 + wave)[:, None]  # nearly that of the constant that is estimated
    kept = line(column, readings, stated_sds=np.array([10.0]))
    contradicted = line(column, readings, stated_sds=np.array([1.0]))
    assert kept.score_tests.scores[0].visible_share < 1e-3
    assert assess(kept, 1).suspect is not None
    assert assess(contradicted, 1).best is None


def test_what_the_best_cause_leaves_unexplained_is_stated_and_its_name_withheld():
    wave = np.linspace(-1, 1, 40)
    readings = 30 * np.exp(-3 * (wave + 1)) + np.random.default_rng(3).standard_normal(40)
    found = assess(line(wave[:, None], readings), 1)
    assert found.suspect is None
    assert found.best is not None
    assert found.best.remaining_dof == 38
    assert found.best.remaining_chi2 > 100
    assert found.best.remaining_p_value < 1e-6


@pytest.mark.parametrize("method", ["tumble", "dual_orthogonal"])
def test_kpp_of_a_dividing_head_is_listed_as_what_no_data_show(method: str):
    answer = calibrate_device(next(base_cells(method)), 0)
    assert answer.grade == "consistent"
    assert answer.limits_name("kpp")
    assert not answer.limits_name("kpo")


def switched_between_sections(seed: int, folder: Path) -> Outcome:
    """Return Ferraris' sections whose gyros were switched on anew before each, by 600 °/h."""
    rng = np.random.default_rng([seed, 64])
    here = find_case("ferraris")
    files = here.files(here.draw(rng), rng, None)
    table = [line.split(",") for line in str(files["means.csv"]).splitlines()]
    for row in table[1:]:
        row[5:] = [str(float(x) + rng.standard_normal() * 600 / 3600) for x in row[5:]]
    (folder / "run.toml").write_text(str(files["run.toml"]), encoding="utf-8")
    (folder / "means.csv").write_text("\n".join(map(",".join, table)), encoding="utf-8")
    return inercal.calibrate(folder / "run.toml")


@pytest.mark.slow
def test_gyros_that_were_switched_on_anew_before_each_section_are_named(tmp_path: Path):
    for seed in range(2):
        verdict = switched_between_sections(seed, tmp_path).verdict
        assert verdict.suspect is not None
        assert verdict.suspect.name == "turn_on"
        (change,) = verdict.advice[0].changes
        assert (change.section, change.key) == ("bench", "turn_on")
        size = parse_quantity(change.value, "rad/s").value * 206_265  # °/h
        assert 200 < size < 1200  # of six directions


def hand_held(change: Callable[[Array], None], seed: int, latitude: float = 47.0) -> Estimate:
    """Return a session by hand whose readings are changed, with `g` estimated."""
    rng = np.random.default_rng([seed, 63])
    session = Session(positions=20, latitude=latitude * DEGREE, gravity_sd=2e-4)
    made = record(mems(rng), session, rng)
    data = made.data[0]
    change(data)
    sensor = METHODS["multi_position"].prepare(imu(), also=("g",))
    sections = [Mark(f"r{k:02d}", a + 20, b - 20) for k, (a, b) in enumerate(made.rests)]
    log = Recording(made.time, data, sensor.channels, ("m/s²",) * 3 + ("rad/s",) * 3)
    seen = average_sections(log, sensor, sections, holds_from_marks(sections), by_hand=True)
    seen = replace(seen, transitions=transitions_between_rests(log, sensor, sections))
    place = Hand(Measured(session.gravity, session.gravity_sd), 47.0 * DEGREE)
    return METHODS["multi_position"].estimator("joint")(
        seen, sensor, place, holds_from_observations(seen, sensor)
    )


def test_a_sensitivity_to_the_square_of_acceleration_is_named_beside_g():
    def bend(data: Array) -> None:
        data[:, 3] += 0.05 * DEGREE * (data[:, 0] * data[:, 1]) / 9.81**2

    suspect = assess(hand_held(bend, 1), 30).suspect
    assert suspect is not None
    assert "gx.g_ip" in suspect.components


@pytest.mark.slow
def test_a_session_by_hand_tests_gravity_latitude_and_clock_as_stated():
    kinds = {one.name: one for one in hand_held(lambda data: None, 2).score_tests.scores}
    assert {"g", "timebase", "latitude", "g_ii"} <= set(kinds)
    assert kinds["g"].dof == 0  # of norms it is a scale


def test_a_warm_up_on_a_ramp_is_named_with_its_key():
    for seed in range(2):
        made = ramps.record(
            np.random.default_rng(seed),
            ramps.PROFILES["up and down, 2 × 30 min"](),
            warm_up=100 * ramps.DEG_H,
        )
        sensor = temperature_ramps.gyro()
        seen = temperature_ramps.observed(made)
        estimate = ramp(seen, sensor, Hand(Measured(9.81, 1e-4)), rest())
        suspect = assess(estimate, len(sensor.coefficients)).suspect
        assert suspect is not None
        assert suspect.name == "warm_up"
        assert [(one.section, one.key) for one in suspect.changes] == [
            ("environment", "kind"),
            ("environment", "warm_up"),
        ]


def sudden(made: ramps.Ramp) -> list[str]:
    """Return the findings on a sudden change in a ramp."""
    sensor, bench = temperature_ramps.gyro(), Hand(Measured(9.81, 1e-4))
    seen = temperature_ramps.observed(made)
    estimate = ramp(seen, sensor, bench, rest())
    found = remarks(Fit("", sensor, bench, seen, rest(), (), estimate)).findings
    return [one.message for one in found if one.what == "sudden change"]


def test_a_jump_on_a_ramp_is_named_and_a_good_ramp_has_none():
    for seed in range(3):
        profile = ramps.PROFILES["up and down, 2 × 30 min"]()
        made = ramps.record(np.random.default_rng([seed, 9]), profile)
        assert sudden(made) == []
        late = made.time > 1300 + 300 * seed
        assert len(sudden(replace(made, reading=made.reading + 200 * ramps.DEG_H * late))) == 1


@pytest.mark.slow
def test_a_thermometer_that_truncates_toward_zero_is_named():
    profile = ramps.PROFILES["up and down, 2 × 30 min"]()
    made = ramps.record(np.random.default_rng(9), profile)
    celsius = made.recorded - ramps.ZERO
    assert sudden(replace(made, recorded=np.round(celsius) + ramps.ZERO)) == []
    assert sudden(replace(made, recorded=np.trunc(celsius) + ramps.ZERO)) != []


@pytest.mark.evidence
def test_a_ramp_without_a_warm_up_raises_few_alarms():
    sensor, alarms = temperature_ramps.gyro(), 0
    for seed in range(150):
        profile = ramps.PROFILES["up and down, 2 × 30 min"]()
        seen = temperature_ramps.observed(ramps.record(np.random.default_rng([seed, 7]), profile))
        estimate = ramp(seen, sensor, Hand(Measured(9.81, 1e-4)), rest())
        alarms += assess(estimate, len(sensor.coefficients)).rejects
    # 99.9 % of a binomial of 150 with 1 %.
    assert alarms <= 7


@pytest.mark.evidence
def test_causes_of_a_rate_platform_come_first_in_nine_of_ten_and_good_runs_are_consistent():
    causes = {"turn_on": {"change": switched}, "latitude": {"latitude": 60.0}}
    causes["scale3"] = {"change": cubic}
    right = total = alarms = 0
    for seed in range(40):
        alarms += platform([seed, 1]).verdict.grade != "consistent"  # pyright: ignore[reportArgumentType]
        for name, made in causes.items():
            suspect = platform([seed, 2], **made).verdict.suspect  # pyright: ignore[reportArgumentType]
            total += 1
            right += suspect is not None and suspect.name.partition("[")[0] == name
    assert right >= 0.9 * total
    assert alarms <= 4  # 99.9 % of a binomial of 40 with 2 %


@pytest.mark.parametrize(
    ("visible", "hidden", "named"), [(200.0, 7.0, "hidden"), (5.0, 7.0, "visible")]
)
def test_the_statement_that_departs_least_is_named(visible: float, hidden: float, named: str):
    wave = np.linspace(-1, 1, 20)
    readings = 40 * wave + np.random.default_rng(5).standard_normal(20)
    columns = {"visible": wave[:, None], "hidden": (1e5 + wave)[:, None]}
    sds = {"visible": np.array([40 / visible]), "hidden": np.array([40 / hidden])}

    def candidates(_: Array) -> list[Candidate]:
        return [
            Candidate(name, "bench", (name,), ("m",), rows, stated_sds=sds[name])
            for name, rows in columns.items()
        ]

    suspect = assess(constant_fit(readings, candidates), 1).suspect
    assert suspect is not None
    assert suspect.name == named


@pytest.mark.parametrize(("unit", "size"), [("m", 300.0), ("rad", 1000.0)])
def test_a_stated_value_that_would_be_wrong_by_more_than_its_range_is_not_named(
    unit: str, size: float
):
    wave = 1000 * np.linspace(-1, 1, 20)[:, None]
    readings = size * wave[:, 0] + np.random.default_rng(6).standard_normal(20)
    stated: dict[str, Any] = {"stated_sds": np.array([1.0])}
    for scale, best in ((1.0, None), (1e4, "cause")):
        largest = np.array([0.1 * scale])
        found = assess(line(wave, readings, unit=unit, largest=largest, **stated), 1).best
        assert (found and found.name) == best


def on_an_arm(
    rng: np.random.Generator,
    radius: float = 1.0,
    sense: int = 1,
    arms: tuple[float, ...] = (0.0, 0.0, 0.0),
) -> Assessment:
    """Return the assessment on a centrifuge at 45.8° with a wrong radius or sense, or lever arms.

    The lever arms are along the axes of the triad, m.
    """
    f, rates = sensed_motion(
        full_circle()[::2], RATES, radius, earth_up=sense * EARTH * np.sin(0.8)
    )
    level = 1 - ups(full_circle()[::2], RATES) ** 2
    f = f - rates[:, None] ** 2 * np.array(arms) * level / PAPER_G
    seen, sensor, spins = centrifuge_table(
        TRUTH.output(f) + 0.02 * ACCELEROMETER_NOISE * rng.standard_normal(f.shape), rates
    )
    seen = replace(seen, covariance=0.02**2 * seen.covariance)
    bench = replace(
        BENCH,
        gravity=Measured(PAPER_G, 2e-5),
        radius=Measured(1.0, 6e-5),
        latitude=Measured(0.8, 1e-3),
        rate=1e-6,
        tilt=1e-5,
    )
    return assess(ml(seen, sensor, bench, spins), 9)


def test_a_wrong_radius_of_an_arm_is_named_and_not_gravity():
    for seed in range(2):
        suspect = on_an_arm(np.random.default_rng([seed, 1]), radius=1.0012).suspect
        assert suspect is not None
        assert suspect.name == "radius"
        assert suspect.sizes[0] == pytest.approx(1.2e-3, rel=0.01)
        assert "g" in suspect.indistinguishable
        left = scipy.stats.chi2.sf(suspect.remaining_chi2, suspect.remaining_dof)
        assert suspect.remaining_p_value == pytest.approx(left)


@pytest.mark.parametrize("arms", [(2e-3, 1e-3, -1e-3), (-5e-4, 1e-3, 2e-3), (0.0, 2e-3, 1e-3)])
def test_lever_arms_in_unknown_attitudes_are_named_before_cross_terms(arms: tuple[float, ...]):
    found = on_an_arm(np.random.default_rng(4), arms=arms).best
    assert found is not None
    assert found.name == "arm_i"
    assert np.isnan(found.sizes).all()  # they depend on the attitudes, which are unknown
    assert found.remaining_p_value < 1e-6


def test_a_reversed_sense_of_rotation_is_named_with_its_key():
    for seed in range(2):
        suspect = on_an_arm(np.random.default_rng([seed, 1]), sense=-1).suspect
        assert suspect is not None
        assert [(c.section, c.key, c.value) for c in suspect.changes] == [
            ("bench", "sense", "clockwise")
        ]
        assert {"latitude", "stretch", "tilt"} <= set(suspect.indistinguishable)
    named = on_an_arm(np.random.default_rng(3)).best
    assert named is None


def test_a_misfit_without_a_cause_is_stated_once_and_with_its_size():
    sensor = triad("t", "f", "x").with_coefficients("bias")
    wave = np.linspace(-1, 1, 200)
    readings = 0.8 * wave + np.random.default_rng(7).standard_normal(200)
    estimate = line((1e5 + wave)[:, None], readings, stated_sds=np.array([1e-2]))
    found = verdict(replace(estimate, names=sensor.coefficients), sensor, ())
    assert found.reasons == (NO_SINGLE_CAUSE,)
    first, second, *_ = found.lines
    assert f"χ² = {estimate.score_tests.chi2:.0f} with 199 degrees" in first
    assert second != first
    assert NO_SINGLE_CAUSE not in first


def test_an_error_of_the_stretch_is_stated_in_the_unit_of_its_key():
    text = format_component(triad("t", "f", "x"), "bench", "stretch", 1e-7, 1e-9, "(m/s²)⁻¹")
    assert text == "0.9807 ± 0.0098 ppm/g"
