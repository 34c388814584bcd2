"""The pages: items of the standard, PDF/A, marks, languages, characters."""

import re
import shutil
import subprocess
import tomllib
from datetime import date
from pathlib import Path
from typing import Any

import pikepdf
import pytest
from tests.base_seeds import slow
from tests.certificate.conftest import CHINESE, Laboratory, need_chinese
from tests.certificate.dcc_xml import etree
from tests.certificate.pdf_text import page_texts, squeezed

from inercal.basics.errors import InputError
from inercal.calibration.files import load
from inercal.laboratory.certificate.content import (
    LANGUAGES,
    CertificateChange,
    CertificateInput,
    Language,
    Texts,
    make_certificate,
    text_table,
)
from inercal.laboratory.certificate.issue import find_font, write_pdf_a1
from inercal.laboratory.certificate.job import read_job
from inercal.physics.sensors.coefficient_tables import TABLES
from inercal.runfile.job import read_laboratory

FOLDER = Path(__file__).parent
ITEMS: list[dict[str, Any]] = tomllib.loads(
    (FOLDER / "iso_17025.toml").read_text(encoding="utf-8")
)["item"]
ORDER = """[job]
deviations = "position 3 was omitted"
external = "temperature tests by Laboratory B"
opinions = "the bias agrees with that of a new sensor"
"""
NAMES = {"dcc": "https://ptb.de/dcc", "si": "https://ptb.de/si"}
JARS = ("pdfbox2", "fontbox2", "xmpbox", "preflight", "commons-logging", "commons-io",
        "javax.activation", "jaxb-api")  # fmt: skip


@pytest.fixture(scope="module")
def issued(example: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("issued") / "lab"
    laboratory = Laboratory(Path(shutil.copytree(example, folder)))
    job = folder / "job.toml"
    job.write_text(ORDER, encoding="utf-8")
    return laboratory.issue("--job", job, "--as-found", laboratory.calibration)


@pytest.mark.parametrize("item", ITEMS, ids=[one["clause"] for one in ITEMS])
def test_pages_and_dcc_have_each_item_of_the_standard(item: dict[str, Any], issued: Path):
    text = "".join(page_texts(issued))
    for one in item["pages"]:
        assert squeezed(one) in text, one
    root = etree.parse(issued.with_suffix(".xml")).getroot()
    for path, wanted in item["dcc"]:
        found = [one.text for one in root.iterfind(path, NAMES)]
        assert wanted in found if wanted else any(found), (path, found)


def test_every_page_has_number_and_pages_n_of_all(issued: Path):
    pages = page_texts(issued)
    assert len(pages) > 1
    for n, text in enumerate(pages, start=1):
        assert squeezed(f"Page {n} of {len(pages)}") in text
        assert "IL-2026-0001" in text
    assert squeezed("End of the certificate") in pages[-1]


def test_structure_is_that_of_pdf_a_3b(issued: Path):
    with pikepdf.open(issued) as document:
        assert document.open_metadata().pdfa_status == "3B"
        root = document.Root
        assert [str(one.S) for one in root.OutputIntents] == ["/GTS_PDFA1"]
        assert str(root.Lang) == "en"
        relations = {str(one.UF): str(one.AFRelationship) for one in root.AF}
        assert relations == {
            "IL-2026-0001.xml": "/Alternative",
            "IL-2026-0001.calibration.json": "/Data",
        }
        attached = document.attachments
        assert attached["IL-2026-0001.xml"].get_file().mime_type == "application/xml"
        dcc = attached["IL-2026-0001.xml"].get_file().read_bytes()
        assert dcc == issued.with_suffix(".xml").read_bytes()
        json = attached["IL-2026-0001.calibration.json"].get_file().read_bytes()
        for page in document.pages:
            for font in page.resources.Font.values():
                assert "/ToUnicode" in font
                (inner,) = font.DescendantFonts
                files = ("/FontFile", "/FontFile2", "/FontFile3")
                assert any(name in inner.FontDescriptor for name in files)
    copy = issued.with_name("attached.json")
    copy.write_bytes(json)
    assert load(copy).sensor.name == "accelerometer SN 0417"


@pytest.mark.slow
@pytest.mark.parametrize("language", ["en", slow("de"), slow("zh")])
def test_preflight_finds_the_pages_valid_as_a_1b(language: Language, example: Path, tmp_path: Path):
    jars = [Path(f"/usr/share/java/{name}.jar") for name in JARS]
    if shutil.which("java") is None or not all(jar.is_file() for jar in jars):
        pytest.skip("no Java with Debian's libpdfbox2-java, libactivation-java, libjaxb-api-java")
    if language == "zh":
        need_chinese()
    calibration = load(example / "run.calibration.json")
    given = CertificateInput(
        calibration,
        calibration,
        read_laboratory(example / "lab.toml"),
        read_job(calibration.job),
        language,
        date(2026, 11, 26),
        draft=True,
    )
    certificate = make_certificate(given, "", CertificateChange())
    copy = tmp_path / "a1b.pdf"
    copy.write_bytes(write_pdf_a1(certificate, find_font(language, None)))
    command = ["java", "-cp", ":".join(map(str, jars))]
    command += ["org.apache.pdfbox.preflight.Validator_A1b", str(copy)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert "is a valid PDF/A-1b file" in done.stdout, done.stdout + done.stderr


@pytest.mark.slow
def test_identical_input_gives_identical_bytes(laboratory: Laboratory, tmp_path: Path):
    first = laboratory.issue()
    laboratory.register = str(tmp_path / "other.db")
    second = laboratory.issue("--force", "--out", tmp_path)
    assert first.read_bytes() == second.read_bytes()
    assert first.with_suffix(".xml").read_bytes() == second.with_suffix(".xml").read_bytes()


@pytest.mark.slow
@pytest.mark.parametrize("language", [slow(x) if x == "zh" else x for x in LANGUAGES])
def test_each_language_prints_its_own_texts(language: Language, laboratory: Laboratory):
    if language == "zh":
        need_chinese()
    text = "".join(page_texts(laboratory.issue("--language", language)))
    texts = Texts(language)
    for key in ("title", "laboratory", "customer", "results", "uncertainty_covariance", "end"):
        assert squeezed(texts.text(key)) in text, key
    assert squeezed(texts.word("meaning", "scale-factor error")) in text
    root = etree.parse(laboratory.folder / "IL-2026-0001.xml").getroot()
    assert root.find(".//dcc:usedLangCodeISO639_1", NAMES).text == language


def test_every_text_is_in_every_language_with_the_same_fields():
    for section, entries in text_table().items():
        for key, entry in entries.items():
            assert set(entry) == set(LANGUAGES), (section, key)
            fields = {one: set(re.findall(r"\{(\w+)\}", text)) for one, text in entry.items()}
            assert fields["en"] == fields["de"] == fields["zh"], (section, key)


def test_every_meaning_of_a_coefficient_is_translated():
    known = text_table()["meaning"]
    assert {term.meaning for table in TABLES.values() for term in table} <= set(known)


def test_a_character_without_a_glyph_is_refused_by_name(laboratory: Laboratory):
    laboratory.change("C. F. Gauss", "高斯")
    ended = laboratory.run()
    assert ended.status == 2
    assert "U+9AD8" in ended.error
    assert "--font" in ended.error
    assert not Path(laboratory.register).exists()


@pytest.mark.slow
def test_a_font_prints_what_the_others_lack(laboratory: Laboratory):
    need_chinese()
    laboratory.change("C. F. Gauss", "高斯")
    assert "高斯" in "".join(page_texts(laboratory.issue("--font", CHINESE)))


def test_text_of_a_user_is_not_read_as_markup(laboratory: Laboratory):
    laboratory.change("C. F. Gauss", "#panic() *x* $y$ <z> & Söhne")
    text = "".join(page_texts(laboratory.issue()))
    assert squeezed("#panic() *x* $y$ <z> & Söhne") in text


def test_a_long_word_stays_on_the_page(laboratory: Laboratory):
    laboratory.change("C. F. Gauss", "G" * 300)
    laboratory.issue()  # typst refuses nothing; the word is broken where it would pass the margin


def test_no_chinese_font_is_refused_with_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(
        "inercal.laboratory.certificate.issue._CHINESE_FONTS", (Path("/nowhere/font.ttc"),)
    )
    with pytest.raises(InputError) as caught:
        find_font("zh", None)
    assert caught.value.key == "--font"
    assert "fonts-noto-cjk" in str(caught.value)
