"""Rows of a table that violate the norm are detected and repaired without the truth."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.accuracy.centrifuge import RATES, Triad, full_circle, printed_attitudes, sensed_motion
from tests.base_seeds import chosen
from tests.methods.test_centrifuge_norm import BENCH, NOISE, table

from inercal.basics.errors import InputError
from inercal.methods.centrifuge_norm.screening import screen_rows

Array = NDArray[np.float64]


def made(seed: int) -> tuple[Array, Array]:
    f, rates = sensed_motion(full_circle(), RATES)
    noise = np.random.default_rng([seed, 404]).standard_normal(f.shape)
    return np.round(Triad().output(f) + NOISE * noise, 6), rates


@pytest.fixture
def printed(data_dir: Path) -> tuple[Array, Array]:
    folder = data_dir / "centrifuge_table1"
    if not folder.is_dir():
        pytest.skip(f"{folder} is missing")
    names = ("table1_as_printed.csv", "table1_corrected.csv")
    one, other = (np.loadtxt(folder / n, delimiter=",", skiprows=1)[:, 3:] for n in names)
    return one, other


@pytest.mark.slow
def test_the_printed_table_lost_twenty_three_signs(printed: tuple[Array, Array]):
    as_printed, corrected = printed
    _, rates = sensed_motion(printed_attitudes(), RATES)
    seen, sensor, spins = table(as_printed, rates)
    suspects = screen_rows(seen, sensor, BENCH, spins)
    wrong = np.argwhere(np.abs(as_printed - corrected) > 1e-4)
    assert len(wrong) == 23
    assert [s.row for s in suspects] == wrong[:, 0].tolist()
    for suspect, (row, axis) in zip(suspects, wrong.tolist(), strict=True):
        (repair,) = suspect.repairs
        assert repair.kind == "sign"
        name = sensor.channels[axis]
        assert list(repair.after) == [name]
        assert repair.after[name] == pytest.approx(corrected[row, axis], abs=2e-6)


@pytest.mark.parametrize("seed", chosen(range(6), (0, 1)))
def test_a_sound_table_raises_no_suspicion(seed: int):
    seen, sensor, spins = table(*made(seed))
    assert screen_rows(seen, sensor, BENCH, spins) == ()


def test_noise_that_is_stated_too_small_makes_no_suspects():
    output, rates = made(1)
    noise = 20 * NOISE * np.random.default_rng(7).standard_normal(output.shape)
    seen, sensor, spins = table(output + noise, rates)
    assert screen_rows(seen, sensor, BENCH, spins) == ()


@pytest.mark.slow
@pytest.mark.parametrize("seed", chosen(range(4), (0,)))
def test_signs_exchanges_and_digits_are_found(seed: int):
    output, rates = made(seed)
    wrong = output.copy()
    wrong[3, 0] *= -1
    wrong[17, [0, 2]] = wrong[17, [2, 0]]
    wrong[40, 1] += 0.3  # one digit, without a carry
    while f"{wrong[40, 1]:.6f}"[:-6] != f"{output[40, 1]:.6f}"[:-6]:
        wrong[40, 1] -= 0.1
    if wrong[40, 1] == output[40, 1]:
        wrong[40, 1] += 0.02
    seen, sensor, spins = table(wrong, rates)
    suspects = {s.row: s for s in screen_rows(seen, sensor, BENCH, spins)}
    assert set(suspects) == {3, 17, 40}
    for row, axis, kind in ((3, 0, "sign"), (17, 0, "exchange"), (40, 1, "digit")):
        name = sensor.channels[axis]
        found = [r for r in suspects[row].repairs if r.kind == kind and name in r.after]
        assert any(abs(r.after[name] - output[row, axis]) < 1e-7 for r in found)


@pytest.mark.slow
def test_a_row_that_no_single_change_repairs_is_named():
    output, rates = made(2)
    output[5] = [0.1, 0.2, 0.3]
    seen, sensor, spins = table(output, rates)
    (suspect,) = screen_rows(seen, sensor, BENCH, spins)
    assert suspect.label == "d05"
    assert suspect.repairs == ()


@pytest.mark.slow
def test_a_table_that_is_wrong_as_a_whole_is_refused():
    output, rates = made(3)
    shuffled = output[np.random.default_rng(3).permutation(len(output))]
    seen, sensor, spins = table(shuffled, rates)
    with pytest.raises(InputError) as refusal:
        screen_rows(seen, sensor, BENCH, spins)
    assert set(refusal.value.names) <= set(seen.labels)
