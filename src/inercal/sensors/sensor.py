"""A sensor: named axes, the coefficients that describe their errors, and the exact forward model.

Two forms of one table (`tables`). In the reference form (IEEE Std 1293) every term acts along the
nominal axes, so the reading is linear in the coefficients::

    y = f_I + Σ c φ(seen)

In the tilted form the misalignments turn the input axis itself and the nonlinear terms act along
the turned, unit axis h (with the lever arm's part in what it feels)::

    a = h·(f + dω/dt × r + ω × (ω × r)),   h = (1, tan δ_O, −tan δ_P) / norm   along (I, P, O)
    y = a + Σ c φ(seen, with f_I replaced by a)

Everything broadcasts over leading axes of trials: motion `(..., n, 3)`, coefficients `(..., p)`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from inercal.errors import InputError
from inercal.motion import Motion
from inercal.sensors.choose import choose
from inercal.sensors.noise import Noise
from inercal.sensors.tables import TABLES, Coefficient

Array = NDArray[np.float64]
Form = Literal["reference", "tilted"]
_TURNS = ("delta_o", "delta_p")
_ARMS = ("arm_i", "arm_p", "arm_o")
_ALONG = {"f": "fi", "w": "wi"}  # what an axis reads when it has no errors
_FELT = ("fi", "fp", "fo", "wi", "wp", "wo")


@dataclass(frozen=True)
class Readout:
    """How an axis states its reading: output = offset + scale · (reading in SI).

    Parameters
    ----------
    scale : float
        Nominal scale factor, output units per m/s² or per rad/s.
    offset : float
        Output at zero, output units.
    unit : str
        Name of the output unit.
    full_scale : float or None
        Largest magnitude of output − offset that the axis can state, output units.
    """

    scale: float = 1.0
    offset: float = 0.0
    unit: str = "SI"
    full_scale: float | None = None


@dataclass(frozen=True)
class Axis:
    """One measuring axis.

    Parameters
    ----------
    name : str
        Name of the axis, such as "x" or "gz".
    measures : "f" or "w"
        Specific force (an accelerometer) or angular rate (a gyro).
    i, p : tuple of 3 floats
        Nominal input and pendulous axes, orthogonal unit vectors in the sensor's frame; O = I × P.
    readout, noise
        How it states its reading, and the noise in it.
    """

    name: str
    measures: Literal["f", "w"]
    i: tuple[float, float, float]
    p: tuple[float, float, float]
    readout: Readout = Readout()
    noise: Noise = Noise()

    def __post_init__(self) -> None:
        frame = self.frame
        if not np.allclose(frame @ frame.T, np.eye(3), atol=1e-9):
            raise InputError(
                f"axis {self.name}: I {self.i} and P {self.p} are not orthogonal units"
            )

    @cached_property
    def frame(self) -> Array:
        """Rows I, P, O in the sensor's frame, (3, 3)."""
        return np.array([self.i, self.p, np.cross(self.i, self.p)])

    def see(self, motion: Motion) -> dict[str, Array]:
        """Return the components of a motion along I, P, O by name, arrays (..., n)."""
        seen: dict[str, Array] = {"dT": np.asarray(motion.dT, dtype=float)}
        for letter, vectors in (("f", motion.f), ("w", motion.w), ("a", motion.dw)):
            along = vectors @ self.frame.T
            seen |= {letter + axis: along[..., k] for k, axis in enumerate("ipo")}
        seen["si"], seen["swi"] = np.sign(seen["fi"]), np.sign(seen["wi"])
        return seen


class _Response(NamedTuple):
    """Reading of one axis and its derivatives, all (..., n)."""

    reading: Array
    to_coefficient: dict[str, Array]
    to_felt: dict[str, Array]  # by component: fi … wo


class Linearisation(NamedTuple):
    """Readings and their derivatives; see `Sensor.linearise`."""

    reading: Array  # (..., n, m)
    design: Array  # (..., n, m, p)
    slope: Array  # (..., n or 1, m, 6)


@dataclass(frozen=True)
class Sensor:
    """Named axes and the chosen coefficients; `coefficients` fixes the order of every vector.

    Parameters
    ----------
    name : str
        What the laboratory calls it.
    axes : tuple of Axis
        Accelerometers and gyros, in the order of the recording's channels.
    coefficients : tuple of str
        Full names, "ax.k0"; see `with_coefficients`.
    form : "reference" or "tilted"
        Where nonlinear terms act (see the module).
    reference_temperature : float
        K; the model's ΔT is counted from it.

    Raises
    ------
    InputError
        Two axes of one name, or an unknown coefficient.
    """

    name: str
    axes: tuple[Axis, ...]
    coefficients: tuple[str, ...] = ()
    form: Form = "reference"
    reference_temperature: float = 293.15
    _by_axis: Mapping[str, tuple[Coefficient, ...]] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        names = [axis.name for axis in self.axes]
        if len(set(names)) != len(names):
            raise InputError(f"sensor {self.name}: two axes have one name in {names}")
        by_axis: dict[str, list[Coefficient]] = {name: [] for name in names}
        for full in self.coefficients:
            axis, _, short = full.partition(".")
            tables = {a.name: TABLES[a.measures] for a in self.axes}
            known = {c.name: c for c in tables.get(axis, ())}
            if short not in known:
                raise InputError(
                    f"no coefficient {full!r}; axes are {', '.join(names)}"
                    + (f" and {axis} has {', '.join(known)}" if known else "")
                )
            by_axis[axis].append(known[short])
        object.__setattr__(self, "_by_axis", {k: tuple(v) for k, v in by_axis.items()})

    def with_coefficients(self, *chosen: str) -> "Sensor":
        """Return the sensor with coefficients chosen by name, group or axis.

        `"bias"`, `"scale"`, `"misalignment"`, `"nonorthogonality"`, … choose for all axes,
        `"k2"` one coefficient for all axes that have it, `"x.k2"` or `"x.bias"` for one.
        """
        return replace(self, coefficients=choose(self.axes, chosen))

    def only(self, measures: Literal["f", "w"]) -> "Sensor":
        """Return the sensor's accelerometers or its gyros alone, with their coefficients."""
        axes = tuple(a for a in self.axes if a.measures == measures)
        kept = {a.name for a in axes}
        names = tuple(c for c in self.coefficients if c.partition(".")[0] in kept)
        return replace(self, axes=axes, coefficients=names)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(axis.name for axis in self.axes)

    def coefficient(self, full: str) -> Coefficient:
        """Return the line of the table behind a full name such as "x.k0"."""
        axis, _, short = full.partition(".")
        return next(c for c in self._by_axis[axis] if c.name == short)

    @cached_property
    def natural(self) -> Array:
        """Natural size of each coefficient, SI, (p,): it reads 1 g or 1 rad/s at 1 g, 1 rad/s."""
        return np.array([self.coefficient(name).natural for name in self.coefficients])

    @cached_property
    def affine(self) -> bool:
        """Whether readings are affine in f and ω, and depend on nothing else."""
        table = [c.basis for line in self._by_axis.values() for c in line]
        linear = all(basis.degree(*_FELT) <= 1 for basis in table)
        others = self.uses("si", "swi", "dT", "ai", "ap", "ao")
        return linear and not others and (self.form == "reference" or self.coefficients == ())

    def uses(self, *components: str) -> bool:
        """Return whether any chosen coefficient acts on one of the components of the motion."""
        return any(c.basis.uses(*components) for line in self._by_axis.values() for c in line)

    def to_si(self, output: Array) -> Array:
        """Return nominal readings in SI, (..., n, m), from output units."""
        return (output - self._readout("offset")) / self._readout("scale")

    def to_output(self, reading: Array) -> Array:
        """Return output units from readings in SI, (..., n, m)."""
        return self._readout("offset") + self._readout("scale") * reading

    def _readout(self, what: str) -> Array:
        return np.array([getattr(axis.readout, what) for axis in self.axes])

    def forward(self, motion: Motion, c: Array) -> Array:
        """Return noise-free readings in SI, (..., n, m), for coefficients `c`, (..., p) in SI."""
        responses = [self._respond(axis, motion, c, derive=False) for axis in self.axes]
        return np.stack(np.broadcast_arrays(*(r.reading for r in responses)), axis=-1)

    def design(self, motion: Motion, c: Array) -> Array:
        """Return d(reading)/d(coefficient) at `c`, (..., n, m, p); exact."""
        return self.linearise(motion, c).design

    def slope(self, motion: Motion, c: Array) -> Array:
        """Return d(reading)/d(f, ω) at the motion, (..., n, m, 6), in the sensor's frame.

        The axis of samples has length 1 where the slope is the same for all of them.
        """
        return self.linearise(motion, c).slope

    def linearise(self, motion: Motion, c: Array) -> Linearisation:
        """Return the reading, (..., n, m), with `design` and `slope`, in one pass."""
        if self.affine:
            return self._linearise_affine(motion, c)
        responses = [self._respond(axis, motion, c, derive=True) for axis in self.axes]
        shape = np.broadcast_shapes(*(r.reading.shape for r in responses))
        reading = np.stack([np.broadcast_to(r.reading, shape) for r in responses], axis=-1)
        design = np.zeros((*shape, len(self.axes), len(self.coefficients)))
        slope = np.zeros((*shape, len(self.axes), 6))
        for k, (axis, response) in enumerate(zip(self.axes, responses, strict=True)):
            for short, column in response.to_coefficient.items():
                design[..., k, self.coefficients.index(f"{axis.name}.{short}")] = column
            for name, column in response.to_felt.items():
                block = slice(0, 3) if name[0] == "f" else slice(3, 6)
                slope[..., k, block] += column[..., None] * axis.frame["ipo".index(name[1])]
        return Linearisation(reading, design, slope)

    def _linearise_affine(self, motion: Motion, c: Array) -> Linearisation:
        """Do the same by two products of matrices: y = (A₀ + Σ c B) (f, ω, 1)."""
        nominal, change = self._affine_maps
        shape = np.broadcast_shapes(motion.f.shape, motion.w.shape)
        felt = np.ones((*shape[:-1], 7))
        felt[..., :3], felt[..., 3:6] = motion.f, motion.w
        m, p = len(self.axes), len(self.coefficients)
        whole = nominal + (c @ change.reshape(p, m * 7)).reshape(*c.shape[:-1], m, 7)
        reading = felt @ np.swapaxes(whole, -1, -2)
        design = felt @ np.moveaxis(change, -1, 0).swapaxes(-1, -2).reshape(7, m * p)
        return Linearisation(
            reading, design.reshape(*design.shape[:-1], m, p), whole[..., None, :, :6]
        )

    @cached_property
    def _affine_maps(self) -> tuple[Array, Array]:
        """A₀, (m, 7), and B, (p, m, 7), of an affine sensor."""
        p = len(self.coefficients)
        felt = np.concatenate([np.eye(6), np.zeros((1, 6))])
        motion = Motion(felt[:, :3], felt[:, 3:])
        at = np.stack([self.forward(motion, c) for c in (*np.eye(p), np.zeros(p))])
        at[:, :6] -= at[:, 6:]
        maps = np.swapaxes(at, -1, -2)
        return maps[p], maps[:p] - maps[p]

    def _respond(self, axis: Axis, motion: Motion, c: Array, *, derive: bool) -> _Response:
        """Return one axis's reading and, on wish, its derivatives."""
        values = {
            line.name: c[..., self.coefficients.index(f"{axis.name}.{line.name}"), None]
            for line in self._by_axis[axis.name]
        }
        seen = axis.see(motion)
        along = _ALONG[axis.measures]
        geometry = _geometry(values, seen, along) if self.form == "tilted" else None
        if geometry is not None:
            seen = seen | {along: geometry.reading, "s" + along[1:]: np.sign(geometry.reading)}
        terms = [
            line
            for line in self._by_axis[axis.name]
            if geometry is None or line.name not in geometry.to_coefficient
        ]
        shape = np.broadcast_shapes(*(v.shape for v in (*seen.values(), *values.values())))
        reading = np.broadcast_to(seen[along], shape).copy()
        for line in terms:
            reading += values[line.name] * line.basis.value(seen)
        if not derive:
            return _Response(reading, {}, {})
        to_coefficient = {line.name: line.basis.value(seen) + np.zeros(shape) for line in terms}
        to_felt = {name: np.full(shape, float(name == along)) for name in _FELT}
        for line in terms:
            for name in _FELT:
                for product in line.basis.derivative(name):
                    to_felt[name] += values[line.name] * product.value(seen)
        if geometry is None:
            return _Response(reading, to_coefficient, to_felt)
        # Chain rule through the turned axis: what acts on `along` acts on a(δ, r, f, ω).
        outer = to_felt.pop(along)
        to_felt[along] = np.zeros(shape)
        for name, inner in geometry.to_felt.items():
            to_felt[name] += outer * inner
        for name, inner in geometry.to_coefficient.items():
            to_coefficient[name] = outer * inner
        return _Response(reading, to_coefficient, to_felt)


def _geometry(values: Mapping[str, Array], seen: Mapping[str, Array], along: str) -> _Response:
    """Return what the turned, displaced axis feels along itself, a, and its derivatives."""
    tan_o = np.tan(values.get("delta_o", np.zeros(1)))
    tan_p = np.tan(values.get("delta_p", np.zeros(1)))
    norm = np.sqrt(1 + tan_o**2 + tan_p**2)
    h = (1 / norm, tan_o / norm, -tan_p / norm)
    kind = along[0]
    felt = [seen[kind + axis] for axis in "ipo"]
    arm = [values[name] for name in _ARMS] if "arm_i" in values else []
    to_coefficient: dict[str, Array] = {}
    to_felt = {kind + axis: h[k] for k, axis in enumerate("ipo")}
    if arm:
        w, dw = (np.stack(np.broadcast_arrays(*(seen[s + a] for a in "ipo")), -1) for s in "wa")
        cross = _cross_matrix(dw) + _cross_matrix(w) @ _cross_matrix(w)
        r = np.stack(np.broadcast_arrays(*arm), axis=-1)
        h_row = np.stack(np.broadcast_arrays(*h), axis=-1)
        felt = [
            f + part for f, part in zip(felt, np.moveaxis(_apply(cross, r), -1, 0), strict=True)
        ]
        along_r = _apply(np.swapaxes(cross, -1, -2), h_row)
        to_coefficient = {name: along_r[..., k] for k, name in enumerate(_ARMS)}
        # h·(ω × (ω × r)) = (h·ω)(ω·r) − (h·r) ω², so d/dω = h (ω·r) + (h·ω) r − 2 (h·r) ω
        dot = {"wr": (w * r).sum(-1), "hw": (h_row * w).sum(-1), "hr": (h_row * r).sum(-1)}
        to_w = (
            h_row * dot["wr"][..., None] + dot["hw"][..., None] * r - 2 * dot["hr"][..., None] * w
        )
        to_felt |= {"w" + axis: to_w[..., k] for k, axis in enumerate("ipo")}
    a = sum(component * x for component, x in zip(h, felt, strict=True)) + np.zeros(1)
    if "delta_o" in values:
        to_coefficient["delta_o"] = (1 + tan_o**2) / norm * (felt[1] - a * tan_o / norm)
    if "delta_p" in values:
        to_coefficient["delta_p"] = (1 + tan_p**2) / norm * (-felt[2] - a * tan_p / norm)
    return _Response(a, to_coefficient, to_felt)


def _cross_matrix(v: Array) -> Array:
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack(
        [np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], -2
    )


def _apply(matrix: Array, vector: Array) -> Array:
    return (matrix @ vector[..., None])[..., 0]
