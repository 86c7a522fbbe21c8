"""Grain graphs to and from networkx, for looking at, drawing and exchanging."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from loops.errors import InputError
from loops.graph import GrainGraph, require_one_state

if TYPE_CHECKING:
    import networkx


def to_networkx(graph: GrainGraph) -> networkx.MultiGraph:
    """Grain graph as a networkx multigraph.

    Nodes are the grain indices with the attributes `x`, `x0` (pairs) and `radius`; edges carry
    `contact` (the index), `i`, `j`, `normal_force`, `shear_force` and `image`; the graph carries
    `cell` and `cell0` (None if not periodic). A multigraph, as a periodic cell may hold two
    contacts between the same two grains.

    Parameters
    ----------
    graph : GrainGraph
        One state (no batch axes).

    Returns
    -------
    networkx.MultiGraph
        The same grains and contacts.

    Raises
    ------
    InputError
        If the graph carries batch axes.

    Examples
    --------
    >>> from loops import GrainGraph, from_networkx, to_networkx
    >>> pair = GrainGraph(x=[[0, 0], [0.9, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> to_networkx(pair).nodes[1]
    {'x': (0.9, 0.0), 'x0': (0.9, 0.0), 'radius': 0.5}
    >>> from_networkx(to_networkx(pair)).contacts.tolist()
    [[0, 1]]
    """
    import networkx

    require_one_state(graph)
    out = networkx.MultiGraph(cell=_listed(graph.cell), cell0=_listed(graph.cell0))
    rows = zip(graph.x.tolist(), graph.x0.tolist(), graph.radii.tolist(), strict=True)
    for grain, (x, x0, radius) in enumerate(rows):
        out.add_node(grain, x=tuple(x), x0=tuple(x0), radius=radius)
    images = np.zeros((graph.contact_count, 2), int) if graph.images is None else graph.images
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        out.add_edge(
            i,
            j,
            contact=c,
            i=i,
            j=j,
            normal_force=float(graph.normal_force[c]),
            shear_force=float(graph.shear_force[c]),
            image=tuple(images[c].tolist()),
        )
    return out


def from_networkx(network: networkx.Graph) -> GrainGraph:
    """Grain graph from a networkx graph.

    Nodes need `x` (a pair) and `radius`; `x0` is optional. Edges may carry `normal_force`,
    `shear_force`, `image`, `contact` (their place in the order) and `i`, `j` (their direction);
    the graph may carry `cell` and `cell0`. Grains are numbered in the order of the nodes.

    Parameters
    ----------
    network : networkx.Graph or networkx.MultiGraph
        Nodes and edges with those attributes.

    Returns
    -------
    GrainGraph
        The same grains and contacts.

    Raises
    ------
    InputError
        Naming the node that lacks `x` or `radius`, and as `GrainGraph`.

    Examples
    --------
    >>> import networkx as nx
    >>> network = nx.cycle_graph(4)
    >>> for node, x in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
    ...     network.nodes[node].update(x=x, radius=0.5)
    >>> from_networkx(network).contacts.tolist()
    [[0, 1], [0, 3], [1, 2], [2, 3]]
    """
    number = {node: k for k, node in enumerate(network.nodes)}
    for node, data in network.nodes(data=True):
        for name in ("x", "radius"):
            if name not in data:
                received, expected = f"attributes {sorted(data)}", f"the attribute {name!r}"
                raise InputError(f"node {node!r}", received, expected, "Set it on every node.")
    nodes = [data for _, data in network.nodes(data=True)]
    edges = list(network.edges(data=True))
    edges.sort(key=lambda edge: edge[2].get("contact", 0))
    cell = network.graph.get("cell")
    return GrainGraph(
        x=np.array([data["x"] for data in nodes], dtype=float).reshape(-1, 2),
        x0=np.array([data.get("x0", data["x"]) for data in nodes], dtype=float).reshape(-1, 2),
        radii=np.array([data["radius"] for data in nodes], dtype=float),
        contacts=np.array(
            [[number[data.get("i", a)], number[data.get("j", b)]] for a, b, data in edges],
            dtype=np.int64,
        ),
        normal_force=np.array([data.get("normal_force", 0.0) for *_, data in edges]),
        shear_force=np.array([data.get("shear_force", 0.0) for *_, data in edges]),
        images=None
        if cell is None
        else np.array([data.get("image", (0, 0)) for *_, data in edges], dtype=np.int64),
        cell=cell,
        cell0=network.graph.get("cell0"),
    )


def _listed(values: np.ndarray | None) -> list[list[float]] | None:
    return None if values is None else values.tolist()
