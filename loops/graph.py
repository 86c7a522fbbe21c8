"""The grain graph: grains, contacts and their state for a contact law; to and from networkx."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from numbers import Real
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from loops.arrays import Flags, Floats, Integers, Regimes, as_complex
from loops.errors import InputError, plain, short
from loops.shown import Shown
from loops.validation import (
    check_branches,
    check_graph,
    checked_regimes,
    integers,
    real,
    require_shape,
)

if TYPE_CHECKING:
    import networkx


# Faults of a networkx graph that one message names.
MOST_NAMED = 5
# Fields with a number for each contact, (..., C).
CONTACT_FIELDS = ("normal_force", "shear_force", "regime", "rolling_moment")


def _frozen(array: NDArray[Any]) -> NDArray[Any]:
    """A read-only array; copied only if the caller could still write to it."""
    if array.flags.writeable:
        array = array.copy()
        array.flags.writeable = False
    return array


@dataclass(frozen=True, eq=False, init=False, repr=False)
class GrainGraph(Shown):
    """Grains in the plane and the contacts between them, one state or a batch of states.

    Spheres with three coordinates are accepted where nothing asks for the plane: branch vectors,
    stresses and the affine tangent with spins blocked, without shear forces.

    Topology (`contacts`, `images`) is shared; everything else may carry leading batch axes
    `...`, which broadcast against each other. Arrays are read-only; `replace` gives a changed
    graph.

    Parameters
    ----------
    x : (..., G, 2) array
        Centres of the grains (length).
    radii : (..., G) array
        Radii of the grains (length, positive).
    contacts : (C, 2) array of int
        Contact `c = (i, j)`. Its branch vector is `d = x_j + cell @ image_c - x_i`.
    normal_force : (..., C) array, optional
        Normal force `N` (force, positive in compression). Zero if left out.
    shear_force : (..., C) array, optional
        Shear force `T` (force) along `t`, the normal turned by 90 degrees counter-clockwise.
        Grain i acts on grain j with `f = N n + T t`. Zero if left out.
    x0 : (..., G, 2) array, optional
        Reference centres (length). The current ones if left out.
    images : (C, 2) array of int, optional
        Periodic image of grain j, in units of the cell vectors.
    cell : (..., 2, 2) array, optional
        Periodic cell, its columns are the cell vectors (length).
    cell0 : (..., 2, 2) array, optional
        Reference cell. The current one if left out.
    regime : (..., C) array of Regime, optional
        Regime of every contact, where the source of the forces tells it; the contact law reads it
        from the state if left out.
    rolling_moment : (..., C) array, optional
        Moment of the rolling spring on grain j (force times length), counter-clockwise; grain i
        has the opposite one. Zero if left out.

    Attributes
    ----------
    branches, reference_branches : (..., C, 2) array
        Branch vectors now and in the reference (length), see `branch_vectors`.

    Raises
    ------
    InputError
        If shapes disagree, a value is not finite, a radius is not positive, a contact names an
        unknown grain, joins a grain to itself, stands there twice or joins coincident centres, or
        a regime is none of `Regime`.
        The message names the grain or the contact.

    Examples
    --------
    >>> from loops import GrainGraph
    >>> pair = GrainGraph(x=[[0, 0], [0.9, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> pair.grain_count, pair.contact_count, pair.batch_shape
    (2, 1, ())
    """

    x: Floats
    radii: Floats
    contacts: Integers
    normal_force: Floats
    shear_force: Floats
    x0: Floats
    images: Integers | None
    cell: Floats | None
    cell0: Floats | None
    regime: Regimes | None
    rolling_moment: Floats | None
    branches: Floats = field(init=False)
    reference_branches: Floats = field(init=False)

    def __init__(
        self,
        x: ArrayLike,
        radii: ArrayLike,
        contacts: ArrayLike,
        normal_force: ArrayLike | None = None,
        shear_force: ArrayLike | None = None,
        x0: ArrayLike | None = None,
        images: ArrayLike | None = None,
        cell: ArrayLike | None = None,
        cell0: ArrayLike | None = None,
        regime: ArrayLike | None = None,
        rolling_moment: ArrayLike | None = None,
    ) -> None:
        pairs = _integers("contacts", contacts, columns=2)
        no_force = np.zeros(pairs.shape[:1])
        values: dict[str, Any] = {
            "x": x,
            "radii": radii,
            "normal_force": no_force if normal_force is None else normal_force,
            "shear_force": no_force if shear_force is None else shear_force,
            "x0": x0,
            "cell": cell,
            "cell0": cell0,
            "rolling_moment": rolling_moment,
        }
        for name, value in values.items():
            optional = value is None and name not in ("x", "radii")
            values[name] = None if optional else _frozen(real(name, value))
        values["contacts"] = pairs
        values["images"] = None if images is None else _integers("images", images, columns=2)
        values["regime"] = None if regime is None else _frozen(checked_regimes(regime, len(pairs)))
        if x0 is None:
            values["x0"] = values["x"]
        if values["cell"] is not None:
            if values["images"] is None:
                values["images"] = _frozen(np.zeros(pairs.shape, dtype=np.int64))
            if values["cell0"] is None:
                values["cell0"] = values["cell"]
        for name, value in values.items():
            object.__setattr__(self, name, value)
        check_graph(self)
        branches = self._checked_branches("centres", self.x, self.cell)
        object.__setattr__(self, "branches", branches)
        if self.x0 is not self.x or self.cell0 is not self.cell:
            branches = self._checked_branches("reference centres", self.x0, self.cell0)
        object.__setattr__(self, "reference_branches", branches)

    def _checked_branches(self, centres: str, x: Floats, cell: Floats | None) -> Floats:
        branches = branches_between(x, self.contacts, self.images, cell)
        branches.flags.writeable = False
        check_branches(centres, self.contacts, branches)
        return branches

    @property
    def grain_count(self) -> int:
        """Number of grains G."""
        return self.x.shape[-2]

    @property
    def contact_count(self) -> int:
        """Number of contacts C."""
        return self.contacts.shape[0]

    @property
    def contact_shape(self) -> tuple[int, ...]:
        """Shape `(..., C)` of what every contact has."""
        return (*self.batch_shape, self.contact_count)

    @property
    def batch_shape(self) -> tuple[int, ...]:
        """Shape of the leading batch axes, `()` for one state."""
        return np.broadcast_shapes(
            self.x.shape[:-2],
            self.x0.shape[:-2],
            self.radii.shape[:-1],
            self.normal_force.shape[:-1],
            self.shear_force.shape[:-1],
            () if self.cell is None else self.cell.shape[:-2],
            () if self.regime is None else self.regime.shape[:-1],
            () if self.rolling_moment is None else self.rolling_moment.shape[:-1],
        )

    def facts(self) -> dict[str, object]:
        """Names and values shown at the prompt and in a notebook."""
        told = {"grains": self.grain_count, "contacts": self.contact_count}
        periodic = {} if self.cell is None else {"cell": "periodic"}
        return told | periodic | ({"batch": self.batch_shape} if self.batch_shape else {})

    def replace(self, **changes: Any) -> GrainGraph:
        """Return a graph with some fields changed, validated again.

        Regimes belong to the forces that they were read with: with other forces they are dropped
        unless given again. Other contacts keep the forces, regimes and rolling moments that they
        have, in this order, unless one of them is given: then all are needed, and the images.

        Examples
        --------
        >>> from loops import GrainGraph
        >>> pair = GrainGraph(x=[[0, 0], [0.9, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
        >>> pair.replace(normal_force=[0.1]).normal_force.tolist()
        [0.1]
        """
        if "contacts" in changes and (given := [n for n in CONTACT_FIELDS if n in changes]):
            fields = (*CONTACT_FIELDS, "images")
            left = [name for name in fields if name not in changes and np.any(getattr(self, name))]
            if left:
                received = f"new contacts with {', '.join(given)} and without {', '.join(left)}"
                expected = "each field of the contacts, in their new order"
                raise InputError("replace", received, expected, "Give it, or None to leave it out.")
        elif changes.keys() & {"normal_force", "shear_force"}:
            changes = {"regime": None, **changes}
        return replace(self, **changes)

    def at_contacts(self, rows: Any) -> dict[str, Any]:
        """Forces, regimes and rolling moments of some contacts, by the names of their fields."""
        values = {name: getattr(self, name) for name in CONTACT_FIELDS}
        return {name: None if v is None else v[..., rows] for name, v in values.items()}


class Kept(NamedTuple):
    """Graph without some grains and contacts, and the former numbers of those that it has."""

    graph: GrainGraph
    grains: Integers
    contacts: Integers


def graph_without(graph: GrainGraph, grains: ArrayLike, contacts: ArrayLike) -> Kept:
    """Return a graph without some grains, and without the contacts between pairs of grains.

    With a grain its contacts go. `InputError` for a grain or a contact that there is not.
    """
    require_one_state(graph)
    gone, pairs = _integers("grains", grains, columns=0).ravel(), _integers("contacts", contacts, 2)
    require_shape("contacts", pairs, None, 2, remedy="Give pairs of grains.")
    count, joined, cut = graph.grain_count, np.sort(graph.contacts), np.sort(pairs)
    known = np.isin(cut @ [count, 1], joined @ [count, 1]) & (cut >= 0).all(axis=1)
    known &= (cut < count).all(axis=1)
    wrong = [f"grain {one}" for one in gone[(gone < 0) | (gone >= count)].tolist()]
    wrong += ["contact {}-{}".format(*pair) for pair in pairs[~known].tolist()]
    if wrong:
        expected = f"grains below {count}, and pairs of them in contact"
        raise InputError("without", ", ".join(wrong[:MOST_NAMED]), expected, "Correct them.")
    stays = np.ones(count, dtype=bool)
    stays[gone] = False
    cut_off = np.isin(joined @ [count, 1], cut @ [count, 1])
    return graph_of_kept(graph, stays, ~cut_off & stays[graph.contacts].all(axis=1))


def graph_of_kept(graph: GrainGraph, stays: Flags, kept: Flags) -> Kept:
    """Return a graph of some of the grains and of the contacts, which are between these."""
    rows, number, images = np.flatnonzero(kept), np.cumsum(stays) - 1, graph.images
    of_cell: dict[str, Any] = {} if images is None else {"images": images[rows]}
    fields = graph.at_contacts(rows) | of_cell | {"cell": graph.cell, "cell0": graph.cell0}
    x, x0, radii = graph.x[stays], graph.x0[stays], graph.radii[stays]
    own = GrainGraph(x, radii, number[graph.contacts[rows]], x0=x0, **fields)
    return Kept(own, np.flatnonzero(stays), rows)


def require_one_state(graph: GrainGraph) -> None:
    """Raise `InputError` if the graph carries batch axes."""
    if graph.batch_shape:
        received = f"batch axes {graph.batch_shape}"
        raise InputError("graph", received, "one state", "Take the states one by one.")


def _integers(name: str, values: ArrayLike, columns: int) -> Integers:
    array = integers(name, values)
    return _frozen(array if array.size else np.empty((0, columns), dtype=np.int64))


def branch_vectors(graph: GrainGraph) -> Floats:
    """Branch vectors of the contacts, `d = x_j + cell @ image - x_i`; the graph keeps them.

    Parameters
    ----------
    graph : GrainGraph
        Grain graph, batch axes `...` allowed.

    Returns
    -------
    (..., C, 2) array
        From the centre of grain i to (the image of) the centre of grain j (length), read-only.

    Examples
    --------
    >>> from loops import GrainGraph, branch_vectors
    >>> cell = [[2.0, 0.0], [0.0, 2.0]]
    >>> row = GrainGraph(x=[[0, 0], [1, 0]], radii=[0.5, 0.5], contacts=[[0, 1], [1, 0]],
    ...                  images=[[0, 0], [1, 0]], cell=cell)
    >>> branch_vectors(row).tolist()
    [[1.0, 0.0], [1.0, 0.0]]
    """
    return graph.branches


def reduced_cell(cell: Floats) -> Floats:
    """Shortest vectors (columns) of the lattice of a cell, by Lagrange's reduction (2, 2)."""
    a, b = sorted(cell.T, key=lambda v: float(v @ v))
    while True:
        b = b - np.rint(a @ b / (a @ a)) * a
        if b @ b >= a @ a:
            return np.stack([a, b], axis=1)
        a, b = b, a


def branches_between(
    x: Floats, contacts: Integers, images: Integers | None, cell: Floats | None
) -> Floats:
    """(..., C, 2) branch vectors of some contacts, rounded once."""
    i, j = contacts.T
    z = as_complex(x)
    d: Floats = (z[..., j] - z[..., i])[..., None].view(np.float64)
    if cell is None or images is None:
        return d
    across = np.flatnonzero((images[:, 0] != 0) | (images[:, 1] != 0))
    if cell.ndim > 2:
        batch = np.broadcast_shapes(d.shape[:-2], cell.shape[:-2])
        d = np.broadcast_to(d, (*batch, *d.shape[-2:])).copy()
    i, j = contacts[across].T
    offset = images[across] @ np.swapaxes(cell, -1, -2)
    d[..., across, :] = across_border(x[..., i, :], x[..., j, :], offset)
    return d


def across_border(start: Floats, end: Floats, offset: Floats) -> Floats:
    """(..., C, 2) `end - start + offset`, `offset` the cell vector, rounded once.

    The rounding error of the difference is added after the cell vector.
    """
    total = end - start
    kept = end - total
    lost = (end - (total + kept)) + (kept - start)
    return np.asarray(total + offset + lost)


def contact_frame(graph: GrainGraph) -> tuple[Floats, Floats, Floats]:
    """Length, normal and tangent of every branch.

    Parameters
    ----------
    graph : GrainGraph
        Grain graph, batch axes `...` allowed.

    Returns
    -------
    l : (..., C) array
        Branch length.
    n : (..., C, 2) array
        Unit normal from grain i to grain j.
    t : (..., C, 2) array
        Unit tangent, `n` turned by 90 degrees counter-clockwise.

    Examples
    --------
    >>> from loops import GrainGraph, contact_frame
    >>> pair = GrainGraph(x=[[0, 0], [0.9, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> [value.tolist() for value in contact_frame(pair)]
    [[0.9], [[1.0, 0.0]], [[-0.0, 1.0]]]
    """
    return _frame(graph.branches)


def _frame(d: Floats) -> tuple[Floats, Floats, Floats]:
    """Length, normal and tangent of branches (..., C, 2)."""
    length = np.hypot(d[..., 0], d[..., 1])
    n = d / length[..., None]
    t = np.stack([-n[..., 1], n[..., 0]], axis=-1)
    return length, n, t


@dataclass(frozen=True, eq=False, repr=False)
class ContactState(Shown):
    """Geometry and forces of the contacts of a graph, batch axes `...` first.

    Attributes
    ----------
    length : (..., C) array
        Branch length `l` (length).
    n, t : (..., C, 2) array
        Unit normal from grain i to grain j, and the tangent, `n` turned counter-clockwise.
    normal_force, shear_force : (..., C) array
        `N` (compression positive) and `T` (force of grain i on grain j along `t`).
    radii_i, radii_j : (..., C) array
        Radii of the two grains (length).
    regime : (..., C) array of Regime, or None
        Regime of the contacts where the source told it.
    turns : (..., C) array, optional
        1 where the frame turns with the branch, 0 where it keeps its direction, as at a wall.
    """

    length: Floats
    n: Floats
    t: Floats
    normal_force: Floats
    shear_force: Floats
    radii_i: Floats
    radii_j: Floats
    regime: Regimes | None = None
    turns: Floats | float = 1.0

    def take(self, contacts: Integers | slice) -> ContactState:
        """Return some contacts of one state."""
        values = (getattr(self, one.name) for one in fields(self))
        return ContactState(*(one[contacts] if np.ndim(one) else one for one in values))

    @property
    def touching_length(self) -> Floats:
        """(..., C) `r_i + r_j`, the branch length at which the contact opens."""
        return self.radii_i + self.radii_j

    @property
    def overlap(self) -> Floats:
        """(..., C) `r_i + r_j - l`, negative for a gap."""
        return self.touching_length - self.length

    @property
    def forces(self) -> Floats:
        """(..., C, 2) forces of grain i on grain j, `f = N n + T t`."""
        return self.normal_force[..., None] * self.n + self.shear_force[..., None] * self.t

    @property
    def arm_i(self) -> Floats:
        """(..., C) lever arm `a_i = r_i - overlap/2` of the contact force about grain i.

        The overlap is shared equally, as Yade, LAMMPS and LIGGGHTS place the contact point;
        `a_i + a_j = l`, and both arms grow at half the rate of `l`.
        """
        return 0.5 * (self.length + self.radii_i - self.radii_j)

    @property
    def arm_j(self) -> Floats:
        """(..., C) lever arm `a_j` of the contact force about grain j, see `arm_i`."""
        return 0.5 * (self.length + self.radii_j - self.radii_i)


class HasGraph(Protocol):
    """A loop, scene or snapshot: it has the graph of its grains."""

    @property
    def graph(self) -> GrainGraph:
        """Grains and contacts."""
        ...


def graph_of(subject: GrainGraph | HasGraph) -> GrainGraph:
    """Return the graph of a loop, scene or snapshot, or the graph itself.

    `InputError` for anything else.
    """
    graph = subject if isinstance(subject, GrainGraph) else getattr(subject, "graph", None)
    if not isinstance(graph, GrainGraph):
        expected = "a graph, or a loop, scene or snapshot"
        remedy = "Give what gl.read_snapshot or gl.loop returns."
        if hasattr(subject, "adj"):
            remedy = "Give gl.loop(network, law=law), or gl.from_networkx(network) and the law."
        kind = type(subject)
        received = f"networkx.{kind.__name__}" if hasattr(subject, "adj") else kind.__name__
        raise InputError("first argument", received, expected, remedy)
    return graph


def contact_state(graph: GrainGraph | HasGraph) -> ContactState:
    """Contacts of a graph as the contact law sees them.

    Parameters
    ----------
    graph : GrainGraph, or loop, scene or snapshot
        Grain graph, batch axes `...` allowed.

    Returns
    -------
    ContactState
        Lengths, frames, forces and radii, (..., C).

    Examples
    --------
    >>> from loops import GrainGraph, contact_state
    >>> pair = GrainGraph(x=[[0, 0], [0.9, 0]], radii=[0.5, 0.5], contacts=[[0, 1]])
    >>> state = contact_state(pair)
    >>> state.length.tolist(), state.arm_i.round(12).tolist(), state.touching_length.tolist()
    ([0.9], [0.45], [1.0])
    """
    graph = graph_of(graph)
    return state_of(graph, slice(None))


def state_of(graph: GrainGraph, part: slice) -> ContactState:
    """Contacts in a part of their list, as `contact_state` has all of them."""
    d, (i, j) = graph.branches[..., part, :], graph.contacts[part].T
    length, n, t = _frame(d)
    return ContactState(
        length=length,
        n=n,
        t=t,
        normal_force=graph.normal_force[..., part],
        shear_force=graph.shear_force[..., part],
        radii_i=graph.radii[..., i],
        radii_j=graph.radii[..., j],
        regime=None if graph.regime is None else graph.regime[..., part],
    )


def to_networkx(graph: GrainGraph | HasGraph) -> networkx.MultiGraph:
    """Grain graph as a networkx multigraph.

    Nodes are the grain indices with the attributes `x`, `x0` (pairs) and `radius`; edges carry
    `contact` (the index), `i`, `j`, `normal_force`, `shear_force`, `image`, and `regime` and
    `rolling_moment` where the graph has them; the graph carries `cell` and `cell0` (None if not
    periodic). A multigraph, as a periodic cell may hold two
    contacts between the same two grains.

    Parameters
    ----------
    graph : GrainGraph, or loop, scene or snapshot
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
    graph = graph_of(graph)
    import networkx

    require_one_state(graph)
    out = networkx.MultiGraph(cell=_listed(graph.cell), cell0=_listed(graph.cell0))
    rows = zip(graph.x.tolist(), graph.x0.tolist(), graph.radii.tolist(), strict=True)
    for grain, (x, x0, radius) in enumerate(rows):
        out.add_node(grain, x=tuple(x), x0=tuple(x0), radius=radius)
    images = np.zeros((graph.contact_count, 2), int) if graph.images is None else graph.images
    for c, (i, j) in enumerate(graph.contacts.tolist()):
        known = {name: v.item() for name, v in graph.at_contacts(c).items() if v is not None}
        out.add_edge(i, j, contact=c, i=i, j=j, image=tuple(images[c].tolist()), **known)
    return out


def from_networkx(network: networkx.Graph) -> GrainGraph:
    """Grain graph from a networkx graph.

    Nodes need `x` (a pair, or `x` and `y`) and `radius`; `x0` (a pair) is optional. Edges may
    carry `shear_force`, `image`, `contact` (their place in the order), `i`, `j` (their direction),
    and all of them or none `normal_force`, `regime`, `rolling_moment`; the graph may carry `cell`
    and `cell0`. Grains are numbered in the order of the nodes.

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
        Naming the nodes that lack `x` or `radius`, the edges that lack what others have, and as
        `GrainGraph`.

    Examples
    --------
    >>> import networkx as nx
    >>> network = nx.cycle_graph(4)
    >>> for node, x in enumerate([(0, 0), (1, 0), (1, 1), (0, 1)]):
    ...     network.nodes[node].update(x=x, radius=0.5)
    >>> from_networkx(network).contacts.tolist()
    [[0, 1], [0, 3], [1, 2], [2, 3]]
    """
    if not hasattr(network, "adj"):
        received, remedy = type(network).__name__, "Give networkx.Graph() with x and radius."
        raise InputError("network", received, "a graph of networkx", remedy)
    number = {node: k for k, node in enumerate(network.nodes)}
    faults, nodes = list[str](), list[dict[str, Any]]()
    for node, data in network.nodes(data=True):
        names = ("x", "radius") if np.ndim(data.get("x", ())) else ("x", "y", "radius")
        if lacks := [name for name in names if name not in data]:
            faults.append(f"node {node!r} without {', '.join(map(repr, lacks))}")
        elif not (isinstance(plain(data["radius"]), Real) and data["radius"] > 0.0):
            faults.append(f"node {node!r} with radius {short(data['radius'])}")
        else:
            nodes.append(data | {"x": (data["x"], data["y"]) if "y" in names else data["x"]})
    if faults:
        expected = "x (a pair, or x and y) and a positive radius on every node"
        raise InputError("networkx graph", "; ".join(faults[:MOST_NAMED]), expected, "Set them.")
    edges = sorted(network.edges(data=True), key=lambda edge: edge[2].get("contact", 0))
    attributes = [data for *_, data in edges]
    fields = [name for name in CONTACT_FIELDS if any(name in data for data in attributes)]
    for name in (one for one in fields if one != "shear_force"):
        if lacks := [f"{a!r}-{b!r}" for a, b, data in edges if name not in data]:
            received = f"none on {', '.join(lacks[:MOST_NAMED])}"
            raise InputError(f"{name} of edges", received, "it on all edges or on none", "Set it.")
    rows: dict[str, Any] = {name: [data.get(name, 0.0) for data in attributes] for name in fields}
    if (cell := network.graph.get("cell")) is not None:
        rows["images"] = [data.get("image", (0, 0)) for data in attributes]
    return GrainGraph(
        x=[data["x"] for data in nodes] or np.empty((0, 2)),
        x0=[data.get("x0", data["x"]) for data in nodes] or np.empty((0, 2)),
        radii=[data["radius"] for data in nodes],
        contacts=[(number[data.get("i", a)], number[data.get("j", b)]) for a, b, data in edges],
        cell=cell,
        cell0=network.graph.get("cell0"),
        **rows,
    )


def _listed(values: np.ndarray | None) -> list[list[float]] | None:
    return None if values is None else values.tolist()
