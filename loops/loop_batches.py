"""All loops of a packing at once: batches of graphs by order, or compiled kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar

import numpy as np

from loops.arrays import (
    ROUNDING,
    Flags,
    Floats,
    Integers,
    Regimes,
    available_cores,
    frobenius,
    one_blas_thread,
)
from loops.assembly import turning_block
from loops.closures import Closure, MacroTangent, Spins, macroscopic_tangent
from loops.closures.system import HasLaw, with_law
from loops.closures.tangents import solved
from loops.compiled import given, use_compiled
from loops.errors import InputError, check_type
from loops.faces import Faces, faces_by_order, find_faces
from loops.geometry import polygon_area, polygon_centroid, polygon_perimeter, polygon_shape
from loops.graph import GrainGraph, state_of
from loops.laws import ContactLaw, Regime
from loops.stress_strain import love_weber_stress


class LoopBatch(NamedTuple):
    """Loops of one order n, cut out of a packing.

    Attributes
    ----------
    graph : GrainGraph
        The loops, batch axis (L,): grains 0..n-1 counter-clockwise, contact c joins c and c+1;
        regimes go along.
    grains, contacts : (L, n) array of int
        Grains and contacts of each loop as numbered in the packing.
    face, row : (L,) array of int
        Face of each loop in `Faces`, and its place in `Faces.loops`.
    origin : (L, 2) array
        Place of the graph's origin in the packing: zero, but the first grain for loops that cross
        a periodic border. These are unrolled from there, since sums with the cell vectors far from
        the origin would lose digits of the branches.
    """

    graph: GrainGraph
    grains: Integers
    contacts: Integers
    face: Integers
    row: Integers
    origin: Floats


def loop_batches(
    graph: GrainGraph, faces: Faces, size: int = 2**16, loops: Integers | None = None
) -> Iterator[LoopBatch]:
    """Cut the loops out of a packing, order by order.

    Forces keep their values: `N` and `T` of a contact do not depend on its direction. The
    reference is the current configuration.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state.
    faces : Faces
        Its faces, from `find_faces`.
    size : int
        At most so many loops in a batch, to bound the memory of what is computed on it.
    loops : (L,) array of int, optional
        The loops to cut out, as faces; all of them if left out.

    Yields
    ------
    LoopBatch
        Loops of one order, in ascending order n.

    Examples
    --------
    >>> from loops import GrainGraph, find_faces, loop_batches
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    >>> [batch.grains.tolist() for batch in loop_batches(square, find_faces(square))]
    [[[0, 1, 2], [0, 2, 3]]]
    """
    crossing = None if graph.images is None else np.asarray(graph.images.any(axis=1))
    row = faces.row
    for order, group in faces_by_order(faces, loops).items():
        ring = np.column_stack([np.arange(order), np.roll(np.arange(order), -1)])
        for start in range(0, len(group.face), size):
            part = slice(start, start + size)
            grains, contacts = group.grains[part], group.contacts[part]
            x, origin = graph.x[grains], np.zeros((len(grains), 2))
            over = np.zeros(len(grains), dtype=bool)
            if crossing is not None:
                over = np.asarray(crossing[contacts].any(axis=1))
            if over.any():
                sign = np.where(group.forward[part][over][..., None], 1.0, -1.0)
                edges = sign * graph.branches[contacts[over]]
                x[over] = np.cumsum(edges, axis=1) - edges
                origin[over] = graph.x[grains[over, 0]]
            fields = graph.at_contacts(contacts)
            if graph.rolling_moment is not None:
                # On the second grain of a contact, which is the first of the ring's if it turns.
                fields["rolling_moment"] *= np.where(group.forward[part], 1.0, -1.0)
            batch = GrainGraph(x=x, radii=graph.radii[grains], contacts=ring, **fields)
            face = group.face[part]
            yield LoopBatch(batch, grains, contacts, face, row[face], origin)


def loop_tangents(
    graph: GrainGraph | HasLaw,
    law: ContactLaw | None = None,
    faces: Faces | None = None,
    closure: Closure | None = None,
    *,
    spins: Spins = "blocked",
) -> MacroTangent:
    """Macroscopic tangents of every loop of a packing, each over the area of its polygon.

    Parameters
    ----------
    graph : GrainGraph, or scene or snapshot
        The packing, one state; contacts have the regimes that it tells.
    law : ContactLaw, optional
        Law of its contacts; that of the scene or snapshot if left out.
    faces : Faces, optional
        Its faces, those that `find_faces` finds if left out.
    closure : {'affine', 'traction'}
        How the surrounding medium drives the grains; it has to be named.
    spins : {'blocked', 'affine', 'free'}
        What the grains' spins do.

    Returns
    -------
    MacroTangent
        Batch axis (L,), one tangent a loop in the order of `faces.loops` (force per length,
        compression positive).

    Raises
    ------
    InputError
        If there are no loops, or no closure is named.

    Examples
    --------
    >>> from loops import GrainGraph, LinearFrictional, find_faces, loop_tangents
    >>> square = GrainGraph(x=[[0, 0], [1, 0], [1, 1], [0, 1]], radii=[0.5] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0], [0, 2]])
    >>> law = LinearFrictional(kn=1.0, kt=0.5)
    >>> loop_tangents(square, law, find_faces(square), "affine").matrix.shape
    (2, 4, 4)
    """
    graph, law = with_law(graph, law)
    faces = find_faces(graph) if faces is None else faces
    check_type("faces", faces, Faces, "Leave them out, or give gl.find_faces(graph).")
    return tangents_of_loops(graph, law, faces, closure, spins)


@one_blas_thread()
def tangents_of_loops(
    graph: GrainGraph, law: ContactLaw, faces: Faces, closure: Closure | None, spins: Spins
) -> MacroTangent:
    """Return the tangents of all loops in the order of `Faces.loops`, see `loop_tangents`."""
    rows, tangents = [], list[MacroTangent]()
    for loops in _by_closures(graph, faces, law, None, faces.loops, [(closure, spins)]):
        rows.append(loops.at)
        tangents += loops.tangents.values()
    if not tangents:
        raise InputError("faces", "no loops", "one at least", "Look at the contacts.")
    order = np.argsort(np.concatenate(rows))
    fields = ("matrix", "volume", "condition", "residual", "trusted", "sensitivity")
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(tangent, name) for tangent in tangents])[order]
        for name in fields
    }
    return replace(tangents[0], **arrays)


TANGENTS: tuple[tuple[Closure, Spins], ...] = (
    ("affine", "blocked"),
    ("traction", "blocked"),
    ("traction", "free"),
)
CONTACTS_AT_ONCE = 2**14  # contacts at a time: their temporary arrays stay in the cache
LOOPS_AT_ONCE = 2**13  # loops that a thread computes at a time
Used = TypeVar("Used")


class LoopNumbers(NamedTuple):
    """Numbers of some loops: their shape, stress and tangents.

    `at` are their places in `Faces.loops`; `shape` (6, L) has centroid, area, perimeter, elongation
    and the angle of the long axis; `sliding` (L,) counts sliding contacts; `stress` (L, 4) is Love
    and Weber's with contacts counted whole; `tangents` by closure and spins.
    `compiled`: by kernels, which give a triangle one tangent under both closures.
    """

    at: Any
    tangents: dict[tuple[Any, Spins], MacroTangent]
    shape: Floats | None = None
    sliding: Floats | Integers | None = None
    stress: Floats | None = None
    compiled: bool = False


def loop_numbers(
    graph: GrainGraph,
    faces: Faces,
    law: ContactLaw | None,
    regime: Regimes | None,
    use: Callable[[LoopNumbers], Used],
    *,
    compiled: bool | None = None,
    threads: int | None = None,
) -> Iterator[Used]:
    """Compute the loops of a packing part by part; yield what `use` makes of each, in threads.

    The kernels take all loops of a large packing; closures take those that the kernels leave as
    ill-conditioned, or all loops of a small packing. Without a law there are shapes alone.
    """
    loops, threads = faces.loops, threads or available_cores()
    wanted = TANGENTS if law is not None else ()
    tasks = [(loops, wanted, True)]
    with ThreadPoolExecutor(threads) as pool:
        if use_compiled(compiled, graph.contact_count):
            packing = compiled_packing(graph, faces, law, regime, threads)
            poor = np.zeros((2, len(loops)), dtype=bool)

            def by_kernels(start: int) -> Used:
                block = slice(start, start + LOOPS_AT_ONCE)
                found, poor[:, block] = packing.numbers(loops, block)
                return use(found)

            yield from pool.map(by_kernels, range(0, len(loops), LOOPS_AT_ONCE))
            blocked, free = poor
            # Most have a gear mode, which only spins that are free have.
            some, gears = (np.array_split(loops[k], threads) for k in (blocked, free & ~blocked))
            tasks = [(part, wanted, False) for part in some]
            tasks += [(part, wanted[2:], False) for part in gears]

        def by_closures(task: tuple[Integers, Sequence[tuple[Closure, Spins]], bool]) -> list[Used]:
            return [use(found) for found in _by_closures(graph, faces, law, regime, *task)]

        for part in pool.map(by_closures, tasks):
            yield from part


def _by_closures(
    graph: GrainGraph,
    faces: Faces,
    law: ContactLaw | None,
    regime: Regimes | None,
    loops: Integers,
    wanted: Sequence[tuple[Closure | None, Spins]],
    whole: bool = False,
) -> Iterator[LoopNumbers]:
    """Yield the wanted tangents of loops, order by order; if `whole` shape and stress besides."""
    for batch in loop_batches(graph, faces, loops=loops):
        cut, found = batch.graph, LoopNumbers(batch.row, {})
        if whole:
            x = cut.x
            place = (*(polygon_centroid(x) + batch.origin).T, polygon_area(x))
            shape = np.stack([*place, polygon_perimeter(x), *polygon_shape(x)])
            found = found._replace(shape=shape)
        if law is not None:
            own = law.take(batch.contacts)
            regimes = None if regime is None else regime[batch.contacts]
            if whole and regimes is not None:
                sliding = np.count_nonzero(regimes == Regime.SLIDING, axis=1)
                stress = love_weber_stress(cut).reshape(-1, 4)
                found = found._replace(sliding=sliding, stress=stress)
            for closure, spins in wanted:
                tangent = macroscopic_tangent(cut, own, closure, spins=spins, regime=regimes)
                found.tangents[closure, spins] = tangent
        yield found


@dataclass(frozen=True, eq=False)
class CompiledPacking:
    """Arrays shared by the kernels, contiguous and read-only.

    `rows` (C, 8): branch vector, tangent block in the frame (n, t) row by row (zero without a law),
    N and T; `length` (C,) those of the branches; `shear` (C,) the shear stiffness; `regime` (C,).
    `by_radii`: whether spins shear by the radii (or by the arms to the contact point); None for a
    law that does neither, which the kernel does not treat. `faces`: offsets, grains, contacts and
    forward of `Faces`.
    """

    law: ContactLaw | None
    by_radii: bool | None
    rows: Floats
    length: Floats
    shear: Floats
    regime: Regimes
    x: Floats
    radii: Floats
    faces: tuple[Integers, Integers, Integers, Flags]

    def numbers(self, loops: Integers, at: slice) -> tuple[LoopNumbers, Flags]:
        """Shape, stress and tangents of a part of the loops; which are poor, see `tangents`."""
        from loops.compiled import tangents as kernel

        chosen = given(loops[at], np.int64)
        rows = self.rows, self.length, self.x, self.regime
        shape = kernel.loop_shapes(*rows, *self.faces, chosen).T
        found = LoopNumbers(at, {}, shape[: kernel.S11], compiled=True)
        if self.law is None:
            return found, np.zeros((2, len(chosen)), dtype=bool)
        tangents, poor = self.tangents(chosen)
        found.tangents.update(zip(TANGENTS, tangents, strict=True))
        stress = shape[kernel.S11 : kernel.S22 + 1].T
        return found._replace(sliding=shape[kernel.SLIDING], stress=stress), poor

    def tangents(self, loops: Integers) -> tuple[list[MacroTangent], Flags]:
        """Affine and traction tangents with spins blocked, traction with spins free; poor loops.

        Conditions are estimates, the rest is as by `macroscopic_tangent`. In poor loops, (2, L) by
        traction with spins blocked and free, rounding could turn a sign by these conditions: use
        `macroscopic_tangent` for them.
        """
        from loops.compiled.tangents import tangents_of_faces

        rows = self.rows, self.length, self.shear, self.radii
        matrices, conditions, smallest, sensitivity, area = tangents_of_faces(
            *rows, *self.faces, loops, self.by_radii is True
        )
        if self.by_radii is None:
            conditions[2] = np.inf
        rounding = ROUNDING * conditions[1:] * frobenius(matrices[1:])
        poor = ~(np.abs(smallest) > rounding)
        # An eigenvalue that the choice of spin arms can turn has no sign, however exact.
        poor[1] &= ~((np.abs(smallest[1]) <= sensitivity) & np.isfinite(conditions[2]))
        change = (0.0, 0.0, sensitivity)
        tangents = [
            solved(matrices[k], *TANGENTS[k], area, conditions[k], sensitivity=change[k])
            for k in range(3)
        ]
        return tangents, poor


def compiled_packing(
    graph: GrainGraph,
    faces: Faces,
    law: ContactLaw | None = None,
    regime: Regimes | None = None,
    threads: int = 1,
) -> CompiledPacking:
    """Prepare a packing, one state, for the kernels; without a law for shapes alone.

    Regimes are the graph's, or read from the state by the law, if left out.
    """
    count = graph.contact_count
    regime = graph.regime if regime is None else regime
    rows, length, shear = np.zeros((count, 8)), np.empty(count), np.zeros(count)
    regimes = np.zeros(count, dtype=np.int8)

    def fill(start: int) -> tuple[bool, bool]:
        part = slice(start, min(start + CONTACTS_AT_ONCE, count))
        rows[part, :2] = graph.branches[part]
        state = state_of(graph, part)
        length[part] = state.length
        if law is None:
            return True, True
        own = law.take(part)
        regimes[part] = own.regime(state) if regime is None else regime[part]
        stiffness = own.local_stiffness(state, regimes[part])
        shear[part] = stiffness[:, 1, 1]
        coupled = stiffness[:, 0, 1].any() or np.any(own.rolling_stiffness(state, regimes[part]))
        g, arm, _ = own.shear_kinematics(state)
        rows[part, 2:6] = turning_block(stiffness, g, state).reshape(-1, 4)
        rows[part, 6], rows[part, 7] = state.normal_force, state.shear_force
        if coupled:
            return False, False
        return np.array_equal(arm, state.radii_i), np.array_equal(arm, state.arm_i)

    with ThreadPoolExecutor(threads) as pool:
        ways = np.array(list(pool.map(fill, range(0, count, CONTACTS_AT_ONCE)))).reshape(-1, 2)
    by_radii, by_arms = bool(ways[:, 0].all()), bool(ways[:, 1].all())
    return CompiledPacking(
        law=law,
        by_radii=by_radii if by_radii or by_arms else None,
        rows=given(rows, np.float64),
        length=given(length, np.float64),
        shear=given(shear, np.float64),
        regime=given(regimes, np.int8),
        x=given(graph.x, np.float64),
        radii=given(graph.radii, np.float64),
        faces=(
            given(faces.offsets, np.int64),
            given(faces.grains, np.int64),
            given(faces.contacts, np.int64),
            given(faces.forward, np.bool_),
        ),
    )
