"""Sessions of a simulated laboratory as those of a check standard, a day each or several."""

from dataclasses import replace
from datetime import date, timedelta

import numpy as np
from numpy.typing import NDArray
from tests.repeatability.laboratory import Laboratory, draw
from tests.repeatability.sessions import sessions_of

from inercal.laboratory.check_standard import CheckedSession

BEGIN = date(2026, 1, 1)


def day(number: int) -> str:
    """Return the day of a number, ISO 8601."""
    return (BEGIN + timedelta(days=number)).isoformat()


def checked_sessions(
    laboratory: Laboratory,
    days: int,
    rng: np.random.Generator,
    *,
    each: int = 1,
    shift: NDArray[np.float64] | float = 0.0,
    shifted: tuple[int, int] = (10**9, 10**9),
    stated: bool = True,
) -> list[CheckedSession]:
    """Return sessions; those of days from shifted[0] and before shifted[1] read `shift` more."""
    of_day = np.repeat(np.arange(days), each)
    drawn = draw(laboratory, len(of_day), rng, of_day)
    moved = (of_day >= shifted[0]) & (of_day < shifted[1])
    values = drawn.values + moved[:, None] * shift
    found = sessions_of(replace(drawn, values=values), of_day, stated=stated)
    return [
        CheckedSession(one, f"{day(int(at))}T08:00:00")
        for one, at in zip(found, of_day, strict=True)
    ]
