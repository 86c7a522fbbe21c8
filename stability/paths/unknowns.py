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
    """What the numbers `z` (r,) of a solve stand for, one column of each field per number.

    `H`, `P` (4, r): Displacement gradient, and stress over `kn`; `u` (G, 2, r): Displacements of
    the centres over the length scale, in the saddle system; `w` (G, r): Spins, where they are free;
    `force` (2, r): The ring's redundant force over `kn` times length; `strains`: The first columns
    of `H`; as many of `P` follow; `rows` (r - strains, R): Combinations of the R closure equations
    that say all there is to say of these fields; None for all equations.
    """

    H: Floats
    P: Floats
    u: Floats
    w: Floats
    force: Floats
    strains: int
    rows: Floats | None

    @property
    def count(self) -> int:
        """Number of unknowns r."""
        return self.H.shape[1]


def all_unknowns(kind: Kind, grains: int, free_spins: bool) -> Unknowns:
    """Every component, place and spin by itself."""
    place = np.eye(2 * grains if kind == "saddle" else 0)
    return _gathered(
        np.eye(4),
        place.reshape(len(place) // 2, 2, len(place)),
        np.eye(grains) if free_spins and kind != "ring" else np.zeros((grains, 0)),
        np.eye(2) if kind == "ring" else np.zeros((2, 0)),
    )


def symmetric_unknowns(
    kind: Kind, group: PointGroup, character: Floats, free_spins: bool
) -> Unknowns:
    """Those fields alone that every element of a group multiplies by its character.

    With the character 1 these are the fields that the symmetry leaves as they are: spins turn their
    sign in a mirror, so they vanish on its axis and are tied off it.
    """
    grains, sign = group.grains.shape[1], character * group.parity
    alone = np.zeros((group.order, 1), dtype=np.int64)
    pairs = np.einsum("s,sik,sjl->sijkl", character, group.maps, group.maps).reshape(-1, 4, 4)
    place, spin = np.zeros((0, 2, 0)), np.zeros((grains, 0))
    force = np.zeros((2, 0))
    if kind == "saddle":
        place = invariant_fields(group.grains, character[:, None, None] * group.maps)
    if kind == "ring":
        # Read against the contact's direction, which a mirror turns round.
        force = invariant_fields(alone, sign[:, None, None] * group.maps)[0]
    if free_spins and kind != "ring":
        spin = invariant_fields(group.grains, sign[:, None, None])[:, 0]
    tensor = invariant_fields(alone, pairs)[0]
    # The equations change as the fields do: balance, closure, moments.
    balance = {
        "affine": [],
        "ring": [force],
        "saddle": [place.reshape(2 * len(place), place.shape[2])],
    }
    parts = [*balance[kind], tensor, *([spin] if free_spins else [])]
    rows = np.asarray(block_diag(*[part.T for part in parts]))
    return _gathered(tensor, place, spin, force, rows)


@dataclass(frozen=True, eq=False)
class UnknownSets:
    """The unknowns of one kind of equations that a model needs.

    `kind`: Equations; `grains`: Number of grains; `free_spins`: Whether spins are unknown; `group`:
    Symmetry of state and control that the path keeps.
    """

    kind: Kind
    grains: int
    free_spins: bool
    group: PointGroup | None

    @cached_property
    def everything(self) -> Unknowns:
        """Without symmetry."""
        return all_unknowns(self.kind, self.grains, self.free_spins)

    @property
    def used(self) -> PointGroup | None:
        """The symmetry, where it helps.

        The affine closure without free spins has eight unknowns at any length, and nothing in it
        relaxes: leaving some out costs more than it saves. A ring has ten; without its redundant
        force it passes the states in which that is not determined.
        """
        return None if self.kind == "affine" and not self.free_spins else self.group

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


def _gathered(
    tensor: Floats, place: Floats, spin: Floats, force: Floats, rows: Floats | None = None
) -> Unknowns:
    """Fields side by side: strains, stresses, redundant force, displacements, spins."""
    widths = [tensor.shape[1]] * 2 + [force.shape[1], place.shape[2], spin.shape[1]]
    ends = np.cumsum(widths)
    at = [slice(end - width, end) for end, width in zip(ends, widths, strict=True)]
    H, P, f = np.zeros((4, ends[-1])), np.zeros((4, ends[-1])), np.zeros((2, ends[-1]))
    u, w = np.zeros((len(place), 2, ends[-1])), np.zeros((len(spin), ends[-1]))
    H[:, at[0]], P[:, at[1]], f[:, at[2]], u[:, :, at[3]], w[:, at[4]] = (
        tensor, tensor, force, place, spin
    )  # fmt: skip
    return Unknowns(H, P, u, w, f, widths[0], rows)
