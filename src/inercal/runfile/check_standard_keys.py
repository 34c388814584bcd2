"""[bench] check_standard and check_standard_age of a run file: whether the bench was in control."""

from pathlib import Path

from inercal.basics.errors import InputError
from inercal.physics.section_settings import BenchSection, key_error, si_value
from inercal.recordings import Finding
from inercal.runfile.job import JobSection

_KEY, _AGE = "[bench] check_standard", "[bench] check_standard_age"


def stated_check_standard(
    section: BenchSection, job: JobSection | None, folder: Path
) -> tuple[str, tuple[Finding, ...]]:
    """Return the state of the check standard in words, and warnings where the run is doubtful.

    Parameters
    ----------
    section : section of [bench]
    job : JobSection or None
        With the date of the run.
    folder : Path
        Of the run file.

    Raises
    ------
    InputError
        A file that `inercal control` did not write, an age that is not positive, or one without a
        check standard or a date of the run.
    """
    if section.check_standard is None:
        if section.check_standard_age is not None:
            raise key_error(_AGE, "needs check_standard; state the file of inercal control")
        return "", ()
    # Here, for few run files name one.
    from inercal.calibration.check_standard import CHECK_STANDARD, load_check_standard

    longest = None
    if section.check_standard_age is not None:
        longest = si_value(section.check_standard_age, "s", _AGE)
        if longest < 0:
            raise key_error(_AGE, f"{section.check_standard_age!r} is negative")
    try:
        found = load_check_standard(folder / section.check_standard)
    except InputError as error:
        raise error.located(_KEY, key=_KEY) from None
    try:
        state = found.state(None if job is None else job.last_day, longest)
    except InputError as error:
        raise error.located(_AGE, key=_AGE) from None
    findings = tuple(Finding("warning", CHECK_STANDARD, one) for one in state.warnings)
    return state.text, findings
