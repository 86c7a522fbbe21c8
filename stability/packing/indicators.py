"""Structural indicators of loops: what the state of a packing says before anything moves.

Each is known from one snapshot and one linear system, the non-affinity from the interval before it;
nothing is fitted. A grain's or a contact's indicator becomes that of a loop as its mean, or its
least value where one contact is enough.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.linalg import eigsh
from scipy.spatial import Delaunay

from loops.arrays import Floats, available_cores
from loops.assembly import contact_tangent
from loops.fabric import force_chains
from loops.faces import Faces
from loops.geometry import polygon_area
from loops.graph import GrainGraph, branch_vectors, contact_state
from loops.laws.protocol import ContactLaw, Regime
from loops.loop_batches import loop_batches
from loops.packing import PackingSystem, PlaneContacts, packing_system, stiffness_matrix
from loops.packing.in_place import inverse_at_contacts

# Softest modes whose participation is summed up.
SOFTEST = 20
# Sign of each indicator as a predictor of instability, by its meaning: 1 where a large value is
# expected to be unstable, -1 where a small one is.
EXPECTED = {
    "coordination": -1,
    "mobilisation": 1,
    "largest_mobilisation": 1,
    "vibrality": 1,
    "spin_vibrality": 1,
    "soft_modes": 1,
    "slip_criticality": -1,
    "opening_criticality": -1,
    "steric_order": 1,
    "density": -1,
    "chain": -1,
    "past_nonaffinity": 1,
}


def indicators(
    graph: GrainGraph,
    law: ContactLaw,
    faces: Faces,
    *,
    regime: ArrayLike | None = None,
    planes: PlaneContacts | None = None,
    held: ArrayLike | None = None,
    nonaffinity: ArrayLike | None = None,
) -> dict[str, Floats]:
    """Structural indicators of every loop, from one snapshot and one linear system.

    Grains' indicators are averaged over the grains of a loop, contacts' over its contacts, unless
    said otherwise.

    Parameters
    ----------
    graph : GrainGraph
        The packing, one state, with forces.
    law : ContactLaw
        Contact law.
    faces : Faces
        Its faces.
    regime, planes, held
        As in `packing_response`.
    nonaffinity : (G,) array, optional
        D2min of every grain over the interval before the snapshot, over the squared mean radius;
        not a number where it is unknown. Without it there is no `past_nonaffinity`.

    Returns
    -------
    dict of (L,) arrays
        In the order of `Faces.loops`, without dimension; not numbers where a loop has nothing of
        the kind.

        `coordination`: closed contacts of a grain. `mobilisation`, `largest_mobilisation`: `|T|`
        over the strength of a contact, mean and largest. `vibrality`: trace of the block of
        `K^-1` of a grain's centre, times the mean stiffness of `K` (Tong and Xu 2014);
        `spin_vibrality`: the same of its spin, as displacement of a rim of mean radius.
        `soft_modes`: share of a grain in the 20 softest modes of the symmetric part of `K`, over
        that of a grain in all modes (Widmer-Cooper et al. 2008). `slip_criticality`,
        `opening_criticality`: least `det K'/det K` over the contacts that stick, as one begins to
        slide, and over all, as one opens: Theory, equation (11.22). `steric_order`: mean deviation
        (radians) of the angles between neighbours from those of three discs that touch (Tong and
        Tanaka 2018). `density`: area of a grain over its share of the loops beside it. `chain`:
        share of the contacts that are links of force chains. `past_nonaffinity`: D2min (Falk and
        Langer 1998), Theory, equation (11.23).

    Raises
    ------
    InputError
        If the packing floats.

    Examples
    --------
    A square lattice of discs under uniform pressure; every contact carries the same:

    >>> import numpy as np
    >>> from loops import GrainGraph, LinearFrictional, find_faces
    >>> lattice = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.01))
    >>> found = indicators(lattice, LinearFrictional(1.0, 0.5, 0.5), find_faces(lattice))
    >>> found["coordination"].tolist(), found["mobilisation"].tolist()
    ([4.0, 4.0, 4.0, 4.0], [0.0, 0.0, 0.0, 0.0])
    >>> (found["density"] - np.pi / 4).round(9).tolist()
    [0.0, 0.0, 0.0, 0.0]
    """
    volume = None if graph.cell is not None else 1.0
    system = packing_system(graph, law, regime=regime, planes=planes, held=held, volume=volume)
    state, closed = contact_state(graph), np.zeros(graph.contact_count, dtype=bool)
    closed[system.contacts] = True
    coordination = np.bincount(graph.contacts[closed].ravel(), minlength=graph.grain_count)
    if planes is not None:
        coordination = coordination + np.bincount(planes.grain, minlength=graph.grain_count)
    strength = law.strength(state)
    mobilised = np.divide(
        np.abs(state.shear_force), strength, out=np.zeros(len(strength)), where=strength > 0
    )
    motion, spin, slip, opening = _compliances(system)
    by_grain = {
        "coordination": np.where(coordination > 0, coordination, np.nan),
        "vibrality": motion,
        "spin_vibrality": spin,
        "soft_modes": soft_participation(system),
        "steric_order": steric_order(graph),
        "density": local_density(graph, faces),
    }
    if nonaffinity is not None:
        by_grain["past_nonaffinity"] = np.asarray(nonaffinity, dtype=float)
    by_contact = {"mobilisation": np.where(closed, mobilised, np.nan)}
    most = {
        "largest_mobilisation": by_contact["mobilisation"],
        "slip_criticality": -slip,
        "opening_criticality": -opening,
    }
    count = len(faces.loops)
    out = {name: np.full(count, np.nan) for name in (*by_grain, *by_contact, *most)}
    row = np.empty(len(faces.kind), dtype=np.int64)
    row[faces.loops] = np.arange(count)
    for batch in loop_batches(graph, faces):
        at = row[batch.face]
        for name, values in by_grain.items():
            out[name][at] = _mean(values[batch.grains])
        for name, values in by_contact.items():
            out[name][at] = _mean(values[batch.contacts])
        for name, values in most.items():
            found = np.where(np.isnan(values), -np.inf, values)[batch.contacts].max(axis=1)
            out[name][at] = np.where(np.isfinite(found), found, np.nan)
    for name in ("slip_criticality", "opening_criticality"):
        out[name] *= -1.0
    out["chain"] = force_chains(graph).on_loops(faces) / faces.order[faces.loops]
    return {name: out[name] for name in EXPECTED if name in out}


def _mean(values: Floats) -> Floats:
    """(L,) means over the last axis of what is a number."""
    known = np.isfinite(values)
    count = known.sum(axis=1)
    total = np.where(known, values, 0.0).sum(axis=1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _compliances(system: PackingSystem) -> tuple[Floats, Floats, Floats, Floats]:
    """Vibrality of centres and spins (G,), `det K'/det K` as a contact slips and opens (C,)."""
    graph, inner = system.graph, len(system.contacts)
    Z = inverse_at_contacts(system, available_cores())
    motion, spin = (np.full(graph.grain_count, np.nan) for _ in range(2))
    for side, pair in enumerate(system.graph.contacts[system.contacts].T):
        x = 2 * side
        motion[pair] = system.unit * (Z[:inner, x, x] + Z[:inner, x + 1, x + 1])
        spin[pair] = system.unit * Z[:inner, 4 + side, 4 + side]
    spin[spin == 0.0] = np.nan
    # Relative motion of the contact from the freedoms x_i, y_i, x_j, y_j, w_i, w_j.
    G = np.zeros((4, 6))
    G[:2, :2], G[:2, 2:4], G[2:, 4:] = -np.eye(2), np.eye(2), np.eye(2)
    compliance = G @ Z[:inner] @ G.T
    own = system.stiffness[:inner]
    scale = np.array([1.0, 1.0, 1.0 / system.length, 1.0 / system.length])
    state, regimes = contact_state(graph), np.full(graph.contact_count, Regime.SLIDING, np.int8)
    slid = scale[:, None] * contact_tangent(state, system.law, regimes)[system.contacts] * scale
    slip, opening = (np.full(graph.contact_count, np.nan) for _ in range(2))
    one = np.eye(4)
    sticks = system.regime[:inner] == Regime.ELASTIC
    slip[system.contacts[sticks]] = np.linalg.det(one - ((own - slid) @ compliance)[sticks])
    opening[system.contacts] = np.linalg.det(one - own @ compliance)
    return motion, spin, slip, opening


def soft_participation(system: PackingSystem, count: int = SOFTEST) -> Floats:
    """(G,) share of each grain's centre in the softest modes, over its share in all modes.

    Modes of the symmetric part of `K` from the smallest eigenvalue on, without translations; spins
    count as the displacement of the rim.
    """
    matrix = stiffness_matrix(system)
    matrix = (0.5 / system.unit) * (matrix + matrix.T)
    moves = np.flatnonzero(abs(matrix).sum(axis=1) > 0)
    matrix = matrix[moves][:, moves].tocsc()
    count = min(count + 2, len(moves) - 1)
    start = np.random.default_rng(0).standard_normal(len(moves))
    (lowest,) = eigsh(matrix, k=1, which="SA", tol=1e-2, v0=start, return_eigenvectors=False)
    below = min(2.0 * lowest, -1e-3)
    values, modes = eigsh(matrix, k=count, sigma=below, which="LM", v0=start)
    number = np.full(system.size + 1, -1)
    number[moves] = np.arange(len(moves))
    freedom = number[np.where(system.freedom[:, :2] >= 0, system.freedom[:, :2], system.size)]
    carries = (freedom >= 0).all(axis=1)
    motion = modes[freedom[carries]]
    # A translation is the same for all grains: what is left of it without its mean is nothing.
    motion = motion - motion.mean(axis=0)
    share = np.sum(motion**2, axis=1)
    kept = np.argsort(values)[share.sum(axis=0)[np.argsort(values)] > 1e-6][: count - 2]
    out = np.full(system.graph.grain_count, np.nan)
    out[carries] = share[:, kept].mean(axis=1) * len(share)
    return out


def steric_order(graph: GrainGraph) -> Floats:
    """(G,) mean deviation of the angles between neighbours from those of discs that touch.

    Neighbours are those of the Delaunay triangulation; over the triangles around a grain.
    """
    x, count = graph.x, graph.grain_count
    home = np.arange(count)
    if graph.cell is not None:
        shifts = np.array([(a, b) for a in (0, -1, 1) for b in (0, -1, 1)]) @ graph.cell.T
        x = (x + shifts[:, None]).reshape(-1, 2)
        home = np.tile(home, len(shifts))
    corners = Delaunay(x).simplices
    corners = corners[(corners < count).any(axis=1)]
    total, triangles = np.zeros(count), np.zeros(count)
    for k in range(3):
        i, j, m = np.roll(corners, -k, axis=1).T
        mine = i < count
        i, j, m = i[mine], j[mine], m[mine]
        a, b = x[j] - x[i], x[m] - x[i]
        between = np.sum(a * b, axis=1) / (np.hypot(*a.T) * np.hypot(*b.T))
        angle = np.arccos(np.clip(between, -1.0, 1.0))
        ri, rj, rm = (graph.radii[home[grain]] for grain in (i, j, m))
        sides = (ri + rj, ri + rm, rj + rm)
        cosine = (sides[0] ** 2 + sides[1] ** 2 - sides[2] ** 2) / (2.0 * sides[0] * sides[1])
        np.add.at(total, i, np.abs(angle - np.arccos(np.clip(cosine, -1.0, 1.0))))
        np.add.at(triangles, i, 1.0)
    return np.where(triangles > 0, total / np.maximum(triangles, 1.0), np.nan)


def local_density(graph: GrainGraph, faces: Faces) -> Floats:
    """(G,) area of each grain over its share of the loops beside it, a loop shared evenly."""
    area, found = np.zeros(graph.grain_count), np.zeros(graph.grain_count, dtype=bool)
    for batch in loop_batches(graph, faces):
        share = polygon_area(batch.graph.x) / batch.grains.shape[1]
        np.add.at(area, batch.grains, share[:, None])
        found[batch.grains] = True
    return np.where(found, np.pi * graph.radii**2 / np.where(found, area, 1.0), np.nan)


def least_squares_nonaffinity(graph: GrainGraph, moved: ArrayLike) -> Floats:
    """(G,) `D2min` of Falk and Langer (1998) over the squared mean radius, equation (11.23).

    The mean square of what the best linear map of a grain's branch vectors leaves of their change;
    `moved` (C, 2) are the branch vectors of the same contacts later. Not a number for grains with
    fewer than three contacts, which have none left.
    """
    d = branch_vectors(graph)
    # Of the change alone, which the same maps fit: squares of whole branches would lose it.
    change = np.asarray(moved, dtype=float) - d
    known = np.isfinite(change).all(axis=1)
    grains = graph.contacts[known]
    d, change = d[known], change[known]
    count = np.bincount(grains.ravel(), minlength=graph.grain_count)
    outer = sparse.csr_array(
        (np.ones(grains.size), (grains.ravel(), np.repeat(np.arange(len(grains)), 2))),
        (graph.grain_count, len(grains)),
    )
    product = {
        name: (outer @ (a[:, :, None] * b[:, None, :]).reshape(-1, 4)).reshape(-1, 2, 2)
        for name, a, b in (("dd", d, d), ("cd", change, d), ("cc", change, change))
    }
    spans = (count > 2) & (
        np.abs(np.linalg.det(product["dd"]))
        > 1e-12 * np.trace(product["dd"], axis1=1, axis2=2) ** 2
    )
    best = product["cd"][spans] @ np.linalg.inv(product["dd"][spans])
    left = product["cc"][spans] - best @ np.swapaxes(product["cd"][spans], 1, 2)
    out = np.full(graph.grain_count, np.nan)
    radius = float(graph.radii.mean())
    out[spans] = np.trace(left, axis1=1, axis2=2) / (count[spans] * radius**2)
    return out
