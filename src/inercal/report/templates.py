"""Render page templates; they all extend `base.html`, which contains head and style."""

import os
from contextlib import suppress
from functools import cache
from typing import Any

from jinja2 import (
    ChoiceLoader,
    Environment,
    FileSystemBytecodeCache,
    PackageLoader,
    StrictUndefined,
)
from jinja2.bccache import Bucket
from markupsafe import Markup

from inercal.physics.glossary import Term, find_term, glossary

_PACKAGE = "inercal.report"
_COMPILED = os.path.join(os.path.dirname(__file__), "__pycache__")


def render(template: str, package: str = _PACKAGE, **values: Any) -> str:
    """Fill in a template and return HTML; values that are not `Markup` are escaped.

    Parameters
    ----------
    template : str
        Name of a file in `package`. It may extend or include files in this package.
    package : str
    **values
        Variables of the template. In addition, the template can call `term`, which links a word to
        its definition. `terms` contains the terms linked so far, and `base.html` lists them at the
        end of the page.
    """
    terms: dict[str, Term] = {}

    def link(shown: str, name: str = "") -> Markup:
        term = find_term(name or shown)
        terms[term.name] = term
        return Markup('<a class="term" href="#term-{}" title="{}">{}</a>').format(
            term.anchor, term.text, shown
        )

    return _environment(package).get_template(template).render(values, term=link, terms=terms)


def glossary_page() -> str:
    """Return the glossary as an HTML page; the live page links to this page."""
    return render("glossary.html", groups=glossary())


class _CompiledTemplates(FileSystemBytecodeCache):
    """Compiled templates that all users may read who may read their folder."""

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Store a template; a page needs no stored template, so a full disk is no error."""
        with suppress(OSError):
            super().dump_bytecode(bucket)
            file = os.path.join(self.directory, self.pattern % bucket.key)
            # Jinja writes files that only their owner can read.
            os.chmod(file, os.stat(self.directory).st_mode & 0o666)


@cache
def _environment(package: str) -> Environment:
    # Compiling the template of a report takes about as long as drawing one of its figures.
    keep = os.access(_COMPILED, os.W_OK | os.X_OK)
    return Environment(
        bytecode_cache=_CompiledTemplates(_COMPILED) if keep else None,
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader(_PACKAGE, ".")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
