"""Sets of loops: turned copies of one, or loops cut out of a packing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, Integers
from loops.errors import InputError, counted, listed, whole_number
from loops.geometry import polygon_area, require_loop
from loops.graph import GrainGraph
from loops.laws.frictional import ContactLaw
from loops.loop_batches import loop_batches
from loops.scene import Subject, scene_of
from loops.shown import Shown
from loops.validation import integers

# Fields with a row a contact, and with a number a loop.
ROWS = ("x", "radii", "normal_force", "shear_force", "contacts")
LOOPS = ("weights", "areas")
# Share of a contact's force that counts for a loop which shares it with the next.
SHARED_HALF = 0.5


@dataclass(frozen=True, eq=False, repr=False)
class LoopSet(Shown):
    """Loops of one or several orders, one after the other; grain and contact c of a loop are a row.

    Attributes
    ----------
    offsets : (L + 1,) array of int
        First row of each loop, and the number of rows M.
    x : (M, 2) array
        Centres of the grains, counter-clockwise (length).
    radii : (M,) array
        Their radii (length).
    normal_force, shear_force : (M,) array
        Forces of the contact to the next grain (force, compression positive).
    weights : (L,) array
        Weights of the loops in a mean.
    areas : (L,) array
        Areas of the polygons (length squared).
    contacts : (M,) array of int
        Number of each contact in the graph that it comes from, for the law's parameters.
    share : float
        Share of each contact that counts: 1, or 1/2 where two loops share it.
    law : ContactLaw or None
        Law of the packing that the loops come from.
    graph_contacts : tuple of int
        Number of contacts of each graph that they come from.

    Examples
    --------
    >>> from patterns import regular_polygon
    >>> from stability.material import oriented
    >>> oriented(regular_polygon(6), 36)
    LoopSet(loops: 36, orders: (6,), contacts: 216, share: 1)
    """

    offsets: Integers
    x: Floats
    radii: Floats
    normal_force: Floats
    shear_force: Floats
    weights: Floats
    areas: Floats
    contacts: Integers
    share: float = 1.0
    law: ContactLaw | None = None
    graph_contacts: tuple[int, ...] = ()

    @property
    def orders(self) -> Integers:
        """Return the number of grains (L,) of each loop."""
        return np.diff(self.offsets)

    def facts(self) -> dict[str, object]:
        """Return the facts that the prompt and a notebook show."""
        orders = tuple(np.unique(self.orders).tolist())
        return {"loops": len(self.weights), "orders": orders, "contacts": len(self.x),
                "share": f"{self.share:g}"}  # fmt: skip

    def part(self, loops: slice) -> LoopSet:
        """Return some loops as a set of their own."""
        offsets = self.offsets[loops.start : loops.stop + 1]
        rows = slice(offsets[0], offsets[-1])
        own: dict[str, Any] = {name: getattr(self, name)[rows] for name in ROWS}
        own |= {name: getattr(self, name)[loops] for name in LOOPS}
        return replace(self, offsets=offsets - offsets[0], **own)

    @property
    def following(self) -> Integers:
        """Return the next grain (M,) of each in its loop."""
        following = np.arange(len(self.x)) + 1
        following[self.offsets[1:] - 1] = self.offsets[:-1]
        return following

    @property
    def branches(self) -> Floats:
        """Return the branch vectors (M, 2) from each grain to the next (length)."""
        return np.asarray(self.x[self.following] - self.x)

    @property
    def stress(self) -> Floats:
        """Return Love and Weber's stress (L, 2, 2) of the loops' contacts (force per length)."""
        d = self.branches
        n = d / np.linalg.norm(d, axis=1)[:, None]
        t = np.stack([-n[:, 1], n[:, 0]], axis=1)
        force = self.normal_force[:, None] * n + self.shear_force[:, None] * t
        total = np.add.reduceat(force[:, :, None] * d[:, None, :], self.offsets[:-1])
        return np.asarray(self.share * total / self.areas[:, None, None])


def loop_set(loops: LoopSet | GrainGraph | Sequence[GrainGraph]) -> LoopSet:
    """Return a set of loops from graphs of single loops or of batches of one order."""
    if isinstance(loops, LoopSet):
        return loops
    graphs = listed("loops of the material", loops, GrainGraph, "Give graphs, or gl.oriented.")
    parts = [_of_graph(graph) for graph in graphs]
    orders = np.concatenate([part.orders for part in parts])
    counts = tuple(dict.fromkeys(graph.contact_count for graph in graphs))
    every: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in (*ROWS, *LOOPS)
    }
    return LoopSet(np.append(0, np.cumsum(orders)), **every, graph_contacts=counts)


def _of_graph(graph: GrainGraph) -> LoopSet:
    """Return the loops of a graph, one or a batch of one order."""
    require_loop(graph)
    n, batch = graph.grain_count, graph.batch_shape
    if graph.contact_count > n or graph.cell is not None:
        received = f"{graph.contact_count} contacts" if graph.cell is None else "a periodic cell"
        remedy = "Leave out the chords."
        raise InputError(f"loop of {n} grains", received, f"a ring of {n} contacts", remedy)

    def rows(array: Floats, *last: int) -> Floats:
        return np.array(np.broadcast_to(array, (*batch, n, *last)).reshape(-1, *last))

    x, N, T = rows(graph.x, 2), rows(graph.normal_force), rows(graph.shear_force)
    areas = polygon_area(x.reshape(-1, n, 2))
    if (areas <= 0.0).any():
        received, remedy = "a clockwise or flat loop", "Number the grains counter-clockwise."
        raise InputError("loop of the material", received, "an area above zero", remedy)
    offsets, numbers = n * np.arange(len(areas) + 1), np.tile(np.arange(n), len(areas))
    return LoopSet(offsets, x, rows(graph.radii), N, T, np.ones(len(areas)), areas, numbers)


def oriented(loop: GrainGraph, count: int) -> LoopSet:
    """Return copies of a loop turned by `k pi/count`, k from 0 to `count` - 1.

    Half a turn is enough: a loop turned by pi answers as the loop itself.

    Parameters
    ----------
    loop : GrainGraph
        One loop, contacts 0..n-1 the ring, counter-clockwise.
    count : int
        Number of copies.

    Returns
    -------
    LoopSet
        The copies, equal weights.

    Raises
    ------
    InputError
        If the count is no positive whole number, or the graph no single loop.

    Examples
    --------
    >>> from patterns import regular_polygon
    >>> from stability.material import oriented
    >>> oriented(regular_polygon(3), 2).x[3:].round(6).tolist()
    [[0.0, 0.57735], [-0.5, -0.288675], [0.5, -0.288675]]
    """
    whole_number("count of orientations", count, 1)
    single = loop_set(loop)
    if len(single.weights) != 1:
        received = counted(len(single.weights), "loop")
        raise InputError("loop to be turned", received, "one", "Turn the loops one by one.")
    angle = np.pi * np.arange(count) / count
    turn = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=-1)
    x = single.x @ np.swapaxes(turn.reshape(count, 2, 2), -1, -2)
    copied: dict[str, Any] = {
        name: np.tile(getattr(single, name), count) for name in (*ROWS[1:], *LOOPS)
    }
    offsets = len(single.x) * np.arange(count + 1)
    return replace(single, offsets=offsets, x=x.reshape(-1, 2), **copied)


def loops_of(
    snapshot: Subject,
    *,
    orders: ArrayLike | None = None,
    count: int | None = None,
) -> LoopSet:
    """Return loops of a packing, with its forces and its law.

    Each contact belongs to two loops and counts half in each, and a loop weighs as much as its
    area: the mean of all loops of a periodic packing has the packing's stress, and under the affine
    closure its affine tangent, but for contacts of dangling grains, which belong to no loop. What
    is out of balance in a loop cut out of its packing stays on its grains as a dead load.

    Parameters
    ----------
    snapshot : Snapshot or Scene
        The packing, one state, with forces.
    orders : int or sequence of int, optional
        Orders of the loops to take; all from 3 on if left out.
    count : int, optional
        At most so many loops, evenly spaced in the order of the faces; all if left out.

    Returns
    -------
    LoopSet
        The loops, of one or several orders, weights the areas of their polygons.

    Raises
    ------
    InputError
        If the packing has no such loop, or `orders` or `count` is wrong.

    Examples
    --------
    >>> from patterns import read_snapshot, sample_path
    >>> from stability.material import loops_of
    >>> loops_of(read_snapshot(sample_path()), orders=[4, 5], count=20)
    LoopSet(loops: 20, orders: (4, 5), contacts: 90, share: 0.5)
    """
    scene = scene_of(snapshot)
    faces = scene.faces
    chosen = np.asarray(faces.loops)
    sides = np.diff(faces.offsets)[chosen]
    if orders is not None:
        wanted = np.atleast_1d(integers("orders", orders))
        if (wanted < 3).any():
            expected = "numbers of grains, 3 or more"
            raise InputError("orders", repr(orders), expected, "Give orders such as [4, 5, 6].")
        chosen = chosen[np.isin(sides, wanted)]
    if count is not None:
        whole_number("count", count, 1)
        if len(chosen) > count:
            chosen = chosen[np.linspace(0, len(chosen) - 1, count).round().astype(int)]
    if not len(chosen):
        received = f"none of the orders {orders}" if orders is not None else "none"
        raise InputError("loops of the packing", received, "one at least", "Ask for other orders.")
    parts, contacts = [], []
    for batch in loop_batches(scene.graph, faces, loops=chosen):
        parts.append(batch.graph)
        contacts.append(batch.contacts.ravel())
    cut = loop_set(parts)
    return replace(
        cut, weights=cut.areas, contacts=np.concatenate(contacts), share=SHARED_HALF,
        law=scene.law, graph_contacts=(scene.graph.contact_count,),
    )  # fmt: skip
