"""Point symmetry of a loop: rotations and mirrors that leave its state unchanged."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Flags, Floats, Integers

# Rounding of coordinates and forces, over their size: a state further from symmetric than this is
# not symmetric. A perturbation of 1e-12 is no rounding.
SYMMETRY_RTOL = 64 * float(np.finfo(float).eps)
# Entries of a map this close to -1, 0 or 1 are rounded to these.
AXIS_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False)
class PointGroup:
    """Permutations of grains and contacts, each with the orthogonal map that goes with it.

    Element s sends grain g to `grains[s, g]`, at `maps[s] x_g` about the centre of the loop, and
    contact c to `contacts[s, c]`. A rotation keeps `T`, a mirror turns its sign (`N` stays), in
    whichever direction the contact is listed.
    """

    grains: Integers
    contacts: Integers
    maps: Floats

    @property
    def order(self) -> int:
        """Number of elements S."""
        return len(self.maps)

    @cached_property
    def parity(self) -> Floats:
        """(S,) +1 for a rotation, -1 for a mirror: the sign of `T` and of spins under it."""
        return np.asarray(np.sign(np.linalg.det(self.maps)), dtype=float)

    @property
    def name(self) -> str:
        """Schoenflies' name in the plane: 'C1', 'C3' (rotations), 'D1', 'D4' (mirrors too)."""
        rotations = int((self.parity > 0).sum())
        return f"{'C' if rotations == self.order else 'D'}{rotations}"

    @cached_property
    def contact_orbits(self) -> Integers:
        """(C,) first contact of the orbit of each contact."""
        return np.asarray(self.contacts.min(axis=0))

    @cached_property
    def contact_parity(self) -> Floats:
        """(C,) sign of `T` relative to the first contact of the orbit.

        0 where a mirror sends the contact to itself, so that `T` vanishes.
        """
        here = self.contacts[:, self.contact_orbits] == np.arange(self.contacts.shape[1])
        return np.asarray((self.parity[:, None] * here).sum(axis=0) / here.sum(axis=0))

    def only(self, chosen: Flags) -> PointGroup:
        """Some of the elements, (S,): a subgroup if they are closed under product."""
        return PointGroup(self.grains[chosen], self.contacts[chosen], self.maps[chosen])

    def along_axes(self) -> PointGroup:
        """The subgroup that sends axis 1 to itself: mirrors in the axes and the half turn."""
        return self.only((self.maps[:, 0, 1] == 0.0) & (self.maps[:, 1, 0] == 0.0))


def point_group(
    configurations: Sequence[Floats],
    contacts: Integers,
    radii: Floats,
    *,
    even: Sequence[ArrayLike] = (),
    odd: Sequence[ArrayLike] = (),
) -> PointGroup:
    """Point group of configurations of a ring with chords, taken together.

    The 2 n candidates are the turns and reversals of the ring; each fixes its map.
    """
    count = len(radii)
    ring = np.column_stack([np.arange(count), np.roll(np.arange(count), -1)])
    if count < 3 or len(contacts) < count or (contacts[:count] != ring).any():
        return identity(count, len(contacts))
    # (2 n, n): the turns of the ring, then its reversals.
    grain, turn = np.arange(count), np.arange(count)[:, None]
    grains = np.concatenate([(turn + grain) % count, (turn - grain) % count])
    mirrored = np.arange(2 * count) >= count
    kept = _same(radii[grains], radii, np.abs(radii).max())
    grains, mirrored = grains[kept], mirrored[kept]
    centred = [np.asarray(x - x.mean(axis=0)) for x in configurations]
    # (S, 2, 2) rotation, or mirror, that brings the centres closest to their images.
    z = centred[0][:, 0] + 1j * centred[0][:, 1]
    turned = np.where(mirrored, z[grains] @ z, z[grains] @ z.conj())
    size = np.abs(turned)
    turned = np.where(size > 0, turned / np.where(size > 0, size, 1.0), 1.0)
    c, s, sign = turned.real, turned.imag, np.where(mirrored, -1.0, 1.0)
    maps = np.stack([c, -sign * s, s, sign * c], axis=-1).reshape(-1, 2, 2)
    nearest = np.rint(maps)
    maps = np.where(np.abs(maps - nearest) <= AXIS_ROUNDING, nearest, maps) + 0.0
    kept = np.ones(len(grains), dtype=bool)
    for x in centred:
        image = np.einsum("sij,gj->sgi", maps, x)
        gap = (x[grains] - image).reshape(len(maps), -1)
        kept &= _same(gap, np.zeros_like(gap), float(np.abs(x).max()))
    # (S, C) contact between the images of each contact's grains, if all exist.
    keys = contacts.min(axis=1) * count + contacts.max(axis=1)
    order = np.argsort(keys)
    i, j = grains[:, contacts[:, 0]], grains[:, contacts[:, 1]]
    wanted = np.minimum(i, j) * count + np.maximum(i, j)
    images = order[np.minimum(np.searchsorted(keys[order], wanted), len(keys) - 1)]
    kept &= (keys[images] == wanted).all(axis=1)
    group = PointGroup(grains[kept], images[kept], maps[kept])
    for values in even:
        group = group.only(_keeps(group, np.asarray(values, dtype=float), np.ones(group.order)))
    for values in odd:
        group = group.only(_keeps(group, np.asarray(values, dtype=float), group.parity))
    return group


def identity(grains: int, contacts: int) -> PointGroup:
    """The group of the identity alone, for so many grains and contacts."""
    return PointGroup(np.arange(grains)[None], np.arange(contacts)[None], np.eye(2)[None])


def invariant_fields(places: Integers, action: Floats) -> Floats:
    """Orthonormal basis of the fields that a group leaves unchanged.

    A field has m numbers at each of I places; element s takes them to the place `places[s]` and
    applies `action[s]`. The basis spans the group average, orbit by orbit: at one place of an
    orbit, the vectors unchanged by the elements that fix it; at its images, their images.
    """
    items, width = places.shape[1], action.shape[-1]
    fields = [np.zeros((items, width, 0))]
    for first in np.unique(places.min(axis=0)):
        here = action[places[:, first] == first]
        values, vectors = np.linalg.eigh(here.mean(axis=0))
        kept = vectors[:, values > 0.5]
        field = np.zeros((items, width, kept.shape[1]))
        field[places[:, first]] = action @ kept
        fields.append(field / np.sqrt(len(np.unique(places[:, first]))))
    return np.concatenate(fields, axis=-1)


def _keeps(group: PointGroup, values: Floats, parity: Floats) -> Flags:
    finite = np.abs(values[np.isfinite(values)])
    return _same(values[group.contacts], parity[:, None] * values, finite.max(initial=1.0))


def _same(a: Floats, b: Floats, size: float) -> Flags:
    """(S,) rows that agree up to rounding of numbers of that size."""
    with np.errstate(invalid="ignore"):
        equal = (a == b) | (np.abs(a - b) <= SYMMETRY_RTOL * size)
    return np.asarray(equal.all(axis=-1))
