"""Find the font of a certificate: a font that comes with typst, or a font file for Chinese."""

import shutil
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path

from inercal.basics.errors import InputError
from inercal.laboratory.certificate.libraries import certificate_library
from inercal.laboratory.certificate.texts import Language

OWN_FONT = "Libertinus Serif"  # included in typst
_CHINESE_FONTS = tuple(
    Path("/usr/share/fonts/opentype/noto") / name
    for name in ("NotoSerifCJK-Regular.ttc", "NotoSansCJK-Regular.ttc")
)  # from Debian's fonts-noto-cjk


def find_font(language: Language, font: Path | None) -> Path | None:
    """Return the font file that a language needs, or None if typst's own fonts are enough.

    Raises
    ------
    InputError
        If the text is Chinese but no Chinese font is given or installed, or if the file does not
        exist.
    """
    if font is not None:
        if not font.is_file():
            raise InputError(f"--font {font}: there is no such file; check the path", key="--font")
        return font
    if language != "zh":
        return None
    for path in _CHINESE_FONTS:
        if path.is_file():
            return path
    raise InputError(
        "a Chinese certificate needs a font with Chinese characters: install Debian's "
        f"fonts-noto-cjk ({_CHINESE_FONTS[0]}), or give a font file with --font",
        key="--font",
    )


@contextmanager
def font_families(font: Path | None) -> Generator[tuple[list[str], list[str]]]:
    """Yield the font families for the text, and the folders where typst finds them.

    Raises
    ------
    InputError
        If the file is not a font.
    """
    if font is None:
        yield [OWN_FONT], []
        return
    with tempfile.TemporaryDirectory() as folder:
        # typst accepts only folders. This folder contains only the font file, and no other fonts.
        for file in {font, font.with_name(font.name.replace("Regular", "Bold"))}:
            if file.is_file():
                shutil.copy(file, folder)
        typst = certificate_library("typst")
        found: list[str] = typst.Fonts(
            include_system_fonts=False, include_embedded_fonts=False, font_paths=[folder]
        ).families()
        if not found:
            raise InputError(
                f"--font {font} is not a font; give a .ttf, .otf or .ttc file", key="--font"
            )
        # If the file is a collection for several regions, the simplified characters are used.
        simplified = [name for name in found if name.endswith(" SC") and "Mono" not in name]
        yield [OWN_FONT, (simplified or found)[0]], [folder]
