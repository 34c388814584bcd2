"""What readings of ±1 g do not tell: nonlinearity that counts as bias and scale factor.

At +g and −g a term of second order adds k2 g² to both readings, which is a bias; asymmetry and a
term of third order add to them with the sign of f, which is a scale factor. Only readings across
gravity contradict, as far as the faces are known to lie level. A term is hidden where, at the size
that shifts a coefficient by five standard uncertainties, it is less visible than η = 6.
"""

import numpy as np

from inercal.estimate import Estimate
from inercal.sensors import Sensor

_TERMS = {
    "k2": "1 µg/g² of k2 counts as 1 µg of bias",
    "koq": "1 µg/g² of koq as 1 ppm of scale factor",
    "k3": "1 µg/g³ of k3 as 1 ppm of scale factor",
}
_SHIFT, _VISIBLE = 5.0, 6.0


def hidden(estimate: Estimate, sensor: Sensor) -> tuple[str, ...]:
    """Return a note of the terms that the positions leave hidden; none where nothing was scored.

    Parameters
    ----------
    estimate : Estimate
        With its score tests.
    sensor : Sensor
        With the coefficients that were estimated.
    """
    axes = [axis.name for axis in sensor.axes if axis.measures == "f"]
    scores = {score.name: score for score in estimate.scored.scores}
    if not scores or not axes:
        return ()
    p = len(sensor.coefficients)
    u = estimate.std[:p]
    found: list[str] = []
    for term in _TERMS:
        for axis in axes:
            score = scores.get(f"{axis}.{term}")
            if f"{axis}.{term}" in sensor.coefficients:
                continue
            if score is None or not score.dof or not score.size[0]:
                found.append(term)
                break
            # The shift that a size of one standard deviation causes is seen with η = 1.
            moved = np.abs(score.shift[:p] / score.size[0] * score.sd[0]) / u
            if _VISIBLE * float(moved.max()) > _SHIFT:
                found.append(term)
                break
    if not found:
        return ()
    counted = ", ".join(_TERMS[term] for term in found)
    return (
        f"{', '.join(found)} of the accelerometers cannot be told from bias and scale factor by "
        f"these positions: {counted}; the uncertainties do not hold it",
    )
