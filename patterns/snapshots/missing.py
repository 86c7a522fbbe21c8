"""Checks of what a snapshot lacks: contacts of grains that overlap, walls around the sample."""

from __future__ import annotations

from itertools import product

import numpy as np

from loops.arrays import Flags, Floats, Integers, median, quantiles
from loops.compiled import given, use_compiled
from loops.errors import counted
from patterns.snapshots.checked import ROUNDINGS, Checked
from patterns.snapshots.findings import Finding, few, finding, rounding
from patterns.snapshots.geometry import high_cell
from patterns.snapshots.stiffness_checks import OF_GRAIN, wrong_radii

# Overlap of a pair without a contact over the typical one of the contacts: clean none. A contact
# below carries a ten-thousandth of a typical force.
LOST_OVERLAP = 1e-4
# Such an overlap over the error that the digits of centres and radii leave: clean none above 1.
LOST_ROUNDINGS = 2.0
# Share of the loaded contacts that may be apart; gaps of more are taken for the error of centres.
FEW_APART = 0.01


def lost_contacts(state: Checked) -> Finding | None:
    """Pairs of grains that overlap and have no row."""
    rows = state.overlapping
    if len(rows) == 0:
        return None
    typical = median(state.overlap[rows])
    loaded = state.overlap[state.loaded]
    apart = np.count_nonzero(loaded < 0) > FEW_APART * len(loaded)
    gap = quantiles(-loaded, [1 - FEW_APART])[0] if apart else 0.0
    noise = 0.0 if state.fit is None else OF_GRAIN * state.fit.noise[1] * typical
    least = max(LOST_OVERLAP * typical, LOST_ROUNDINGS * state.rounded, gap, noise)
    pairs, overlap = overlapping_pairs(state.x, state.radii, repeated_cell(state), least)
    if len(pairs) == np.count_nonzero(state.overlap > least):
        return finding("lost", 0.0, "none")
    # Of a wrong radius another check tells.
    fits = ~np.isin(pairs, wrong_radii(state)[0]).any(axis=1)
    pairs, overlap = pairs[fits], overlap[fits]
    # A pair that touches through several images of the cell has a row for each.
    count = len(state.x)
    touching, place, found = np.unique(pairs @ [count, 1], return_index=True, return_counts=True)
    low, high = np.minimum(*state.contacts.T), np.maximum(*state.contacts.T)
    rows = np.sort(low * count + high)
    listed = np.searchsorted(rows, touching, "right") - np.searchsorted(rows, touching)
    lost = place[found > listed]
    lost = lost[np.argsort(-overlap[lost])]

    def by(k: int) -> str:
        one, two = state.ids[pairs[k]].tolist()
        return f"{one} and {two} (by {overlap[k] / typical:.3g} typical overlaps)"

    strip = state.walls is not None and state.graph.cell is not None and all(state.periodic)
    case = "ok" if not len(lost) else "between_walls" if strip else "some"
    return finding("lost", len(lost), case, each=few(lost, by))


def repeated_cell(state: Checked) -> Floats | None:
    """The cell, so high in a direction that is not periodic that nothing meets across it."""
    cell = state.graph.cell
    if cell is None or all(state.periodic):
        return cell
    return high_cell(cell, state.periodic.index(False), state.x, 4 * float(state.radii.max()))


def overlapping_pairs(
    x: Floats, radii: Floats, cell: Floats | None, least: float, *, compiled: bool | None = None
) -> tuple[Integers, Floats]:
    """Pairs of grains (P, 2), the lower one first, that overlap by more than `least`, and by what.

    A pair that overlaps through several images of a periodic `cell` stands there as often.
    """
    count, owner = len(x), np.arange(len(x))
    if cell is not None:
        x, owner = _with_images(x, cell, 2.0 * float(radii.max()))
    r = radii[owner]
    if use_compiled(compiled, count):
        from loops.compiled.overlaps import overlapping

        pairs = overlapping(given(x, np.float64), given(r, np.float64), least)
    else:
        pairs = _overlapping(x, r, least)
    one, two = np.ascontiguousarray(pairs.T)
    overlap = r[one] + r[two] - np.hypot(x[one, 0] - x[two, 0], x[one, 1] - x[two, 1])
    a, b = (one, two) if cell is None else (owner[one], owner[two])
    low, high = np.minimum(a, b), np.maximum(a, b)
    kept = (low != high) & (overlap > least)
    if cell is not None:
        # Across a border a pair is found from both sides: once by the lower grain of the two.
        real = np.where(one < count, a, b)
        kept &= ((one < count) & (two < count)) | (((one < count) | (two < count)) & (real == low))
    return np.stack([low[kept], high[kept]], axis=1), overlap[kept]


def _overlapping(x: Floats, radii: Floats, least: float) -> Integers:
    """(P, 2) grains that overlap, as the kernel finds them in another order."""
    bins = np.floor((x - x.min(axis=0)) / (2.0 * float(radii.max()))).astype(np.int64)
    width = int(bins[:, 1].max()) + 3
    key = bins[:, 0] * width + bins[:, 1]
    order = np.argsort(key, kind="stable")
    key, x, radii = key[order], x[order], radii[order]
    found = [np.zeros((0, 2), dtype=np.int64)]
    # Later grains of the own bin and of the bin above, then three bins of the next column.
    for at, stop in (
        (np.arange(1, len(x) + 1), np.searchsorted(key, key + 1, "right")),
        (np.searchsorted(key, key + width - 1), np.searchsorted(key, key + width + 1, "right")),
    ):
        one = np.flatnonzero(at < stop)
        while len(one):
            two = at[one]
            reach = radii[one] + radii[two] - least
            near = (reach > 0) & (np.sum((x[one] - x[two]) ** 2, axis=1) < reach**2)
            found.append(np.stack([one[near], two[near]], axis=1))
            at[one] += 1
            one = one[at[one] < stop[one]]
    return order[np.concatenate(found)]


def _with_images(x: Floats, cell: Floats, reach: float) -> tuple[Floats, Integers]:
    """Centres within the cell, then images of those within `reach` of it; grains of both."""
    inside = np.linalg.solve(cell, x.T).T
    inside -= np.floor(inside)
    margin = reach * np.linalg.norm(cell[:, ::-1], axis=0) / np.abs(np.linalg.det(cell))
    copies, owners = [inside], [np.arange(len(x))]
    layers = (range(-k, k + 1) for k in np.ceil(margin).astype(int).tolist())
    for image in product(*layers):
        if image != (0, 0):
            moved = inside + image
            near = np.flatnonzero(((moved > -margin) & (moved < 1.0 + margin)).all(axis=1))
            copies.append(moved[near])
            owners.append(near)
    return np.concatenate(copies) @ cell.T, np.concatenate(owners)


# Relative change of an edge of the cell that is told, over its standard error; and what it does to
# an overlap, over a typical one: from here on loops may be wrong.
EDGE_ERRORS = 5.0
EDGE_SHIFT = 0.3


def cell(state: Checked) -> Finding | None:
    """Overlaps across the border of the cell against the others: edges that are too long or short.

    An edge longer by the share s makes a branch across it longer by s times its part along it.
    """
    images = state.graph.images
    if state.graph.cell is None or images is None:
        return None
    if not images.any():
        known = 0 if state.walls is None else len(state.walls[0])
        case = "walls" if known else "large"
        return finding("cell", 0.0, case, count=len(images), walls=known)
    fit, inner = state.fit, np.asarray(~images.any(axis=1))
    wanted = np.full(len(inner), median(state.overlap[inner]) if inner.any() else np.nan)
    if fit is not None:
        wanted = fit.needed
    n = state.d / state.length[:, None]
    edges, worst = np.zeros(2), 0.0
    scatter = median(np.abs(state.overlap - wanted)[inner])
    for k, edge in enumerate(state.graph.cell.T):
        rows = np.flatnonzero((images[:, k] != 0) & (images[:, 1 - k] == 0))
        if len(rows) < FEWEST_BARE:
            continue
        part = images[rows, k] * (n[rows] @ edge)
        rows, part = rows[part > 0], part[part > 0]
        if not len(rows):
            continue
        shares = (wanted - state.overlap)[rows] / part
        share, size = median(shares), median(part)
        error = 1.5 * max(scatter / size, median(np.abs(shares - share))) / np.sqrt(len(rows))
        error += ROUNDINGS * rounding(state.x) / size
        if abs(share) > EDGE_ERRORS * error:
            edges[k] = share
            worst = max(worst, abs(share) * size / median(np.abs(wanted)))
    if not edges.any():
        return finding("cell", worst)
    long = " and ".join(f"{'xy'[k]} {100 * abs(s):.2g} % too {'long' if s > 0 else 'short'}"
                        for k, s in enumerate(edges) if s)  # fmt: skip
    right = ",".join(f"{value:.9g}" for value in (state.graph.cell * (1 - edges)).ravel())
    case = "wrong" if worst > EDGE_SHIFT else "off"
    return finding("cell", worst, case, long=long, right=right)


# Resultant on a grain, in mean normal forces, that counts as pushing it: at rest 0.065 (root mean
# square), at a wall that is missing 1.
PUSHED = 0.3
# Cosine between that resultant and a contact which stands against it.
AGAINST = 0.7
# Share of such grains that nothing stands against, all of them outward: without the walls of the
# file 0.84 and more, in a flow 0.2.
BARE_SHARE = 0.7
# Fewer such grains tell nothing.
FEWEST_BARE = 5


def walls(state: Checked) -> Finding | None:
    """Grains at the outline that are pushed outward and have nothing that pushes back."""
    if state.graph.cell is not None and all(state.periodic):
        return finding("walls", 0.0, "periodic")
    force = np.add(*state.resultants)
    size = np.hypot(*force.T)
    mean = state.mean_force
    pushed = (state.degree > 0) & (size > PUSHED * mean)
    centre = state.x[state.degree > 0].mean(axis=0)
    bare = pushed & ~_stopped(state, pushed, force)
    count, grains = int(np.count_nonzero(pushed)), np.flatnonzero(bare)
    outward = np.einsum("gk,gk->g", force[grains], state.x[grains] - centre) > 0
    grains = grains[outward][np.argsort(-size[grains[outward]])]
    known = 0 if state.walls is None else len(state.walls[0])
    if len(grains) == 0:
        return finding("walls", 0, "hold" if known else "none", count=known)
    case = "few" if len(grains) < max(FEWEST_BARE, BARE_SHARE * count) else "missing"
    words = counted(known, "contact with walls is known", "contacts with walls are known")
    words = words if known else "no walls known"
    most, each = size[grains[0]] / mean, few(state.ids[grains])
    values = {"known": words, "pushed": count, "most": most, "each": each}
    return finding("walls", len(grains), case, **values)


def _stopped(state: Checked, grains: Flags, force: Floats) -> Flags:
    """(G,) whether some of the grains have a contact in the direction of a force (G, 2)."""
    stopped = np.zeros(len(state.x), dtype=bool)
    for end, sign in zip(state.contacts.T, (1.0, -1.0), strict=True):
        rows = np.flatnonzero(grains[end])
        towards, d = force[end[rows]], sign * state.d[rows]
        along = towards[:, 0] * d[:, 0] + towards[:, 1] * d[:, 1]
        ahead = along > AGAINST * np.hypot(*towards.T) * state.length[rows]
        stopped[end[rows[ahead]]] = True
    return stopped
