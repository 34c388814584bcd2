"""What people write, what it means in SI, and how what cannot be meant is refused."""

import random
import re
from math import inf, nan, pi, radians, sqrt

import numpy as np
import pytest
from numpy.testing import assert_allclose
from tests.refusals import refused

from inercal.basics.errors import InputError
from inercal.basics.units import (
    Measured,
    format_count,
    format_duration,
    format_interval,
    format_number,
    format_quantity,
    parse_quantity,
    si_factor,
    to_si,
)

G = 9.80665
ARCSEC = pi / 648000


@pytest.mark.parametrize(
    ("text", "like", "value", "sd"),
    [
        ("0.5 m ± 5 µm", "m", 0.5, 5e-6),
        ("0.5 m +/- 5 um", "m", 0.5, 5e-6),
        ("0.5m+-5um", "mm", 0.5, 5e-6),
        ("0.5 m ± 5 \u03bcm", "m", 0.5, 5e-6),  # the Greek letter, not the micro sign
        ("0.5 m ± 10 µm (k=2)", "m", 0.5, 5e-6),
        ("0.5 m ± 9.8 µm, k = 1.96", "m", 0.5, 5e-6),
        ("(12 ± 3) µg", "g", 12e-6 * G, 3e-6 * G),
        ("(12 ± 3) µg (k=2)", "m/s²", 12e-6 * G, 1.5e-6 * G),
        ("-12 ± 3 mg", "g", -12e-3 * G, 3e-3 * G),
        ("−12 mg", "g", -12e-3 * G, 0),  # the minus sign, not the hyphen
        ("2 arcsec", "rad", 2 * ARCSEC, 0),
        ("2″", "rad", 2 * ARCSEC, 0),
        ("1.5′", "rad", 90 * ARCSEC, 0),
        ("45.5°", "rad", radians(45.5), 0),
        ("45.5 º", "rad", radians(45.5), 0),  # the masculine ordinal of some keyboards
        ("10 µg/g²", "µg/g^2", 10e-6 / G, 0),
        ("0.1 °/√h", "°/√h", radians(0.1) / 60, 0),
        ("0.1 deg/sqrt(h)", "rad/√s", radians(0.1) / 60, 0),
        ("0.1 deg/hr^0.5", "°/√h", radians(0.1) / 60, 0),
        ("0.1 deg/h^(1/2)", "°/√h", radians(0.1) / 60, 0),
        ("60 µg/√Hz", "m/s²/√Hz", 60e-6 * G, 0),
        ("60 µg/√(Hz)", "m/s/√s", 60e-6 * G, 0),
        ("3 (°/h)/g", "°/h/g", radians(3) / 3600 / G, 0),
        ("102.4 Hz", "Hz", 102.4, 0),
        ("2048 LSB/g", "LSB/(m/s²)", 2048 / G, 0),
        ("16.4 LSB/(°/s)", "count/(rad/s)", 16.4 * 180 / pi, 0),
        ("1 mA/g", "A/g", 1e-3 / G, 0),
        ("60 r/min", "rad/s", 2 * pi, 0),
        ("60 rpm", "rev/s", 2 * pi, 0),
        ("250 dps", "°/s", radians(250), 0),
        ("9.81 m/s² ± 40 ppm", "m/s²", 9.81, 9.81 * 40e-6),
        ("-9.81 m/s² ± 0.1 %", "g", -9.81, 9.81e-3),
        ("9.81 m·s⁻²", "g", 9.81, 0),
        ("9.81 m s^-2", "g", 9.81, 0),
        ("9.81 m/s**2", "g", 9.81, 0),
        ("9.81 m/s2", "g", 9.81, 0),
        ("1 mGal", "m/s²", 1e-5, 0),
        ("23 °C ± 0.5 K", "K", 296.15, 0.5),
        ("23 ± 0.5 °C", "K", 296.15, 0.5),
        ("5 µg/°C", "µg/K", 5e-6 * G, 0),
        ("0 ± 0.5 %", "1", 0, 0.005),
        ("100 % ± 0.5 %", "1", 1, 0.005),
        ("(3 ± 1) ppm", "1", 3e-6, 1e-6),
        ("3e-5", "1", 3e-5, 0),
        ("1 ± 4e-5", "1", 1, 4e-5),
        (" .5 ", "1", 0.5, 0),
        (3, "1", 3, 0),
        (-2.5, "1", -2.5, 0),
        ("5 counts", "LSB", 5, 0),
        ("2 hours", "s", 7200, 0),
        ("1 ppm/K", "1/K", 1e-6, 0),
    ],
)
def test_text_parses_to_value_and_deviation(text: str | float, like: str, value: float, sd: float):
    assert_allclose(
        [parse_quantity(text, like).value, parse_quantity(text, like).sd], [value, sd], rtol=1e-14
    )


@pytest.mark.parametrize(
    ("text", "like", "part"),
    [
        ("2 mm", "rad", "2 mm"),
        ("1 Hz", "rad/s", "1 Hz"),
        ("1 rad/s", "Hz", "1 rad/s"),
        ("1 rad", "1", "1 rad"),
        ("5 m ± 3 s", "m", "± 3 s"),
        (
            "1 g",
            "LSB/g",
            "1 g",
        ),
        ("5 khz", "Hz", "khz"),
        ("5 arcsek", "rad", "arcsek"),
        ("5 kg", "g", "kg"),
        ("5 Mg", "g", "Mg"),
        ("5 m°C", "K", "m°C"),
        ("5 xx", "m", "xx"),
        ("5", "m", "5"),
        (5, "m", None),
        ("5 ± 3", "m", "5 ± 3"),
        ("5 ± 3 %", "m", "5 ± 3 %"),
        ("5 m ± 3", "m", "5 m ± 3"),
        ("5 m ± -3 mm", "m", "5 m ± -3 mm"),
        ("5 m ± 1 mm ± 1 mm", "m", "5 m ± 1 mm ± 1 mm"),
        ("± 5 m", "m", "± 5 m"),
        ("5 m (k=2)", "m", "5 m (k=2)"),
        ("5 m ± 1 m (k=0)", "m", "5 m ± 1 m (k=0)"),
        ("5 m ± 1 m (k=-2)", "m", "5 m ± 1 m (k=-2)"),
        ("0 g ± 5 %", "g", "0 g ± 5 %"),
        ("23 °C ± 5 %", "K", "23 °C ± 5 %"),
        ("1 ± 40 ppm", "1", "1 ± 40 ppm"),
        ("50 ppm ± 10 %", "1", "50 ppm ± 10 %"),
        ("2", "%", "2"),  # 2 % or 200 %?
        (0.02, "ppm", None),
        ("0 ± 2", "%", "0 ± 2"),
        ("5 % ± 3", "%", "5 % ± 3"),
        ("0,5 m", "m", "0,5 m"),
        ("nan", "1", "nan"),
        ("-inf m", "m", "-inf m"),
        ("1e999 m", "m", "1e999 m"),
        ("1e308 km", "m", "1e308 km"),
        ("1 m ± 1e308 km", "m", "1 m ± 1e308 km"),
        ("-1e308 m ± 60 µm", "m", "-1e308 m ± 60 µm"),
        ("1 m ± 1e200 m", "m", "1 m ± 1e200 m"),
        (nan, "1", None),
        (-inf, "1", None),
        ("", "m", ""),
        (" \n", "1", " \n"),
        (True, "1", None),
        (None, "m", None),
        ([1.0], "m", None),
        ("m", "m", "m"),
        ("5 m//s", "m", "m//s"),
        ("5 (m", "m", "(m"),
        ("5 m)", "m", "m)"),
        ("5 m/", "m", "m/"),
        ("5 2 m", "m", "2 m"),
        ("5 m\n6 m", "m", "5 m\n6 m"),
        ("45°30′12″", "rad", "°30′12″"),
        ("5 __import__('os')", "m", "__import__('os')"),
        ("x" * 101, "m", "x" * 101),
        ("9**9**9**9", "1", "**9**9**9"),
        ("1 9**9**9**9", "1", "9**9**9**9"),
        ("1 m**9**9**9", "m", "m**9**9**9"),
        ("1 ((((h^9)^9)^9)^9)^9", "m", "((((h^9)^9)^9)^9)^9"),
        (
            "1 nm^9 ns^9 nV^9 ng^9 nrad^9",
            "m",
            "nm^9 ns^9 nV^9 ng^9 nrad^9",
        ),  # beyond the range of floats
    ],
)
def test_text_is_refused_with_the_part_that_is_wrong(text: str, like: str, part: str | None):
    with refused(names=() if part is None else (part,)):
        parse_quantity(text, like)


def test_an_integer_beyond_all_floats_is_refused():
    with refused(names=()):
        parse_quantity(10**5000, like="1")


@pytest.mark.parametrize(
    ("unit", "size"),
    [
        ("1", 1),
        ("g", G),
        ("mg", 1e-3 * G),
        ("µg", 1e-6 * G),
        ("ug/√Hz", 1e-6 * G),
        ("µg/g³", 1e-6 / G**2),
        ("µg/g²/K", 1e-6 / G),
        ("µg/(rad/s)²", 1e-6 * G),
        ("ppm/(rad/s)", 1e-6),
        ("%", 0.01),
        ("°/h/g²", radians(1) / 3600 / G**2),
        ("m°/s", radians(1e-3)),
        ("1/√Hz", 1),
        ("√(m·s)", 1),
        ("√h", 60),
        ("√(h)/√(min)", sqrt(60)),
        ("kHz", 1e3),
        ("min", 60),
        ("ms", 1e-3),
        ("sample/s", 1),
    ],
)
def test_factor_is_the_si_size_of_one_unit(unit: str, size: float):
    assert si_factor(unit) == pytest.approx(size, rel=1e-14)


def test_factor_holds_the_unit_to_an_expected_dimension():
    assert si_factor("°/h", like="rad/s") == pytest.approx(pi / 648000, rel=1e-14)
    with refused(names=["°/h"]):
        si_factor("°/h", like="rad")


@pytest.mark.parametrize(
    "unit", ["", " ", "2 m", "m^", "√", "()", "m^-", "g_n", "³", "m^2.7", "²m"]
)
def test_factor_refuses_what_is_not_a_unit(unit: str):
    with refused(names=[unit]):
        si_factor(unit)


def test_celsius_is_no_factor_but_a_difference_of_one_is_a_kelvin():
    with refused(names=["°C"]):
        si_factor("°C", like="K")
    assert si_factor("ppm/°C") == si_factor("ppm/K")


def test_a_column_in_celsius_becomes_kelvin():
    column = np.array([[-273.15, 0.0], [23.0, 100.0]])
    assert_allclose(to_si(column, "°C", "K"), [[0, 273.15], [296.15, 373.15]])
    assert_allclose(to_si(column, "mg", "g"), column * 1e-3 * G)
    with refused(names=["V"]):
        to_si(column, "V", "K")


@pytest.mark.parametrize(
    ("value", "sd", "unit", "text"),
    [
        (12.34e-6 * G, 0.41e-6 * G, "µg", "12.34 ± 0.41 µg"),
        (0.5, 5e-6, "m", "0.5000000 ± 0.0000050 m"),
        (123456, 1234, "m", "123.5 ± 1.2 km"),
        (123456, 1234, "LSB", "123500 ± 1200 LSB"),
        (-0.001, 1, "m", "0.0 ± 1.0 m"),
        (1.0, 0.0996, "1", "1.00 ± 0.10"),
        (1e-9, 1e-11, "m", "1.000 ± 0.010 nm"),
        (1e-9, 1e-11, "1", "1.000e-9 ± 0.010e-9"),
        (1.234e8, 1.3e5, "LSB", "1.2340e8 ± 0.0013e8 LSB"),
        (0, 5e-7 / G, "g/g²", "0.00 ± 0.50 µg/g²"),
        (radians(1e-5), radians(1e-6), "°/s", "0.0360 ± 0.0036 °/h"),
        (296.15, 0.5, "°C", "23.00 ± 0.50 °C"),
        (radians(2 / 3600), 0, "″", "2 ″"),
        (G, 0, "m/s²", "9.80665 m/s²"),
        (1, inf, "m", "1 ± inf m"),
        (nan, nan, "m", "nan m"),
    ],
)
def test_readable_rounds_to_two_digits_of_the_uncertainty(
    value: float, sd: float, unit: str, text: str
):
    assert format_quantity(value, sd, unit) == text


def test_a_quantity_changes_its_prefix_where_it_would_need_an_exponent():
    for power in range(-3, 6):
        for unit in ("µg", "ms", "g/K", "mrad"):
            text = format_quantity(3.14159 * 10.0**power * si_factor(unit), 0, unit, 2)
            shown = re.fullmatch(r"([\d.]+) (.*)", text)
            assert shown, text
            value = parse_quantity(text, like=unit).value / si_factor(unit)
            assert value == pytest.approx(3.14159 * 10.0**power, rel=0.02)
            assert len(shown[1].strip("0.")) <= 3
            if shown[2][0] in "µm" and shown[2] != "m":
                assert 0.01 <= float(shown[1]) < 100


def test_no_number_of_common_size_has_an_exponent_and_each_keeps_its_digits():
    rng = random.Random(6)
    for _ in range(300):
        value = rng.choice((-1, 1)) * 10 ** rng.uniform(-4, 6.9)
        digits = rng.randint(1, 9)
        text = format_number(value, digits)
        assert "e" not in text
        assert float(text) == float(f"{value:.{digits}g}")


def test_the_ends_of_an_interval_differ_from_the_value_in_it():
    rng = random.Random(7)
    for _ in range(300):
        value = rng.gauss(0, 1) * 10 ** rng.uniform(-6, 6)
        low, high = value - 10 ** rng.uniform(-9, 3), value + 10 ** rng.uniform(-9, 3)
        first, last = map(float, format_interval(value, low, high).split(" … "))
        assert value - first == pytest.approx(value - low, rel=0.051)
        assert last - value == pytest.approx(high - value, rel=0.051)
    assert format_interval(1, 0, inf) == "0.0 … inf"


def test_a_day_is_a_unit_of_time():
    assert parse_quantity("40 d", like="s").value == 40 * 86_400


@pytest.mark.parametrize("size", [(1, "s"), (60, "min"), (3600, "h"), (86400, "d")])
def test_a_duration_is_in_the_largest_unit_of_which_it_has_two(size: tuple[float, str]):
    seconds, unit = size
    for number in (2, 12.3, 23.4):
        shown, of = format_duration(number * seconds).split()
        assert (float(shown), of) == (pytest.approx(number, rel=0.05), unit)


def test_a_count_of_one_has_its_noun_in_the_singular():
    counts = [format_count(count, "analysis", "analyses") for count in (0, 1, 2)]
    assert counts == ["0 analyses", "1 analysis", "2 analyses"]
    assert [format_count(count, "rest") for count in (0, 1, 2)] == ["0 rests", "1 rest", "2 rests"]


def test_parse_reads_what_readable_prints():
    rng = random.Random(5)
    for _ in range(300):
        value = rng.gauss(0, 1) * 10 ** rng.uniform(-12, 12)
        sd = abs(value) * 10 ** rng.uniform(-6, 2)
        back = parse_quantity(format_quantity(value, sd, "µg"), like="g")
        assert back.sd == pytest.approx(sd, rel=0.051)
        assert abs(back.value - value) <= 0.051 * sd


def test_measured_is_a_value_without_uncertainty_unless_one_is_stated():
    assert parse_quantity("3 m", like="m") == Measured(3.0, 0.0)


PIECES = [
    *"0123456789.,+-*/^()[]{}±√·°′″%µμ²³⁻¹ \t\n\"'\\_#@;:=<>&|~$€∞①٣mskghrKVAGeEN",
    *("**", "sqrt", "deg", "Hz", "(k=2)", "LSB", "ppm", "°C", "nan", "inf", "1e9", "lambda "),
    *("+/-", " ± ", "5 ", "m", "/s", "/√h", "9**9"),
]


@pytest.mark.slow
def test_junk_gives_a_quantity_or_one_line_of_refusal():
    rng = random.Random(1)
    refusals: list[str] = []
    for _ in range(10_000):
        text = rng.choice(["", "5 "]) + "".join(rng.choices(PIECES, k=rng.randint(0, 12)))
        try:
            measured = parse_quantity(text, like=rng.choice(["m", "g", "1", "K", "°/√h"]))
        except InputError as refusal:
            refusals.append(str(refusal))
        else:
            assert abs(measured.value) < inf
            assert 0 <= measured.sd < inf
    assert len(refusals) < 9_990  # the pieces do form quantities
    assert all(len(line) < 300 and line.isprintable() for line in refusals)


def test_any_unicode_is_refused_without_a_traceback_of_its_own():
    rng = random.Random(2)
    for _ in range(2_000):
        top = rng.choice([0x2FF, 0xFFFF, 0x10FFFF])
        text = "".join(chr(rng.randint(0, top)) for _ in range(rng.randint(2, 110)))
        for junk in (text, "1 " + text):
            with pytest.raises(InputError):
                parse_quantity(junk, like="m")


def test_a_scale_factor_of_the_other_kind_of_sensor_is_named_as_such():
    with pytest.raises(InputError) as error:
        parse_quantity("4.6 LSB/g", like="LSB/(°/s)")
    assert "accelerometer" in str(error.value)
    assert "gyro" in str(error.value)
    assert "^" not in str(error.value)


def test_fahrenheit_has_its_zero_and_its_size():
    assert to_si(np.array([32.0, 212.0]), "°F", "K") == pytest.approx([273.15, 373.15])
    found = parse_quantity("77 ℉ ± 1.8 °F", "°C")
    assert (found.value, found.sd) == pytest.approx((298.15, 1.0))
    assert si_factor("µg/degF") == pytest.approx(1.8 * si_factor("µg/K"))


@pytest.mark.parametrize(("text", "kelvin"), [("0.2 °C", 0.2), ("0.2 K", 0.2), ("1.8 °F", 1.0)])
def test_a_temperature_difference_has_no_zero(text: str, kelvin: float):
    assert parse_quantity(text, "K", difference=True).value == pytest.approx(kelvin)
