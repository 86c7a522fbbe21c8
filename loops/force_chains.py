"""Force chains (Peters, Muthuswamy, Wibowo and Tordesillas 2005) and the loops beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from loops.arrays import Floats, Integers
from loops.fabric import principal
from loops.faces import Faces
from loops.graph import GrainGraph, contact_state, require_one_state
from loops.shown import Shown


@dataclass(frozen=True, eq=False, repr=False)
class ForceChains(Shown):
    """Chains of strongly loaded grains.

    Attributes
    ----------
    stress : (G, 2, 2) array
        Stress of every grain over its own area (force per length, compression positive).
    major : (G,) array
        Its major principal stress, that of the symmetric part.
    axis : (G,) array
        Direction of it to axis 1, in (-pi/2, pi/2].
    chain : (G,) array of int
        Chain that the grain is in, numbered by its smallest grain; -1 for none.
    links : (K,) array of int
        Contacts that join the grains of chains.
    """

    stress: Floats
    major: Floats
    axis: Floats
    chain: Integers
    links: Integers

    def facts(self) -> dict[str, object]:
        """Names and values shown at the prompt and in a notebook."""
        lengths = np.bincount(self.chain[self.chain >= 0])
        longest = int(lengths.max(initial=0))
        return {"chains": len(lengths), "grains": int(lengths.sum()), "longest": longest}

    def on_loops(self, faces: Faces) -> Integers:
        """Number of links among the contacts of every loop; a loop with any is beside a chain.

        In the order of `faces.loops`, of the faces of the same graph.
        """
        linked = np.concatenate([[0], np.cumsum(np.isin(faces.contacts, self.links))])
        counts: Integers = np.diff(linked[faces.offsets])
        return counts[faces.loops]


def force_chains(graph: GrainGraph, angle: float = np.pi / 4, least: int = 3) -> ForceChains:
    """Find the force chains of a packing.

    A grain may be in a chain if its major principal stress is above the mean over the grains that
    have contacts. It is followed to either side of its major axis: the next one touches it, may be
    in a chain, and the branch between both deviates by at most `angle` from the axis of either.
    Where several do, the branch with the smallest of the larger deviations is taken, and only if
    it is the other's choice as well, so that chains don't fork.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state; forces of walls are not in it.
    angle : float
        Largest deviation (radians).
    least : int
        Number of grains that a chain has at least.

    Returns
    -------
    ForceChains
        Stresses of the grains, their chains and links.

    Raises
    ------
    InputError
        If the graph has batch axes.

    Examples
    --------
    >>> from loops import GrainGraph, force_chains
    >>> x = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]
    >>> pairs = [[0, 1], [1, 2], [3, 4], [4, 5], [0, 3], [1, 4], [2, 5]]
    >>> rows = GrainGraph(x=x, radii=[0.5] * 6, contacts=pairs,
    ...                   normal_force=[9.0, 9.0, 1.0, 1.0, 0.5, 0.5, 0.5])
    >>> force_chains(rows).chain.tolist()
    [0, 0, 0, -1, -1, -1]
    """
    require_one_state(graph)
    state = contact_state(graph)
    i, j = graph.contacts.T
    stress = np.zeros((graph.grain_count, 2, 2))
    n0, n1 = state.n.T.copy()
    # The tangent is the normal turned: t = (-n1, n0).
    force = (
        state.normal_force * n0 - state.shear_force * n1,
        state.normal_force * n1 + state.shear_force * n0,
    )
    for grain, arm in ((i, state.arm_i), (j, state.arm_j)):
        arms = (arm * n0, arm * n1)
        for a, b in np.ndindex(2, 2):
            stress[:, a, b] += np.bincount(grain, force[a] * arms[b], graph.grain_count)
    stress /= (np.pi * graph.radii**2)[:, None, None]
    difference, axis = principal(stress)
    major = 0.5 * (stress[:, 0, 0] + stress[:, 1, 1] + difference)
    along = np.column_stack([np.cos(axis), np.sin(axis)])
    touched = np.bincount(graph.contacts.ravel(), minlength=graph.grain_count) > 0
    strong = touched & (major > major[touched].mean() if touched.any() else touched)
    near = np.flatnonzero(strong[i] & strong[j])
    n = state.n[near]
    cosines = np.stack([np.einsum("ck,ck->c", along[g[near]], n) for g in (i, j)], axis=1)
    deviation = np.arccos(np.clip(np.abs(cosines), 0.0, 1.0)).max(axis=1)
    along_axis = np.flatnonzero(deviation <= angle)
    # By falling deviation: the last contact written at a side of a grain deviates least.
    order = along_axis[np.argsort(deviation[along_axis], kind="stable")[::-1]]
    good = near[order]
    sides = 2 * graph.contacts[good] + (cosines[order] * [1.0, -1.0] > 0)
    choice = np.full(2 * graph.grain_count, -1)
    choice[sides.ravel()] = np.repeat(good, 2)
    links = good[(choice[sides] == good[:, None]).all(axis=1)]
    smallest = _smallest_linked(graph, links)
    long = np.bincount(smallest, minlength=graph.grain_count) >= max(least, 1)
    chain = np.where(long, np.cumsum(long) - 1, -1)[smallest]
    return ForceChains(
        stress=stress,
        major=major,
        axis=axis,
        chain=chain,
        links=np.sort(links[chain[i[links]] >= 0]),
    )


def _smallest_linked(graph: GrainGraph, links: Integers) -> Integers:
    """(G,) smallest grain of the chain of links that each grain belongs to."""
    smallest = np.arange(graph.grain_count)
    one, two = graph.contacts[links].T
    while True:
        a, b = smallest[one], smallest[two]
        if (a == b).all():
            return smallest
        np.minimum.at(smallest, np.maximum(a, b), np.minimum(a, b))
        while (smallest[smallest] != smallest).any():
            smallest = smallest[smallest]
