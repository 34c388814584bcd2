"""Basis functions as data: sums of products of the motion components at an axis.

The components are those along the input (I), pendulous (P) and output (O) axes. A basis function is
written as text, such as `"fi fp"`, `"-wp wp - wo wo"` or `"0.5 si fi"`. Its value, its exact
derivatives and its formula in a report are all derived from this text.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from inercal.basics.arrays import Array

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
