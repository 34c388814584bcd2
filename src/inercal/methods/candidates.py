"""List candidates for score tests: errors that a problem of means omits or treats as known.

The candidates come from an extended problem. This problem uses the same observations, and every
coefficient in the sensor's table and every declared parameter of the bench is free. The Jacobian of
the extended problem at the solution contains an exact column for each candidate. Coefficients that
were not estimated are zero at the solution. Bench parameters that were estimated with a prior are
also candidates. Their columns are used without the prior, so the test can find an error far larger
than the stated deviation.

Single rows with arbitrary readings are further candidates, and so is a drift of the biases that is
linear in time over the run.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array, Bools
from inercal.basics.keys import PRIOR_OF, CoefficientName, ErrorName, ObservationName
from inercal.basics.parameters import Parameter
from inercal.estimation import Candidate, Problem
from inercal.estimation.scores import CandidateKind, of_all_trials
from inercal.methods import Priors
from inercal.physics.quantities import QUANTITIES
from inercal.physics.sensors import G0, SI_UNITS, Sensor
from inercal.physics.sensors.coefficient_tables import LARGEST_RELATIVE_SIZE, TABLES, ErrorTerm

# Parameters in these scopes affect many rows; a parameter of one position only affects its own
# rows.
_SHARED_SCOPES = ("run", "speed", "mounting", "pass")
# SI per SI unit: the rounding error of an effect that cancels over whole turns
_ROUNDING_LIMIT = 1e-12
# rad: somebody may mistake north for south or east; harmonics of an encoder are always small.
# Readings of an autocollimator may be in mrad instead of ″.
# A steel arm of 1 m stretches by about 1e-8 per m/s².
_LARGEST_ANGLES = {
    "azimuth": np.pi,
    "latitude": np.pi / 2,
    "autocollimator scale": 300.0,
    "stretch": 1e-6,
}
_LARGEST_HARMONIC = 0.01
_NATURAL_SIZES = {"m/s²": G0, "(m/s²)⁻¹": 1 / G0}


Columns = Mapping[str, Array]
"""The derivative of the observations, (m,) or (trials, m), with respect to each parameter."""
Families = Mapping[str, Sequence[str]]
"""The parameters that are also tested together, by the name of the joint candidate."""


class Column(NamedTuple):
    """One component of a candidate: full name, SI unit and derivative of the observations, (m,).

    `largest` and `stated_sd` are as for `Candidate`; either all columns of a candidate have them,
    or none.
    """

    name: str
    unit: str
    rows: Array
    largest: float | None = None
    stated_sd: float | None = None


def coefficient_column(sensor: Sensor, full: str, rows: Array) -> Column:
    """Return the column of a sensor coefficient, given its full name."""
    line = sensor.coefficient(full)
    return Column(full, SI_UNITS[line.unit], rows, line.largest)


def candidate(name: str, kind: CandidateKind, columns: Sequence[Column]) -> Candidate:
    """Return a candidate that consists of these columns."""
    names, units, rows, largest, sds = zip(*columns, strict=True)
    return Candidate(
        name,
        kind,
        names,
        units,
        np.stack(rows, axis=-1),
        largest=None if largest[0] is None else np.array(largest),
        stated_sds=None if sds[0] is None else np.array(sds),
    )


def together_and_alone(
    kind: CandidateKind, families: Iterable[tuple[str, Sequence[Column]]]
) -> list[Candidate]:
    """Return each family of two or more columns as one candidate, then each column separately."""
    families = list(families)
    together = [candidate(name, kind, own) for name, own in families if len(own) > 1]
    each = {one.name: one for _, own in families for one in own}
    return together + [candidate(name, kind, [one]) for name, one in each.items()]


def extended_sensor(sensor: Sensor, *, temperature_varies: bool = False) -> Sensor:
    """Return the sensor with all coefficients in its axes' tables, the selected ones first.

    Temperature coefficients are included only if `temperature_varies`, that is, if the temperature
    is known and changes.
    """
    whole = tuple(
        f"{axis.name}.{line.name}"
        for axis in sensor.axes
        for line in TABLES[axis.measures]
        if temperature_varies or not line.basis.uses("dT", "dTdt")
    )
    more = tuple(name for name in whole if name not in sensor.coefficients)
    return replace(sensor, coefficients=(*sensor.coefficients, *more))


def parameters_with_deviations(declared: Mapping[str, Parameter]) -> dict[str, Parameter]:
    """Return the bench's parameters with deviations added, so that all of them become nuisances."""
    return {n: q if q.sd > 0 else replace(q, sd=1.0) for n, q in declared.items()}


def candidate_function(
    problem: Callable[[], Problem],
    names: Sequence[str],
    sensor: Sensor,
    declared: Mapping[str, Parameter],
    time: Array | None = None,
    families: Families | None = None,
    priors: Priors = (),
    common_errors: Sequence[str] = (),
    zero_input: Bools | None = None,
) -> Callable[[Array], Sequence[Candidate]]:
    """Return the function `Problem.candidates` for a problem of mean readings or norms.

    Parameters
    ----------
    problem : callable
        Returns the extended problem, with `extended_sensor(sensor)` (with or without temperature
        coefficients) and `parameters_with_deviations(declared)`. Observations are labelled
        "ax[row]" by channel and row, or only "row".
    names : sequence of str
        The parameters of the problem that was solved.
    sensor : Sensor
        The sensor with the estimated coefficients.
    declared : mapping of str to Parameter
        The bench's parameters by full name.
    time : (r,) or (trials, r) array, optional
        Time of each row, s, if a drift of the biases is a candidate.
    families : mapping of str to sequence of str, optional
        Full names of parameters that are tested together. They replace the families of
        coefficients with the same short name, and the separate tests of bench parameters.
    priors : sequence of Gaussian, optional
        Priors on estimated coefficients, which are tested because they may be wrong.
    common_errors : sequence of str, optional
        The same as for `common_error_candidates`.
    zero_input : (m,) array of bool, optional
        Observations from axes with zero nominal input. For these, terms that depend on the input's
        sign are omitted, because the sign would come from the estimated tilt and be arbitrary.
    """

    def candidates(x: Array) -> list[Candidate]:
        larger, known = problem(), list(names)
        there = np.empty((*x.shape[:-1], len(larger.names)))
        there[...] = larger.start.reshape(-1, len(larger.names))[0]
        free = [k for k, name in enumerate(larger.names) if name in known]
        there[..., free] = x[..., [known.index(larger.names[k]) for k in free]]
        _, jacobian = larger.linearise(there)
        if x.ndim == 1:
            jacobian = jacobian.reshape(-1, len(larger.names))
        column = {name: jacobian[..., k] for k, name in enumerate(larger.names)}
        if zero_input is not None:
            column |= {
                n: np.where(zero_input, 0.0, column[n])
                for n in _sign_dependent_coefficients(sensor)
                if n in column
            }
        return [
            *candidates_from_columns(
                larger.observations, sensor, names, declared, column, families
            ),
            *prior_candidates(sensor, names, priors, column),
            *common_error_candidates(declared, column, common_errors),
            *(() if time is None else drift_candidates(larger.observations, sensor, time, column)),
        ]

    return candidates


def _sign_dependent_coefficients(sensor: Sensor) -> list[str]:
    """Return the coefficients of the sensor's axes, selected or not, that depend on a sign."""
    whole = extended_sensor(sensor, temperature_varies=True)
    return [n for n in whole.coefficients if whole.coefficient(n).basis.uses("si", "swi")]


def candidates_from_columns(
    observations: Sequence[str],
    sensor: Sensor,
    names: Sequence[str],
    declared: Mapping[str, Parameter],
    column: Columns,
    families: Families | None = None,
    further_units: dict[str, str] | None = None,
) -> list[Candidate]:
    """Return the candidates from their columns (m,); arguments as for `candidate_function`.

    `further_units` gives the units of observed quantities that are not channels of the sensor.
    """
    families = families or {}
    return [
        *_coefficient_candidates(sensor, names, column, families),
        *bench_candidates(declared, column, families, _row_labels(observations, sensor)),
        *row_candidates(observations, sensor, further_units or {}),
    ]


def _coefficient_candidates(
    sensor: Sensor, names: Sequence[str], column: Columns, families: Families
) -> list[Candidate]:
    """Return the coefficients that are not estimated, tested by kind and then one by one."""
    larger = extended_sensor(sensor, temperature_varies=True)
    kinds: dict[tuple[str, str], list[Column]] = {}
    for full in larger.coefficients:
        axis = CoefficientName(full).axis
        if full in names or full not in column or not _affects_observations(column[full]):
            continue
        measures = sensor.measures[axis]
        for kind in _family_names(full, families) or [family_name(larger.coefficient(full))]:
            column_of = coefficient_column(larger, full, column[full])
            kinds.setdefault((measures, kind), []).append(column_of)
    return together_and_alone("coefficient", ((kind, own) for (_, kind), own in kinds.items()))


def family_name(line: ErrorTerm) -> str:
    """Return the name for the test of a coefficient on all axes, as users write it in [method]."""
    return line.group if line.group == "g" else line.name


def _family_names(full: str, families: Families) -> list[str]:
    """Return the names of the families that contain a parameter."""
    return [name for name, members in families.items() if full in members]


def bench_candidates(
    declared: Mapping[str, Parameter], column: Columns, families: Families, rows: Sequence[str]
) -> list[Candidate]:
    """Return candidates for the bench parameters that act on several rows, from columns (m,).

    `rows` are the row names of the observations, (m,). The parameters of one position are
    candidates if several rows share the position's attitude. Parameters of a single row are
    candidates if `families` contains them, because a family acts on many rows.

    The components of one vector at one place, "pose_x[XY30]" to "pose_z[XY30]", form one candidate,
    "pose[XY30]". Their sizes show which component is wrong.
    """
    kinds: dict[str, list[Column]] = {}
    for name, parameter in declared.items():
        if name not in column or not _affects_observations(column[name]):
            continue
        together = _family_names(name, families)
        several = _affects_several_rows(column[name], rows)
        if together or several or parameter.scope in _SHARED_SCOPES:
            for kind in together or [ErrorName(name).vector]:
                kinds.setdefault(kind, []).append(_bench_column(name, parameter, column[name]))
    return [
        candidate(kind if len(own) > 1 else own[0].name, "bench", own)
        for kind, own in kinds.items()
    ]


def _bench_column(name: str, parameter: Parameter, rows: Array) -> Column:
    return Column(name, parameter.unit, rows, _largest_departure(parameter), parameter.sd)


def common_error_candidates(
    declared: Mapping[str, Parameter], column: Columns, names: Sequence[str]
) -> Iterator[Candidate]:
    """Yield candidates that treat errors stated for single rows as common to all rows.

    Independent errors average out over the rows, but a common error does not.

    Parameters
    ----------
    declared, column
        The same as for `candidate_function`.
    names : sequence of str
        Names of the vectors: "lean" has the components "lean_1[row]" and "lean_2[row]".
    """
    for name in names:
        sums: dict[str, list[str]] = {}
        for full in declared:
            component = ErrorName(full).name
            if full in column and component.rpartition("_")[0] == name:
                sums.setdefault(component, []).append(full)
        if any(len(rows) < 2 for rows in sums.values()) or not sums:
            continue
        columns = [
            _bench_column(
                component, declared[rows[0]], np.sum([column[full] for full in rows], axis=0)
            )
            for component, rows in sums.items()
        ]
        yield candidate(name, "bench", columns)


def prior_column(sensor: Sensor, full: str, sd: float, rows: Array) -> Column:
    """Return the column of a coefficient's prior, which may be wrong by many deviations."""
    known = coefficient_column(sensor, full, rows)
    largest = max(sensor.coefficient(full).largest, 10 * sd)
    return known._replace(name=f"{PRIOR_OF}{full}", largest=largest, stated_sd=sd)


def prior_candidates(
    sensor: Sensor, names: Sequence[str], priors: Priors, column: Columns
) -> list[Candidate]:
    """Return the priors of coefficients as candidates, by kind and one by one.

    Each column omits the row of its prior, so only the data determine the coefficient. If a prior
    is wrong by δ, the coefficient differs from the value that agrees with the prior, also by δ.
    Its shift is therefore J⁺c δ − δ. `names` are the parameters of the problem.
    """
    kinds: dict[str, list[Column]] = {}
    for prior in priors:
        for full, sd in zip(prior.names, np.sqrt(np.diagonal(prior.covariance)), strict=True):
            kind = f"{PRIOR_OF}{CoefficientName(full).term}"
            kinds.setdefault(kind, []).append(prior_column(sensor, full, sd, column[full]))
    known = [f"{PRIOR_OF}{name}" for name in names]
    return [
        replace(one, moved=-np.equal.outer(known, one.components).astype(float))
        for one in together_and_alone("bench", kinds.items())
    ]


def unit_scale(parameter: Parameter) -> float:
    """Return the natural size of a bench parameter in SI; it makes columns comparable."""
    return _NATURAL_SIZES.get(parameter.unit, 1.0)


def _largest_departure(parameter: Parameter) -> float:
    """Return the largest plausible departure of a bench parameter from its stated value, SI."""
    size = max(abs(parameter.value), unit_scale(parameter))
    return max(largest_angle(parameter.name, LARGEST_RELATIVE_SIZE * size), 10 * parameter.sd)


def largest_angle(name: str, otherwise: float = LARGEST_RELATIVE_SIZE) -> float:
    """Look up the largest plausible error, rad or relative, of the bench angle with a name."""
    if re.match(r"(sin|cos)\d", name):
        return _LARGEST_HARMONIC
    return _LARGEST_ANGLES.get(name, otherwise)


def _affects_observations(column: Array) -> bool:
    """Return whether a parameter changes the observations by more than rounding."""
    acting = np.max(np.abs(column), axis=-1, initial=0.0) > _ROUNDING_LIMIT
    return bool(of_all_trials(acting[..., None])[0])


def _affects_several_rows(column: Array, rows: Sequence[str]) -> bool:
    """Return whether a parameter changes the observations of two or more rows."""
    acting = np.flatnonzero(of_all_trials(np.abs(column) > _ROUNDING_LIMIT))
    return len({rows[k] for k in acting.tolist()}) > 1


def _row_labels(observations: Sequence[str], sensor: Sensor) -> list[str]:
    """Return the row label of each observation."""
    return [_row_label(label, sensor.measures) for label in observations]


def row_candidates(
    observations: Sequence[str], sensor: Sensor, further_units: dict[str, str]
) -> Iterator[Candidate]:
    """Yield one candidate per row, for arbitrary errors in the readings of that row."""
    channels = {axis.name: QUANTITIES[axis.measures].unit for axis in sensor.axes} | further_units
    rows: dict[str, list[int]] = {}
    for k, label in enumerate(observations):
        rows.setdefault(_row_label(label, channels), []).append(k)
    for row, places in rows.items():
        columns = np.zeros((len(observations), len(places)))
        columns[places, range(len(places))] = 1.0
        names = tuple(observations[k] for k in places)
        units = tuple(channels.get(ObservationName(name).channel, "m/s²") for name in names)
        yield Candidate(row, "row", names, units, columns)


def drift_candidates(
    observations: Sequence[str], sensor: Sensor, time: Array, column: Columns
) -> Iterator[Candidate]:
    """Yield candidates for a drift of the biases, linear in time from the first row to the last.

    The axes of one kind are tested together and then one by one. An axis's column is its bias
    column multiplied by the time of its rows. If all rows have the same time, there are no
    candidates.
    """
    span = np.ptp(time, axis=-1, keepdims=True)
    rows = _row_labels(observations, sensor)
    labels = list(dict.fromkeys(rows))
    if not (span > 0).all() or len(labels) != time.shape[-1] or len(labels) < 3:
        return
    at = [labels.index(row) for row in rows]
    ramp = ((time - time.mean(axis=-1, keepdims=True)) / span)[..., at]
    for kind, quantity in QUANTITIES.items():
        own: list[Column] = []
        for channel in (name for name, one in sensor.measures.items() if one == kind):
            bias = column.get(f"{channel}.{quantity.bias}")
            if bias is not None and _affects_observations(bias * ramp):
                own.append(Column(f"drift of {channel}", quantity.unit, bias * ramp))
        yield from together_and_alone("time", [(f"drift of {quantity.sensors}", own)])


def _row_label(label: str, channels: Mapping[str, str]) -> str:
    """Return the row of an observation labelled "ax[row]", or the whole label."""
    one = ObservationName(label)
    return one.row if one.row and one.channel in channels else label
