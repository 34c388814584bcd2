"""The templates of pages; each extends `base.html`, which holds the head and the look of all."""

from functools import cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from inercal.physics.glossary import Term, find_term, glossary

_PACKAGE = "inercal.report"


def render(template: str, package: str = _PACKAGE, **values: Any) -> str:
    """Return a template filled in, HTML; values are escaped but for those that are `Markup`.

    Parameters
    ----------
    template : str
        Name of a file in `package`; what it extends or includes may lie here.
    package : str
    **values
        What the template names. It has besides `term`, a function that links a word to its
        definition, and `terms`, what was linked so far: `base.html` lists them at the end.
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
    """Return the page of the terms, which the live page links to, HTML."""
    return render("glossary.html", groups=glossary())


@cache
def _environment(package: str) -> Environment:
    return Environment(
        loader=ChoiceLoader([PackageLoader(package, "."), PackageLoader(_PACKAGE, ".")]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
