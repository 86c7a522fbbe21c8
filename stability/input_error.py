"""Errors of the input of loops: how far those of forces and stiffnesses move the eigenvalues."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, get_args

import numpy as np

from loops import ContactLaw, ContactState, Faces, GrainGraph, Regime, contact_state
from loops.arrays import Flags, Floats, Integers, Regimes, in_threads, one_blas_thread
from loops.assembly import translational_blocks
from loops.closures import Closure
from loops.geometry import outward, polygon_area
from loops.loop_batches import LoopBatch, loop_batches
from stability.spectra import restrict, subspace_basis, symmetric_modes

CLOSURES = get_args(Closure)
# Share of the eigenvalue up to which a bound of first order is taken as it is.
SMALL = 0.1
# Perturbed states of a loop whose bound is larger, or with a contact that may slide or stick.
SAMPLES = 16
# Contacts of which every combination of sticking and sliding is among them.
COMBINED = 4
# Share of kn that keeps the blocks of open contacts regular.
TINY = 1e-12
# Loops of one order at a time: their arrays stay in the cache.
LOOPS_AT_ONCE = 2**10
# Terms that a turned branch changes: the frame twice, both levers, the area.
TURN = 5.0


class ContactErrors(NamedTuple):
    """Bounds on the errors of the contacts, (C,) each.

    `N`, `T` (force), `overlap` (length), `stiffness` (share of kn and of kt, each by itself) and
    `turn` (change of the branch vector over its length).
    """

    N: Floats
    T: Floats
    overlap: Floats
    stiffness: Floats
    turn: Floats


class EigenvalueErrors(NamedTuple):
    """Smallest eigenvalue of Ks of loops in the symmetric subspace, (L,) each.

    `value`; `bound`, of first order in the errors of the contacts; `error`, the bound where it is
    small, else the sum of it and of the largest change over the perturbed states.
    """

    value: Floats
    bound: Floats
    error: Floats


@one_blas_thread()
def eigenvalue_errors(
    graph: GrainGraph,
    law: ContactLaw,
    regime: Regimes,
    faces: Faces,
    errors: ContactErrors,
    loops: Integers,
) -> dict[Closure, EigenvalueErrors]:
    """Errors of the smallest eigenvalue of every loop by those of its contacts, spins blocked.

    In the order of `faces.loops`, not numbers for those that are no `loops` (faces); in the unit
    of kn. With the motions `a` and `b` of a contact under the mode, by the transposed equations of
    the loop and by its own, `dK = sum a . dk b/V`: the bound adds the sizes of these terms.
    """
    found = {one: EigenvalueErrors(*np.full((3, len(faces.loops)), np.nan)) for one in CLOSURES}
    near = at_edge(contact_state(graph), law, errors)
    bits = np.random.default_rng(0).integers(0, 2**SAMPLES, (5, graph.contact_count))

    def batches(loops: Integers) -> Iterator[tuple[LoopBatch, Contacts]]:
        for batch in loop_batches(graph, faces, LOOPS_AT_ONCE, loops):
            at = batch.contacts
            own = ContactErrors(*(error[at] for error in errors))
            yield batch, Contacts(batch.graph, law.take(at), regime[at], own)

    def judge(loops: Integers) -> None:
        for batch, contacts in batches(loops):
            changes = contacts.changes()
            for closure, to in found.items():
                value, bound = contacts.first_order(closure, changes)
                to.value[batch.row], to.bound[batch.row] = value, bound
                # Sampled below.
                sure = (bound <= SMALL * np.abs(value)) & ~near[batch.contacts].any(axis=1)
                to.error[batch.row] = np.where(sure, bound, np.inf)
        unsure = np.any([np.isinf(to.error[faces.row[loops]]) for to in found.values()], axis=0)
        for batch, contacts in batches(loops[unsure]):
            at, row, changes = batch.contacts, batch.row, contacts.changes()
            place = np.clip(np.cumsum(near[at], axis=1) - 1, 0, COMBINED)
            largest = dict.fromkeys(CLOSURES, np.zeros(len(row)))
            for sample in range(SAMPLES):
                sign = np.where(bits[:, at] >> sample & 1, 1.0, -1.0)
                # Every combination of the first contacts that may slide, others at random.
                slides = np.where(place < COMBINED, sample >> place & 1, sign[0] > 0.0)
                own = np.where(slides, Regime.SLIDING, Regime.ELASTIC)
                own = np.where(near[at], own, contacts.regime).astype(np.int8)
                k = contacts.perturbed(changes, own, sign)
                for closure, to in found.items():
                    change = np.abs(smallest(contacts.motions(closure, k)[0]) - to.value[row])
                    largest[closure] = np.maximum(largest[closure], change)
            for closure, to in found.items():
                to.error[row] = to.bound[row] + largest[closure]

    in_threads(judge, np.array_split(loops, max(1, len(loops) // LOOPS_AT_ONCE)))
    return found


def at_edge(state: ContactState, law: ContactLaw, errors: ContactErrors) -> Flags:
    """(C,) contacts that may stick or slide within the errors of their forces."""
    larger = replace(state, normal_force=state.normal_force + errors.N)
    strength = law.strength(state)
    lacks = np.abs(np.abs(state.shear_force) - strength)
    within = lacks <= errors.T + law.strength(larger) - strength
    return np.asarray(within & (errors.N > 0.0) & np.isfinite(strength))


def smallest(tangents: Floats) -> Floats:
    """(L,) smallest eigenvalue of Ks in the symmetric subspace."""
    return symmetric_modes(restrict(tangents, "symmetric"))[0][..., 0]


class Contacts(NamedTuple):
    """Contacts (L, n) of loops of one order, with the errors of their input."""

    graph: GrainGraph
    law: ContactLaw
    regime: Regimes
    errors: ContactErrors

    def blocks(self, state: ContactState, regime: Regimes) -> Floats:
        """(L, n, 2, 2) blocks of the contacts in a state."""
        k = translational_blocks(state, self.law, regime)
        size = np.abs(k).max(axis=(-3, -2, -1), keepdims=True)
        return np.asarray(k + TINY * np.where(size > 0.0, size, 1.0) * np.eye(2))

    def changes(self) -> Floats:
        """(5, L, n, 2, 2) changes of the blocks by the errors of N, T, overlap, kn and kt."""
        state, errors, regime = contact_state(self.graph), self.errors, self.regime
        T = state.shear_force
        k, D = self.blocks(state, regime), self.law.local_stiffness(state, regime)
        g, frame = self.law.shear_kinematics(state)[0], np.stack([state.n, state.t], axis=-1)
        D = D * errors.stiffness[..., None, None]
        D[..., 1] *= g[..., None]
        parts = [D * [1.0, 0.0], D * [0.0, 1.0]]
        moved = (
            replace(state, normal_force=state.normal_force + errors.N),
            replace(state, shear_force=state.shear_force + np.copysign(errors.T, T)),
            replace(state, length=state.length - errors.overlap),
        )
        return np.stack(
            [self.blocks(one, regime) - k for one in moved]
            + [frame @ part @ np.swapaxes(frame, -1, -2) for part in parts]
        )

    def perturbed(self, changes: Floats, regime: Regimes, sign: Floats) -> Floats:
        """Blocks in these regimes, in a state whose input has errors of these signs (5, L, n)."""
        state, errors = contact_state(self.graph), self.errors
        state = replace(
            state,
            normal_force=np.maximum(state.normal_force + sign[0] * errors.N, 0.0),
            shear_force=state.shear_force + sign[1] * errors.T,
            length=state.length - sign[2] * errors.overlap,
        )
        k = self.blocks(state, regime)
        return np.asarray(k + np.einsum("eln,elnij->lnij", sign[3:], changes[3:]))

    def first_order(self, closure: Closure, changes: Floats) -> tuple[Floats, Floats]:
        """(L,) smallest eigenvalue, and the bound on its change."""
        k = self.blocks(contact_state(self.graph), self.regime)
        A, right = self.motions(closure, k)
        _, left = self.motions(closure, np.swapaxes(k, -1, -2))
        values, modes = symmetric_modes(restrict(A, "symmetric"))
        mode = modes[..., 0] @ subspace_basis("symmetric")
        a, b = (np.einsum("lnij,lj->lni", way, mode) for way in (left, right))
        terms = np.abs(np.einsum("lni,elnij,lnj->eln", a, changes, b)).sum(axis=(0, 2))
        # A turned branch turns its frame and its lever.
        size = np.linalg.norm(k, axis=(-2, -1)) * np.linalg.norm(a, axis=-1)
        turned = TURN * (self.errors.turn * size * np.linalg.norm(b, axis=-1)).sum(axis=1)
        return values[:, 0], (terms + turned) / self.volume()

    def volume(self) -> Floats:
        """(L,) areas of the polygons."""
        return np.abs(polygon_area(self.graph.x))

    def motions(self, closure: Closure, k: Floats) -> tuple[Floats, Floats]:
        """Tangents (L, 4, 4), and the contacts' motions per component of H, (L, n, 2, 4).

        Under the traction closure contacts carry `f = f^ - P m`, and their motions close the ring
        and make `H`: six equations `F (f^, P) = (0, V H)`. Triangles are affine under either.
        """
        x, V, n = self.graph.x, self.volume(), self.graph.grain_count
        B = np.zeros((*k.shape[:2], 2, 6))
        if closure == "affine" or n == 3:
            B[..., 0, 2:4] = B[..., 1, 4:] = -self.graph.branches
            motion = B[..., 2:]
            A = np.einsum("lnai,lnab,lnbj->lij", motion, k, motion, optimize=True)
            return A / V[:, None, None], motion
        x = x - x.mean(axis=-2, keepdims=True)
        B[..., :2] = np.eye(2)
        B[..., 0, 2:4] = B[..., 1, 4:] = -outward(x, 0.5 * (x + np.roll(x, -1, axis=-2)))
        compliant = np.linalg.solve(k, B)
        F = np.einsum("lnai,lnaj->lij", B, compliant, optimize=True)
        y = np.linalg.solve(F, V[:, None, None] * np.eye(6)[:, 2:])
        return y[:, 2:], np.asarray(-compliant @ y[:, None])
