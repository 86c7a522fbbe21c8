"""All loops of a packing at once: batches of graphs by order, or compiled kernels."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeVar, get_args

import numpy as np

from loops.arrays import Floats, Integers, Regimes, available_cores, one_blas_thread
from loops.closures import Closure, MacroTangent, Spins, macroscopic_tangent
from loops.closures.ring import GIVEN, LENGTH
from loops.closures.rings import Rings, contact_rows, kernels, solve_by_numpy, solve_compiled
from loops.closures.system import HasLaw, named_closure, with_law
from loops.closures.tangents import of_ring
from loops.compiled import given, use_compiled
from loops.errors import InputError, check_choice, check_type
from loops.faces import Faces, faces_by_order, find_faces
from loops.geometry import polygon_area, polygon_centroid, polygon_perimeter, polygon_shape
from loops.graph import GrainGraph, state_of
from loops.laws.frictional import ContactLaw, Regime
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
    rule = named_closure(closure), spins
    check_choice("spins", spins, get_args(Spins))
    if len(faces.loops) == 0:
        raise InputError("faces", "no loops", "one at least", "Look at the contacts.")
    packing = loops_of_packing(graph, faces, law)
    return packing.tangents(slice(None), [rule], use_compiled(None, graph.contact_count))[0]


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
    """

    at: Any
    tangents: dict[tuple[Closure, Spins], MacroTangent]
    shape: Floats
    sliding: Floats | Integers | None = None
    stress: Floats | None = None


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

    Kernels take the loops of a large packing, numpy those of a small one. Without a law there are
    shapes alone.
    """
    threads = threads or available_cores()
    packing = loops_of_packing(graph, faces, law, regime, threads)
    if not use_compiled(compiled, graph.contact_count):
        for batch in loop_batches(graph, faces):
            yield use(packing.batch_numbers(batch))
        return
    kernels()
    with ThreadPoolExecutor(threads) as pool:

        def part(start: int) -> Used:
            return use(packing.numbers(slice(start, start + LOOPS_AT_ONCE)))

        yield from pool.map(part, range(0, len(packing.loops), LOOPS_AT_ONCE))


@dataclass(frozen=True, eq=False)
class PackingLoops:
    """Loops of a packing as rings, and what else their numbers need.

    `loops` (L,) are `Faces.loops`; `regime` (C,); `rolls`: rolling springs act, which the equations
    of a ring leave out.
    """

    graph: GrainGraph
    faces: Faces
    loops: Integers
    law: ContactLaw | None
    rings: Rings
    regime: Regimes
    rolls: bool

    def numbers(self, at: slice) -> LoopNumbers:
        """Shape, stress and tangents of a part of the loops, by the kernels."""
        from loops.compiled import shapes

        rings, x = self.rings, given(self.graph.x, np.float64)
        parts = rings.rows, rings.branches, x, self.regime
        shape = shapes.loop_shapes(*parts, *rings[4:], self.loops[at]).T
        if self.law is None:
            return LoopNumbers(at, {}, shape[: shapes.S11])
        tangents = dict(zip(TANGENTS, self.tangents(at, TANGENTS, True), strict=True))
        stress = shape[shapes.S11 : shapes.S22 + 1].T
        return LoopNumbers(at, tangents, shape[: shapes.S11], shape[shapes.SLIDING], stress)

    def batch_numbers(self, batch: LoopBatch) -> LoopNumbers:
        """Shape, stress and tangents of loops of one order, by numpy."""
        x = batch.graph.x
        place = (*(polygon_centroid(x) + batch.origin).T, polygon_area(x))
        shape = np.stack([*place, polygon_perimeter(x), *polygon_shape(x)])
        if self.law is None:
            return LoopNumbers(batch.row, {}, shape)
        tangents = dict(zip(TANGENTS, self.tangents(batch.row, TANGENTS, False), strict=True))
        sliding = np.count_nonzero(self.regime[batch.contacts] == Regime.SLIDING, axis=1)
        stress = love_weber_stress(batch.graph).reshape(-1, 4)
        return LoopNumbers(batch.row, tangents, shape, sliding, stress)

    def tangents(
        self, at: slice | Integers, wanted: Sequence[tuple[Closure, Spins]], compiled: bool
    ) -> list[MacroTangent]:
        """Tangents of a part of the loops, by the kernels or by numpy."""
        loops = given(self.loops[at], np.int64)
        left = [rule for rule in wanted if self.rolls and rule[1] == "free"]
        rules = [rule for rule in wanted if rule not in left]
        solve = solve_compiled if compiled else solve_by_numpy
        # The spin of a loop in its reference.
        turn = np.array([[[0.0, 0.5, -0.5, 0.0], [0.0, 0.5, 0.5, 0.0]]])
        found = {
            rule: of_ring(one, *rule, None, one.growth)
            for rule, one in zip(rules, solve(self.rings, loops, rules, turn), strict=True)
        }
        found |= {rule: self._tangents_with_rolling_springs(loops, *rule) for rule in left}
        return [found[rule] for rule in wanted]

    def _tangents_with_rolling_springs(
        self, loops: Integers, closure: Closure, spins: Spins
    ) -> MacroTangent:
        assert self.law is not None
        places, tangents = [], list[MacroTangent]()
        for batch in loop_batches(self.graph, self.faces, loops=loops):
            own, regime = self.law.take(batch.contacts), self.regime[batch.contacts]
            places.append(np.searchsorted(loops, batch.face))
            tangents.append(
                macroscopic_tangent(batch.graph, own, closure, spins=spins, regime=regime)
            )
        order = np.argsort(np.concatenate(places))
        fields = ("matrix", "volume", "condition", "residual", "trusted", "sensitivity")
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(tangent, name) for tangent in tangents])[order]
            for name in fields
        }
        return replace(tangents[0], **arrays)


def loops_of_packing(
    graph: GrainGraph,
    faces: Faces,
    law: ContactLaw | None = None,
    regime: Regimes | None = None,
    threads: int = 1,
) -> PackingLoops:
    """Prepare the loops of a packing, one state; without a law for shapes alone.

    Regimes are the graph's, or read from the state by the law, if left out.
    """
    count = graph.contact_count
    regime = graph.regime if regime is None else regime
    rows, regimes = np.zeros((count, GIVEN)), np.zeros(count, dtype=np.int8)

    def fill(start: int) -> bool:
        part = slice(start, min(start + CONTACTS_AT_ONCE, count))
        state = state_of(graph, part)
        if law is None:
            rows[part, LENGTH] = state.length
            return False
        own = law.take(part)
        regimes[part] = own.regime(state) if regime is None else regime[part]
        rows[part] = contact_rows(state, own, regimes[part])
        return bool(np.any(own.rolling_stiffness(state, regimes[part])))

    with ThreadPoolExecutor(threads) as pool:
        rolls = any(list(pool.map(fill, range(0, count, CONTACTS_AT_ONCE))))
    branches = given(graph.branches, np.float64)
    rings = Rings(
        given(rows, np.float64), branches, branches, given(graph.radii, np.float64),
        given(faces.offsets, np.int64), given(faces.grains, np.int64),
        given(faces.contacts, np.int64), given(faces.forward, np.bool_),
    )  # fmt: skip
    loops = given(faces.loops, np.int64)
    return PackingLoops(graph, faces, loops, law, rings, given(regimes, np.int8), rolls)
