"""How many more sessions a statement needs, and of which kind.

With λ = s²/σ² the variance of a session's own error over that of the scatter, and ν = m (n − 1) for
m like axes and n sessions, the relative standard deviation of the estimated σ is (1 + λ)/√(2ν).
"""

from math import ceil

import numpy as np

from inercal.laboratory.repeatability.repeated_sessions import Repeatability, ScatterComponent

RELATIVE = 0.3  # standard deviation of σ that is aimed at
_PLURAL = {"session": "sessions", "day": "days", "turn-on": "turn-ons", "mount": "mountings"}
_LONGEST = 4.0  # λ beyond which longer sessions help more than further ones


def required_sessions(noise_ratio: float, similar: int, relative: float = RELATIVE) -> int:
    """Return how many sessions give a relative standard deviation of σ.

    Parameters
    ----------
    noise_ratio : float
        λ.
    similar : int
        m.

    Examples
    --------
    >>> [required_sessions(x, similar=1) for x in (0.0, 0.25, 1.0)]
    [7, 10, 24]
    >>> [required_sessions(x, similar=3) for x in (0.0, 0.25, 1.0)]
    [3, 4, 9]
    """
    return 1 + ceil((1 + noise_ratio) ** 2 / (2 * relative**2 * similar) - 1e-9)


def noise_ratio(found: Repeatability, one: ScatterComponent) -> float:
    """Return λ of a component; infinite where no scatter was found."""
    places = list(one.effect.places)
    own = np.diagonal(found.matched.own, axis1=1, axis2=2)[:, places].mean()
    shape = one.effect.effect.shape[places]
    scatter = one.sd**2 * float(np.sum(shape**2)) / len(places)
    return float(own / scatter) if scatter > 0 else float("inf")


def advice_lines(found: Repeatability) -> list[str]:
    """Return what would make the scatter better known."""
    lines: list[str] = []
    for number, one in enumerate(found.components):
        if number in found.fit.unseen:
            continue  # a finding names it
        ratio, what = noise_ratio(found, one), f"{one.effect.name} ({one.effect.level})"
        if one.sd == 0:
            lines.append(f"{what}: the sessions scatter no more than their uncertainties explain")
        elif ratio > _LONGEST:
            lines.append(f"{what}: longer sessions show it better than further ones do")
        elif (needed := required_sessions(ratio, one.effect.similar)) > one.effect.effect.levels:
            lines.append(
                f"{what}: a standard deviation within {100 * RELATIVE:.0f} % takes {needed} "
                f"{_PLURAL[one.effect.level]}; there are {one.effect.effect.levels}"
            )
    return lines
