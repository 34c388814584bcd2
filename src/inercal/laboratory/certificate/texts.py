"""Read the texts of a certificate in English, German and Chinese from the table `texts.toml`."""

import tomllib
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, Literal, get_args

Language = Literal["en", "de", "zh"]
LANGUAGES: tuple[Language, ...] = get_args(Language)


@dataclass(frozen=True)
class Texts:
    """The texts of a certificate in one language."""

    language: Language

    def text(self, key: str, **fields: object) -> str:
        """Return a text with its fields filled in."""
        return str(text_table()["text"][key][self.language]).format(**fields)

    def word(self, section: str, key: str) -> str:
        """Return the translation of a word that inercal uses; an unknown word is not changed."""
        entry = text_table()[section].get(key)
        return key if entry is None else str(entry[self.language])


@lru_cache(maxsize=1)
def text_table() -> dict[str, dict[str, Any]]:
    """Return all texts, by section, key and language."""
    source = files("inercal.laboratory.certificate").joinpath("texts.toml")
    return tomllib.loads(source.read_text(encoding="utf-8"))
