"""The DCC: valid by its schema, read back to what was written, units that a D-SI parser takes."""

import warnings
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
import xmlschema
from dsi_unit import DsiUnit
from numpy.typing import NDArray
from tests.certificate.conftest import Laboratory
from tests.certificate.dcc_xml import etree
from tests.refusals import refused

from inercal.calibration import Calibration
from inercal.calibration.files import load
from inercal.laboratory.certificate.content import (
    Certificate,
    CertificateChange,
    CertificateInput,
    make_certificate,
)
from inercal.laboratory.certificate.dcc import dsi_unit, write_dcc
from inercal.laboratory.certificate.dcc_reading import read_dcc, schema_defects
from inercal.laboratory.certificate.job import read_job
from inercal.physics.sensors import SI_UNITS, Sensor, imu, triad
from inercal.physics.sensors.coefficient_tables import TABLES
from inercal.runfile.job import JobSection, LaboratoryFile, read_laboratory

Array = NDArray[np.float64]
SIGNATURE = (
    '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" '
    'targetNamespace="http://www.w3.org/2000/09/xmldsig#"><xs:element name="Signature"/>'
    "</xs:schema>"
)


@pytest.fixture
def laboratory_file(example: Path) -> LaboratoryFile:
    return read_laboratory(example / "lab.toml").model_copy(update={"capability": None})


@pytest.fixture
def job(example: Path) -> JobSection:
    return read_job(load(example / "run.calibration.json").job)


def whole_imu(seed: int = 3) -> Calibration:
    """Return a calibration with every coefficient of the tables, of one axis each, correlated."""
    rng = np.random.default_rng(seed)
    sensor = Sensor("nine", (*imu().axes, *triad("field", "m", "m").axes))
    first = {axis.measures: axis.name for axis in reversed(sensor.axes)}
    sensor = sensor.with_coefficients(
        *(f"{first[kind]}.{term.name}" for kind, table in TABLES.items() for term in table)
    )
    p = len(sensor.coefficients)
    sd = 1e-4 * sensor.unit_scale
    root = rng.standard_normal((p, 2 * p))
    full = root @ root.T
    size = np.sqrt(np.diag(full))
    covariance = full / np.outer(size, size) * np.outer(sd, sd)
    values = 0.03 * sensor.unit_scale * rng.uniform(-1, 1, p)
    return Calibration(sensor, values, (covariance + covariance.T) / 2, "multi_position", "ml")


def certificate(
    calibration: Calibration,
    laboratory_file: LaboratoryFile,
    job: JobSection,
    as_found: Calibration | None = None,
    change: CertificateChange | None = None,
) -> Certificate:
    given = CertificateInput(
        calibration, as_found, laboratory_file, job, "en", date(2026, 11, 26), draft=True
    )
    return make_certificate(given, "IL-2026-0001", change or CertificateChange())


def two_validators(document: bytes, schema: Path, folder: Path) -> list[str]:
    """Return what libxml2, and xmlschema, which shares no code with it, find wrong."""
    (folder / "signature.xsd").write_text(SIGNATURE)
    places = {
        "https://ptb.de/si": str(schema.with_name("SI_Format-2.1.0.xsd")),
        "http://www.w3.org/2000/09/xmldsig#": str(folder / "signature.xsd"),
    }
    text = schema.read_text(encoding="utf-8")
    for address, namespace in (
        ("https://ptb.de/si/v2.1.0/SI_Format.xsd", "https://ptb.de/si"),
        (
            "https://www.ptb.de/dcc/d-sig/xmldsig-core-schema.xsd",
            "http://www.w3.org/2000/09/xmldsig#",
        ),
    ):
        assert address in text
        text = text.replace(address, Path(places[namespace]).as_uri())
    (folder / "dcc.xsd").write_text(text, encoding="utf-8")
    other = xmlschema.XMLSchema(str(folder / "dcc.xsd"), allow="all")
    found = [str(one.reason) for one in other.iter_errors(document.decode())]
    return [*schema_defects(document, schema), *found]


def parse_unit(unit: str) -> DsiUnit:
    """Return a unit as the package of PTB reads it, which must have nothing against it."""
    with warnings.catch_warnings():
        # It warns of every unit that "per" is deprecated, and of wrong ones; `valid` is the result.
        warnings.simplefilter("ignore")
        parsed = DsiUnit(unit)
    assert parsed.valid, unit
    assert not parsed.non_dsi_unit, unit
    return parsed


@pytest.mark.slow
@pytest.mark.parametrize("change", ["", "amended", "substituted"])
def test_every_kind_of_certificate_is_valid(
    change: str,
    example: Path,
    schema: Path,
    laboratory_file: LaboratoryFile,
    job: JobSection,
    tmp_path: Path,
):
    calibration = load(example / "run.calibration.json")
    changed = (
        CertificateChange("amended" if change == "amended" else "substituted", "IL-1", "ab", "why")
        if change
        else None
    )
    found = certificate(calibration, laboratory_file, job, calibration if change else None, changed)
    assert two_validators(write_dcc(found), schema, tmp_path) == []


@pytest.mark.slow
def test_every_coefficient_of_the_tables_is_valid(
    schema: Path, laboratory_file: LaboratoryFile, job: JobSection, tmp_path: Path
):
    document = write_dcc(certificate(whole_imu(), laboratory_file, job))
    assert two_validators(document, schema, tmp_path) == []


@pytest.mark.slow
def test_a_contradiction_to_the_schema_is_found(
    schema: Path, laboratory_file: LaboratoryFile, job: JobSection, tmp_path: Path
):
    document = write_dcc(certificate(whole_imu(), laboratory_file, job))
    broken = document.replace(b"<dcc:countryCodeISO3166_1>DE", b"<dcc:countryCodeISO3166_1>de")
    assert broken != document
    assert len(schema_defects(broken, schema)) >= 1
    assert len(two_validators(broken, schema, tmp_path)) > len(schema_defects(broken, schema))


@pytest.mark.parametrize("dof", [None, 6.0])
def test_coefficients_u_and_covariance_are_read_back(
    dof: float | None, laboratory_file: LaboratoryFile, job: JobSection
):
    calibration = whole_imu()
    job = job.model_copy(update={"degrees_of_freedom": dof})
    made = certificate(calibration, laboratory_file, job)
    (found,) = read_dcc(write_dcc(made)).results
    assert found.names == calibration.sensor.coefficients
    np.testing.assert_array_equal(found.full_value, calibration.values)
    np.testing.assert_array_equal(found.covariance, calibration.covariance)
    k = 2.0 if dof is None else 2.52  # GUM, table G.2, 95.45 %
    np.testing.assert_allclose(found.k, k, atol=5e-3)
    # Rounded to two digits of U: at most half a digit of it, 5 %, away.
    expanded = found.k * calibration.std
    np.testing.assert_allclose(found.expanded, expanded, rtol=0.052)
    np.testing.assert_array_less(np.abs(found.value - calibration.values), 0.051 * expanded)
    np.testing.assert_array_equal(found.calibration.values, calibration.values)


def test_pages_and_dcc_state_the_same_numbers(laboratory_file: LaboratoryFile, job: JobSection):
    made = certificate(whole_imu(), laboratory_file, job)
    (found,) = read_dcc(write_dcc(made)).results
    for row, value, expanded in zip(made.results[0].rows, found.value, found.expanded, strict=True):
        # From the SI number, in the printed unit with the printed digits, comes the printed text.
        decimals = len(row.value.partition(".")[2])
        assert f"{value / row.si:.{decimals}f}" == row.value
        assert f"{expanded / row.si:.{decimals}f}" == row.expanded
        digits = row.expanded.replace(".", "").strip("0")
        assert 1 <= len(digits) <= 2


def test_ellipsoid_has_the_coverage_factor_of_all_coefficients(
    example: Path, laboratory_file: LaboratoryFile, job: JobSection
):
    calibration = load(example / "run.calibration.json")
    root = etree.fromstring(write_dcc(certificate(calibration, laboratory_file, job)))
    found = root.findtext(".//{*}ellipsoidalRegionXMLList/{*}coverageFactor")
    # Random vectors of 12 standard normal components: 95.45 % are shorter.
    length = np.linalg.norm(np.random.default_rng(1).standard_normal((200_000, 12)), axis=1)
    assert float(found) == pytest.approx(np.quantile(length, 0.9545), abs=0.01)


@pytest.mark.slow
def test_units_parse_by_the_package_of_ptb_and_keep_their_dimension(
    laboratory_file: LaboratoryFile, job: JobSection
):
    (found,) = read_dcc(write_dcc(certificate(whole_imu(), laboratory_file, job))).results
    units = {*found.units, *(unit for row in found.covariance_units for unit in row)}
    parsed = {unit: parse_unit(unit) for unit in units}
    for first, row in zip(found.units, found.covariance_units, strict=True):
        for second, unit in zip(found.units, row, strict=True):
            assert parsed[first] * parsed[second] == parsed[unit]


def test_the_parser_refuses_what_is_no_unit():
    with pytest.raises(AssertionError):
        parse_unit(r"\per\second")
    with pytest.raises(AssertionError):
        parse_unit(r"\metre\foo")


def test_every_unit_of_the_tables_has_a_notation():
    assert all(dsi_unit(unit).startswith("\\") for unit in SI_UNITS.values())


def test_text_that_looks_like_markup_stays_text(laboratory_file: LaboratoryFile, job: JobSection):
    name = '<b> & "]]>" \x1b[2J'
    job = job.model_copy(update={"customer": name})
    root = etree.fromstring(write_dcc(certificate(whole_imu(), laboratory_file, job)))
    assert root.findtext(".//{*}customer/{*}name/{*}content") == '<b> & "]]>" \\x1b[2J'


def test_results_before_and_after_adjustment_are_two_measurements(
    laboratory_file: LaboratoryFile, job: JobSection
):
    after = whole_imu()
    before = replace(after, values=after.values * 2, conditions={"gravity": "9.81 m/s²"})
    after = replace(after, conditions={"gravity": "9.82 m/s²"})
    document = write_dcc(certificate(after, laboratory_file, job, before))
    first, second = read_dcc(document).results
    np.testing.assert_array_equal(first.full_value, before.values)
    np.testing.assert_array_equal(second.full_value, after.values)
    root = etree.fromstring(document)
    status = [one.text for one in root.iterfind(".//{*}influenceCondition/{*}status")]
    assert {*status[: len(status) // 2]} == {"beforeAdjustment"}
    assert {*status[len(status) // 2 :]} == {"afterAdjustment"}


def test_a_schema_that_lacks_what_it_imports_is_refused(schema: Path, tmp_path: Path):
    alone = tmp_path / "dcc.xsd"
    alone.write_bytes(schema.read_bytes())
    with refused(key="--schema", file=alone):
        schema_defects(b"<a/>", alone)
    with refused(key="--schema"):
        schema_defects(b"<a/>", tmp_path / "none.xsd")


def test_the_verb_validates_by_a_schema(laboratory: Laboratory, schema: Path, tmp_path: Path):
    assert laboratory.run("--schema", schema).status == 0
    # A schema of another version refuses the certificate, and no number is used.
    other = tmp_path / "dcc.xsd"
    text = schema.read_text(encoding="utf-8")
    other.write_text(text.replace(r"3\.2\.1", r"9\.9\.9"), encoding="utf-8")
    (tmp_path / "si.xsd").write_bytes(schema.with_name("SI_Format-2.1.0.xsd").read_bytes())
    ended = laboratory.run("--schema", other)
    assert ended.status == 2
    assert "9\\.9\\.9" in ended.error or "schemaVersion" in ended.error
    assert laboratory.issue().name == "IL-2026-0002.pdf"


def test_a_blank_in_the_name_of_an_axis_parts_no_list(
    laboratory_file: LaboratoryFile, job: JobSection
):
    plain = imu().with_coefficients("bias")
    axes = (replace(plain.axes[0], name="a x"), *plain.axes[1:])
    names = ("a x.k0", *plain.coefficients[1:])
    sensor = replace(plain, axes=axes, coefficients=names)
    calibration = Calibration(sensor, 1e-3 * np.arange(6.0), 1e-8 * np.eye(6))
    (found,) = read_dcc(write_dcc(certificate(calibration, laboratory_file, job))).results
    assert found.names == ("a_x.k0", *names[1:])
