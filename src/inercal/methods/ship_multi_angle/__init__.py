"""A triad on a plain rate table, tilted by known angles, as in tests of ship models.

* `joint`: all states together, untilted and tilted, each axis against the force it sensed; the
  angles of each mounting, its radius, the speeds, the lean at each rest, the radius and gravity are
  nuisances with their stated deviations.
* `planar`: the untilted states alone, linear (`inercal.methods.ship_planar`).
* `planar_norm`: the untilted states as vectors and the tilted ones as norms, with equal weights.
* `damped`: the source's Levenberg–Marquardt on the norms of the tilted states, from `planar`.
* `global`: the source's optimisation of the same norms, by differential evolution.

Norms do not observe a rotation of the triad, and the value that damping or a search leaves there is
no measurement: both estimators name the free directions and the source of their uncertainty. Equal
sums of squares of both validate neither.

Source: Xiao Changrun, Liu Yang, Liu Ruijie, Transducer and Microsystem Technologies 33(10), 2014,
10.13873/J.1000-9787(2014)10-0021-04; its equations are illegible in our copy and rebuilt from its
text. `joint`, `planar_norm` and all covariances are ours.
"""

from collections.abc import Sequence
from dataclasses import replace

from inercal.basics.errors import NotObserved
from inercal.benches.rate_table.bench import RateTable, mounting_names
from inercal.benches.rate_table.fixture import TiltConvention, multi_angle_plan, planar_plan
from inercal.estimation import Estimate, Gaussian
from inercal.methods import prediction_error, solving
from inercal.methods._base import Method
from inercal.methods.estimator_inputs import require_matching_rows
from inercal.methods.observability import require_observed
from inercal.methods.ship_consistency import joint_problem
from inercal.methods.ship_multi_angle.norm_estimators import damped, global_
from inercal.methods.ship_multi_angle.vector_norm_estimator import planar_norm
from inercal.methods.ship_planar import planar, require_excitation
from inercal.physics.plan import Spin
from inercal.physics.sensors import Sensor
from inercal.recordings import Observations


def plan(
    seconds: float = 150.0, reading: TiltConvention = "azimuth", one_speed: bool = False
) -> tuple[Spin, ...]:
    """Return the nine untilted states, then the sixteen groups.

    Parameters
    ----------
    seconds : float
        Length of each dwell, s.
    reading : "azimuth", "dihedral" or "successive"
        Of the pose of two tilts (`inercal.benches.rate_table.fixture`).
    one_speed : bool
        Whether all groups are at one speed, as in the source.
    """
    return (
        *planar_plan(seconds=seconds),
        *multi_angle_plan(reading, one_speed=one_speed, seconds=seconds),
    )


def joint(
    observations: Observations,
    sensor: Sensor,
    bench: RateTable,
    steps: Sequence[Spin],
    priors: Sequence[Gaussian] = (),
) -> Estimate:
    """Return the coefficients and the bench's errors, at the largest posterior probability.

    Parameters
    ----------
    observations : Observations
        One row a state, (..., r, 3) m/s².
    sensor : Sensor
        Of three accelerometers, with the coefficients to estimate.
    bench : RateTable
    steps : sequence of r Spin
        Of the rows, in known attitudes.
    priors : sequence of Gaussian
        On coefficients, from other measurements.

    Raises
    ------
    InputError
        Steps that are not those of the rows.
    NotObserved
        Coefficients that these states do not determine.
    """
    require_matching_rows(observations, sensor, steps)
    try:
        estimate = solving.solve(
            observations,
            priors,
            lambda some, own: joint_problem(some, sensor, bench, steps, own),
        )
        require_observed(estimate, sensor, missing=())
    except NotObserved:
        if not priors:
            # Where the states are the cause, this refusal states the mounting to add.
            require_excitation(bench, steps)
        raise
    return replace(estimate, notes=(_state_note(estimate, steps), *estimate.notes))


def _state_note(estimate: Estimate, steps: Sequence[Spin]) -> str:
    """Return the note on what the states determine, what priors decided, and the frame."""
    text = f"the states determine {estimate.rank} of {len(estimate.wanted)} coefficients"
    if left := [one.words for one in estimate.null_directions]:
        text += f"; warning: priors alone decided {'; '.join(left)}"
    frame = f"the mean of {len(set(mounting_names(steps)))} mountings by their stated angles"
    return f"{text}; the frame is {frame}"


METHOD = Method(
    name="ship_multi_angle",
    bench=RateTable,
    default_coefficients={"f": ("k0", "k1", "delta_o", "delta_p")},
    also={"f": ("temperature",)},
    needs=("f",),
    plan=plan,
    estimators={
        "joint": joint,
        "planar": planar,
        "planar_norm": planar_norm,
        "damped": damped,
        "global": global_,
    },
    norm_only_estimators=("damped", "global"),
    remarks=prediction_error.remarks,
    weighs_common_errors=True,
    source="Xiao, Liu and Liu, Transducer and Microsystem Technologies 33(10), 2014",
)
