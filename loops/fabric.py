"""Fabric of a packing: orientation of its contacts and loops, and its force chains.

Force chains after Peters, Muthuswamy, Wibowo and Tordesillas (2005).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from loops.arrays import Floats, Integers, as_complex
from loops.errors import number, whole_number
from loops.faces import Faces
from loops.graph import (
    GrainGraph,
    HasGraph,
    contact_state,
    graph_of,
    require_one_state,
)
from loops.pruning import component_labels
from loops.shown import Shown
from loops.validation import real


class TensorMean(NamedTuple):
    """Weighted mean of symmetric tensors, their standard deviation and number."""

    mean: Floats
    std: Floats
    number: int


def mean_tensor(tensors: ArrayLike, weights: ArrayLike | None = None) -> TensorMean:
    """Weighted mean and standard deviation of symmetric tensors, component by component.

    Parameters
    ----------
    tensors : (L, 2, 2) array
        Tensors.
    weights : (L,) array, optional
        Weights, not negative; all alike if left out.

    Returns
    -------
    TensorMean
        Not a number where there is nothing to average.

    Examples
    --------
    >>> from loops.fabric import mean_tensor
    >>> mean, std, number = mean_tensor([[[1, 0], [0, 0]], [[0, 0], [0, 1]]])
    >>> mean.tolist(), std.tolist(), number
    ([[0.5, 0.0], [0.0, 0.5]], [[0.5, 0.0], [0.0, 0.5]], 2)
    """
    values = np.asarray(tensors, dtype=float).reshape(-1, 4)
    weight = np.ones(len(values)) if weights is None else np.asarray(weights, dtype=float)
    total = weight.sum()
    if not total > 0:
        return TensorMean(np.full((2, 2), np.nan), np.full((2, 2), np.nan), len(values))
    mean = weight @ values / total
    std = np.sqrt(weight @ (values - mean) ** 2 / total)
    return TensorMean(mean.reshape(2, 2), std.reshape(2, 2), len(values))


def direction_tensors(vectors: ArrayLike) -> Floats:
    """Tensors of directions, `v (x) v / |v|^2`; of branches their mean is Satake's fabric tensor.

    Parameters
    ----------
    vectors : (..., d) array
        Vectors of the plane or of space, none of them zero.

    Returns
    -------
    (..., d, d) array
        Symmetric tensors of trace 1.

    Examples
    --------
    >>> from loops.fabric import direction_tensors
    >>> direction_tensors([3.0, 0.0]).tolist()
    [[1.0, 0.0], [0.0, 0.0]]
    """
    v = np.asarray(vectors, dtype=float)
    return v[..., :, None] * v[..., None, :] / (v * v).sum(axis=-1)[..., None, None]


def edge_tensors(branches: ArrayLike, faces: Faces) -> Floats:
    """Shape of each loop by its edges: `sum e (x) e / sum |e|^2` over the branches around it.

    Half the unit tensor for every regular polygon, so only the shape counts, neither the size nor
    the order of a loop.

    Parameters
    ----------
    branches : (C, 2) array
        Branch vectors of the packing (length), `graph.branches`.
    faces : Faces
        Its faces, from `find_faces`.

    Returns
    -------
    (L, 2, 2) array
        Symmetric tensors of trace 1, in the order of `faces.loops`.

    Examples
    --------
    >>> from loops import GrainGraph, branch_vectors, find_faces
    >>> from loops.fabric import edge_tensors
    >>> oblong = GrainGraph(x=[[0, 0], [3, 0], [3, 1], [0, 1]], radii=[1.6] * 4,
    ...                     contacts=[[0, 1], [1, 2], [2, 3], [3, 0]])
    >>> edge_tensors(branch_vectors(oblong), find_faces(oblong)).round(12).tolist()
    [[[0.9, 0.0], [0.0, 0.1]]]
    """
    d, loops = np.asarray(branches, dtype=float), faces.loops
    if len(loops) == 0:
        return np.empty((0, 2, 2))
    # The sign of an edge doesn't matter.
    squares, begin = (as_complex(d) ** 2)[faces.contacts], faces.offsets[:-1]
    size = np.add.reduceat(np.abs(squares), begin)[loops]
    turned = np.add.reduceat(squares, begin)[loops] / size
    parts = 1.0 + turned.real, turned.imag, turned.imag, 1.0 - turned.real
    return 0.5 * np.stack(parts, axis=-1).reshape(-1, 2, 2)


def principal(tensor: ArrayLike) -> tuple[Floats, Floats]:
    """Anisotropy of symmetric tensors and the direction of their larger principal value.

    Parameters
    ----------
    tensor : (..., 2, 2) array
        Tensors; their symmetric part is taken.

    Returns
    -------
    anisotropy : (...) array
        Difference of the principal values; of a fabric tensor from 0 to 1, and half the amplitude
        `a` of the density of directions `(1 + a cos 2(theta - direction))/(2 pi)`, which is the
        Fourier series of second order.
    direction : (...) array
        Angle to axis 1, radians in (-pi/2, pi/2]; 0 where the tensor is isotropic.

    Raises
    ------
    InputError
        If the tensors are not 2 by 2.

    Examples
    --------
    >>> from loops.fabric import principal
    >>> [float(value) for value in principal([[0.25, 0.0], [0.0, 0.75]])]
    [0.5, 1.5707963267948966]
    """
    s = real("tensor", tensor, ..., 2, 2)
    # + 0.0 turns -0.0 into 0.0, which would be -90 degrees.
    difference, shear = s[..., 0, 0] - s[..., 1, 1], s[..., 0, 1] + s[..., 1, 0] + 0.0
    return np.hypot(difference, shear), 0.5 * np.arctan2(shear, difference)


def axial_mean(angles: ArrayLike, weights: ArrayLike | None = None) -> tuple[float, float]:
    """Mean of axes, which are the same turned by 180 degrees: by doubled angles.

    Parameters
    ----------
    angles : (L,) array
        Angles of the axes (radians).
    weights : (L,) array, optional
        Weights; all alike if left out.

    Returns
    -------
    direction : float
        Mean axis, radians in (-pi/2, pi/2]; not a number without angles.
    resultant : float
        From 0, no axis preferred, to 1, all alike.

    Examples
    --------
    >>> import numpy as np
    >>> from loops.fabric import axial_mean
    >>> direction, resultant = axial_mean(np.radians([80.0, -80.0]))
    >>> round(float(np.degrees(abs(direction))), 9), round(resultant, 9)
    (90.0, 0.939692621)
    """
    angle = np.asarray(angles, dtype=float)
    weight = np.ones(len(angle)) if weights is None else np.asarray(weights, dtype=float)
    if not weight.sum() > 0:
        return float("nan"), float("nan")
    mean = np.array([weight @ np.cos(2 * angle), weight @ np.sin(2 * angle)]) / weight.sum()
    return float(0.5 * np.arctan2(mean[1], mean[0])), float(np.hypot(*mean))


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
        link = np.zeros(1 + max(np.max(of, initial=0) for of in (faces.contacts, self.links)), bool)
        link[self.links] = True
        linked = np.zeros(1 + len(faces.contacts), dtype=np.int64)
        np.cumsum(link[faces.contacts], out=linked[1:])
        counts: Integers = np.diff(linked[faces.offsets])
        return counts[faces.loops]

    def bending(self, graph: GrainGraph, later: Floats) -> tuple[Integers, Floats]:
        """Bend of every segment of three grains of the chains until a later state.

        Parameters
        ----------
        graph : GrainGraph
            The packing that the chains are of.
        later : (C, 2) array
            Later branch vectors of its contacts; nan where a grain is no longer there.

        Returns
        -------
        links : (S, 2) array of int
            Both contacts of each segment.
        bend : (S,) array
            Half the decrease of the angle between both branches at the middle grain (radians):
            above zero where the chain bends, below where it straightens (Tordesillas and
            Muthuswamy 2009 take more than one degree for buckling).
        """
        ends, link = graph.contacts[self.links].ravel(), np.repeat(self.links, 2)
        at = np.argsort(ends, kind="stable")
        # Chains don't fork: a grain has one link or two.
        first = np.flatnonzero(ends[at][1:] == ends[at][:-1])
        middle, links = ends[at][first], np.column_stack([link[at][first], link[at][first + 1]])
        away = np.where(graph.contacts[links, 0] == middle[:, None], 1.0, -1.0)[..., None]
        angles = []
        for branches in (graph.branches, later):
            u, v = np.moveaxis(away * branches[links], 1, 0)
            cross = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
            angles.append(np.arctan2(np.abs(cross), np.sum(u * v, axis=1)))
        return links, 0.5 * (angles[0] - angles[1])


def force_chains(
    graph: GrainGraph | HasGraph, angle: float = np.pi / 4, least: int = 3
) -> ForceChains:
    """Find the force chains of a packing.

    A grain may be in a chain if its major principal stress is above the mean over the grains that
    have contacts. It is followed to either side of its major axis: the next one touches it, may be
    in a chain, and the branch between both deviates by at most `angle` from the axis of either.
    Where several do, the branch with the smallest of the larger deviations is taken, and only if
    it is the other's choice as well, so that chains don't fork.

    Parameters
    ----------
    graph : GrainGraph, or loop, scene or snapshot
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
    graph = graph_of(graph)
    require_one_state(graph)
    number("angle", angle, 0.0, 0.5 * np.pi)
    whole_number("least", least, 1)
    branches, (i, j) = graph.branches, graph.contacts.T
    stress = _force_moments(graph)
    stress /= (np.pi * graph.radii**2)[:, None, None]
    difference, axis = principal(stress)
    major = 0.5 * (stress[:, 0, 0] + stress[:, 1, 1] + difference)
    along = np.column_stack([np.cos(axis), np.sin(axis)])
    touched = np.bincount(graph.contacts.ravel(), minlength=graph.grain_count) > 0
    strong = touched & (major > major[touched].mean() if touched.any() else touched)
    near = np.flatnonzero(strong[i] & strong[j])
    n = branches[near] / np.hypot(*branches[near].T)[:, None]
    one, two = (np.einsum("ck,ck->c", along[g[near]], n) for g in (i, j))
    # Cosine of the larger of the deviations from both axes.
    cosine = np.minimum(np.minimum(np.abs(one), np.abs(two)), 1.0)
    along_axis = np.flatnonzero(cosine >= np.cos(angle))
    # By falling deviation: the last contact written at a side of a grain deviates least.
    order = along_axis[np.argsort(-cosine[along_axis], kind="stable")[::-1]]
    good = near[order]
    sides = 2 * graph.contacts[good] + np.column_stack([one[order] > 0, two[order] < 0])
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


def _force_moments(graph: GrainGraph) -> Floats:
    """Return (G, 2, 2) sums of force times arm over the contacts of each grain."""
    state, moments = contact_state(graph), np.zeros((graph.grain_count, 2, 2))
    n, force = state.n.T.copy(), state.forces.T.copy()
    for grain, arm in zip(graph.contacts.T, (state.arm_i, state.arm_j), strict=True):
        arms = arm * n
        for a, b in np.ndindex(2, 2):
            moments[:, a, b] += np.bincount(grain, force[a] * arms[b], graph.grain_count)
    return moments


def _smallest_linked(graph: GrainGraph, links: Integers) -> Integers:
    """(G,) smallest grain of the chain of links that each grain belongs to."""
    linked, ends = np.unique(graph.contacts[links], return_inverse=True)
    _, label = component_labels(len(linked), ends.reshape(-1, 2), np.ones(len(linked), dtype=bool))
    smallest = np.arange(graph.grain_count)
    smallest[linked] = linked[np.unique(label, return_index=True)[1]][label]
    return smallest
