"""Calibrate a batch of sensors in a worker, which continues if a sensor fails."""

import re
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import partial
from hashlib import sha256
from itertools import accumulate, compress
from pathlib import Path
from time import perf_counter, process_time
from typing import TYPE_CHECKING, Any

from inercal.basics.errors import InercalError
from inercal.basics.parallel.executor import begin_step
from inercal.basics.process_settings import with_one_thread
from inercal.fleet import results
from inercal.fleet.inputs import INSTALLED, Version, is_address, local_copy
from inercal.fleet.line import GROUPS, Line, SensorRow
from inercal.recordings.io.column_table import file_sha256

if TYPE_CHECKING:
    from inercal.pipeline import Outcome
    from inercal.runfile import Run

_MOST_TOGETHER, _MOST_BYTES = 50, 1 << 25  # sensors solved together, and their recordings' sizes
_AROUND, _DISTINCT = 32, 16  # samples on each side, and different ones: no two sensors share them
_ONE_LINE = 500  # largest number of characters of an error message


@dataclass(frozen=True)
class Work:
    """A sensor to calibrate.

    Parameters
    ----------
    row : SensorRow
    digest : str
        Hash of the sensor's run file (`Line.digest`).
    version : Version
        Version of the sensor's recording, by size and time.
    arrived : bool
        Whether the recording arrived at a station.
    """

    row: SensorRow
    digest: str
    version: Version
    arrived: bool = False


@dataclass(frozen=True)
class BatchDone:
    """The counts that a worker returns for a batch, without any coefficients.

    Parameters
    ----------
    done, failed : int
        Number of sensors that were calibrated, and number of sensors that failed.
    seconds : tuple of float
        Wall time of each sensor.
    """

    done: int
    failed: int
    seconds: tuple[float, ...]


def compute_batch(line: Line, out: results.ResultWriter, work: Sequence[Work]) -> BatchDone:
    """Calibrate a batch of sensors and write their rows as one part.

    Each sensor is a step of the task.

    Parameters
    ----------
    line : Line
        The production line; its rows are not needed.
    out : ResultWriter
        Writer for the results.
    work : sequence of Work

    Raises
    ------
    InputError
        The part cannot be written.
    """
    rows: list[dict[str, Any]] = []
    times: list[float] = []
    while len(rows) < len(work):
        begun, some = perf_counter(), _next_sensors(work[len(rows) :])
        found = _rows_together(line, some, len(rows))
        rows += found
        times += [(perf_counter() - begun) / len(found)] * len(found)
    out.write(rows)
    done = sum(row["status"] == results.DONE for row in rows)
    return BatchDone(done, len(rows) - done, tuple(times))


def _next_sensors(work: Sequence[Work]) -> Sequence[Work]:
    """Return the next sensors whose recordings may be in memory together; at least one."""
    sizes = accumulate(one.version.size for one in work[:_MOST_TOGETHER])
    return work[: max(1, sum(size <= _MOST_BYTES for size in sizes))]


@with_one_thread
def _rows_together(line: Line, work: Sequence[Work], first: int) -> list[dict[str, Any]]:
    """Calibrate sensors together and return their rows; `first` is the step of the first one."""
    from inercal.pipeline.similar_runs import calibrate_similar

    def run(number: int, one: Work) -> "Run":
        begin_step(number)
        return line.run(one.row, one.digest)

    begin = process_time()
    local = [not is_address(one.row.recording) for one in work]
    numbered = list(enumerate(work, first))
    outcomes = calibrate_similar([partial(run, *one) for one in compress(numbered, local)])
    rows: list[dict[str, Any]] = []
    for (number, one), is_local in zip(numbered, local, strict=True):
        begin_step(number)  # again, because the tests of a sensor may need further fits
        rows.append(
            _row(line, one, partial(next, outcomes) if is_local else partial(_calibrate, line, one))
        )
    used = (process_time() - begin) / len(rows)
    return [row | {"seconds": used} if row["status"] == results.DONE else row for row in rows]


def result_row(line: Line, work: Work) -> dict[str, Any]:
    """Calibrate a sensor and return its row, even if the calibration fails."""
    begin = process_time()
    row = _row(line, work, partial(_calibrate, line, work))
    return row | {"seconds": process_time() - begin} if row["status"] == results.DONE else row


def _row(line: Line, work: Work, settle: "Callable[[], Outcome | Exception]") -> dict[str, Any]:
    """Return the row of a sensor from a function that calibrates it or returns its error."""
    try:
        outcome = settle()
        if isinstance(outcome, Exception):
            raise outcome
        found, recording = _columns(outcome)
    except Exception as error:  # any error, because only this sensor is affected
        text = " ".join(str(error).split()) or type(error).__name__
        shared, name = f"{line.path}: ", Path(work.row.recording).name
        if isinstance(error, InercalError) and not error.key and text.startswith(shared):
            # All sensors share the template, so an error that names no key is in the recording.
            text = text.removeprefix(shared)
            if not text.startswith(name):
                text = f"{work.row.recording}: {text}"
        if text.startswith(name):
            text = f"{work.row.recording}{text.removeprefix(name)}"
        kept = "" if isinstance(error, InercalError) else traceback.format_exc()
        return failed_row(line.folder, work, text, type(error).__name__, kept)
    return _common(work, recording) | found | {"status": results.DONE}


def failed_row(
    folder: Path,
    work: Work,
    error: str,
    error_type: str,
    trace: str = "",
    status: str = results.FAILED,
) -> dict[str, Any]:
    """Return the row for a sensor without a result."""
    digest = ""
    if not is_address(work.row.recording):
        with suppress(OSError):  # the error already states this
            digest = file_sha256(folder / work.row.recording)
    # The message is one line, without the folder, because all sensors have the same folder.
    text = re.sub(rf"(?<![\w/.]){re.escape(f'{folder}/')}", "", error)[:_ONE_LINE]
    found = {"status": status, "error": text, "error_type": error_type, "traceback": trace}
    return _common(work, digest) | found


def _common(work: Work, recording_sha256: str) -> dict[str, Any]:
    columns = dict(work.row.columns)
    named = {name: columns.pop(name, None) for name in GROUPS}
    return {
        "key": results.row_key(recording_sha256, work.digest, INSTALLED),
        "id": work.row.id,
        "recording": work.row.recording,
        **named,
        "table": list(columns.items()),
        "recording_sha256": recording_sha256,
        "sections_sha256": work.digest,
        "inercal": INSTALLED,
        "size": work.version.size,
        "mark": work.version.mark,
        "created": datetime.now(UTC).isoformat(timespec="microseconds"),
        "arrived": work.arrived,
    }


def _calibrate(line: Line, work: Work) -> "Outcome":
    """Calibrate a sensor by itself; its recording may be in a store."""
    # Methods and kernels are loaded in the worker, not in the process that distributes the work.
    from inercal.pipeline import calibrate

    address, run = work.row.recording, line.run(work.row, work.digest)
    if not is_address(address):
        return calibrate(run)
    with local_copy(address) as copy:
        run = replace(run, data=run.data.model_copy(update={"file": str(copy)}))
        try:
            outcome = calibrate(run)
        except InercalError as error:
            error.args = (str(error).replace(str(copy), address), *error.args[1:])
            raise
    provenance = {**outcome.calibration.provenance, "recording": address}
    return replace(outcome, calibration=replace(outcome.calibration, provenance=provenance))


def _fingerprints(outcome: "Outcome") -> Iterator[str]:
    """Yield hashes of all means, and of the readings around the largest one in each section.

    A copy with other times, cut ends or shifted sections has some of these hashes. Readings that
    hardly vary have none, because two sensors may have the same ones.
    """
    yield sha256(outcome.observations.mean.tobytes()).hexdigest()[:16]
    if outcome.recording is None:
        return
    data = outcome.recording.data
    for mark in outcome.marks:
        k = mark.start + int(data[mark.start : mark.stop, 0].argmax())
        rows: list[bytes] = [row.tobytes() for row in data[max(k - _AROUND, 0) : k + _AROUND]]
        if len(set(rows)) >= _DISTINCT:
            yield sha256(b"".join(rows)).hexdigest()[:16]


def _columns(outcome: "Outcome") -> tuple[dict[str, Any], str]:
    """Return the columns of a result and the hash of the recording."""
    from inercal.calibration.files import calibration_text

    calibration, estimate = outcome.calibration, outcome.estimate
    judged = None if outcome.verdict.grade == "unreliable" else calibration.conformity
    found: dict[str, Any] = {
        "method": calibration.method,
        "estimator": calibration.estimator,
        "grade": outcome.verdict.grade,
        "verdict": "\n".join(outcome.verdict.lines),
        "conformity": None if judged is None else judged.result,
        "beyond": None if judged is None else " ".join(judged.beyond),
        "chi2": float(estimate.chi2),
        "dof": float(estimate.dof),
        "birge": float(estimate.birge),
        "coefficients": " ".join(calibration.sensor.coefficients),
        "value": calibration.values.tolist(),
        "std": calibration.std.tolist(),
        "covariance": results.lower_triangle(calibration.covariance),
        "calibration": calibration_text(calibration),
        "readings": list(_fingerprints(outcome)),
    }
    return found, calibration.provenance["recording sha256"]
