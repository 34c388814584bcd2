"""What is made of a run when all is done: recording, calibration, report, and their digests."""

from collections.abc import Callable, Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from inercal.calibration.files import save
from inercal.host.addresses import layout_of_address
from inercal.host.folder import Folder
from inercal.host.journal import Journal
from inercal.host.live import Live
from inercal.host.log import digest
from inercal.host.record import write
from inercal.pipeline import Outcome, calibrate
from inercal.report import write_report

if TYPE_CHECKING:
    from inercal.store import History


class Finished(NamedTuple):
    """The outcome, and the files of the run by what they are."""

    outcome: Outcome
    files: dict[str, str]


def finish(
    folder: Folder,
    journal: Journal,
    live: Live | None = None,
    keep: "Callable[[], History | None]" = lambda: None,
    truth: Callable[[Outcome], Mapping[str, float]] | None = None,
) -> Finished:
    """Write recording, calibration and report of a run that is done, and keep their digests.

    Parameters
    ----------
    folder : Folder
    journal : Journal
    live : Live, optional
        Its values are compared with those of the recording, and the journal says how they agree.
    keep : callable, optional
        Called when the calibration is written: it gives the sensor's history for the report.
    truth : callable, optional
        Returns the true coefficients, SI, for the report; those of the run file where left out.

    Raises
    ------
    InercalError
        The recording cannot be used: it stands all the same, and so does the log.
    """
    run = folder.run
    was = journal.header()
    about = {"table": was.table, "imu": was.imu, "begun": was.begun, "inercal": version("inercal")}
    # The log may be gigabytes: it is read for its digest once.
    came = digest(folder.log)
    layout = layout_of_address(was.imu)
    recording = write(run, layout, folder.log, folder.path, about, was.poll, came)
    files = {"run_file": run.path, "log": folder.log, "recording": recording}
    _keep(journal, folder.log, came)
    _keep(journal, run.path)
    _keep(journal, recording)
    outcome = calibrate(run)
    if live is not None and live.begun:
        _compare(journal, live, outcome)
    files["calibration_file"] = save(outcome.calibration, folder.made("calibration.json"))
    report = folder.made("report.html")
    true = run.truth if truth is None else truth(outcome)
    files["report"] = write_report(outcome, report, true or None, keep())
    _keep(journal, files["calibration_file"])
    _keep(journal, files["report"])
    journal.put_state("done")
    named = {kind: str(path) for kind, path in files.items()}
    return Finished(outcome, named | {"journal": str(folder.journal)})


def _keep(journal: Journal, path: Path, sha256: str | None = None) -> None:
    """Keep the size and the digest of a file, which is read for it unless it is given."""
    journal.file(path.name, path.stat().st_size, sha256 or digest(path))


def _compare(journal: Journal, live: Live, outcome: Outcome) -> None:
    """Keep how what was found while it ran agrees with what the recording gives."""
    names = outcome.estimate.names
    found = np.array([outcome.estimate.value[names.index(name)] for name in live.names])
    known = np.isfinite(live.values)
    apart = float(np.max(np.abs(live.values - found)[known], initial=0.0))
    words = (
        "what was found live is what the recording gives, to the last bit"
        if apart == 0
        else f"what was found live and what the recording gives are apart by up to {apart:.2g} (SI)"
    )
    journal.event("info" if apart == 0 else "warning", words)
