"""List other orders and signs of columns, to find columns that are exchanged or reversed."""

from itertools import permutations, product
from json import dumps
from typing import NamedTuple

import numpy as np

from inercal.basics.arrays import Array


class SignedPermutation(NamedTuple):
    """Another order of columns, each with a sign: new[i] = signs[i] · old[order[i]]."""

    order: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def is_identity(self) -> bool:
        """Whether order and signs are unchanged."""
        return self.order == tuple(range(len(self.order))) and min(self.signs) > 0

    def reorder(self, columns: Array) -> Array:
        """Return the columns (..., k) in this order with these signs."""
        return columns[..., list(self.order)] * np.array(self.signs, dtype=float)

    def signed_names(self, names: tuple[str, ...]) -> str:
        """Return the names of the columns in this order, with signs as in a run file."""
        each = (
            names[k] if sign > 0 else names[k][1:] if names[k].startswith("-") else f"-{names[k]}"
            for k, sign in zip(self.order, self.signs, strict=True)
        )
        return dumps(list(each), ensure_ascii=False)


def identity_permutation(k: int) -> SignedPermutation:
    """Return the permutation that leaves k columns unchanged."""
    return SignedPermutation(tuple(range(k)), (1,) * k)


def signed_permutations(k: int) -> tuple[SignedPermutation, ...]:
    """Return all orders and signs of k columns, starting with the identity."""
    return tuple(
        SignedPermutation(o, s) for o in permutations(range(k)) for s in product((1, -1), repeat=k)
    )
