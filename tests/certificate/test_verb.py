"""`inercal certificate`: numbers, job data, amendments, refusals, extras."""

import base64
import builtins
import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from tests.certificate.conftest import Laboratory
from tests.certificate.dcc_xml import etree
from tests.certificate.pdf_text import page_texts, squeezed
from tests.program import run_program
from tests.refusals import refused

import inercal
from inercal.calibration.files import load
from inercal.laboratory.certificate.content import CertificateInput
from inercal.laboratory.certificate.issue import IssueOptions, issue
from inercal.laboratory.certificate.job import read_job
from inercal.laboratory.store import Register
from inercal.laboratory.store.certificates import number_text, require_series
from inercal.runfile.job import read_laboratory


class NextYear(date):
    @classmethod
    def today(cls) -> "NextYear":
        return cls(2027, 1, 2)


@pytest.mark.slow
def test_numbers_follow_one_another_and_begin_anew_each_year(
    laboratory: Laboratory, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("inercal.cli.certificate_commands.date", NextYear)
    assert laboratory.issue().name == "IL-2026-0001.pdf"
    assert laboratory.issue().name == "IL-2026-0002.pdf"
    assert laboratory.run(date="2027-01-02").status == 0
    assert (laboratory.folder / "IL-2027-0001.pdf").is_file()
    assert laboratory.issue().name == "IL-2026-0003.pdf"


@pytest.mark.slow
def test_a_second_certificate_names_the_first_unless_it_changes_it(laboratory: Laboratory):
    first, second, third = (
        laboratory.run("--json", *options)
        for options in ((), (), ("--amends", "IL-2026-0001", "--reason", "why"))
    )
    assert json.loads(second.output)["other_certificates"] == ["IL-2026-0001"]
    assert "IL-2026-0001" in second.error
    for ended in (first, third):
        assert "other_certificates" not in json.loads(ended.output)
        assert "warning" not in ended.error


@pytest.mark.slow
def test_a_refused_certificate_uses_no_number(laboratory: Laboratory):
    change = ("--amends", "IL-2026-0099", "--reason", "why")
    assert laboratory.run(*change).status == 2
    assert not (laboratory.folder / "register.db").exists()
    laboratory.issue()
    assert laboratory.run(*change).status == 2
    (laboratory.folder / "occupied").write_text("", encoding="utf-8")
    assert laboratory.run("--out", laboratory.folder / "occupied").status == 2
    assert laboratory.issue().name == "IL-2026-0002.pdf"


def test_dates_that_contradict_each_other_are_named(laboratory: Laboratory):
    ended = laboratory.run(date="2026-11-01")
    assert ended.status == 2
    assert "issued 2026-11-01" in ended.error
    assert "None" not in ended.error


@pytest.mark.slow
def test_certificates_issued_at_once_have_numbers_of_their_own(
    laboratory: Laboratory, tmp_path: Path
):
    calibration = load(laboratory.calibration)
    given = CertificateInput(
        calibration,
        None,
        read_laboratory(laboratory.lab),
        read_job(calibration.job),
        "en",
        date(2026, 11, 26),
    )

    def number(_: int) -> str:
        with Register(laboratory.register) as opened:
            return issue(laboratory.calibration, given, IssueOptions(), opened).number

    with Register(laboratory.register) as opened:
        opened.enter_calibration(laboratory.calibration)
    with ThreadPoolExecutor(4) as pool:
        found = sorted(pool.map(number, range(4)))
    assert found == [f"IL-2026-{k:04}" for k in range(1, 5)]


def test_copy_gives_the_files_again(laboratory: Laboratory, tmp_path: Path):
    pdf = laboratory.issue()
    options = ("--register", laboratory.register, "--out", tmp_path / "copy", "--json")
    written = json.loads(run_program("certificate", "copy", "IL-2026-0001", *options).output)
    assert Path(written["pdf"]).read_bytes() == pdf.read_bytes()
    assert Path(written["dcc"]).read_bytes() == pdf.with_suffix(".xml").read_bytes()
    ended = run_program("certificate", "copy", "IL-2026-0002", "--register", laboratory.register)
    assert ended.status == 2
    assert "IL-2026-0001" in ended.error  # the last one there is


def test_a_file_in_the_way_leaves_the_certificate_in_the_register(laboratory: Laboratory):
    (laboratory.folder / "IL-2026-0001.pdf").write_text("mine", encoding="utf-8")
    ended = laboratory.run()
    assert ended.status == 2
    assert "inercal certificate copy IL-2026-0001" in ended.error
    assert (laboratory.folder / "IL-2026-0001.pdf").read_text(encoding="utf-8") == "mine"
    with Register(laboratory.register) as opened:
        assert opened.certificate("IL-2026-0001").issued == "2026-11-26"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("option", "kind", "words"),
    [
        ("--amends", "amended", "This certificate amends certificate No. IL-2026-0001."),
        ("--replaces", "substituted", "This certificate replaces certificate No. IL-2026-0001"),
    ],
)
def test_a_change_names_the_earlier_certificate_and_its_hash(
    option: str, kind: str, words: str, laboratory: Laboratory
):
    laboratory.issue()
    pdf = laboratory.issue(option, "IL-2026-0001", "--reason", "the serial number was wrong")
    text = "".join(page_texts(pdf))
    assert squeezed(words) in text
    assert squeezed("Reason: the serial number was wrong") in text
    core = etree.parse(pdf.with_suffix(".xml")).getroot().find(".//{*}coreData")
    assert core.findtext(".//{*}typeOfChange") == kind
    assert core.findtext(".//{*}replacedUniqueIdentifier") == "IL-2026-0001"
    listed = run_program("certificate", "list", "--register", laboratory.register, "--json")
    found = [(one["number"], one["change"]) for one in json.loads(listed.output)["certificates"]]
    assert found == [("IL-2026-0001", ""), ("IL-2026-0002", kind)]
    with Register(laboratory.register) as opened:
        earlier = opened.certificate("IL-2026-0001")
        assert opened.successors("IL-2026-0001") == (("IL-2026-0002", kind),)
    assert core.findtext(".//{*}previousReport/{*}value") == earlier.dcc_sha256


def test_as_found_prints_both_results(laboratory: Laboratory):
    text = "".join(page_texts(laboratory.issue("--as-found", laboratory.calibration)))
    assert squeezed("Results before adjustment") in text
    assert squeezed("Results after adjustment") in text


def test_few_degrees_of_freedom_are_stated(laboratory: Laboratory, tmp_path: Path):
    job = tmp_path / "job.toml"
    job.write_text("[job]\ndegrees_of_freedom = 6\n", encoding="utf-8")
    text = "".join(page_texts(laboratory.issue("--job", job)))
    assert squeezed("k = 2.52") in text  # GUM, table G.2
    assert squeezed("ν = 6 effective degrees of freedom") in text


@pytest.mark.slow
def test_a_file_of_the_order_adds_and_replaces(laboratory: Laboratory, tmp_path: Path):
    job = tmp_path / "job.toml"
    job.write_text(
        '[job]\ncustomer = "Basin No. 5"\ndeviations = "position 3 was omitted"\n'
        'external = "temperature by B"\nopinions = "as good as new"\nplace = "Kiel"\n'
        "measured_until = 2026-11-26\n",
        encoding="utf-8",
    )
    pdf = laboratory.issue("--job", job)
    text = "".join(page_texts(pdf))
    for words in ("Basin No. 5", "position 3 was omitted", "temperature by B", "as good as new",
                  "Place of the calibration Kiel", "2026-11-25 to 2026-11-26"):  # fmt: skip
        assert squeezed(words) in text, words
    assert squeezed("Basin No. 3") not in text
    root = etree.parse(pdf.with_suffix(".xml")).getroot()
    assert root.findtext(".//{*}performanceLocation") == "other"


@pytest.mark.parametrize(
    ("file", "old", "key"),
    [
        ("lab.toml", 'address = "Werkstraße 1, 80331 München"\n', "address"),
        ("lab.toml", 'country = "DE"\n', "country"),
        ("lab.toml", 'approved_by = "C. F. Gauss"\n', "approved_by"),
        ("lab.toml", 'procedure = "QA-17, after IEEE Std 1293-2018"\n', "procedure"),
    ],
)
def test_a_missing_item_is_named(file: str, old: str, key: str, laboratory: Laboratory):
    laboratory.change(old, "")
    ended = laboratory.run()
    assert ended.status == 2
    assert key in ended.error
    assert not Path(laboratory.register).exists()


@pytest.mark.parametrize(
    "options",
    [
        ("--amends", "IL-2026-0001"),
        ("--reason", "why"),
        ("--amends", "A", "--replaces", "B", "--reason", "why"),
        ("--date", "26.11.2026"),
        ("--date", "2999-01-01"),
        ("--language", "fr"),
        ("--font", "none.ttf"),
        ("--draft", "--amends", "A", "--reason", "why"),
        ("--job", "none.toml"),
        ("--as-found", "none.calibration.json"),
    ],
)
def test_wrong_options_are_refused(options: tuple[str, ...], laboratory: Laboratory):
    assert laboratory.run(*options).status == 2
    assert not Path(laboratory.register).exists()


def test_dates_that_contradict_one_another_are_refused(laboratory: Laboratory):
    assert laboratory.run(date="2026-11-24").status == 2


def test_a_file_of_the_order_with_another_key_or_section_is_refused(tmp_path: Path):
    path = tmp_path / "job.toml"
    for text in ("[job]\ncustomr = 'a'\n", "[jobs]\n", "customer = 'a'\n"):
        path.write_text(text, encoding="utf-8")
        with refused(file=path):
            read_job({}, path)


@pytest.mark.parametrize("series", ["{year}", "{sequence}", "a/{year}{sequence}", "{year}{x}", ""])
def test_a_pattern_without_distinct_numbers_is_refused(series: str):
    with refused(key="certificate_number"):
        require_series(series)


def test_numbers_of_a_pattern():
    assert number_text("{year}.{sequence}", 2026, 12) == "2026.12"
    assert number_text("A{sequence:3}-{year}", 2026, 12) == "A012-2026"


@pytest.mark.parametrize(("package", "extra"), [("typst", "certificate"), ("lxml", "certificate")])
def test_a_missing_extra_is_named_before_any_work(
    package: str, extra: str, laboratory: Laboratory, monkeypatch: pytest.MonkeyPatch
):
    def find_spec(name: str) -> Any:
        return None if name == package else object()

    monkeypatch.setattr("inercal.basics.errors.find_spec", find_spec)
    ended = laboratory.run()
    assert ended.status == 2
    assert f"inercal[{extra}]" in ended.error


def test_a_missing_extra_of_signatures_is_named(
    laboratory: Laboratory, keys: Path, monkeypatch: pytest.MonkeyPatch
):
    def find_spec(name: str) -> Any:
        return None if name == "pyhanko" else object()

    monkeypatch.setattr("inercal.basics.errors.find_spec", find_spec)
    for ended in (
        laboratory.run("--sign", keys / "own.p12"),
        run_program("certificate", "verify", laboratory.calibration),
    ):
        assert ended.status == 2
        assert "inercal[signature]" in ended.error


def test_the_schema_is_not_in_the_package():
    package = Path(__file__).parents[2] / "src" / "inercal"
    assert not list(package.rglob("*.xsd"))
    assert builtins.any(package.rglob("certificate.typ"))


def test_a_calibration_as_found_is_of_the_same_sensor(laboratory: Laboratory, tmp_path: Path):
    other = load(laboratory.calibration)
    other = replace(other, sensor=replace(other.sensor, name="SN 0418"))
    found = inercal.save(other, tmp_path / "found.calibration.json")
    ended = laboratory.run("--as-found", found)
    assert ended.status == 2
    assert "SN 0418" in ended.error


@pytest.mark.parametrize("row", [0, 1])
def test_a_changed_covariance_is_compared_with_the_calibration_file(
    row: int, laboratory: Laboratory, tmp_path: Path
):
    root = etree.parse(laboratory.issue().with_suffix(".xml"))
    cell = next(root.iter("{*}column")).findall("{*}covariance/{*}value")[row]
    cell.text = repr(1.02 * float(cell.text) + 1e-12)
    changed = tmp_path / "changed.xml"
    root.write(changed)
    ended = run_program("certificate", "verify", changed, "--json")
    (found,) = (one for one in json.loads(ended.output)["checks"] if one["name"] == "results 1")
    assert found["passed"] is False
    assert "covariance differs" in found["text"]


@pytest.mark.parametrize("damage", ["attachment", "list", "covariance"])
def test_results_that_cannot_be_read_are_a_failed_check(
    damage: str, laboratory: Laboratory, tmp_path: Path
):
    original = laboratory.issue().with_suffix(".xml")
    root = etree.parse(original)
    place = {"attachment": "dataBase64", "list": "valueXMLList"}.get(damage, "covariance")
    element = next(root.iter(f"{{*}}{place}"))
    if damage == "attachment":
        content = base64.b64decode(element.text).replace(b'"schema"', b'"sch\\ema"', 1)
        element.text = base64.b64encode(content).decode()
    elif damage == "list":
        element.text = element.text.rpartition(" ")[0]
    else:
        element.getparent().remove(element)
    damaged = tmp_path / "damaged.xml"
    root.write(damaged)
    ended = run_program("certificate", "verify", damaged, "--json")
    checks = {one["name"]: one["passed"] for one in json.loads(ended.output)["checks"]}
    assert (ended.status, checks["results 1"]) == (3, False)
