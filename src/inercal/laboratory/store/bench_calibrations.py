"""The calibrations that were made on one bench, of all sensors."""

from collections.abc import Sequence

from inercal.basics.errors import InputError
from inercal.laboratory.store.entries import CalibrationEntry
from inercal.laboratory.store.history import latest_per_recording

_MOST_NAMED = 8


def calibrations_of_bench(
    entries: Sequence[CalibrationEntry], word: str
) -> tuple[CalibrationEntry, ...]:
    """Return the calibrations on a bench, the last entered of each recording, in their order.

    Parameters
    ----------
    entries : sequence of CalibrationEntry
        Of a register.
    word : str
        Name of the bench, or the kind of one without a name.

    Raises
    ------
    InputError
        No such bench, or benches of several kinds with that name.
    """
    found = [one for one in entries if word == (one.bench or one.kind)]
    kinds = sorted({one.kind for one in found})
    if not found:
        known = sorted({one.bench or one.kind for one in entries} - {""})
        listed = ", ".join(map(repr, known[:_MOST_NAMED])) + ", …" * (len(known) > _MOST_NAMED)
        raise InputError(
            f"--bench {word!r}: no calibration on it in the register; "
            + (f"it has {listed}" if known else "it has none with a bench"),
            key="--bench",
            names=(word,),
        )
    if len(kinds) > 1:
        raise InputError(
            f"--bench {word!r}: benches of {len(kinds)} kinds have this name, {', '.join(kinds)}; "
            "give each its own [bench] name",
            key="--bench",
            names=(word,),
        )
    return tuple(latest_per_recording(found)[0])
