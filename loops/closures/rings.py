"""Tangents of loops by the equations of a ring: numpy solves a few, kernels many."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from loops.arrays import ROUNDING, Flags, Floats, Integers, Regimes, frobenius
from loops.closures import ring as equations
from loops.closures.null_space import (
    AMBIGUITY_LIMIT,
    RESIDUAL_LIMIT,
    solve_through_null_space,
)
from loops.closures.ring import ERROR_LIMIT, KEPT, ROLL, Ring
from loops.closures.spins import affine_spin
from loops.closures.system import Closure, Spins
from loops.compiled import compiled, given, use_compiled
from loops.errors import InputError
from loops.geometry import polygon_area, require_loop
from loops.graph import ContactState, GrainGraph
from loops.laws.frictional import ContactLaw

CLOSURES = {"affine": equations.AFFINE, "traction": equations.TRACTION}
SPINS = {"blocked": equations.BLOCKED, "affine": equations.TURNING, "free": equations.FREE}


class Solved(NamedTuple):
    """Tangents of loops (L, 4, 4) over the areas of their polygons, and what is known of them.

    (L,) each: bound on the error of `matrix`, Frobenius; residual and ambiguity of the solve; see
    `MacroTangent.sensitivity`; area, and the factor by which its rounding is amplified, which the
    bound leaves out.
    """

    matrix: Floats
    error: Floats
    residual: Floats
    ambiguity: Floats
    sensitivity: Floats
    area: Floats
    growth: Floats


class Rings(NamedTuple):
    """Loops as rings of contacts, contiguous and read-only.

    `rows` (C, 10) of `contact_rows`; `branches` and `reference` (C, 2); `radii` (G,). Loop l has
    the `grains` and `contacts` from `offsets[l]` to `offsets[l + 1]`, `forward` where it passes a
    contact from its first grain to its second.
    """

    rows: Floats
    branches: Floats
    reference: Floats
    radii: Floats
    offsets: Integers
    grains: Integers
    contacts: Integers
    forward: Flags


def is_ring(
    graph: GrainGraph, law: ContactLaw, spins: Spins, state: ContactState, regime: Regimes
) -> bool:
    """Return whether a graph is a loop without chords, and free of rolling springs that act."""
    if graph.cell is not None or graph.contact_count != graph.grain_count:
        return False
    try:
        require_loop(graph)
    except InputError:
        return False
    rolls = spins == "free" and np.any(law.rolling_stiffness(state, regime))
    return not rolls and bool((polygon_area(graph.x0) != 0.0).all())


def contact_rows(state: ContactState, law: ContactLaw, regime: Regimes) -> Floats:
    """(..., C, 10) what a ring needs of its contacts besides their branches, see `ring`."""
    D, (g, b_i, b_j) = law.local_stiffness(state, regime), law.shear_kinematics(state)
    columns = (
        state.length, b_i, b_j, state.normal_force, state.shear_force, g,
        D[..., 0, 0], D[..., 0, 1], D[..., 1, 0], D[..., 1, 1],
    )  # fmt: skip
    return np.stack(np.broadcast_arrays(*columns), axis=-1)


def tangents_of_rings(
    graph: GrainGraph, law: ContactLaw, closure: Closure, spins: Spins, state: ContactState,
    regime: Regimes,
) -> Solved:  # fmt: skip
    """Tangents of a loop or a batch of loops of one order, batch axes `...` as the graph has."""
    turn = turning(graph) if spins == "affine" else None
    parts = graph.branches, graph.reference_branches, graph.radii
    return tangents_of_rows(contact_rows(state, law, regime), *parts, [(closure, spins)], turn)[0]


def tangents_of_rows(
    rows: Floats, branches: Floats, reference: Floats, radii: Floats,
    wanted: list[tuple[Closure, Spins]], turn: Floats | None = None, compiled: bool | None = None,
) -> list[Solved]:  # fmt: skip
    """Tangents of loops of one order, contact c from grain c to the next, see `Rings`.

    All with batch axes `...`; `turn` (..., 2, 4) is that of `turning`, for spins that turn.
    """
    parts = rows, branches, reference, radii[..., None]
    batch = np.broadcast_shapes(*(part.shape[:-2] for part in parts))
    n, count = radii.shape[-1], int(np.prod(batch))

    def flat(a: Floats) -> Floats:
        return given(np.broadcast_to(a, (*batch, *a.shape[-2:])).reshape(-1, a.shape[-1]), float)

    rows, branches, reference, radii = (flat(part) for part in parts)
    every, forward = np.arange(count * n), np.ones(count * n, dtype=bool)
    offsets = np.arange(count + 1) * n
    rings = Rings(rows, branches, reference, radii[:, 0], offsets, every, every, forward)
    if turn is not None:
        turn = np.broadcast_to(turn, (*batch, 2, 4)).reshape(-1, 2, 4)
    solve = solve_compiled if use_compiled(compiled, len(every)) else solve_by_numpy
    found = solve(rings, np.arange(count), wanted, turn)
    return [Solved(*(part.reshape((*batch, *part.shape[1:])) for part in one)) for one in found]


def turning(graph: GrainGraph) -> Floats:
    """(..., 2, 4) spin of grains that turn with their loop per component of H, and its size."""
    spin = affine_spin(graph)
    return np.stack([spin.row, np.abs(spin.row) + spin.error / ROUNDING], axis=-2)


@cache
def kernels() -> Any:
    """Return the functions of `ring`, compiled."""
    return compiled(equations, entry=("tangents", "relax"))


def solve_compiled(
    rings: Rings,
    loops: Integers,
    wanted: list[tuple[Closure, Spins]],
    turn: Floats | None = None,
) -> list[Solved]:
    """Solve loops by the kernels, those that have null vectors by numpy; see `solve_by_numpy`."""
    codes = np.array([[CLOSURES[closure], SPINS[spins]] for closure, spins in wanted])
    spin = np.zeros((1, 2, 4)) if turn is None else turn
    found = kernels().tangents(*rings, loops, codes, spin)
    none, solved = np.zeros(len(loops)), []
    for rule, matrix, error, sensitivity in zip(wanted, *found[:3], strict=True):
        one = Solved(matrix, error, none.copy(), none.copy(), sensitivity, *found[3:])
        left = np.flatnonzero(np.isinf(error))
        if len(left):
            own = None if turn is None else turn[left % len(turn)]
            (rest,) = solve_by_numpy(rings, loops[left], [rule], own)
            for to, part in zip(one, rest, strict=True):
                to[left] = part
        solved.append(one)
    return solved


def solve_by_numpy(
    rings: Rings,
    loops: Integers,
    wanted: list[tuple[Closure, Spins]],
    turn: Floats | None = None,
) -> list[Solved]:
    """Tangents of loops under closures and rules of the spins, through their null vectors.

    `turn` (L or 1, 2, 4) is that of `turning`, for spins that turn with their loop.
    """
    order, count = rings.offsets[loops + 1] - rings.offsets[loops], len(loops)
    solved = [Solved(np.empty((count, 4, 4)), *np.empty((6, count))) for _ in wanted]
    for n in np.unique(order).tolist():
        at = np.flatnonzero(order == n)
        own = _of_order(rings, loops[at], n)
        for (closure, spins), found in zip(wanted, solved, strict=True):
            spin = np.zeros((len(at), 2, 4))
            if spins == "affine" and turn is not None:
                spin = turn[at % len(turn)]
            part = _solve_order(own, n, closure, spins, spin)
            for to, values in zip(found, part, strict=True):
                to[at] = values
    return solved


def _of_order(rings: Rings, loops: Integers, n: int) -> Rings:
    """Return loops of order n as one ring whose numbers are arrays, a number for each loop.

    The numbers of a single loop are no arrays: numpy is faster then.
    """
    at = rings.offsets[loops] + np.arange(n)[:, None]
    row, forward = rings.contacts[at], rings.forward[at]
    sign = np.where(forward, 1.0, -1.0)[:, None]
    rows, branches, reference = (np.swapaxes(a[row], 1, 2) for a in rings[:3])
    arms = slice(equations.BI, equations.BJ + 1)
    rows[:, arms] = np.where(forward[:, None], rows[:, arms], rows[:, arms][:, ::-1])
    parts = rows, sign * branches, sign * reference, rings.radii[rings.grains[at]]
    own = [part[..., 0] if len(loops) == 1 else part for part in parts]
    one = np.arange(n)
    return Rings(own[0], own[1], own[2], own[3], np.array([0, n]), one, one, forward[:, 0] | True)


@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def _solve_order(own: Rings, n: int, closure: Closure, spins: Spins, turn: Floats) -> Solved:
    """Solve a ring whose numbers are arrays, or numbers if it is a single loop."""
    shape = own.radii.shape[1:]
    ring = Ring(np.empty((n, equations.COLUMNS, *shape)), np.zeros((3, n + 1), dtype=np.int64))
    passed = own.grains, own.contacts, own.forward
    size = equations.fill_ring(ring, *own[:4], 0, n, *passed)
    area, growth, unit = (np.atleast_1d(a) for a in size)
    for c in range(n):
        ring.places[KEPT, c] = np.max(equations.kept_motions(ring, c))
        equations.condense(ring, c)
    rule = equations.AFFINE if n == 3 else CLOSURES[closure], SPINS[spins]
    spin = np.moveaxis(turn, 0, -1).reshape(2, 4, *shape)
    matrix, error, residual, ambiguity, sensitivity, *_ = _solve_ring(ring, n, *rule, spin)
    blocks = ring.contacts[:, equations.KNN : equations.KTT + 1].reshape(4 * n, -1)
    matrix[~blocks.any(axis=0)] = error[~blocks.any(axis=0)] = 0.0
    if spins == "free" and n % 2 == 0:
        equations.share_otherwise(ring, n, np.empty((n, 2, *shape)))
        other, doubt, *_ = _solve_ring(ring, n, *rule, spin)
        pairs = zip(np.nan_to_num(matrix), np.nan_to_num(other), strict=True)
        sensitivity = unit * (doubt + [equations.change(*pair) for pair in pairs])
    matrix = unit[:, None, None] * matrix
    return Solved(matrix, unit * error, residual, ambiguity, sensitivity, area, growth)


def _solve_ring(ring: Ring, n: int, closure: int, spins: int, turn: Floats) -> Solved:
    """Solve in units of the rings; zeros for sensitivity, area and growth."""
    contacts = ring.contacts.reshape(n, equations.COLUMNS, -1)
    shape, felt = ring.contacts.shape[2:], contacts[:, equations.FELT] > 0.0
    modes = np.full(contacts.shape[2], equations.NO_GEAR)
    ring.places[ROLL, :n] = -1
    if spins == equations.FREE:
        ring.places[ROLL, :n] = np.where(felt.any(axis=1), 0, -1)
        for c in range(n):
            equations.weigh_moments(ring, c)
        every = np.moveaxis(contacts, -1, 0)
        modes = np.array([equations.gear_mode(Ring(one, ring.places), n) for one in every])
        equations.balance_last(ring, n, modes.reshape(shape))
    gear = (modes == equations.GEAR).reshape(shape) * 1.0
    N, one = equations.place_unknowns(ring, n, closure), (1,) * len(shape)
    A = np.empty((N + n * (spins == equations.FREE), N + 4, *shape))
    equations.assemble(ring, A, n, closure, spins, turn[0])
    E, size, doubt = (np.empty((N, k, *shape)) for k in (N + 4, N, 4))
    equations.balance_rolls(ring, A, n, N, gear, E)
    # Each unknown and each strain by itself.
    X, H = np.eye(N).reshape(N, N, *one), np.eye(4).reshape(4, 4, *one)
    equations.sum_sizes(ring, n, closure, gear, X, 0.0 * H[:, :1], turn[1], size)
    equations.sum_sizes(ring, n, closure, gear, 0.0 * X[:, :4], H, turn[1], doubt)
    E, size, doubt = (
        np.moveaxis(a.reshape(*a.shape[:2], -1), -1, 0) for a in (E, size, ROUNDING * doubt)
    )
    for roll, feels in zip(ring.places[ROLL], felt, strict=False):
        # Some rings feel a spin where others don't.
        if roll >= 0 and not feels.all():
            E[~feels, roll] = size[~feels, roll] = doubt[~feels, roll] = 0.0
            E[~feels, roll, roll] = 1.0
    largest = np.abs(E[..., :N]).max(axis=-1, keepdims=True)
    scale = 1.0 / np.where(largest > 0.0, largest, 1.0)
    E, size, doubt = scale * E, scale * size, scale * doubt
    stress, no_vectors = np.eye(N)[-4:], np.empty((N, 0))
    found = solve_through_null_space(
        E[..., :N], -E[..., N:], stress, no_vectors, size=size, doubt=doubt
    )
    error = frobenius(np.asarray(found.error))
    # Near a pole the terms of the equations are large, and so is what rounding leaves of them.
    load, terms = frobenius(E[..., N:]), frobenius(E[..., :N]) * frobenius(found.x)
    residual = found.residual * load / np.where(load > 0.0, load + terms, 1.0)
    solved = Solved(found.x[:, -4:], error, residual, found.ambiguity, *np.zeros((3, len(error))))
    _eliminate_poor(ring, A.reshape(*A.shape[:2], -1), n, closure, modes, turn[1], solved)
    return solved


def _eliminate_poor(
    ring: Ring, A: Floats, n: int, closure: int, gear: Integers, turn: Floats, found: Solved
) -> None:
    """Solve by elimination what is too near a singular system for its null vectors to be told."""
    N, contacts = A.shape[1] - 4, ring.contacts.reshape(n, equations.COLUMNS, -1)
    turn = turn.reshape(4, -1)
    known = (found.residual <= RESIDUAL_LIMIT) & (found.ambiguity <= AMBIGUITY_LIMIT)
    known &= found.error < ERROR_LIMIT * frobenius(found.matrix)
    for at in np.flatnonzero(~known):
        solver = equations.solver_of(N)
        out, alone = np.empty((4, 4)), Ring(contacts[..., at], ring.places)
        spin = turn[:, at % turn.shape[1]]
        mode = gear[at] if gear[at] == equations.NO_GEAR else equations.GEAR
        one = alone, A[..., at], n, N, closure, mode
        if not equations.solve_ring(*one, solver, out) > 0.0:
            continue
        bound = equations.bound_error(*one, spin, solver)
        if gear[at] == equations.UNSURE:
            # Arms that cancel two by two, as those of mirrored grains, leave such a mode no
            # stiffness, and by symmetry no load either: it stands still.
            bi, bj = alone.contacts[:, equations.BI], alone.contacts[:, equations.BJ]
            uneven = np.sort(np.abs(bi - bj) / np.maximum(bi, bj))
            unknowns, sizes = np.linalg.norm(solver.X, axis=1), solver.sizes[1]
            equations.sum_sizes(alone, n, closure, 0.0, unknowns, np.ones(4), spin, sizes)
            moment = np.abs(A[N:, :N, at] @ solver.X + A[N:, N:, at]).max(axis=1)
            wi, wj = alone.contacts[:, equations.WI], alone.contacts[:, equations.WJ]
            load = wi * moment + wj * np.roll(moment, -1)
            loaded = load > ROUNDING * sizes[alone.places[ROLL, :n]]
            if loaded.any() or (uneven[1::2] - uneven[::2] > ROUNDING).any():
                continue
        if bound < ERROR_LIMIT * np.linalg.norm(out):
            found.matrix[at], found.error[at] = out, bound
            found.residual[at] = found.ambiguity[at] = 0.0
