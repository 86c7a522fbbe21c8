"""Unknowns of the closure's equations: all of them, or those that a symmetry leaves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.linalg import block_diag

from loops.arrays import Floats
from loops.symmetry import PointGroup, invariant_fields

Kind = Literal["affine", "ring", "saddle"]


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What the numbers `z` (r,) of a solve stand for.

    `fields` (8 + m, r): Displacement gradient, stress over `kn` and what else moves, one column
    for each number: displacements of the centres over the length scale, free spins times radii, or
    a ring's redundant force; `strains`: The first numbers are strains, as many stresses follow;
    `rows` (r - strains, 4 + m): Combinations of the closure's equations that say all there is to
    say of these fields. Fields and rows are None where they are the whole.
    """

    strains: int
    count: int
    fields: Floats | None = None
    rows: Floats | None = None

    def of(self, equations: Floats) -> Floats:
        """The closure's equations (4 + m, 8 + m) for these numbers."""
        if self.rows is None or self.fields is None:
            return equations
        return np.asarray(self.rows @ equations @ self.fields)

    @cached_property
    def tensors(self) -> Floats:
        """(8, r) `H` and `P` per number."""
        return np.eye(8, self.count) if self.fields is None else self.fields[:8]

    def values(self, z: Floats) -> Floats:
        """(8 + m,) the fields themselves."""
        return z if self.fields is None else self.fields @ z


def symmetric_unknowns(
    kind: Kind, group: PointGroup, character: Floats, free_spins: bool
) -> Unknowns:
    """Those fields alone that every element of a group multiplies by its character.

    With the character 1 these are the fields that the symmetry leaves as they are: spins turn their
    sign in a mirror, so they vanish on its axis and are tied off it.
    """
    sign = character * group.parity
    alone = np.zeros((group.order, 1), dtype=np.int64)
    pairs = np.einsum("s,sik,sjl->sijkl", character, group.maps, group.maps).reshape(-1, 4, 4)
    tensor = invariant_fields(alone, pairs)[0]
    moving = []
    if kind == "saddle":
        place = invariant_fields(group.grains, character[:, None, None] * group.maps)
        moving.append(place.reshape(-1, place.shape[2]))
    if kind == "ring":
        # Read against the contact's direction, which a mirror turns round.
        moving.append(invariant_fields(alone, sign[:, None, None] * group.maps)[0])
    elif free_spins:
        moving.append(invariant_fields(group.grains, sign[:, None, None])[:, 0])
    # The equations change as the fields do: strain or stress, then balance and moments.
    rows, fields = block_diag(tensor, *moving).T, block_diag(tensor, tensor, *moving)
    return Unknowns(tensor.shape[1], fields.shape[1], fields, rows)


@dataclass(frozen=True, eq=False)
class UnknownSets:
    """The unknowns of one kind of equations that a model needs.

    `kind`: Equations; `moving`: Number m of unknowns besides strain and stress; `free_spins`:
    Whether spins are unknown; `group`: Symmetry of state and control that the path keeps.
    """

    kind: Kind
    moving: int
    free_spins: bool
    group: PointGroup | None

    @cached_property
    def everything(self) -> Unknowns:
        """Without symmetry."""
        return Unknowns(4, 8 + self.moving)

    @property
    def used(self) -> PointGroup | None:
        """The symmetry, where it helps.

        The affine closure without free spins has eight unknowns at any length, and nothing in it
        relaxes: leaving some out costs more than it saves. A ring has ten; without its redundant
        force it passes the states in which that is not determined.
        """
        return self.group if self.moving else None

    @cached_property
    def rates(self) -> Unknowns:
        """For the rates of the path, which are as symmetric as its state."""
        if self.used is None:
            return self.everything
        ones = np.ones(self.used.order)
        return symmetric_unknowns(self.kind, self.used, ones, self.free_spins)

    @cached_property
    def tangent(self) -> tuple[Unknowns, ...]:
        """For all four columns of the tangent, in blocks that do not mix.

        Mirrors in the axes keep `H11` and `H22` and turn the sign of `H12` and `H21`: the fields
        of either kind answer to themselves alone, so both blocks together are the full tangent.
        """
        if self.used is None:
            return (self.everything,)
        axes = self.used.along_axes()
        if axes.order == 1:
            return (self.everything,)
        even = self.rates
        if axes.order < self.used.order:
            even = symmetric_unknowns(self.kind, axes, np.ones(axes.order), self.free_spins)
        if (axes.parity > 0).all():
            return (even,)
        return even, symmetric_unknowns(self.kind, axes, axes.parity, self.free_spins)
