"""Simulate a calibration as a function of all imperfections.

The estimator is treated as a black box. All imperfections together form a vector z of independent
standard normal numbers, and the calibration is a function of this vector::

    z  ->  errors of the bench, noise of the readings, errors of the priors
       ->  readings = forward(motion(bench's errors), truth) + noise
       ->  estimate(readings; the bench as stated, with its priors)  =  E(z)

The derivative of E at a point gives the budget to first order (GUM 5.1). The scatter of E(z) for
random z gives the Monte Carlo budget (GUM Supplement 1, JCGM 101:2008).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from inercal.basics.arrays import Array
from inercal.basics.errors import InputError
from inercal.basics.parameters import NOT_QUALIFIED, Parameter, QualifiedParameters
from inercal.benches import Bench, MeanBench
from inercal.benches.kind_definition import kind_for_bench
from inercal.estimation import Estimate, Gaussian
from inercal.physics.plan import Spin, Step
from inercal.physics.sensors import Sensor
from inercal.pipeline.budget.imperfections import (
    NOISE,
    Imperfection,
    bench_imperfections,
    noise_imperfection,
    prior_imperfection,
)
from inercal.recordings import Observations

Estimator = Callable[..., Estimate]  # observations, sensor, bench, steps, priors


@dataclass(frozen=True, eq=False)
class Experiment:
    """A virtual experiment: a sensor on a bench, with a plan and an estimator.

    Parameters
    ----------
    sensor : Sensor
        Sensor with the p coefficients that are estimated.
    bench : MeanBench
        Bench that is stated to the estimator. Its errors are drawn with the stated deviations.
    steps : tuple of r Step
        Steps of the plan.
    estimator : callable
        Function that returns an estimate from observations, sensor, bench, steps and priors.
    noise : (r, m, m) array
        Covariance of the mean readings of each step, SI, positive definite.
    priors : tuple of Gaussian
        Independent priors of coefficients; their means are drawn about the true values.
    truth : mapping of str to float
        True coefficients by full name, SI; missing coefficients are zero. Coefficients that are not
        estimated are known effects and are not used here (see
        `inercal.pipeline.budget.contributions`).

    Raises
    ------
    InputError
        If the plan has no attitudes or is for another bench, or if the noise is not positive
        definite.
    """

    sensor: Sensor
    bench: MeanBench
    steps: tuple[Step, ...]
    estimator: Estimator
    noise: Array
    priors: tuple[Gaussian, ...] = ()
    truth: Mapping[str, float] = field(default_factory=dict[str, float])

    def __post_init__(self) -> None:
        require_budget_plan(self.bench, self.steps)
        shape = (len(self.steps), *[len(self.sensor.axes)] * 2)
        if self.noise.shape != shape:
            raise InputError(f"noise has shape {self.noise.shape}; give shape {shape}", key="noise")
        variance = np.diagonal(self.noise, axis1=-2, axis2=-1)
        if not (np.isfinite(self.noise).all() and (variance > 0).all()):
            raise InputError(
                "the noise of the readings must be finite and positive in a budget", key="noise"
            )

    @cached_property
    def true_values(self) -> Array:
        """True values of the estimated coefficients, (p,), SI."""
        return self._true_coefficients(self.sensor.coefficients)

    def _true_coefficients(self, names: tuple[str, ...]) -> Array:
        return np.array([self.truth.get(name, 0.0) for name in names])

    @cached_property
    def bench_parameters(self) -> dict[str, Parameter]:
        """The bench parameters by full name, including exact parameters."""
        return dict(self.bench.nuisances(self.steps, self.sensor))

    @cached_property
    def imperfections(self) -> tuple[Imperfection, ...]:
        """The imperfections, in the order of their draws in z."""
        labels = [step.label for step in self.steps]
        noise = noise_imperfection(self.sensor, labels, self.noise)
        return (*bench_imperfections(self.bench_parameters), *self._prior_imperfections, noise)

    @cached_property
    def _prior_imperfections(self) -> tuple[Imperfection, ...]:
        return tuple(prior_imperfection(self.sensor, prior) for prior in self.priors)

    @cached_property
    def draw_columns(self) -> dict[str, slice]:
        """The slice of z that contains the draws of each imperfection, by name."""
        ends = np.cumsum([0, *(len(one.draws) for one in self.imperfections)]).tolist()
        names = [one.name for one in self.imperfections]
        return {name: slice(*ends[k : k + 2]) for k, name in enumerate(names)}

    @property
    def size(self) -> int:
        """Number of elements of z."""
        return sum(len(one.draws) for one in self.imperfections)

    def __call__(self, z: Array) -> Array:
        """Return the estimates E(z), (n, p), of n trials for z, (n, size).

        Raises
        ------
        InputError
            If the estimator does not converge or does not accept the readings.
        """
        return self.estimates(*self.simulated_readings(z))

    @cached_property
    def expansion_point(self) -> Array:
        """The point at which derivatives are computed, (size,): no bench errors, one noise draw.

        Some estimators use residuals for their weights or to decide when to stop. Without noise,
        their residuals would only be rounding errors.
        """
        z = np.zeros(self.size)
        noise = self.draw_columns[NOISE]
        z[noise] = np.random.default_rng(0).standard_normal(noise.stop - noise.start)
        return z

    def simulated_readings(self, z: Array) -> tuple[Array, tuple[Gaussian, ...]]:
        """Return simulated readings, (n, r, m) SI, and priors with random means, (n, k)."""
        loose = [name for name, parameter in self.bench_parameters.items() if parameter.sd > 0]
        q = {name: np.array(parameter.value) for name, parameter in self.bench_parameters.items()}
        names = (name for one in self.imperfections for name in one.draws)
        places = {name: k for k, name in enumerate(names) if name in q}
        joint, root = self._joint_draws
        # An error that is equal in all trials is one number, so its motion is computed once.
        constant = (z == z[0]).all(axis=0)
        for name in loose:
            if name not in joint:
                error = z[0 if constant[places[name]] else slice(None), places[name]]
                q[name] = q[name] + self.bench_parameters[name].sd * error
        if joint:
            drawn = [places[name] for name in joint]
            errors = z[0 if constant[drawn].all() else slice(None), drawn] @ root.T
            q |= {name: q[name] + errors[..., k] for k, name in enumerate(joint)}
        priors: list[Gaussian] = []
        for prior, one in zip(self.priors, self._prior_imperfections, strict=True):
            error = z[:, self.draw_columns[one.name]] @ np.linalg.cholesky(prior.covariance).T
            priors.append(replace(prior, mean=self._true_coefficients(prior.names) + error))
        noise = z[:, self.draw_columns[NOISE]].reshape(-1, *self.noise.shape[:2])
        noise = (np.linalg.cholesky(self.noise) @ noise[..., None])[..., 0]
        return self.readings(q, self.sensor.coefficients) + noise, tuple(priors)

    @cached_property
    def _joint_draws(self) -> tuple[list[str], Array]:
        """Return the qualified parameters to draw, and the Cholesky root of their covariance."""
        known: QualifiedParameters = getattr(self.bench, "qualified", NOT_QUALIFIED)
        declared = self.bench_parameters
        names = known.acting(declared)
        covariance = known.joint_covariance([declared[name] for name in names])
        return names, np.asarray(np.linalg.cholesky(covariance), dtype=float)

    def readings(self, q: Mapping[str, Array], coefficients: tuple[str, ...]) -> Array:
        """Return readings without noise, (..., r, m), SI.

        Parameters
        ----------
        q : mapping of str to (...) array
            Bench parameters by full name.
        coefficients : tuple of str
            Coefficients of the simulated sensor, with values from `truth`.
        """
        sensor = replace(self.sensor, coefficients=coefficients)
        result = self.bench.mean_motion(self.steps, q).motion
        added = self.bench.reading_offsets(self.steps, sensor, q)
        return sensor.forward(result, self._true_coefficients(coefficients)) + added

    def estimates(
        self, readings: Array, priors: tuple[Gaussian, ...], bench: MeanBench | None = None
    ) -> Array:
        """Return the coefficients, (n, p) SI, estimated from readings (n, r, m).

        Parameters
        ----------
        readings : (n, r, m) array
        priors : tuple of Gaussian
            Priors with means (n, k).
        bench : MeanBench, optional
            Bench that is stated to the estimator, if it differs from the bench of the readings.
        """
        if self._accepts_trials:
            found = self._run_estimator(readings, priors, bench)
            values, converged = found.value, found.converged
        else:
            singles = [
                self._run_estimator(row, tuple(replace(g, mean=g.mean[k]) for g in priors), bench)
                for k, row in enumerate(readings)
            ]
            values = np.stack([one.value for one in singles])
            converged = np.array([bool(one.converged) for one in singles])
        if not np.all(converged):
            raise InputError(
                f"the estimator did not converge in {int(np.sum(~converged))} of {len(readings)} "
                "trials; check the plan and the stated noise"
            )
        return values[:, : len(self.sensor.coefficients)]

    @cached_property
    def _accepts_trials(self) -> bool:
        """Whether the estimator accepts many tables at once; closed formulas do not."""
        readings, priors = self.simulated_readings(self.expansion_point[None])
        try:
            self._run_estimator(readings, priors)
        except InputError:
            return False  # any other error will occur again with a single table
        return True

    def stated(self) -> Array:
        """Return the standard uncertainties that the estimator states, (p,), SI."""
        variance = np.diagonal(self.estimate().covariance)
        return np.sqrt(variance[: len(self.sensor.coefficients)])

    def estimate(self) -> Estimate:
        """Return the estimate from the readings at `expansion_point`.

        Raises
        ------
        InputError
            If the estimator does not accept the readings.
        NotObserved
            If the plan does not determine all coefficients.
        """
        readings, priors = self.simulated_readings(self.expansion_point[None])
        single = tuple(replace(g, mean=g.mean[0]) for g in priors)
        return self._run_estimator(readings[0], single)

    def observations(self, readings: Array) -> Observations:
        """Return the readings, (..., r, m) SI, as observations for the estimator."""
        r = len(self.steps)
        return Observations(
            labels=tuple(step.label for step in self.steps),
            mean=readings,
            covariance=self.noise,
            duration=np.array([step.seconds or 1.0 for step in self.steps]),
            samples=np.ones(r, dtype=np.int64),
            time=np.arange(r, dtype=float),
            channels=self.sensor.channels,
        )

    def _run_estimator(
        self, readings: Array, priors: tuple[Gaussian, ...], bench: MeanBench | None = None
    ) -> Estimate:
        seen = self.observations(readings)
        return self.estimator(seen, self.sensor, bench or self.bench, self.steps, priors)


def require_budget_plan(bench: Bench, steps: Sequence[Step]) -> MeanBench:
    """Return the bench; raise an error if the plan does not define the motion of the sensor.

    Raises
    ------
    InputError
        If there are no steps, if the steps are for another bench, if attitudes on the arm are
        unknown, or if this kind of bench does not accept the plan.
    """
    kind = kind_for_bench(bench)
    if steps and not all(isinstance(step, kind.steps) for step in steps):
        raise InputError(
            f"the steps of the plan are for another bench than {kind.name}; change [bench] kind or "
            "the plan",
            key="[bench] kind",
        )
    if reason := kind.refuses_budget(bench, steps):
        raise InputError(reason)
    if not isinstance(bench, MeanBench):
        raise InputError(
            f"a budget needs mean readings, which a bench of kind {kind.name} does not provide; "
            "use another bench",
            key="[bench] kind",
        )
    if not steps:
        raise InputError("a budget needs a plan with steps; add steps", key="steps")
    if any(isinstance(step, Spin) and step.attitude is None for step in steps):
        raise InputError(
            "a budget needs a plan with attitudes, but a table of means does not state attitudes; "
            "state [method] attitudes and rates",
            key="[method] attitudes",
        )
    return bench
