"""Constants of a path: contacts, reference, law, closure, scales, unknowns of the equations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from loops import ContactLaw, GrainGraph, InputError, Regime, boundary_vectors, polygon_area
from loops.arrays import Flags, Floats, Integers
from loops.closures import Closure, Spins
from loops.closures.system import ClosureForm, closure_form
from loops.geometry import from_centroid, outward, reference_volume, require_loop
from loops.graph import ContactState
from loops.laws.compiled import pressed_contacts
from loops.laws.of_pairs import require_linear_forces
from loops.symmetry import PointGroup, invariant_fields
from stability.path import WORK_TERMS

# Rounding of coordinates, in units of r_i + r_j: gaps within it are none.
JUST_TOUCHING = 8 * float(np.finfo(float).eps)
# Largest accepted mismatch of the initial forces: N against that of the overlaps in units of
# kn (r_i + r_j), T beyond its strength in units of kn times length, branch vectors over length.
START_MISMATCH = 1e-9


@dataclass(frozen=True, eq=False)
class Unknowns:
    """Unknown numbers `z` (r,) of a solve: t strains, as many stresses, the rest.

    `fields` (8 + m, r): For each number a displacement gradient, a stress over `kn` and the rest:
    displacements of the centres over the length scale, free spins times radii; `rows`
    (r - t, 4 + m): Combinations of the closure's equations that determine these fields.
    """

    fields: Floats
    rows: Floats

    @property
    def strains(self) -> int:
        """Number t of strains."""
        return self.fields.shape[1] - len(self.rows)


def all_unknowns(moving: int) -> Unknowns:
    """Strain, stress and `moving` numbers besides, without symmetry."""
    return Unknowns(np.eye(8 + moving), np.eye(4 + moving))


@dataclass(frozen=True, eq=False)
class PathModel:
    """Constants of a path.

    It integrates a vector `y` of Y variables: `places` of the grains (displacement gradient `H`
    under the affine closure, else displacements of the centres, small ones of which keep their
    digits), shear forces of the contacts, loading parameter and `WORK_TERMS`, both counted from the
    start.

    `law`: Contact law; `closure`, `spins`: Closure and spin rule; `contacts` (C, 2): Grains i and
    j; `x0` (G, 2): Reference centres; `d0` (C, 2): Reference branch vectors; `radii` (G,): Radii;
    `volume`: Reference area V0 that the stress refers to; `b`, `m` (G, 2): Boundary vectors of the
    polygon and the outward normals of its edges' midpoints `R (x0_c + x0_{c+1})/2`, times V0 over
    the polygon's area: with `F_i = -P b_i` the stress `P` is that of `V0`. Empty under the affine
    closure; `first_place`: Places of the initial graph; `watches_pairs`: Whether
    grains without a contact are watched for touching: not in a periodic cell, where images could
    touch too; `met` (Q,): Pairs, see `pair_keys`, that are in contact or have touched; `length`,
    `stiffness`: Scales: square root of V0, mean kn of the law, see `law_scale`; `symmetry`:
    Symmetry of the state and of its control that the rates keep; all unknowns if None;
    `search_all`: Whether the branch search tries contacts inside their cone too.
    """

    law: ContactLaw
    closure: Closure
    spins: Spins
    contacts: Integers
    x0: Floats
    d0: Floats
    radii: Floats
    volume: float
    b: Floats
    m: Floats
    first_place: Floats
    watches_pairs: bool
    met: Integers
    length: float
    stiffness: float
    symmetry: PointGroup | None = None
    search_all: bool = False

    @cached_property
    def contact_count(self) -> int:
        """Number of contacts C."""
        return len(self.contacts)

    @cached_property
    def grain_count(self) -> int:
        """Number of grains G."""
        return len(self.x0)

    @cached_property
    def places(self) -> int:
        """Number of integrated variables that tell the place of the grains."""
        return 4 if self.closure == "affine" else 2 * self.grain_count

    @cached_property
    def shears(self) -> slice:
        """Integrated variables that are shear forces."""
        return slice(self.places, self.places + self.contact_count)

    @cached_property
    def size(self) -> int:
        """Number Y of integrated variables."""
        return self.places + self.contact_count + 1 + len(WORK_TERMS)

    @cached_property
    def is_ring(self) -> bool:
        """Whether it is a loop without chords, its contacts from grain to grain."""
        grains = np.arange(self.grain_count)
        ring = np.column_stack([grains, np.roll(grains, -1)])
        return self.grain_count > 2 and np.array_equal(self.contacts, ring)

    @cached_property
    def length0(self) -> Floats:
        """(C,) reference branch lengths."""
        return np.hypot(self.d0[:, 0], self.d0[:, 1])

    @cached_property
    def overlap0(self) -> Floats:
        """(C,) overlaps in the reference; within rounding of it, grains just touch."""
        overlap = self.touching - self.length0
        return np.where(np.abs(overlap) <= JUST_TOUCHING * self.touching, 0.0, overlap)

    @cached_property
    def touching(self) -> Floats:
        """(C,) `r_i + r_j`."""
        return np.asarray(self.radii[self.contacts].sum(axis=1))

    @cached_property
    def mu(self) -> Floats:
        """(C,) coefficients of friction."""
        return np.broadcast_to(self.law.mu, self.contact_count)

    @cached_property
    def has_cone(self) -> Flags:
        """(C,) whether a contact may both stick and slide."""
        return np.isfinite(self.mu) & (self.mu > 0)

    @cached_property
    def group(self) -> PointGroup | None:
        """Symmetry that leaves unknowns out: the affine closure relaxes nothing but free spins."""
        return self.symmetry if self.closure == "traction" or self.spins == "free" else None

    @cached_property
    def mirrors(self) -> bool:
        """Whether mirrors in the axes are symmetries: `H11, H22` and `H12, H21` don't mix."""
        return self.group is not None and bool((self.group.along_axes().parity < 0.0).any())

    @cached_property
    def unknowns(self) -> Unknowns:
        """Unknowns of the path's rates, which are as symmetric as its state.

        A mirror changes the sign of spins: they vanish on its axis and are paired off it.
        """
        group, traction, free = self.group, self.closure == "traction", self.spins == "free"
        if group is None:
            return all_unknowns(self.grain_count * (free + 2 * traction))
        alone = np.zeros((group.order, 1), dtype=np.int64)
        pairs = np.einsum("sik,sjl->sijkl", group.maps, group.maps).reshape(-1, 4, 4)
        tensor, moving = invariant_fields(alone, pairs)[0], []
        if traction:
            place = invariant_fields(group.grains, group.maps)
            moving.append(place.reshape(-1, place.shape[2]))
        if free:
            moving.append(invariant_fields(group.grains, group.parity[:, None, None])[:, 0])
        # The equations change as the fields do: strain or stress, then balance and moments.
        return Unknowns(block_diag(tensor, tensor, *moving), block_diag(tensor, *moving).T)

    @cached_property
    def form(self) -> ClosureForm:
        """Geometry of the closure; spins that turn with the loop are added later."""
        x0, d0 = (self.x0, None) if self.closure == "traction" else (None, self.d0)
        volume = np.asarray(self.volume)
        return closure_form(self.spins, self.contacts, self.radii, volume, x0=x0, d0=d0)


def path_model(
    graph: GrainGraph,
    contacts: ContactState,
    law: ContactLaw,
    closure: Closure,
    spins: Spins,
    volume: ArrayLike | None,
) -> PathModel:
    """Gather the constants of a path from its initial graph and the state of its contacts."""
    d, d0 = graph.branches, graph.reference_branches
    v0 = float(reference_volume(graph) if volume is None else np.asarray(volume))
    if not (np.isfinite(v0) and v0 > 0):
        raise InputError("volume", str(v0), "a positive area", "Give the reference area.")
    length = float(np.sqrt(v0))
    b = m = np.zeros((0, 2))
    if closure != "affine":
        require_loop(graph)
        ratio = v0 / abs(float(polygon_area(graph.x0)))
        centred = from_centroid(graph.x0)
        midpoints = 0.5 * (centred + np.roll(centred, -1, axis=0))
        b, m = ratio * boundary_vectors(graph.x0), ratio * outward(graph.x0, midpoints)
        place = (graph.x - graph.x0).ravel()
    else:
        gradient = np.linalg.lstsq(d0, d - d0)[0]
        place = np.asarray(-gradient.T.ravel(), dtype=float)
        image = d0 + d0 @ gradient
        _require_start(
            np.abs(d - image).max(axis=1, initial=0.0) / length,
            ("branch vector", d, image, "an affine image of the reference"),
            "Make the current centres the reference, or use the traction closure.",
        )
    model = PathModel(
        law=law,
        closure=closure,
        spins=spins,
        contacts=graph.contacts,
        x0=graph.x0,
        d0=d0,
        radii=graph.radii,
        volume=v0,
        b=b,
        m=m,
        first_place=place,
        watches_pairs=graph.cell is None,
        met=np.array([], dtype=np.int64),
        length=length,
        stiffness=law_scale(contacts, law),
    )
    model = without_pairs(model, graph.contacts)
    expected, largest = law.normal_force(contacts), model.stiffness * contacts.touching_length
    mismatch = np.abs(contacts.normal_force - expected) / largest
    if mismatch.max(initial=0.0) > START_MISMATCH:
        require_linear_forces(law, contacts)
    _require_start(
        mismatch,
        ("normal force", contacts.normal_force, expected, "as its overlap gives it"),
        "Write graph.replace(normal_force=law.normal_force(gl.contact_state(graph))).",
    )
    return model


def _require_start(mismatch: Floats, numbers: tuple[str, Floats, Floats, str], remedy: str) -> None:
    """Raise `InputError` for the contact whose given number is farthest from the expected one."""
    if mismatch.max(initial=0.0) > START_MISMATCH:
        c, (name, given, expected, as_what) = int(mismatch.argmax()), numbers
        received, wanted = given[c].tolist(), f"{expected[c].tolist()}, {as_what}"
        raise InputError(f"{name} of contact {c}", str(received), wanted, remedy)


def with_contact(model: PathModel, pairs: Integers) -> PathModel:
    """Model in which pairs of grains have come into contact."""
    parameters = np.concatenate([np.arange(model.contact_count), np.zeros(len(pairs), dtype=int)])
    return replace(
        model,
        symmetry=None,
        law=model.law.take(parameters).parted(np.arange(len(parameters)) >= model.contact_count),
        contacts=np.vstack([model.contacts, pairs]),
        d0=np.vstack([model.d0, model.x0[pairs[:, 1]] - model.x0[pairs[:, 0]]]),
    )


def without_pairs(model: PathModel, pairs: Integers) -> PathModel:
    """Model that no longer watches the given pairs of grains, (A, 2)."""
    return replace(model, met=np.concatenate([model.met, pair_keys(model, pairs)]))


def pair_keys(model: PathModel, pairs: Integers) -> Integers:
    """(Q,) a number for each pair of grains, the same in either order."""
    low, high = np.sort(pairs, axis=1).T
    return np.asarray(low * model.grain_count + high)


def law_scale(state: ContactState, law: ContactLaw) -> float:
    """Mean `kn` of the contacts in their state; of a tenth of overlap where they have none yet."""
    elastic = np.full(len(state.length), Regime.ELASTIC, dtype=np.int8)
    kn = law.local_stiffness(state, elastic)[..., 0, 0]
    if not kn.mean() > 0.0:
        kn = law.local_stiffness(compressed_state(state, law, 0.9), elastic)[..., 0, 0]
    return float(kn.mean())


def compressed_state(state: ContactState, law: ContactLaw, length: float) -> ContactState:
    """The same contacts compressed to a fraction of `r_i + r_j`, without shear force."""
    overlap, radii = (1.0 - length) * state.touching_length, (state.radii_i, state.radii_j)
    return pressed_contacts(law, np.array(radii), overlap, 0.0 * overlap)
