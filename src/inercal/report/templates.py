"""The templates of pages; each extends `base.html`, which holds the head and the look of all."""

from functools import cache
from typing import Any

from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

_PACKAGES = ("inercal.report", "inercal.studies")  # where templates and style sheets lie


def render(template: str, **values: Any) -> str:
    """Return a template filled in, HTML; values are escaped but for those that are `Markup`."""
    return _environment().get_template(template).render(values)


@cache
def _environment() -> Environment:
    return Environment(
        loader=ChoiceLoader([PackageLoader(package, ".") for package in _PACKAGES]),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
