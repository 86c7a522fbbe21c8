"""Errors of the input of loops: how far those of forces and stiffnesses move the eigenvalues."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from loops import ContactLaw, ContactState, Faces, GrainGraph, Regime, contact_state
from loops.arrays import Flags, Floats, Integers, Regimes, in_threads, one_blas_thread
from loops.closures import Closure, Spins
from loops.closures.ring import BI, BJ, DNN, DNT, DTN, DTT, LENGTH
from loops.closures.rings import contact_rows, tangents_of_rows
from loops.loop_batches import LoopBatch, loop_batches
from stability.verdict import loop_spectra

# Closures and spins by the names of their columns.
RULES: dict[str, tuple[Closure, Spins]] = {
    "affine": ("affine", "blocked"),
    "traction": ("traction", "blocked"),
    "traction_free": ("traction", "free"),
}
# Share of the eigenvalue up to which a bound of first order is taken as it is.
SMALL = 0.1
# Perturbed states of a loop whose bound is larger, or with a contact that may slide or stick.
SAMPLES = 16
# Contacts of which every combination of sticking and sliding is among them.
COMBINED = 4
# Steps of the differences: of stiffness, force over stiffness and length, and of a length over
# itself, where overlaps of spheres are small.
STEP, LENGTH_STEP = 1e-7, 1e-10
# Loops of one order at a time: their arrays stay in the cache.
LOOPS_AT_ONCE = 2**8


class InputErrors(NamedTuple):
    """Bounds on the errors of the contacts, (C,) each, and of the centres, (G,) each.

    `N`, `T` (force), `overlap` (length), `kn`, `kt` (shares of them); coordinates `x`, `y`
    (length). An overlap errs by these besides.
    """

    N: Floats
    T: Floats
    overlap: Floats
    kn: Floats
    kt: Floats
    x: Floats
    y: Floats


class EigenvalueErrors(NamedTuple):
    """Smallest eigenvalue of Ks of loops in the symmetric subspace, (L,) each.

    `value`; `bound`, of first order in the errors of the input; `error`, the bound where it is
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
    errors: InputErrors,
    loops: Integers,
) -> dict[str, EigenvalueErrors]:
    """Errors of the smallest eigenvalue of every loop by those of its input, for each of `RULES`.

    In the order of `faces.loops`, not numbers for those that are no `loops` (faces); in the unit
    of kn. The bound adds the sizes of the eigenvalue's slopes times the errors.
    """
    found = {rule: EigenvalueErrors(*np.full((3, len(faces.loops)), np.nan)) for rule in RULES}
    near = at_edge(contact_state(graph), law, errors)
    draw, most = np.random.default_rng(0).integers, 2**SAMPLES
    bits = [*draw(0, most, (5, graph.contact_count)), *draw(0, most, (2, graph.grain_count))]

    def batches(loops: Integers) -> Iterator[tuple[LoopBatch, LoopInput, Integers]]:
        for batch in loop_batches(graph, faces, LOOPS_AT_ONCE, loops):
            at = batch.contacts
            places = [at] * 5 + [batch.grains] * 2
            own, drawn = (
                np.stack([each[place] for each, place in zip(every, places, strict=True)])
                for every in (errors, bits)
            )
            yield batch, LoopInput(batch.graph, law.take(at), regime[at], own), drawn

    def judge(loops: Integers) -> None:
        for batch, given, _ in batches(loops):
            for rule, (value, bound) in given.first_order().items():
                to = found[rule]
                to.value[batch.row], to.bound[batch.row] = value, bound
                # Sampled below.
                sure = (bound <= SMALL * np.abs(value)) & ~near[:, batch.contacts].any(axis=(0, 2))
                to.error[batch.row] = np.where(sure, bound, np.inf)
        unsure = np.any([np.isinf(to.error[faces.row[loops]]) for to in found.values()], axis=0)
        for batch, given, drawn in batches(loops[unsure]):
            (back, ahead), sample = near[:, batch.contacts], np.arange(SAMPLES)[:, None, None]
            own = back | ahead
            place = np.clip(np.cumsum(own, axis=1) - 1, 0, COMBINED)
            sign = np.where(drawn[:, None] >> sample & 1, 1.0, -1.0)
            # Every combination of the first contacts that may slide, others at random; T is on the
            # side where they may.
            slides = np.where(place < COMBINED, sample >> place & 1, sign[0] > 0.0)
            regimes = np.where(slides, Regime.SLIDING, Regime.ELASTIC)
            regimes = np.where(own, regimes, given.regime).astype(np.int8)
            sign[1] = np.where(back == ahead, sign[1], np.where(ahead, 1.0, -1.0))
            values = given.eigenvalues(sign * given.errors[:, None], regimes)
            for rule, to in found.items():
                change = np.abs(values[rule] - to.value[batch.row]).max(axis=0)
                known = to.error[batch.row]
                # Corners of the errors at random need not hold the worst one: a margin.
                larger = 2.0 * to.bound[batch.row] + np.where(np.isnan(change), np.inf, change)
                to.error[batch.row] = np.where(np.isinf(known), larger, known)

    in_threads(judge, np.array_split(loops, max(1, len(loops) // LOOPS_AT_ONCE)))
    return found


def at_edge(state: ContactState, law: ContactLaw, errors: InputErrors) -> Flags:
    """(2, C) contacts that within the errors of their forces stick, or slide with T < 0, T > 0."""
    larger = replace(state, normal_force=state.normal_force + errors.N)
    strength, T = law.strength(state), state.shear_force
    lacks = np.abs(np.stack([-T, T]) - strength)
    within = lacks <= errors.T + law.strength(larger) - strength
    return np.asarray(within & (errors.N > 0.0) & np.isfinite(strength))


class LoopInput(NamedTuple):
    """Loops of one order n, with the regimes (L, n) and errors (7, L, n) of their input."""

    graph: GrainGraph
    law: ContactLaw
    regime: Regimes
    errors: Floats

    def eigenvalues(self, changes: Floats, regime: Regimes) -> dict[str, Floats]:
        """(P, L) smallest eigenvalues under each rule, of a changed input (7, P, L, n).

        The arms of spins stay: what they change is `MacroTangent.sensitivity`.
        """
        moved = np.moveaxis(changes[5:], 0, -1)
        d = self.graph.branches + np.roll(moved, -1, axis=-2) - moved
        length, state = np.hypot(d[..., 0], d[..., 1]), contact_state(self.graph)
        _, *arms = self.law.shear_kinematics(state)
        N, T = state.normal_force, state.shear_force
        changed = replace(
            state,
            length=length - changes[2],
            normal_force=np.maximum(N + changes[0], np.minimum(N, 0.0)),
            shear_force=T + changes[1],
        )
        rows = contact_rows(changed, self.law, regime)
        rows[..., LENGTH] = length
        rows[..., BI], rows[..., BJ] = arms
        rows[..., [DNN, DTN]] *= 1.0 + changes[3, ..., None]
        rows[..., [DNT, DTT]] *= 1.0 + changes[4, ..., None]
        wanted = list(RULES.values())
        found = tangents_of_rows(rows, d, d, self.graph.radii, wanted, compiled=True)
        values = (loop_spectra(one.matrix.reshape(-1, 4, 4), compiled=True) for one in found)
        each = (value[:, 0].reshape(length.shape[:-1]) for value in values)
        return dict(zip(RULES, each, strict=True))

    def first_order(self) -> dict[str, tuple[Floats, Floats]]:
        """(L,) smallest eigenvalue under each rule, and the bound on its change."""
        state, (_, count, n) = contact_state(self.graph), self.errors.shape
        size = np.abs(self.law.local_stiffness(state, self.regime)).max(axis=(-3, -2, -1))
        force, one = STEP * size[:, None] * state.length, np.ones(state.length.shape)
        away = LENGTH_STEP * state.length
        steps = np.stack([force, force, away, STEP * one, STEP * one, away, away])
        kinds = np.flatnonzero(self.errors.any(axis=(1, 2)))
        changes = np.zeros((len(steps), 1 + len(kinds) * n, count, n))
        for k, kind in enumerate(kinds):
            # Each contact or centre by itself.
            changes[kind, 1 + k * n : 1 + (k + 1) * n] = np.eye(n)[:, None] * steps[kind]
        times = np.moveaxis(self.errors[kinds] / steps[kinds], -1, 1).reshape(-1, count)
        found = {}
        for rule, values in self.eigenvalues(changes, self.regime).items():
            bound = (np.abs(values[1:] - values[0]) * times).sum(axis=0)
            found[rule] = values[0], np.where(np.isnan(bound), np.inf, bound)
        return found
