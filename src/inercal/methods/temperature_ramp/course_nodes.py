"""The course of a coarse thermometer as a spline whose nodes are estimated.

R(t) is a natural cubic spline through the crossings, both ends of the recording, and free points
between crossings. It is linear in the values of its nodes, so its means over blocks are too. Each
node has a value with a standard uncertainty: the free points that of the monotone cubic through
crossings and ends.
"""

from dataclasses import dataclass

import numpy as np
import scipy.interpolate  # pyright: ignore[reportMissingTypeStubs]

from inercal.basics.arrays import Array
from inercal.methods.temperature_ramp.thermometer_steps import Crossings

_FREE, _FREE_AT_ENDS = 0.2, 0.4  # spacings of the crossings: standard uncertainty of a free point
_MOST_FREE_POINTS = 8  # in one interval
_LONG = 4.0  # times a neighbour: an inner interval with several free points


@dataclass(frozen=True, eq=False)
class CourseNodes:
    """The k nodes of a thermometer's course.

    Parameters
    ----------
    crossings : Crossings
        What they were found from.
    time : (k,) array
        s, rising.
    kelvin, sd : (k,) arrays
        Values before the fit and their standard uncertainties, K.
    """

    crossings: Crossings
    time: Array
    kelvin: Array
    sd: Array

    def means(self, edges: Array) -> tuple[Array, Array]:
        """Return the means over b blocks of R and dR/dt per value of a node, (b, k) each.

        Parameters
        ----------
        edges : (b + 1,) array
            Ends of the blocks, s.
        """
        spline = scipy.interpolate.CubicSpline(self.time, np.eye(self.time.size), bc_type="natural")
        seconds = np.diff(edges)[:, None]
        values: Array = np.asarray(spline(edges), dtype=np.float64)
        integral: Array = np.asarray(spline.antiderivative()(edges), dtype=np.float64)
        return np.diff(integral, axis=0) / seconds, np.diff(values, axis=0) / seconds


def course_nodes(crossings: Crossings, ends: tuple[float, float], first: float, last: float):
    """Return the nodes of a course.

    Parameters
    ----------
    crossings : Crossings
        Two or more.
    ends : (float, float)
        Begin and end of the recording, s.
    first, last : float
        Readings there, K.

    Returns
    -------
    CourseNodes
    """
    step = crossings.step
    fixed = np.array([ends[0], *crossings.time, ends[1]])
    values = np.array([first, *crossings.kelvin, last])
    sd = np.hypot(
        np.array([step / np.sqrt(12), *crossings.sd, step / np.sqrt(12)]),
        np.array([crossings.noise, *np.zeros(crossings.time.size), crossings.noise]),
    )
    length = np.diff(fixed)
    free: list[float] = []
    width: list[float] = []
    beyond: list[float] = []
    for k, one in enumerate(length.tolist()):
        at_end = k in (0, length.size - 1)
        # Between two crossings of one boundary the course turns, anywhere short of the next one.
        turns = not at_end and values[k] == values[k + 1]
        turn = 0.5 * crossings.spacing * float(np.sign(values[k] - values[k - 1])) if turns else 0.0
        neighbours = [float(length[n]) for n in (k - 1, k + 1) if 0 <= n < length.size]
        ratio = one / min(neighbours)
        many = ratio if at_end or ratio > _LONG else 1.0
        count = int(np.clip(round(many), 1, _MOST_FREE_POINTS))
        free += (fixed[k] + one * (np.arange(count) + 1) / (count + 1)).tolist()
        wide = _FREE_AT_ENDS if at_end or turns else _FREE
        width += [crossings.spacing * wide] * count
        beyond += [turn] * count
    between = scipy.interpolate.PchipInterpolator(fixed, values)(np.array(free)) + np.array(beyond)
    order = np.argsort(np.concatenate([fixed, free]))

    def ordered(*parts: Array | list[float]) -> Array:
        return np.concatenate(parts)[order]

    return CourseNodes(
        crossings, ordered(fixed, free), ordered(values, between), ordered(sd, width)
    )
