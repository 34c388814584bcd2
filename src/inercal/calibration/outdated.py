"""Mark a calibration as outdated if its inputs have changed since it was made."""

from dataclasses import replace

from inercal.calibration import Calibration

OUTDATED = "outdated"
"""Key in `Calibration.provenance`; its text states the reason."""


def marked_as_outdated(calibration: Calibration, reason: str) -> Calibration:
    """Return the calibration with a note in its provenance that says why a new one may be needed.

    Parameters
    ----------
    calibration : Calibration
    reason : str
        Reason in words. If it is empty, the calibration is returned unchanged.
    """
    if not reason:
        return calibration
    return replace(calibration, provenance={**calibration.provenance, OUTDATED: reason})
