"""Basis functions as data: sums of products of the components of motion at an axis.

The components are those along its input (I), pendulous (P) and output (O) axes. A basis function is
written as text, `"fi fp"`, `"-wp wp - wo wo"`, `"0.5 si fi"`: this declaration gives its value, its
exact derivatives and its formula in a report.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from inercal.basics.arrays import Array

# specific force, rate and its derivative along I, P, O; signs of fi and wi; temperature difference
# and rate of the temperature
COMPONENTS = ("fi", "fp", "fo", "wi", "wp", "wo", "ai", "ap", "ao", "si", "swi", "dT", "dTdt")


@dataclass(frozen=True)
class Product:
    """A number times components of the motion: `Product(-1.0, ("wp", "wp"))` is −ω_P²."""

    factor: float
    components: tuple[str, ...]

    def value(self, seen: Mapping[str, Array]) -> Array | float:
        """Return the product, broadcast over the arrays of `seen`."""
        result: Array | float = self.factor
        for name in self.components:
            result = result * seen[name]
        return result

    def derivative(self, name: str) -> "Product | None":
        """Return the derivative to component `name`, None where it is zero."""
        power = self.components.count(name)
        if power == 0:
            return None
        rest = list(self.components)
        rest.remove(name)
        return Product(self.factor * power, tuple(rest))


@dataclass(frozen=True)
class Basis:
    """A sum of products, parsed from text.

    Raises
    ------
    ValueError
        A word of the text is neither a number nor one of `COMPONENTS`.

    Examples
    --------
    >>> Basis("wi wo + ap").derivative("wi")
    (Product(factor=1.0, components=('wo',)),)
    """

    text: str

    @cached_property
    def products(self) -> tuple[Product, ...]:
        """The products of the sum."""
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
        """Return the basis function at the motion `seen`."""
        return sum(product.value(seen) for product in self.products)

    def derivative(self, name: str) -> tuple[Product, ...]:
        """Return the products of the derivative to one component; empty where it is zero."""
        return self._derivatives.get(name, ())

    @cached_property
    def _derivatives(self) -> Mapping[str, tuple[Product, ...]]:
        """Those that are not zero: a fit asks for them at each evaluation."""
        return {
            name: tuple(d for one in self.products if (d := one.derivative(name)) is not None)
            for name in self._components
        }

    @cached_property
    def _components(self) -> frozenset[str]:
        return frozenset(name for product in self.products for name in product.components)

    def uses(self, *names: str) -> bool:
        """Return whether any of the components appears."""
        return not self._components.isdisjoint(names)

    def degree(self, *names: str) -> int:
        """Return the highest number of factors among `names` in one product."""
        return max(sum(c in names for c in product.components) for product in self.products)
