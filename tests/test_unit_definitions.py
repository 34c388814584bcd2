"""The table of units against a pint registry of the same definitions."""

import itertools
import random
from typing import Any

import pint
import pytest
from numpy.testing import assert_allclose
from pint.util import UnitsContainer

from inercal.basics.errors import InputError
from inercal.basics.units import si_factor
from inercal.basics.units.expression import PREFIXES, UNITS, canonical_name, size_and_dimension

PREFIXED = [prefix + name for name, unit in UNITS.items() for prefix in ("", *unit.prefixes)]


@pytest.fixture(scope="module")
def registry() -> Any:
    lines = [f"{prefix}- = {size!r}" for prefix, size in PREFIXES.items()]
    for name, unit in UNITS.items():
        powers = "".join(f" * {other}**{power}" for other, power in unit.powers.items())
        size = f"[{unit.dimension}]" if unit.dimension else f"{unit.size!r}{powers}"
        lines.append(" = ".join((name, size, "_", *unit.names[1:])))
    make: Any = pint.UnitRegistry
    return make(lines)


@pytest.mark.slow
def test_products_of_powers_have_the_size_and_dimension_that_pint_finds(registry: Any):
    rng = random.Random(0)
    for _ in range(2_000):
        powers = {rng.choice(PREFIXED): rng.choice([-3, -2, -1, -0.5, 0.5, 1, 2, 3])
                  for _ in range(rng.randint(1, 4))}  # fmt: skip
        size, dimension = size_and_dimension(powers)
        peer, _ = registry.get_base_units(UnitsContainer(powers))
        assert_allclose(size, float(peer), rtol=1e-15)
        known = registry.get_dimensionality(UnitsContainer(powers))
        assert dimension == {name.strip("[]"): float(power) for name, power in known.items()}


def test_every_name_with_its_prefixes_and_plural_is_a_unit():
    for name, unit in UNITS.items():
        for spelling, prefix in itertools.product(unit.names, ("", *unit.prefixes)):
            assert canonical_name(prefix + spelling) == prefix + name
            if len(spelling) > 1:
                assert canonical_name(prefix + spelling + "s") == prefix + name
    assert canonical_name("ug") == canonical_name("µg") == "µg"


@pytest.mark.parametrize("name", ["mms", "kms", "gs", "Mg", "kg", "nrpm", "", "s s", "meterss"])
def test_other_names_and_prefixes_are_unknown_whatever_was_read_before(name: str):
    assert si_factor("mm") == 1e-3
    assert canonical_name(name) is None


def test_a_size_beyond_all_numbers_is_refused():
    with pytest.raises(InputError, match="is not a unit"):
        si_factor("km^9·km^9·" + "·".join(["km^9"] * 9))
    with pytest.raises(InputError, match="is not a unit"):
        si_factor("/".join(["nm^9"] * 2) + "/km^9/km^9/rev^9/rev^9/h^9/h^9/µs^-9")
