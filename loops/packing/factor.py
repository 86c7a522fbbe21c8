"""Factorisation of a packing's system, through its null vectors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from loops.arrays import Floats
from loops.errors import InputError
from loops.packing.system import PackingSystem, assembled

# Added to the diagonal, times the typical stiffness: gear modes and mechanisms get a stiffness of
# their own that changes no other answer. No sign changed between 1e-9 and 1e-5.
REGULARISATION = 1e-7
# A refinement gains three to four digits where nothing is singular; this is where it ends.
ROUNDING = 1e-15
# SuperLU solves fastest in panels of a few right-hand sides.
PANEL = 4


class Factors(Protocol):
    """What solves with a matrix."""

    def solve(self, rhs: Floats, /) -> Floats:
        """(size,) or (size, k) solutions."""
        ...


@dataclass(frozen=True, eq=False)
class UpdatedFactors:
    """Factors of `K - P G` from those of `K`: `change` (size, k) is `K^-1 P (1 - G K^-1 P)^-1`."""

    lu: Factors
    change: Floats
    gauge: sparse.csr_array

    def solve(self, rhs: Floats, /) -> Floats:
        """(size,) or (size, k) solutions (Woodbury)."""
        v = self.lu.solve(rhs)
        return np.asarray(v + self.change @ (self.gauge @ v))


@dataclass(frozen=True, eq=False)
class Factor:
    """`K`, and the LU factors of `K + eps`, one grain of each free component held."""

    matrix: sparse.csc_array
    lu: Factors

    def solve(self, loads: Floats, *, refinements: int = 8) -> Floats:
        """(size,) or (size, k) solutions; refinement takes the regularisation out again."""
        v = self._panels(loads)
        goal, before = ROUNDING * np.linalg.norm(loads), np.inf
        for _ in range(refinements):
            left = loads - self.matrix @ v
            # Loads that a mechanism doesn't carry don't get smaller, its motion only larger.
            size = float(np.linalg.norm(left))
            if size <= goal or size > 0.5 * before:
                break
            before = size
            v += self._panels(left)
        return v

    def _panels(self, loads: Floats) -> Floats:
        if loads.ndim == 1:
            return self.lu.solve(loads)
        out = np.empty(loads.shape, order="F")
        for start in range(0, loads.shape[1], PANEL):
            part = slice(start, start + PANEL)
            out[:, part] = self.lu.solve(np.asfortranarray(loads[:, part]))
        return out


def regularised(
    system: PackingSystem, matrix: sparse.csc_array, eps: float = REGULARISATION
) -> sparse.csc_array:
    """`K + eps unit`, and the anchors' translations on springs that carry nothing."""
    diagonal = np.full(system.size, eps * system.unit)
    diagonal[system.freedom[system.carrying.anchors, :2].ravel()] += system.unit
    return (matrix + sparse.diags_array(diagonal)).tocsc()


def factorised(
    system: PackingSystem, stiffness: Floats | None = None, eps: float = REGULARISATION
) -> Factor:
    """Factorise the system, with `stiffness` (E, 4, 4) in place of its own if given."""
    matrix = assembled(system, stiffness)
    options = {"SymmetricMode": True}
    try:
        lu = splu(
            regularised(system, matrix, eps),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.001,
            options=options,
        )
    except RuntimeError as error:
        raise InputError(
            "packing", "a singular system", "contacts that hold the grains", f"SuperLU: {error}."
        ) from error
    return Factor(matrix, lu)
