"""Loops of a packing: their rates under its response, and structural indicators of its state.

Indicators describe the state before anything moves: each is known from one snapshot and one
linear system, the non-affinity from the interval before it; nothing is fitted. A grain's or a
contact's indicator becomes that of a loop as its mean, or its least value where one contact is
enough.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.sparse.linalg import eigsh
from scipy.spatial import Delaunay

from loops.arrays import Flags, Floats, available_cores
from loops.contacts import Contacts
from loops.errors import check_type
from loops.fabric import force_chains
from loops.faces import Faces
from loops.geometry import boundary_vectors, polygon_area
from loops.graph import GrainGraph, contact_state, reduced_cell
from loops.in_place import inverse_at_contacts
from loops.laws.frictional import Regime
from loops.loop_batches import loop_batches
from loops.scene import Scene, of_scene
from loops.shown import Shown
from loops.stress_strain import contact_forces, turning_change
from loops.system import System, packing_system, stiffness_matrix
from loops.validation import real
from stability.packing.response import PackingResponse

QUARTER_TURN: Floats = np.array([[0.0, -1.0], [1.0, 0.0]])
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


@dataclass(frozen=True, eq=False, repr=False)
class LoopRates(Shown):
    """Rates of the loops of a packing, in the order of `Faces.loops`.

    Where a loop has a contact that carries nothing its rates are not numbers.

    Attributes
    ----------
    strain : (L, 2, 2) array
        Displacement gradient `H'` of the polygon from the branch rates (boundary formula).
    stress : (L, 2, 2) array
        Nominal stress rate `P' = (1/(2 V)) sum f' (x) d`, contacts shared with the neighbours.
    second_order_work : (L,) array
        `W2 = (P' - theta' J P) : sym H'`, in the frame that turns with the loop; of changes
        `(R^T (P + dP) - P) : (1 - U)` with `1 - H = R U`.
    normalised_work : (L,) array
        The same over the norms of its two factors.
    additive_work : (L,) array
        `w = -(1/(2 V)) sum f'.d'`: areas times `w` sum to the sample's `V P':H'`.
    nonaffinity : (L,) array
        `|sym H'_loop - sym H'| / |sym H'|`, of changes with `1 - U`.
    opening, closing : (L,) array
        Time until the first contact has lost its force, and until the first gap across the loop has
        closed, in the unit of time of `H'`; infinite if none does.
    area : (L,) array
        Areas of the polygons.
    """

    strain: Floats
    stress: Floats
    second_order_work: Floats
    normalised_work: Floats
    additive_work: Floats
    nonaffinity: Floats
    opening: Floats
    closing: Floats
    area: Floats


def loop_rates(response: PackingResponse, faces: Faces) -> LoopRates:
    """Read the loops' rates from the packing's: Theory, equations (11.3) and (11.4).

    Parameters
    ----------
    response : PackingResponse
        From `rates_at` of a packing.
    faces : Faces
        Faces of the same graph.

    Returns
    -------
    LoopRates
    """
    graph = response.system.graph
    carries = np.zeros(graph.contact_count, dtype=bool)
    carries[response.system.contacts] = True
    state, branch, force = contact_state(graph), response.branch_rate, response.force_rate
    turn = np.sum(state.t * branch, axis=1) / state.length
    normal = np.sum(state.n * force, axis=1) + state.shear_force * turn
    losing = _time(state.normal_force, normal)
    return _of_loops(graph, faces, carries, response.strain_rate, (branch, force), losing, _turning)


def loop_changes(before: GrainGraph, after: Contacts, faces: Faces) -> LoopRates:
    """Return changes of every loop up to a later state, as rates over a unit of time.

    Parameters
    ----------
    before : GrainGraph
        The packing at the start.
    after : Contacts
        Of the same packing, from `replay` or `follow`.
    faces : Faces
        Faces of the start.

    Returns
    -------
    LoopRates
        Loops that have opened included; `strain` is the change of the displacement gradient, times
        are shares of the way as if overlaps and gaps had changed evenly.
    """
    count = before.contact_count
    d, end = before.branches, after.branches[:count]
    # By the overlap: below 1 where a contact is open at the end.
    length = np.linalg.norm(d, axis=1)
    overlap = before.radii[before.contacts].sum(axis=1) - length
    losing = _time(overlap, length - np.linalg.norm(end, axis=1))
    force, every = after.forces[:count] - contact_forces(before), np.ones(count, dtype=bool)
    return _of_loops(before, faces, every, after.strain, (end - d, force), losing, turning_change)


def _turning(P: Floats, rate: Floats, H: Floats) -> tuple[Floats, Floats]:
    """Return the rates of stress and strain in the frame that turns with the spin of `H`."""
    spin = 0.5 * (H[..., 0, 1] - H[..., 1, 0])
    return rate - spin[..., None, None] * (QUARTER_TURN @ P), 0.5 * (H + np.swapaxes(H, -1, -2))


def loop_sums(values: Floats, faces: Faces) -> Floats:
    """Return sums over the contacts of each loop (L,)."""
    face = np.repeat(np.arange(len(faces.kind)), faces.order)
    sums = np.bincount(face, values[faces.contacts], minlength=len(faces.kind))
    return np.asarray(sums[faces.loops])


def _of_loops(
    graph: GrainGraph,
    faces: Faces,
    carries: Flags,
    strain: Floats,
    rates: tuple[Floats, Floats],
    losing: Floats,
    turning: Callable[[Floats, Floats, Floats], tuple[Floats, Floats]],
) -> LoopRates:
    """Return rates of loops from those of a packing's branches and forces.

    `losing` (C,) are the times until each contact loses its force; `turning` takes stress, its rate
    and `H'` to the rates in the frame that turns with the loop.
    """
    (branch_rate, force_rate), forces, branches = rates, contact_forces(graph), graph.branches
    whole = turning(np.zeros((2, 2)), np.zeros((2, 2)), strain)[1]
    count = len(faces.loops)
    out: dict[str, Floats] = {name: np.empty(count) for name in LoopRates.__annotations__}
    out |= {name: np.empty((count, 2, 2)) for name in ("strain", "stress")}
    for batch in loop_batches(graph, faces):
        c, x = batch.contacts, batch.graph.x
        known = carries[c].all(axis=1)
        sides = np.roll(x, -1, axis=1) - x
        # Whether a loop's sides run along its contacts or against them.
        along = np.sign(np.sum(sides * branches[c], axis=2, keepdims=True))
        stretch = along * branch_rate[c]
        force, rate = along * forces[c], along * force_rate[c]
        area = polygon_area(x)
        v = np.cumsum(stretch, axis=1) - stretch
        H = -np.swapaxes(v, 1, 2) @ boundary_vectors(x) / area[:, None, None]
        half = 0.5 / area[:, None, None]
        stress = half * np.swapaxes(rate, 1, 2) @ sides
        turned, e = turning(half * np.swapaxes(force, 1, 2) @ sides, stress, H)
        work = np.sum(turned * e, axis=(1, 2))
        with np.errstate(invalid="ignore", divide="ignore"):
            sizes = np.linalg.norm(turned, axis=(1, 2)) * np.linalg.norm(e, axis=(1, 2))
            normalised = work / sizes
            nonaffinity = np.linalg.norm(e - whole, axis=(1, 2)) / np.linalg.norm(whole)
        columns = {
            "strain": H,
            "stress": stress,
            "second_order_work": work,
            "normalised_work": normalised,
            "additive_work": -np.sum(rate * stretch, axis=(1, 2)) / (2 * area),
            "nonaffinity": nonaffinity,
            "opening": losing[c].min(axis=1),
            "closing": _first_closing(x, batch.graph.radii, v),
        }
        for name, values in columns.items():
            values[~known] = np.nan
            out[name][batch.row] = values
        out["area"][batch.row] = area
    return LoopRates(**out)


def _time(left: Floats, rate: Floats) -> Floats:
    """Return the time until `left` is used up at `rate`; infinite where it grows."""
    falls = rate < 0
    return np.where(falls, np.maximum(left, 0.0) / np.where(falls, -rate, 1.0), np.inf)


def _first_closing(x: Floats, radii: Floats, v: Floats) -> Floats:
    """Return the earliest closing of a gap between grains of a loop, not neighbours along it."""
    n = x.shape[1]
    first = np.full(len(x), np.inf)
    for apart in range(2, n // 2 + 1):
        other = (np.arange(n) + apart) % n
        d, rate = x[:, other] - x, v[:, other] - v
        length = np.linalg.norm(d, axis=2)
        gap = length - radii - radii[:, other]
        closing = np.sum(d * rate, axis=2) / np.where(length > 0, length, 1.0)
        # Grains that overlap without a contact of their own, or meet themselves, have no gap.
        time = np.where(gap > 0, _time(gap, closing), np.inf)
        first = np.minimum(first, time.min(axis=1))
    return first


@of_scene
def indicators(
    scene: Scene,
    faces: Faces | None = None,
    *,
    nonaffinity: ArrayLike | None = None,
) -> dict[str, Floats]:
    """Return structural indicators of every loop, from one snapshot and one linear system.

    Grains' indicators are averaged over the grains of a loop, contacts' over its contacts, unless
    said otherwise.

    Parameters
    ----------
    scene : Scene or Snapshot
        The packing, one state, with forces.
    faces : Faces, optional
        Faces of the graph; those of the scene if left out.
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
        `K^-1` of a grain's centre, times a typical stiffness of contacts (Tong and Xu 2014);
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
    >>> from loops import GrainGraph, LinearFrictional, Scene
    >>> lattice = GrainGraph(x=[[0, 0], [1, 0], [0, 1], [1, 1]], radii=[0.5] * 4,
    ...     contacts=[[0, 1], [1, 0], [2, 3], [3, 2], [0, 2], [2, 0], [1, 3], [3, 1]],
    ...     images=[[0, 0], [1, 0], [0, 0], [1, 0], [0, 0], [0, 1], [0, 0], [0, 1]],
    ...     cell=2 * np.eye(2), normal_force=np.full(8, 0.01))
    >>> found = indicators(Scene(lattice, LinearFrictional(1.0, 0.5, 0.5)))
    >>> found["coordination"].tolist(), found["mobilisation"].tolist()
    ([4.0, 4.0, 4.0, 4.0], [0.0, 0.0, 0.0, 0.0])
    >>> (found["density"] - np.pi / 4).round(9).tolist()
    [0.0, 0.0, 0.0, 0.0]
    """
    graph, law = scene.graph, scene.law
    faces = scene.faces if faces is None else faces
    check_type("faces", faces, Faces, "Leave them out, or give gl.find_faces(graph).")
    # No stress is asked for.
    whole = replace(scene.boundary, volume=1.0)
    system = packing_system(Scene(graph, law, whole))
    state, closed = scene.contact_state, np.zeros(graph.contact_count, dtype=bool)
    closed[system.contacts] = True
    ends = system.rows.ends[system.kept].ravel()
    coordination = np.bincount(ends, minlength=graph.grain_count)[: graph.grain_count]
    strength = law.strength(state)
    mobilised = np.where(closed, 0.0, np.nan)
    np.divide(np.abs(state.shear_force), strength, out=mobilised, where=closed & (strength > 0))
    motion, spin, slip, opening = _compliances(system)
    # Mean over the grains or the contacts of a loop, or the most extreme value.
    grains: dict[str, Floats] = {
        "coordination": np.where(coordination > 0, coordination, np.nan),
        "vibrality": motion,
        "spin_vibrality": spin,
        "soft_modes": soft_participation(system),
        "steric_order": steric_order(graph),
        "density": local_density(graph, faces),
    }
    if nonaffinity is not None:
        grains["past_nonaffinity"] = real("nonaffinity", nonaffinity, graph.grain_count)
    most, least = (partial(one.reduce, axis=1) for one in (np.fmax, np.fmin))
    contacts: dict[str, tuple[Callable[[Floats], Floats], Floats]] = {
        "mobilisation": (_mean, mobilised),
        "largest_mobilisation": (most, mobilised),
        "slip_criticality": (least, slip),
        "opening_criticality": (least, opening),
    }
    out = {name: np.full(len(faces.loops), np.nan) for name in (*grains, *contacts)}
    for batch in loop_batches(graph, faces):
        for name, values in grains.items():
            out[name][batch.row] = _mean(values[batch.grains])
        for name, (of_loop, values) in contacts.items():
            out[name][batch.row] = of_loop(values[batch.contacts])
    out["chain"] = force_chains(graph).on_loops(faces) / faces.order[faces.loops]
    return {name: out[name] for name in EXPECTED if name in out}


def _mean(values: Floats) -> Floats:
    """Return means over the last axis of what is a number (L,)."""
    return np.asarray(np.ma.masked_invalid(values).mean(axis=1).filled(np.nan))


def _compliances(system: System) -> tuple[Floats, Floats, Floats, Floats]:
    """Return vibrality of centres and spins (G,), `det K'/det K` as contacts slip, open (C,)."""
    graph, inner = system.graph, len(system.contacts)
    Z = inverse_at_contacts(system, available_cores())
    motion, spin = (np.full(graph.grain_count, np.nan) for _ in range(2))
    # The same in every frame: root mean square of the two stiffnesses of a contact.
    unit = float(np.linalg.norm(system.stiffness[:, :2, :2], axis=(1, 2)).mean()) / np.sqrt(2.0)
    for side, pair in enumerate(system.graph.contacts[system.contacts].T):
        x = 2 * side
        motion[pair] = unit * (Z[:inner, x, x] + Z[:inner, x + 1, x + 1])
        spin[pair] = unit * Z[:inner, 4 + side, 4 + side]
    spin[spin == 0.0] = np.nan
    # Relative motion of the contact from the freedoms x_i, y_i, x_j, y_j, w_i, w_j.
    G = np.zeros((4, 6))
    G[:2, :2], G[:2, 2:4], G[2:, 4:] = -np.eye(2), np.eye(2), np.eye(2)
    compliance = G @ Z[:inner] @ G.T
    own = system.stiffness[:inner]
    scale = np.array([1.0, 1.0, 1.0 / system.length, 1.0 / system.length])
    slides = np.full(len(system.rows.ends), Regime.SLIDING, dtype=np.int8)
    slid = scale[:, None] * system.rows.tangents(slides)[system.contacts] * scale
    slip, opening = (np.full(graph.contact_count, np.nan) for _ in range(2))
    one = np.eye(4)
    sticks = system.regime[:inner] == Regime.ELASTIC
    slip[system.contacts[sticks]] = np.linalg.det(one - ((own - slid) @ compliance)[sticks])
    opening[system.contacts] = np.linalg.det(one - own @ compliance)
    return motion, spin, slip, opening


def soft_participation(system: System, count: int = SOFTEST) -> Floats:
    """Return each grain's share in the softest modes, over its share in all: its centre (G,).

    Modes of the symmetric part of `K` from the smallest eigenvalue on, without translations; spins
    count as the displacement of the rim.
    """
    matrix = stiffness_matrix(system)
    matrix = (0.5 / system.unit) * (matrix + matrix.T)
    moves = np.flatnonzero(abs(matrix).sum(axis=1) > 0)
    if len(moves) < 4:
        # One grain and its images: no motion but the translations and its spin.
        return np.full(system.graph.grain_count, np.nan)
    matrix = matrix[moves][:, moves].tocsc()
    count = min(count + 2, len(moves) - 1)
    start = np.random.default_rng(0).standard_normal(len(moves))
    (lowest,) = eigsh(matrix, k=1, which="SA", tol=1e-2, v0=start, return_eigenvectors=False)
    values, modes = eigsh(matrix, k=count, sigma=min(2.0 * lowest, -1e-3), which="LM", v0=start)
    whole = np.zeros((system.size, modes.shape[1]))
    whole[moves] = modes
    carries = (system.freedom[:, :2] >= 0).all(axis=1)
    motion = whole[system.freedom[carries, :2]]
    # A translation is the same for all grains: what is left of it without its mean is nothing.
    share = np.sum((motion - motion.mean(axis=0)) ** 2, axis=1)
    kept = np.argsort(values)[share.sum(axis=0)[np.argsort(values)] > 1e-6][: count - 2]
    out = np.full(system.graph.grain_count, np.nan)
    out[carries] = share[:, kept].mean(axis=1) * len(share)
    return out


def steric_order(graph: GrainGraph) -> Floats:
    """Return mean deviations of angles between neighbours from those of touching discs (G,).

    Neighbours are those of the Delaunay triangulation; over the triangles around a grain.
    """
    x, count = graph.x, graph.grain_count
    home = np.arange(count)
    if graph.cell is not None:
        cell = reduced_cell(graph.cell)
        x = x - np.floor(np.linalg.solve(cell, x.T).T) @ cell.T
        shifts = np.array([(a, b) for a in (0, -1, 1) for b in (0, -1, 1)]) @ cell.T
        x = (x + shifts[:, None]).reshape(-1, 2)
        home = np.tile(home, len(shifts))
    corners = Delaunay(x).simplices
    total, triangles = np.zeros(count), np.zeros(count)
    for k in range(3):
        turned = np.roll(corners, -k, axis=1)
        i, j, m = turned[turned[:, 0] < count].T
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
    """Return the area of each grain over its share of the loops beside it, evenly shared (G,)."""
    area = np.zeros(graph.grain_count)
    for batch in loop_batches(graph, faces):
        share = polygon_area(batch.graph.x) / batch.grains.shape[1]
        np.add.at(area, batch.grains, share[:, None])
    area[area == 0.0] = np.nan
    return np.asarray(np.pi * graph.radii**2 / area)


def least_squares_nonaffinity(graph: GrainGraph, moved: ArrayLike) -> Floats:
    """Return `D2min` of Falk and Langer (1998) over the squared mean radius (G,), (11.23).

    The mean square of what the best linear map of a grain's branch vectors leaves of their change;
    `moved` (C, 2) are the branch vectors of the same contacts later. Not a number for grains with
    fewer than three contacts, which have none left.
    """
    d = graph.branches
    # Of the change alone, which the same maps fit: squares of whole branches would lose it.
    change = np.asarray(moved, dtype=float) - d
    known = np.isfinite(change).all(axis=1)
    ends, d, change = graph.contacts[known], d[known], change[known]
    dd, cd, cc = np.zeros((3, graph.grain_count, 2, 2))
    for grains in ends.T:
        for total, a, b in ((dd, d, d), (cd, change, d), (cc, change, change)):
            np.add.at(total, grains, a[:, :, None] * b[:, None, :])
    count = np.bincount(ends.ravel(), minlength=graph.grain_count)
    regular = np.abs(np.linalg.det(dd)) > 1e-12 * np.trace(dd, axis1=1, axis2=2) ** 2
    spans = (count > 2) & regular
    best = cd[spans] @ np.linalg.inv(dd[spans])
    left = cc[spans] - best @ np.swapaxes(cd[spans], 1, 2)
    out = np.full(graph.grain_count, np.nan)
    radius = float(graph.radii.mean())
    out[spans] = np.trace(left, axis1=1, axis2=2) / (count[spans] * radius**2)
    return out
