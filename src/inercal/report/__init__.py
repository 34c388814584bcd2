"""The report of a calibration: one HTML page that needs nothing but itself.

Figures are SVG inside the page, whose colours follow the reader's light or dark scheme.
"""

from collections.abc import Mapping
from pathlib import Path

from inercal.errors import InputError
from inercal.io.atomic import atomic_write
from inercal.pipeline import Outcome


def write_report(
    outcome: Outcome, path: str | Path, truth: Mapping[str, float] | None = None
) -> Path:
    """Write the report; the file appears whole or not at all. Return its path.

    Parameters
    ----------
    outcome : Outcome
    path : path
    truth : mapping of str to float, optional
        Of a simulation: coefficients in SI by full name; those missing are zero.

    Raises
    ------
    InputError
        matplotlib or jinja2 is missing, or the file cannot be written.
    """
    try:
        from inercal.report.page import page
    except ImportError as error:
        # A broken module of this package is no missing extra.
        if (error.name or "").partition(".")[0] not in ("matplotlib", "jinja2", "markupsafe"):
            raise
        raise InputError(
            "reports need matplotlib and jinja2: pip install 'inercal[report]'"
        ) from error
    text = page(outcome, truth)
    with atomic_write(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return Path(path)


__all__ = ["write_report"]
