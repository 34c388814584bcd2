"""Rates and poses: errors as stated, tables of the plans, and what a plan leaves open.

Devices are of a generator that imports nothing of inercal, `platform_devices`. The figures are of
plans of 36 s a section with gyros of two grades: angle random walk 0.1 and 0.3 °/√h, bias
instability 0.5 and 5 °/h; table plain or with its angle read back.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.base_seeds import chosen
from tests.methods.platform_devices import (
    DEG_PER_H,
    EXACT,
    FULL,
    MID,
    MID_SIX,
    PLAIN,
    READ,
    SHORT,
    TABLES,
    Devices,
    Row,
    Table,
    devices,
    plan,
    turns,
)
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.basics.keys import CoefficientName
from inercal.basics.units import Measured
from inercal.benches.rate_platform import RatePlatform
from inercal.benches.rate_platform.sections import KnownTurn, RateDwell
from inercal.calibration.best_cause import SuspectedCause
from inercal.calibration.detectability import undetectable_exact_parameters
from inercal.calibration.grade import assess
from inercal.estimation import Estimate, Gaussian
from inercal.methods import METHODS
from inercal.methods.rates_and_poses import ml
from inercal.physics.sensors import GYRO, triad
from inercal.recordings import Observations

LINEAR = ("bias", "scale", "delta_o", "delta_p")
ALL = (*LINEAR, "scale2", "scale3", "scale_prime")
G_TERMS = ("g_i", "g_p", "g_o")
LATITUDE = float(np.radians(50.0))
UNIT = {line.name: line.si for line in GYRO}


def bench(table: Table, **more: Any) -> RatePlatform:
    return RatePlatform(Measured(9.81, 1e-4), Measured(LATITUDE, 0.0), **(table.stated() | more))


def steps_of(rows: Sequence[Row]) -> list[RateDwell]:
    return [
        (KnownTurn if row.turn else RateDwell)(
            f"{k} {row.name}", row.name, row.rate, row.seconds, row.setting
        )
        for k, row in enumerate(rows)
    ]


def estimated(
    made: Devices,
    stated: RatePlatform,
    terms: Sequence[str] = LINEAR,
    priors: Sequence[Gaussian] = (),
    device: int | None = None,
    temperature: np.ndarray | None = None,
) -> Estimate:
    steps, r = steps_of(made.rows), len(made.rows)
    sensor = triad("t", "w", "g").with_coefficients(*terms)
    return ml(
        Observations(
            labels=tuple(step.label for step in steps),
            mean=made.reading if device is None else made.reading[device],
            covariance=made.sd[:, None, None] ** 2 * np.eye(3),
            duration=np.array([step.seconds for step in steps]),
            samples=np.ones(r, dtype=np.int64),
            time=np.arange(r, dtype=float),
            channels=sensor.channels,
            timed=False,
            temperature=temperature,
        ),
        sensor,
        stated,
        steps,
        priors,
    )


def errors(made: Devices, found: Estimate, terms: Sequence[str]) -> Mapping[str, np.ndarray]:
    """Return error and stated deviation of each kind of coefficient, (2, n, 3), SI."""
    result: dict[str, np.ndarray] = {}
    for term in terms:
        at = [found.names.index(f"g{a}.{term}") for a in "xyz"]
        off = found.value[:, at] - made.truth[term]
        sd = np.sqrt(np.diagonal(found.covariance, axis1=-2, axis2=-1)[:, at])
        result[term] = np.stack([off, np.broadcast_to(sd, off.shape)])
    return result


def nees(made: Devices, found: Estimate, terms: Sequence[str]) -> float:
    names = [
        name for name in found.names if CoefficientName(name).term in terms and "[" not in name
    ]
    at = [found.names.index(name) for name in names]
    truth = np.stack(
        [made.truth[CoefficientName(n).term][:, "xyz".index(n[1])] for n in names], axis=-1
    )
    off = found.value[:, at] - truth
    inverse = np.linalg.inv(found.covariance[:, at][:, :, at])
    return float(np.einsum("ti,tij,tj->t", off, inverse, off).mean() / len(at))


def test_an_exact_table_gives_the_truth(seed: int):
    made = devices(
        MID, "T", EXACT, ALL, 3, np.random.default_rng(seed), latitude=np.pi / 2, noisy=False
    )
    stated = replace(bench(READ), latitude=Measured(np.pi / 2, 0.0))
    found = estimated(made, stated, ALL)
    assert found.converged.all()
    for term, (off, sd) in errors(made, found, ALL).items():
        assert np.abs(off / sd).max() < 1e-6, term


def test_errors_are_as_stated(seed: int):
    made = devices(SHORT, "T", READ, LINEAR, 100, np.random.default_rng(seed))
    found = estimated(made, bench(READ))
    assert found.converged.all()
    assert 0.9 < nees(made, found, LINEAR) < 1.1  # 1200 components: 0.04 a standard deviation
    assert 0.75 < np.mean(found.chi2) / found.dof < 1.25


# Root-mean-square errors by plain numpy, in the units of reports: bias in °/h, scale and κ′ in
# ppm, misalignment in ″, κ₂ in ppm/(rad/s), κ₃ in ppm/(rad/s)².
EXPECTED: Mapping[tuple[str, str, str], Mapping[str, float]] = {
    ("short", "T", "plain"): {"bias": 0.47, "scale": 503, "delta_o": 180},
    ("short", "T", "read"): {"bias": 0.39, "scale": 5.6, "delta_o": 70},
    ("short", "C", "read"): {"bias": 1.6, "scale": 11, "delta_o": 70},
    ("mid", "T", "plain"): {
        "bias": 0.34, "scale": 499, "delta_o": 178, "scale2": 38, "scale_prime": 262, "scale3": 8.7
    },
    ("mid", "T", "read"): {
        "bias": 0.34, "scale": 6.9, "delta_o": 71, "scale2": 1.7, "scale_prime": 12, "scale3": 0.39
    },
    ("mid", "C", "read"): {
        "bias": 1.4, "scale": 21, "delta_o": 71, "scale2": 7.3, "scale_prime": 51, "scale3": 1.6
    },
    ("full", "T", "plain"): {
        "bias": 0.17, "scale": 494, "delta_o": 183, "scale2": 19, "scale_prime": 169, "scale3": 5.5
    },
    ("full", "T", "read"): {
        "bias": 0.15, "scale": 5.4, "delta_o": 71, "scale2": 0.8, "scale_prime": 4.5, "scale3": 0.16
    },
    ("full", "C", "read"): {
        "bias": 0.66, "scale": 7.6, "delta_o": 72, "scale2": 3.4, "scale_prime": 19, "scale3": 0.68
    },
}  # fmt: skip
PLANS = {"short": (SHORT, LINEAR), "mid": (MID, ALL), "full": (FULL, ALL)}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "grade", "table"),
    chosen(EXPECTED, [("short", "C", "read"), ("mid", "T", "plain"), ("full", "T", "read")]),
)
def test_errors_of_the_plans_are_those_of_the_table(name: str, grade: str, table: str, seed: int):
    rows, terms = PLANS[name]
    n = 200 if name == "full" else 300
    made = devices(rows, grade, TABLES[table], terms, n, np.random.default_rng(seed))
    found = estimated(made, bench(TABLES[table]), terms)
    assert found.converged.all()
    assert 0.93 < nees(made, found, terms) < 1.07
    assert 0.9 < np.mean(found.chi2) / found.dof < 1.1
    for term, (off, sd) in errors(made, found, terms).items():
        # The scale factor's error of a plain table is common to three axes, κ′ in a part.
        shared = table == "plain" and term in ("scale", "scale_prime")
        spread = 4 / np.sqrt(2 * n * (1 if shared else 3))
        assert abs(np.sqrt(np.mean(off**2) / np.mean(sd**2)) - 1) < max(spread, 0.1), term
    stated = {
        term: float(np.sqrt(np.mean(sd**2))) for term, (_, sd) in errors(made, found, terms).items()
    }
    for term, rms in EXPECTED[name, grade, table].items():
        assert stated[term] / UNIT[term] == pytest.approx(rms, rel=0.1), term


@pytest.mark.slow
def test_six_settings_show_the_sensitivity_to_acceleration_too(seed: int):
    terms = (*ALL, *G_TERMS)
    made = devices(MID_SIX, "T", READ, terms, 100, np.random.default_rng(seed))
    found = estimated(made, bench(READ, arm=0.0), terms)
    assert 0.93 < nees(made, found, terms) < 1.07
    expected = {"bias": 0.23, "scale": 6.0, "delta_o": 51, "scale2": 1.2, "scale_prime": 8.4,
                "scale3": 0.27}  # fmt: skip
    stated = {
        t: np.sqrt(np.mean(sd**2)) / UNIT[t] for t, (_, sd) in errors(made, found, terms).items()
    }
    assert {t: stated[t] for t in expected} == pytest.approx(expected, rel=0.1)
    assert np.sqrt(np.mean([stated[t] ** 2 for t in G_TERMS])) == pytest.approx(0.35, rel=0.1)


NO_REST = plan([100, -100])
ONE_SPEED = plan([0, 100, -100])
ONE_WAY = plan([0, 50, 100, 200])
EVEN = ("scale2", "scale_prime")
OPEN: Mapping[str, tuple[Sequence[Row], Sequence[str], Sequence[str]]] = {
    "one speed, no rest": (NO_REST, (*LINEAR, *EVEN), EVEN),
    "one speed and a rest": (ONE_SPEED, (*LINEAR, *EVEN), EVEN),
    "third order of one speed": (ONE_SPEED, (*LINEAR, "scale3"), ("scale", "scale3")),
    "asymmetry of one sense": (ONE_WAY, (*LINEAR, "scale_prime"), ("scale", "scale_prime")),
    "g with each axis up alone": (ONE_SPEED, (*LINEAR, *G_TERMS), ("bias", *G_TERMS)),
    "third order of two speeds that are nearly one": (
        plan([0, 100, -100, 100.3, -100.3], seconds=360), (*LINEAR, "scale3"), ("scale", "scale3"),
    ),
    "even terms of rates in one sense each": (
        plan([0, 100, -50]), (*LINEAR, *EVEN), ("scale", *EVEN),
    ),
    "g of settings that are upside down alone": (
        [replace(row, sign=-1) for row in ONE_SPEED], (*LINEAR, "g_i"), (),
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", OPEN)
def test_what_a_plan_leaves_open_is_refused_by_name(name: str):
    rows, terms, touched = OPEN[name]
    made = devices(rows, "T", READ, LINEAR, 1, np.random.default_rng(1))
    stated = bench(READ, arm=0.0)
    if not touched:
        assert estimated(made, stated, terms).converged.all()
        return
    names = [f"g{axis}.{term}" for axis in "xyz" for term in touched]
    with refused(NotObserved, names=names) as refusal:
        estimated(made, stated, terms)
    assert isinstance(refusal.value, NotObserved)
    assert len(refusal.value.directions) == 3  # one a gyro


def test_squares_of_acceleration_cannot_be_told_from_the_bias():
    made = devices(MID_SIX, "T", READ, LINEAR, 1, np.random.default_rng(1))
    terms = (*LINEAR, *G_TERMS, "g_ii", "g_pp", "g_oo")
    with refused(NotObserved) as refusal:
        estimated(made, bench(READ, arm=0.0), terms)
    assert set(refusal.value.names) == {
        f"g{axis}.{term}" for axis in "xyz" for term in ("bias", "g_ii", "g_pp", "g_oo")
    }


def test_a_temperature_that_varies_shows_its_coefficients():
    rows = [*plan([0, 50, -50]), *plan([0, 50, -50])]
    made = devices(rows, "T", READ, LINEAR, 1, np.random.default_rng(6))
    warm = np.where(np.arange(len(rows)) < len(rows) // 2, 293.15, 323.15)
    made.reading += 2.0 * DEG_PER_H * (warm - 293.15)[:, None]
    terms = (*LINEAR, "bias_dT", "scale_dT")
    found = estimated(made, bench(READ), terms, device=0, temperature=warm)
    at = [found.names.index(f"g{a}.bias_dT") for a in "xyz"]
    off = found.value[at] - 2.0 * DEG_PER_H
    assert np.abs(off / np.sqrt(np.diagonal(found.covariance)[at])).max() < 4
    with refused(NotObserved):
        estimated(made, bench(READ), terms, device=0, temperature=np.full(len(rows), 300.0))


def test_a_prior_on_the_asymmetry_widens_the_scale_of_rates_in_one_sense():
    made = devices(ONE_WAY, "T", READ, (*LINEAR, "scale_prime"), 50, np.random.default_rng(2))
    names = tuple(f"g{a}.scale_prime" for a in "xyz")
    prior = Gaussian.independent(names, 0.0, 5e-4)
    terms = (*LINEAR, "scale_prime")
    found = estimated(made, bench(READ), terms, [prior])
    assert 0.85 < nees(made, found, terms) < 1.15
    sd = errors(made, found, terms)["scale"][1]
    assert np.all(sd > 2.4e-4)


# Rows, estimated terms, what is left out, and the names that say it: of one speed two do.
LEFT_OUT = {
    "asymmetry of one speed": (SHORT, LINEAR, {"scale_prime": 5e-4}, EVEN),
    "asymmetry": (MID, (*LINEAR, "scale3"), {"scale_prime": 5e-4}, ("scale_prime",)),
    "third order": (MID, LINEAR, {"scale3": 6e-5}, ("scale3",)),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_a_term_that_is_left_out_and_shows_is_named(name: str):
    rows, terms, size, alike = LEFT_OUT[name]
    made = devices(rows, "T", READ, terms, 1, np.random.default_rng(3), size=size)
    found = estimated(made, bench(READ), terms, device=0)
    assert found.chi2 > 5 * found.dof
    best = max(found.score_tests.scores, key=lambda one: one.chi2 / max(one.dof, 1))
    assert best.name in {f"gx.{term}" for term in alike}


@pytest.mark.parametrize(
    "key", ["rate_scale", "rate_asymmetry", "rate_stability", "setting", "latitude"]
)
def test_an_error_that_is_not_stated_is_refused(key: str):
    made = devices(SHORT, "T", READ, LINEAR, 1, np.random.default_rng(1))
    with refused(key=f"[bench] {key}"):
        estimated(made, replace(bench(READ), **{key: None}))


def test_the_place_of_the_sensor_is_needed_for_the_sensitivity_to_acceleration():
    made = devices(MID_SIX, "T", READ, LINEAR, 1, np.random.default_rng(1))
    with refused(key="[bench] arm"):
        estimated(made, bench(READ), (*LINEAR, *G_TERMS))


SILENT = {
    "rate_scale": (PLAIN, 9.0),
    "rate_asymmetry": (PLAIN, 1.15),
    "setting": (PLAIN, 1e3),
}


@pytest.mark.parametrize("key", SILENT)
def test_an_error_of_the_table_taken_as_zero_shows_in_no_residual(key: str):
    """Which is why it must be stated."""
    table, least = SILENT[key]
    made = devices(MID, "T", table, ALL, 100, np.random.default_rng(4))
    found = estimated(made, replace(bench(table), **{key: 0.0}), ALL)
    assert nees(made, found, ALL) > least
    assert 0.8 < np.mean(found.chi2) / found.dof < 1.2


@pytest.mark.slow
def test_the_bias_may_differ_from_setting_to_setting():
    rng = np.random.default_rng(5)
    made = devices(MID, "T", READ, ALL, 60, rng)
    settings = list(dict.fromkeys(row.setting for row in made.rows))
    switched = 60 * DEG_PER_H * rng.standard_normal((60, len(settings), 3))
    at = [settings.index(row.setting) for row in made.rows]
    made.reading += switched[:, at]
    found = estimated(made, bench(READ, turn_on=60 * DEG_PER_H), ALL)
    assert 0.9 < nees(made, found, ALL) < 1.1
    assert 0.85 < np.mean(found.chi2) / found.dof < 1.15
    taken_as_one = estimated(made, bench(READ), ALL)
    assert np.mean(taken_as_one.chi2) / taken_as_one.dof > 100


def with_g(switched: float, square: float = 0.0) -> tuple[list[SuspectedCause | None], Estimate]:
    """Return the best causes in six devices with g-sensitivity, and the last estimate.

    The biases differ between the six settings by `switched`, °/h, or D_PP is `square`, °/h/g².
    """
    table, n = Table(2e-5, 1e-5, 5e-6, 0.0, float(np.radians(0.02))), 6
    made = devices(MID_SIX, "C", table, (*LINEAR, *G_TERMS), n, rng := np.random.default_rng(9))
    settings = list(dict.fromkeys(row.setting for row in made.rows))
    at = [settings.index(row.setting) for row in made.rows]
    made.reading += (switched * DEG_PER_H * rng.standard_normal((n, len(settings), 3)))[:, at]
    pendulous = [[row.axis == (a + 1) % 3 for a in range(3)] for row in made.rows]
    made.reading += square * DEG_PER_H * np.array(pendulous)
    sensor = triad("t", "w", "g").with_coefficients(*LINEAR, *G_TERMS)
    possible = METHODS["rates_and_poses"].possible(sensor)
    found = [
        estimated(made, bench(table, arm=0.005), (*LINEAR, *G_TERMS), device=k) for k in range(n)
    ]
    return [assess(one, len(sensor.coefficients), possible).best for one in found], found[-1]


@pytest.mark.slow
def test_biases_that_differ_between_six_settings_are_a_large_shift_of_g_and_not_of_g_squared():
    for best in with_g(switched=40.0)[0]:
        assert best is not None
        assert best.name == "turn_on"
        # Half a difference of two biases, 40/√2 °/h, is taken for g-sensitivity; U, which contains
        # the scatter of the residuals, is about 15 °/h/g.
        assert 1.2 < best.shift < 3


@pytest.mark.slow
def test_a_sensitivity_to_g_squared_is_not_taken_for_changes_of_the_bias():
    assert {best and best.name for best in with_g(0.0, square=40.0)[0]} == {"g_pp"}


@pytest.mark.slow
def test_what_is_absorbed_by_g_is_named_where_the_run_file_does_not_state_it():
    _, found = with_g(0.0)
    sensor = triad("t", "w", "g").with_coefficients(*LINEAR, *G_TERMS)
    assert {"latitude", "turn_on"} <= set(undetectable_exact_parameters(found, sensor, {}))
    made = devices(MID_SIX, "C", PLAIN, LINEAR, 1, np.random.default_rng(9))
    plain = estimated(made, bench(PLAIN), LINEAR, device=0)
    sensor = sensor.with_coefficients(*LINEAR)
    assert not {"latitude", "turn_on"} & set(undetectable_exact_parameters(plain, sensor, {}))


def test_the_level_part_of_the_earths_rate_is_sensed_but_over_whole_turns(seed: int):
    rates = [0, 3, -3, 10, -10]
    rows = [replace(row, seconds=37.3) for row in plan(rates)]
    made = devices(rows, "T", READ, LINEAR, 100, np.random.default_rng(seed))
    assert 0.9 < nees(made, estimated(made, bench(READ)), LINEAR) < 1.1


TURNED = Table(0.0, 0.0, 0.0, 0.0, float(np.radians(0.05)), float(np.radians(0.01)))
BOTH_WAYS = (*LINEAR, "scale_prime")
TURNS = {  # angles, terms, and rms of scale and κ′, ppm, by grade: each after and before a rest
    "one way": ([364.0], LINEAR, {"T": {"scale": 31}, "C": {"scale": 49}}),
    "both ways": (
        [364.0, -363.0],
        BOTH_WAYS,
        {"T": {"scale": 21, "scale_prime": 40}, "C": {"scale_prime": 61}},
    ),
}


@pytest.mark.parametrize("grade", ["T", "C"])
@pytest.mark.parametrize("name", TURNS)
def test_turns_by_known_angles_give_the_scale_factor_as_well_as_the_angle(name: str, grade: str):
    angles, terms, expected = TURNS[name]
    made = devices(turns(angles), grade, TURNED, terms, 60, np.random.default_rng(7))
    found = estimated(made, bench(TURNED), terms)
    assert found.converged.all()
    assert 0.85 < nees(made, found, terms) < 1.15
    stated = {
        t: np.sqrt(np.mean(sd**2)) / UNIT[t] for t, (_, sd) in errors(made, found, terms).items()
    }
    assert {t: stated[t] for t in expected[grade]} == pytest.approx(expected[grade], rel=0.1)


def test_the_error_of_a_turns_angle_shows_in_no_residual_and_must_be_stated():
    made = devices(turns([364.0]), "T", TURNED, LINEAR, 100, np.random.default_rng(8))
    found = estimated(made, bench(TURNED, turn_angle=0.0))
    assert nees(made, found, LINEAR) > 2.5
    assert 0.8 < np.mean(found.chi2) / found.dof < 1.2
    with refused(key="[bench] turn_angle"):
        estimated(made, replace(bench(TURNED), turn_angle=None))


def test_turns_of_one_way_leave_the_asymmetry_open_and_no_turn_shows_the_nonlinearity():
    made = devices(turns([364.0]), "T", TURNED, LINEAR, 1, np.random.default_rng(9))
    with refused(NotObserved):
        estimated(made, bench(TURNED), BOTH_WAYS)
    with refused(key="[method]", names=[f"g{a}.scale3" for a in "xyz"]):
        estimated(made, bench(TURNED), (*LINEAR, "scale3"))
