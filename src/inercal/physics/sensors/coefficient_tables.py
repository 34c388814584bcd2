"""Define the error models as tables with one coefficient per line.

The reading y of an axis, divided by its nominal scale, is the quantity along its input axis I plus
each coefficient times its basis function::

    accelerometer   y = f_I + Σ c φ(f, ω, dω/dt, ΔT, dT/dt)  m/s²
    gyro            y = ω_I + Σ c φ(f, ω, ΔT, dT/dt)          rad/s
    magnetometer    y = m_I + Σ c φ(m, ΔT)                    T

P is the pendulous axis and O the output axis, O = I × P. `k1` is the deviation of the scale factor
from nominal (0 is nominal). The misalignments have the signs of IEEE Std 1293: `delta_o` rotates I
about O and adds +f_P; `delta_p` rotates I about P and adds −f_O.

Sources: accelerometer, the model equation of IEEE Std 1293-2018 (clause 8 of its Part I: K0, K0′,
K1, K1′, Koq, K2, K3, δo, δp, Kip, Kio, Kpo, Kpp, Koo, Kspin, Kang.acc); gyro, IEEE Std 952 and 1431
for bias, scale factor and sensitivity to acceleration and its square; magnetometer, Kok and Schön,
IEEE Sensors Journal 16 (2016) 5679: the rows of its matrix D hold scale factor, soft iron and
misalignment, which no recording can separate. Arms are the components of the lever r in
f + dω/dt × r + ω × (ω × r).

Basis functions are data: sums of products of the motion components at an axis. The components are
those along the input (I), pendulous (P) and output (O) axes. A basis function is written as text,
such as `"fi fp"`, `"-wp wp - wo wo"` or `"0.5 si fi"`. Its value, its exact derivatives and its
formula in a report are all derived from this text.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import pi

from inercal.basics.arrays import Array

G0 = 9.80665  # m/s², exact (CGPM 1901)
_UG, _PPM, _ARCSEC, _MM = 1e-6 * G0, 1e-6, pi / 648_000, 1e-3
_DEG = pi / 180
_DEG_H = _DEG / 3600  # °/h
_FIELD = 50e-6  # strength of the Earth's field, T
_FORCE = ("fi", "fp", "fo")
# Groups of terms that need temperature soaks, many of them, or a temperature ramp.
_SOAK, _ORDER, _RATE = "temperature", "temperature_order", "temperature_rate"
LARGEST_RELATIVE_SIZE = 0.1  # multiple of the natural size: larger coefficients are implausible
TEMPERATURE_SPAN = 100.0  # difference from the reference temperature for natural sizes, K
TEMPERATURE_RATE = 10 / 60  # temperature rate for natural sizes, K/s

# specific force, angular rate and its derivative along I, P, O; signs of fi and wi; temperature
# difference and temperature rate; magnetic flux density along I, P, O
COMPONENTS = (
    *(letter + axis for letter in "fwa" for axis in "ipo"),
    *("si", "swi", "dT", "dTdt"),
    *("mi", "mp", "mo"),
)


@dataclass(frozen=True)
class Product:
    """A number times motion components: `Product(-1.0, ("wp", "wp"))` is −ω_P²."""

    factor: float
    components: tuple[str, ...]

    def value(self, seen: Mapping[str, Array]) -> Array | float:
        """Return the value of the product, broadcast over the arrays in `seen`."""
        result: Array | float = self.factor
        for name in self.components:
            result = result * seen[name]
        return result

    def derivative(self, name: str) -> "Product | None":
        """Return the derivative with respect to component `name`, or None if it is zero."""
        power = self.components.count(name)
        if power == 0:
            return None
        rest = list(self.components)
        rest.remove(name)
        return Product(self.factor * power, tuple(rest))


@dataclass(frozen=True)
class Basis:
    """A basis function, parsed from text into a sum of products.

    Raises
    ------
    ValueError
        A word in the text is neither a number nor one of `COMPONENTS`.

    Examples
    --------
    >>> Basis("wi wo + ap").derivative("wi")
    (Product(factor=1.0, components=('wo',)),)
    """

    text: str

    @cached_property
    def products(self) -> tuple[Product, ...]:
        """The products that are added."""
        products: list[Product] = []
        for part in self.text.replace("- ", "+ -").split("+ "):
            factor = 1.0
            components: list[str] = []
            for word in part.split():
                name = word.removeprefix("-")
                factor *= -1.0 if word.startswith("-") else 1.0
                if name in COMPONENTS:
                    components.append(name)
                elif name:
                    factor *= float(name)
            products.append(Product(factor, tuple(components)))
        return tuple(products)

    def value(self, seen: Mapping[str, Array]) -> Array | float:
        """Return the value of the basis function for the motion components `seen`."""
        return sum(product.value(seen) for product in self.products)

    def derivative(self, name: str) -> tuple[Product, ...]:
        """Return the products of the derivative with respect to a component; empty if zero."""
        return self._derivatives.get(name, ())

    @cached_property
    def _derivatives(self) -> Mapping[str, tuple[Product, ...]]:
        """The nonzero derivatives, cached because a fit needs them at each evaluation."""
        return {
            name: tuple(d for one in self.products if (d := one.derivative(name)) is not None)
            for name in self._components
        }

    @cached_property
    def _components(self) -> frozenset[str]:
        return frozenset(name for product in self.products for name in product.components)

    def uses(self, *names: str) -> bool:
        """Return whether any of the given components appears."""
        return not self._components.isdisjoint(names)

    def degree(self, *names: str) -> int:
        """Return the largest number of factors from `names` in any product."""
        return max(sum(c in names for c in product.components) for product in self.products)


@dataclass(frozen=True)
class ErrorTerm:
    """One term of an error model."""

    name: str
    symbol: str  # as printed in reports
    unit: str  # as printed in reports
    si: float  # one such unit, in SI
    basis: Basis
    meaning: str
    group: str  # name that selects all terms of its kind in a run file
    # SI size that changes the reading by 1 g (or 1 rad/s) at 1 g, 1 rad/s, `TEMPERATURE_SPAN` from
    # the reference temperature and `TEMPERATURE_RATE`
    unit_scale: float = field(default=1.0)

    @property
    def largest(self) -> float:
        """The largest plausible magnitude, SI."""
        return LARGEST_RELATIVE_SIZE * self.unit_scale

    @property
    def temperature_order(self) -> int:
        """The power of ΔT in the basis function."""
        return self.basis.degree("dT")

    @property
    def without_temperature(self) -> tuple[Product, ...]:
        """The basis function's products without ΔT; equal for terms of the same quantity."""
        return tuple(
            Product(one.factor, tuple(c for c in one.components if c != "dT"))
            for one in self.basis.products
        )


def _table(measures: float, *lines: tuple[str, str, str, float, str, str, str]):
    """Return the table of terms; `measures` is the SI size of one natural unit of the reading."""
    table: list[ErrorTerm] = []
    for name, symbol, unit, si, text, group, meaning in lines:
        basis = Basis(text)
        unit_scale = measures / G0 ** basis.degree(*_FORCE) / TEMPERATURE_SPAN ** basis.degree("dT")
        unit_scale /= _FIELD ** basis.degree("mi", "mp", "mo")
        unit_scale /= TEMPERATURE_RATE ** basis.degree("dTdt")
        table.append(ErrorTerm(name, symbol, unit, si, basis, meaning, group, unit_scale))
    return tuple(table)


ACCELEROMETER: tuple[ErrorTerm, ...] = _table(
    G0,
    ("k0", "K₀", "µg", _UG, "1", "bias", "bias"),
    ("k1", "K₁−1", "ppm", _PPM, "fi", "scale", "scale-factor error"),
    ("delta_o", "δ_O", "″", _ARCSEC, "fp", "misalignment", "misalignment about O"),
    ("delta_p", "δ_P", "″", _ARCSEC, "-fo", "misalignment", "misalignment about P"),
    ("k2", "K₂", "µg/g²", _UG / G0**2, "fi fi", "nonlinearity", "second-order nonlinearity"),
    ("k3", "K₃", "µg/g³", _UG / G0**3, "fi fi fi", "nonlinearity", "third-order nonlinearity"),
    ("koq", "K_oq", "µg/g²", _UG / G0**2, "si fi fi", "asymmetry", "odd quadratic nonlinearity"),
    ("k0_prime", "K₀′", "µg", _UG, "0.5 si", "asymmetry", "bias asymmetry"),
    ("k1_prime", "K₁′", "ppm", _PPM, "0.5 si fi", "asymmetry", "scale-factor asymmetry"),
    ("kip", "K_ip", "µg/g²", _UG / G0**2, "fi fp", "cross", "cross-axis nonlinearity I–P"),
    ("kio", "K_io", "µg/g²", _UG / G0**2, "fi fo", "cross", "cross-axis nonlinearity I–O"),
    ("kpo", "K_po", "µg/g²", _UG / G0**2, "fp fo", "cross", "cross-coupling P–O"),
    ("kpp", "K_pp", "µg/g²", _UG / G0**2, "fp fp", "cross", "cross-axis nonlinearity P–P"),
    ("koo", "K_oo", "µg/g²", _UG / G0**2, "fo fo", "cross", "cross-axis nonlinearity O–O"),
    ("kspin", "K_spin", "µg/(rad/s)²", _UG, "wi wp", "rotation", "spin-offset coefficient"),
    ("kang", "K_ang", "µg/(rad/s²)", _UG, "ao", "rotation", "angular-acceleration coefficient"),
    ("arm_i", "r_I", "mm", _MM, "-wp wp - wo wo", "arm", "lever arm along I"),
    ("arm_p", "r_P", "mm", _MM, "wi wp - ao", "arm", "lever arm along P"),
    ("arm_o", "r_O", "mm", _MM, "wi wo + ap", "arm", "lever arm along O"),
    ("k0_dT", "K₀,T", "µg/K", _UG, "dT", _SOAK, "bias temperature coefficient"),
    ("k0_dT2", "K₀,TT", "µg/K²", _UG, "dT dT", _SOAK, "bias, second order in temperature"),
    ("k1_dT", "K₁,T", "ppm/K", _PPM, "fi dT", _SOAK, "scale-factor temperature coefficient"),
    ("k2_dT", "K₂,T", "µg/g²/K", _UG / G0**2, "fi fi dT", _SOAK, "k2 against temperature"),
    ("k0_dT3", "K₀,TTT", "µg/K³", _UG, "dT dT dT", _ORDER, "bias, third order in temperature"),
    ("k1_dT2", "K₁,TT", "ppm/K²", _PPM, "fi dT dT", _ORDER, "scale, second order in temperature"),
    ("delta_o_dT", "δ_O,T", "″/K", _ARCSEC, "fp dT", _ORDER, "misalignment O against temperature"),
    ("delta_p_dT", "δ_P,T", "″/K", _ARCSEC, "-fo dT", _ORDER, "misalignment P against temperature"),
    ("k0_dTdt", "K₀,Ṫ", "µg/(K/min)", _UG * 60, "dTdt", _RATE, "bias against temperature rate"),
)

GYRO: tuple[ErrorTerm, ...] = _table(
    1.0,
    ("bias", "ε", "°/h", _DEG_H, "1", "bias", "bias"),
    ("scale", "κ", "ppm", _PPM, "wi", "scale", "scale-factor error"),
    ("delta_o", "δ_O", "″", _ARCSEC, "wp", "misalignment", "misalignment about O"),
    ("delta_p", "δ_P", "″", _ARCSEC, "-wo", "misalignment", "misalignment about P"),
    ("g_i", "D_I", "°/h/g", _DEG_H / G0, "fi", "g", "g-sensitivity along I"),
    ("g_p", "D_P", "°/h/g", _DEG_H / G0, "fp", "g", "g-sensitivity along P"),
    ("g_o", "D_O", "°/h/g", _DEG_H / G0, "fo", "g", "g-sensitivity along O"),
    ("g_ii", "D_II", "°/h/g²", _DEG_H / G0**2, "fi fi", "g2", "g²-sensitivity I–I"),
    ("g_pp", "D_PP", "°/h/g²", _DEG_H / G0**2, "fp fp", "g2", "g²-sensitivity P–P"),
    ("g_oo", "D_OO", "°/h/g²", _DEG_H / G0**2, "fo fo", "g2", "g²-sensitivity O–O"),
    ("g_ip", "D_IP", "°/h/g²", _DEG_H / G0**2, "fi fp", "g2", "g²-sensitivity I–P"),
    ("g_io", "D_IO", "°/h/g²", _DEG_H / G0**2, "fi fo", "g2", "g²-sensitivity I–O"),
    ("g_po", "D_PO", "°/h/g²", _DEG_H / G0**2, "fp fo", "g2", "g²-sensitivity P–O"),
    ("scale2", "κ₂", "ppm/(rad/s)", _PPM, "wi wi", "nonlinearity", "second-order nonlinearity"),
    ("scale3", "κ₃", "ppm/(rad/s)²", _PPM, "wi wi wi", "nonlinearity", "third-order nonlinearity"),
    ("scale_prime", "κ′", "ppm", _PPM, "0.5 swi wi", "asymmetry", "scale-factor asymmetry"),
    ("bias_dT", "ε_T", "°/h/K", _DEG_H, "dT", _SOAK, "bias temperature coefficient"),
    ("scale_dT", "κ_T", "ppm/K", _PPM, "wi dT", _SOAK, "scale temperature coefficient"),
    ("bias_dT2", "ε_TT", "°/h/K²", _DEG_H, "dT dT", _ORDER, "bias, second order in temperature"),
    ("bias_dT3", "ε_TTT", "°/h/K³", _DEG_H, "dT dT dT", _ORDER, "bias, third order in temperature"),
    ("scale_dT2", "κ_TT", "ppm/K²", _PPM, "wi dT dT", _ORDER, "scale, second order in temperature"),
    ("delta_o_dT", "δ_O,T", "″/K", _ARCSEC, "wp dT", _ORDER, "misalignment O against temperature"),
    ("delta_p_dT", "δ_P,T", "″/K", _ARCSEC, "-wo dT", _ORDER, "misalignment P against temperature"),
    (
        "bias_dTdt",
        "ε_Ṫ",
        "°/h/(K/min)",
        _DEG_H * 60,
        "dTdt",
        _RATE,
        "bias against temperature rate",
    ),
)

MAGNETOMETER: tuple[ErrorTerm, ...] = _table(
    _FIELD,
    ("bias", "o", "µT", 1e-6, "1", "bias", "hard iron and bias"),
    ("scale", "κ", "%", 0.01, "mi", "scale", "scale factor and soft iron along I"),
    ("delta_o", "δ_O", "°", _DEG, "mp", "misalignment", "misalignment and soft iron towards P"),
    ("delta_p", "δ_P", "°", _DEG, "-mo", "misalignment", "misalignment and soft iron towards −O"),
    ("bias_dT", "o_T", "nT/K", 1e-9, "dT", _SOAK, "bias temperature coefficient"),
    ("scale_dT", "κ_T", "ppm/K", _PPM, "mi dT", _SOAK, "scale temperature coefficient"),
)

SI_UNITS = {  # SI sizes of the printed units
    "µg": "m/s²",
    "ppm": "1",
    "″": "rad",
    "µg/g²": "(m/s²)⁻¹",
    "µg/g³": "(m/s²)⁻²",
    "µg/(rad/s)²": "(m/s²)/(rad/s)²",
    "µg/(rad/s²)": "(m/s²)/(rad/s²)",
    "mm": "m",
    "µg/K": "(m/s²)/K",
    "µg/K²": "(m/s²)/K²",
    "ppm/K": "1/K",
    "µg/g²/K": "(m/s²)⁻¹/K",
    "°/h": "rad/s",
    "°/h/g": "(rad/s)/(m/s²)",
    "°/h/g²": "(rad/s)/(m/s²)²",
    "ppm/(rad/s)": "(rad/s)⁻¹",
    "ppm/(rad/s)²": "(rad/s)⁻²",
    "°/h/K": "(rad/s)/K",
    "µg/K³": "(m/s²)/K³",
    "ppm/K²": "1/K²",
    "″/K": "rad/K",
    "µg/(K/min)": "(m/s²)/(K/s)",
    "°/h/K²": "(rad/s)/K²",
    "°/h/K³": "(rad/s)/K³",
    "µT": "T",
    "nT/K": "T/K",
    "%": "1",
    "°": "rad",
    "°/h/(K/min)": "(rad/s)/(K/s)",
}
TABLES = {"f": ACCELEROMETER, "w": GYRO, "m": MAGNETOMETER}
TERMS = {kind: {term.name: term for term in table} for kind, table in TABLES.items()}
# SI size and name of the bias unit, by kind of axis.
BIAS_UNITS = {kind: (table[0].si, table[0].unit) for kind, table in TABLES.items()}
GROUPS = tuple(dict.fromkeys(c.group for table in TABLES.values() for c in table))
