"""Whether a calibration was kept though what it came from has changed: its provenance says why."""

from dataclasses import replace

from inercal.calibration import Calibration

OUTDATED = "outdated"
"""The key of `Calibration.provenance`."""


def marked_as_outdated(calibration: Calibration, reason: str) -> Calibration:
    """Return a calibration whose provenance says why another one may be due; itself without reason.

    Parameters
    ----------
    calibration : Calibration
    reason : str
        In words; empty where there is none.
    """
    if not reason:
        return calibration
    return replace(calibration, provenance={**calibration.provenance, OUTDATED: reason})
