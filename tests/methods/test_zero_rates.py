"""What gyros read at rest against the bias that a gyro can have."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from tests.methods.test_six_position_gyros import RUN, recorded
from tests.refusals import refused

from inercal.basics.errors import NotObserved
from inercal.estimation import Gaussian
from inercal.physics.plan import Hold, Turn
from inercal.physics.sensors import imu
from inercal.pipeline import Outcome, apply_data_columns, calibrate, simulate
from inercal.recordings import Observations
from inercal.recordings.io.rest_norm import check_zero_rates
from inercal.recordings.io.write import write_recording
from inercal.runfile import read

EXAMPLES = Path(__file__).parents[2] / "examples"
BIAS = '"gx.bias" = "0.3 °/s"'
PRIOR = '[method.prior]\n"gx.bias" = "{} °/s ± {} °/s"\n'
STEPS = (Hold("a", (0, 0, 1), 10.0), Turn("b", (0, 0, 1), 6.28, 10.0), Hold("c", (0, 0, -1), 10.0))


def session(folder: Path, gx: float, more: str = "") -> Outcome:
    """Return the result of six positions whose first gyro has a bias, °/s."""
    assert BIAS in RUN
    path = folder / "run.toml"
    text = RUN.replace(BIAS, f'"gx.bias" = "{gx} °/s"') + more
    path.write_text(text, encoding="utf-8")
    return recorded(read(path), 1)


def unit_warnings(outcome: Outcome) -> list[str]:
    return [one.message for one in outcome.findings if one.what == "units"]


def gyro_warnings(rates: Sequence[Sequence[float]], *priors: Gaussian) -> list[str]:
    """Return the warnings of means of gyros, °/s, one row for each of STEPS."""
    mean = np.hstack([np.zeros((3, 3)), np.radians(np.asarray(rates, dtype=float))])
    sensor, seconds = imu("i"), np.full(3, 10.0)
    seen = Observations(
        labels=("a", "b", "c"),
        mean=mean,
        covariance=np.tile(1e-9 * np.eye(6), (3, 1, 1)),
        duration=seconds,
        samples=np.full(3, 1000),
        time=np.array([0.0, 10.0, 20.0]),
        channels=sensor.channels,
    )
    columns = ("-gyro-x", 5, "gyr_z")
    return [one.message for one in check_zero_rates(seen, sensor, STEPS, priors, columns)]


def prior_of_gx(value: float, sd: float) -> Gaussian:
    return Gaussian(("gx.bias",), np.radians([value]), np.radians([[sd]]) ** 2)


@pytest.mark.parametrize("bias", [52.0, -31.0])
def test_a_bias_beyond_data_sheets_is_a_warning_that_names_axis_and_column(
    tmp_path: Path, bias: float
):
    outcome = session(tmp_path, bias)
    (message,) = unit_warnings(outcome)
    assert "gx (column gyr_x)" in message
    assert f"{abs(bias):.0f} °/s" in message
    assert "gy" not in message.split("but")[0].replace("gyr", "")
    assert message in outcome.calibration.notes
    assert outcome.verdict.grade == "reservations"
    assert outcome.calibration.value("gx.bias") == pytest.approx(np.radians(bias), rel=1e-3)


def test_a_bias_within_data_sheets_is_no_warning(tmp_path: Path):
    outcome = session(tmp_path, 15.0)
    assert not unit_warnings(outcome)
    assert outcome.verdict.grade == "consistent"


def test_a_prior_that_expects_the_bias_takes_the_warning_away(tmp_path: Path):
    assert not unit_warnings(session(tmp_path, 52.0, PRIOR.format(50, 5)))


def test_only_readings_at_rest_count():
    assert not gyro_warnings([[1, 0, 0], [0, 0, 300], [1, 0, 0]])
    assert len(gyro_warnings([[0, 0, 25], [0, 0, 0], [0, 0, 25]])) == 1


def test_the_bound_is_twenty_degrees_a_second_either_way():
    for rate, said in ((19.9, False), (20.1, True), (-19.9, False), (-20.1, True)):
        assert bool(gyro_warnings([[rate, 0, 0]] * 3)) is said


def test_a_prior_shifts_the_bound_and_its_uncertainty_widens_it():
    rates = [[52, 0, 0]] * 3
    assert gyro_warnings(rates, prior_of_gx(0.0, 1.0))
    assert gyro_warnings(rates, prior_of_gx(-50.0, 1.0))
    assert not gyro_warnings(rates, prior_of_gx(50.0, 1.0))
    assert not gyro_warnings(rates, prior_of_gx(0.0, 30.0))
    assert gyro_warnings([[52, -60, 0]] * 3, prior_of_gx(50.0, 1.0))


def test_columns_are_named_as_the_file_has_them():
    (message,) = gyro_warnings([[-52, -60, 70]] * 3)
    assert "gx (column gyro-x) −52 °/s, gy (column 5) −60 °/s, gz (column gyr_z) 70 °/s" in message
    assert len(message) <= 300


@pytest.mark.slow
def test_a_refusal_by_hand_names_gyros_that_read_too_much_at_rest(tmp_path: Path):
    """An MPU-6050 has 131 LSB/(°/s); turns of 131 times their angle agree with no rest."""
    text = (EXAMPLES / "hand_held" / "simulated.toml").read_text(encoding="utf-8")
    path = tmp_path / "run.toml"
    path.write_text(text.replace("hand_held.csv", "counts.npz"), encoding="utf-8")
    run = read(path)
    counts = apply_data_columns(run, simulate(run, 1))
    for column in run.data.gyro:
        counts.data[..., counts.channels.index(str(column))] *= 131
    write_recording(counts, tmp_path / "counts.npz")
    with refused(NotObserved) as refusal:
        calibrate(run)
    assert "gx (column gyr_x) 52" in str(refusal.value)
    assert "[sensor.gyro]" in str(refusal.value)


def test_a_forgotten_offset_warns_on_a_rate_table(tmp_path: Path):
    rows = [f"{axis},{rate},{445 + rate * (axis == 'z')}" for axis in "xz" for rate in (0, 50, -50)]
    (tmp_path / "table.csv").write_text("\n".join(["axis,rate,gz", *rows]))
    (tmp_path / "run.toml").write_text(
        '[sensor]\nname = "G"\n[sensor.gyro]\naxis = "z"\nunit = "°/s"\n'
        '[bench]\nkind = "rate_platform"\nlatitude = "50 °"\nrate_scale = "0.2 %"\n'
        'rate_asymmetry = "100 ppm"\nrate_stability = "500 ppm"\nsetting = "0.5 °"\n'
        '[data]\nfile = "table.csv"\nkind = "means"\naxis = "axis"\ntable_rate = "rate"\n'
        'gyro = ["gz"]\n[data.sd]\ngyro = "1 °/h"\n'
        '[method]\nname = "rates_and_poses"\ncoefficients = ["bias", "scale"]\n'
    )
    (warning,) = unit_warnings(calibrate(read(tmp_path / "run.toml")))
    assert "gz (column gz) 445 °/s" in warning
